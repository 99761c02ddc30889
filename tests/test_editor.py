"""Keywords, colors and the TextMate grammar, judged by the language's own grammar, tokens and parser."""

from __future__ import annotations

import json
import re
import runpy
import tomllib
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from golden import cases
from pygments.token import Comment, Error, Keyword, Name, Operator, Punctuation, String, Whitespace

from ss2sql.editor.keywords import CONSTANTS, TEXTS, keywords, list_words
from ss2sql.editor.lexer import SelectScriptLexer
from ss2sql.errors import ParseError, Source
from ss2sql.frontend.syntax import ast, tokenizer
from ss2sql.frontend.syntax.parser import GRAMMAR, load_parse_table, run_automaton
from ss2sql.frontend.syntax.tokenizer import CONTEXTUAL, PAIRS, RESERVED, Token
from ss2sql.frontend.syntax.tree_builder import Builder

ROOT = Path(__file__).parent.parent
CASES = cases()
textmate: Any = SimpleNamespace(**runpy.run_path(str(ROOT / "docs" / "textmate.py")))


def colored(script: str) -> list[tuple[str, str]]:
    """What is neither blank nor comment, with its kind without `Token.`."""
    found = SelectScriptLexer(ensurenl=False, stripnl=False).get_tokens(script)
    return [(str(kind)[6:], part) for kind, part in found if kind not in Whitespace and kind not in Comment]


def read_tokens(script: str) -> list[Token] | None:
    """The tokens as the parser takes them, keywords with their own kind; None of what is no script."""
    source = Source(script)
    try:
        tokens = tokenizer.tokenize(source)
    except ParseError:
        return None
    outcome = run_automaton(Builder(source), tokens, 0, len(tokens))
    return tokens[:-1] if isinstance(outcome, ast.Script) else None


# --- keywords ------------------------------------------------------------------------------------------


def test_the_words_are_those_of_the_grammar():
    quoted = set(re.findall(r'"([A-Za-z]+)"i', GRAMMAR.read_text("utf-8")))
    assert list_words() == {word.upper() for word in quoted} == RESERVED | CONTEXTUAL


def test_every_keyword_has_a_text_and_no_other():
    assert {keyword.text for keyword in keywords().values()} == set(TEXTS)
    assert all(keyword.about for keyword in keywords().values())


def test_two_words_are_one_keyword_where_the_grammar_asks_for_the_second():
    rows = load_parse_table().rows
    for word in list_words():
        behind = [set(rows[row[word]]) for row in rows if row.get(word, -1) >= 0]
        seconds = {one for one in set.union(*behind) if not one.islower()}  # others are rules
        seconds -= {"SIBLINGS"}  # which stands between ORDER and BY
        assert (len(seconds) == 1 and seconds <= list_words()) == (word in PAIRS)
        assert word not in PAIRS or seconds == {PAIRS[word]}


# --- colors --------------------------------------------------------------------------------------------


def uncolored(script: str) -> Iterator[object]:
    """Tokens of a script that have another color than the grammar asks for."""
    found = SelectScriptLexer(ensurenl=False, stripnl=False).get_tokens(script)
    if "".join(part for _, part in found) != script:
        yield "another text"
    if (tokens := read_tokens(script)) is None:
        return
    shown = colored(script)
    if [part for _, part in shown] != [script[token.start : token.end] for token in tokens]:
        yield "other tokens"
    for token, (kind, _) in zip(tokens, shown, strict=False):
        is_word = kind in ("Keyword", "Keyword.Constant", "Operator.Word", "Name.Builtin.Pseudo")
        if is_word != (token.kind in list_words()) or kind == "Error":
            yield token


def test_colors_are_the_tokens_of_the_language():
    assert [(case.name, wrong) for case in CASES for wrong in uncolored(case.script)] == []


def test_every_keyword_has_its_color():
    script = """SELECT this FROM a WHERE None IN b AND NOT True OR False XOR c
        GROUP BY d HAVING e ORDER BY f ASC, g DESC LIMIT 3 AS list;
        SELECT IF(a) FROM a START WITH n = 1 CONNECT BY BREADTH FIRST NO CYCLE MAXIMUM 3 n = 2 STOP WITH n == 9 AS list;
        SELECT a FROM a START WITH n = 1 CONNECT BY COST 1 HEURISTIC 2 MEMORIZE n = 2 AS list;
        SELECT a FROM a START WITH n = 1 CONNECT BY PROBABILITY 1 UNIQUE n = 2 AS list;
        SELECT LAST a FROM a START WITH EACH n IN b CONNECT BY DEPTH FIRST PRIOR a == n ORDER SIBLINGS BY a AS list;
        SELECT DISTINCT CASE WHEN a IS NULL THEN b ELSE c END FROM d LEFT JOIN e ON f BETWEEN 1 AND 2 OR g LIKE 'h'
        LIMIT 3 OFFSET 4;"""
    assert {token.kind for token in read_tokens(script) or ()} >= list_words()
    shown = {part.upper() for kind, part in colored(script) if not kind.startswith(("Name", "Punct", "Lit"))}
    assert shown >= list_words() - {"THIS"}
    assert ("Name.Builtin.Pseudo", "this") in colored(script)


def test_a_word_is_a_keyword_only_where_the_grammar_asks_for_it():
    script = (
        "SELECT maximum, a.limit FROM cost WHERE unique > 1 START WITH maximum = 1 CONNECT BY MAXIMUM 3 maximum = 2;"
    )
    names = [part for kind, part in colored(script) if kind in ("Name", "Name.Attribute")]
    assert names == ["maximum", "a", "limit", "cost", "unique", "maximum", "maximum"]
    assert [part for kind, part in colored(script) if kind == "Keyword"] == [
        "SELECT", "FROM", "WHERE", "START", "WITH", "CONNECT", "BY", "MAXIMUM"]  # fmt: skip


def test_text_that_is_no_script_is_colored_too():
    assert ("Keyword", "CONNECT") in colored("CONNECT BY NO CYCLE n = n + 1")
    assert ("Keyword", "GROUP") in colored("SELECT a FORM b GROUP BY c")
    assert ("Literal.String", '"open') in colored('x = "open')
    assert [kind for kind, _ in colored("1x ` 2")] == ["Error", "Error", "Literal.Number.Integer"]
    assert colored("((" * 300)[0] == ("Punctuation", "(("[:1])  # deeper than scripts may be
    assert colored("") == []


def test_other_kinds():
    script = "x.y = f(this, 'a', 1.5) + None AS list; # end"
    assert colored(script)[:4] == [("Name", "x"), ("Punctuation", "."), ("Name.Attribute", "y"), ("Operator", "=")]
    kinds = {part: kind for kind, part in colored(script)}
    assert (kinds["f"], kinds["this"], kinds["1.5"]) == ("Name.Function", "Name.Builtin.Pseudo", "Literal.Number.Float")
    assert (kinds["None"], kinds["list"], kinds["+"]) == ("Keyword.Constant", "Keyword.Type", "Operator")
    found = list(SelectScriptLexer().get_tokens("/* a\nb */ 1 # c"))
    assert [part for kind, part in found if kind in Comment] == ["/* a\nb */", "# c"]
    assert {Keyword, Name, Operator, Punctuation, String, Error}  # the parents that styles know


def test_pygments_finds_the_lexer():
    points = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["entry-points"]["pygments.lexers"]
    module, _, name = points["selectscript"].partition(":")
    assert getattr(import_module(module), name) is SelectScriptLexer
    assert "selectscript" in SelectScriptLexer.aliases
    assert SelectScriptLexer.analyse_text("SELECT a FROM b START WITH n = 1;") > 0.8
    assert SelectScriptLexer.analyse_text("(define (f x) (car x))") == 0


# --- TextMate ------------------------------------------------------------------------------------------


def test_the_textmate_grammar_is_what_would_be_written():
    assert textmate.FILE.read_text("utf-8") == textmate.format_grammar()
    assert json.loads(textmate.format_grammar())["scopeName"] == "source.selectscript"


def scopes(script: str) -> Iterator[tuple[int, str, str]]:
    """What an editor makes of the grammar: at each place the first pattern that matches; begin and end as one."""
    patterns = []
    for entry in textmate.build_grammar()["patterns"]:
        if "match" in entry:
            expression = entry["match"]
        else:
            inner = "|".join(one["match"] for one in entry.get("patterns", ())) or r"(?!)"
            expression = rf"{entry['begin']}(?:{inner}|(?!{entry['end']})[\s\S])*(?:{entry['end']}|\Z)"
        flags = re.MULTILINE | (re.IGNORECASE if expression.startswith("(?i)") else 0)
        expression = expression.removeprefix("(?i)").replace(r"\h", "[0-9a-fA-F]")
        patterns.append((entry["name"], re.compile(expression, flags)))
    position = 0
    while position < len(script):
        found = [(name, match) for name, one in patterns if (match := one.search(script, position)) and match[0]]
        if not found:
            return
        name, match = min(found, key=lambda pair: pair[1].start())
        yield match.start(), name, match[0]
        position = match.end()


def seen_otherwise(script: str) -> Iterator[Token]:
    """Words of a script that an editor takes for something else than the grammar does."""
    found = {}
    for start, name, part in scopes(script):
        for word in re.finditer(r"\w+", part) if "string" not in name and "comment" not in name else ():
            found[start + word.start()] = name
    for token in read_tokens(script) or ():
        if token.kind in list_words():
            wanted, missing = ("constant.language" if token.kind in CONSTANTS else "keyword."), ""
        elif token.kind in ("NAME", "STRING") and token.text.upper() not in CONTEXTUAL:
            wanted, missing = ("variable", "entity", "support", "string"), "string"
        else:
            continue  # punctuation, and words that may be names: where they are it cannot know
        if not found.get(token.start, missing).startswith(wanted):
            yield token


def test_the_textmate_grammar_sees_the_same_words():
    assert [(case.name, token) for case in CASES for token in seen_otherwise(case.script)] == []

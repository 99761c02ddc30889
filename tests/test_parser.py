"""The parser: trees of expressions and queries, their places in the text, and which words are names where.

The plans of the golden cases show what the clauses of a query become.
"""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import pytest
from fuzz_judge import nodes
from golden import each_row
from hypothesis import given, settings
from hypothesis import strategies as st
from trees import code, expr, query, same, script

from ss2sql.errors import ParseError, Span
from ss2sql.frontend.syntax import ast, tokenizer


@each_row("syntax/expressions", "source", "tree")
def test_expressions(source: str, tree: str) -> None:
    assert repr(expr(source)) == tree


@pytest.mark.parametrize(
    ("source", "plain"),
    [("a # b\n + /* c; \n 'd */ b # ; end", "a + b"), ("\ufeffa\u00a0+\tb\r\n", "a + b"),
     ("'one \\\n line'", "'one  line'"), ("'one \\\r\n line'", "'one  line'")],
)  # fmt: skip
def test_white_space_and_comments(source: str, plain: str) -> None:
    same(expr(source), expr(plain))


# Section 3 of the language: each line of operators binds tighter than the one above. NOT stands between AND and ==, the
# minus of one operand between * and ^.
LEVELS: list[dict[str, str]] = [
    {"OR": ""}, {"XOR": ""}, {"AND": ""},
    {"==": "eq", "!=": "ne", "<>": "ne", "<": "lt", "<=": "le", ">": "gt", ">=": "ge", "IN": "in", "NOT IN": "not_in"},
    {"+": "add", "-": "sub"}, {"*": "mul", "/": "div", "%": "mod"}, {"^": "pow"},
]  # fmt: skip
PREFIXES = {"NOT": 2.5, "-": 5.5}
SIGNS = [(sign, level) for level, signs in enumerate(LEVELS) for sign in signs]


def test_operators_bind_as_their_levels_say() -> None:
    for left, outer in SIGNS:
        for right, inner in SIGNS:
            if outer < inner or left == right == "^":
                same(expr(f"a {left} b {right} c"), expr(f"a {left} (b {right} c)"))
            elif outer > inner or outer in (4, 5):
                same(expr(f"a {left} b {right} c"), expr(f"(a {left} b) {right} c"))
        for prefix, inside in PREFIXES.items():
            grouped = f"({prefix} a) {left} b" if outer < inside else f"{prefix} (a {left} b)"
            same(expr(f"{prefix} a {left} b"), expr(grouped))
            if outer < inside or prefix == "-":
                same(expr(f"a {left} {prefix} b"), expr(f"a {left} ({prefix} b)"))


@given(st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\x00")))
def test_any_string_can_be_written(value: str) -> None:
    quoted = value.replace("\\", "\\\\").replace("'", "\\'").replace("\n", "\\n").replace("\r", "\\r")
    assert repr(expr(f"'{quoted}'")) == f"Literal(value={value!r})"


@settings(max_examples=50)
@given(st.integers(0, 2**64))
def test_integers_have_64_bits(value: int) -> None:
    for written, fits, number in ((f"{value}", value < 2**63, value), (f"-{value}", value <= 2**63, -value)):
        if fits:
            assert repr(expr(written)) == f"Literal(value={number})"
        else:
            assert code(written) == "P007"


def test_statements() -> None:
    found = script("a = 1;\nSELECT this FROM a AS list;\n[a, b]")
    assert [type(statement) for statement in found.statements] == [ast.Assign, ast.Query, ast.ListLiteral]
    assert len(script(";; a;\n;b;;").statements) == 2


# --- queries ---------------------------------------------------------------------------------------------


def test_the_name_of_a_representation_is_kept_as_written() -> None:
    for written in ("VALUE", "list"):
        found = query(f"SELECT a FROM b AS {written}").representation
        assert (found and found.name) == written
    same(query("SELECT a FROM b AS list()"), query("SELECT a FROM b AS list"))


SOURCES = ["a", "w.t", "n.this", "f(a, 1)", "[1, 2]", "a[0]", "f(a)[0, 1]", "'text'", "5", "None", "this", "v{-2.0}",
           "(a + b)", "(x = a)", "(SELECT a FROM b)", "SELECT a FROM b AS list", "IF(a; b; c)"]  # fmt: skip


@pytest.mark.parametrize("written", SOURCES)
def test_sources(written: str) -> None:
    for named in ("", "n = "):
        found = query(f"SELECT a FROM x, {named}{written}, y WHERE c")
        assert [part.name for part in found.sources] == [None, "n" if named else None, None]
        same(found.sources[1].expr, expr(written))


# The words of an option, and its argument.
OPTIONS: dict[str, tuple[str, str]] = {
    "DEPTH FIRST": ("DEPTH FIRST", ""), "breadth first": ("BREADTH FIRST", ""), "no cycle": ("NO CYCLE", ""),
    "BREADTH /* and */\n FIRST": ("BREADTH FIRST", ""), "Unique": ("UNIQUE", ""), "MEMORIZE": ("MEMORIZE", ""),
    **{f"{word} {argument}": (word, argument) for word, arguments in {
        "MEMORIZE": ("5", "(a + 1)"), "MAXIMUM": ("5", "(a)"), "HEURISTIC": ("a - b",), "PROBABILITY": ("0.5",),
        "COST": ("1", "cost", "first", "(f(a)[0] + 2 OR unique)", "(SELECT a FROM b AS value)",
                 "SELECT a FROM b AS value"),
    }.items() for argument in arguments},
}  # fmt: skip


@pytest.mark.parametrize("written", OPTIONS)
def test_options(written: str) -> None:
    word, argument = OPTIONS[written]
    for options in (written, f"{written} UNIQUE"):
        found = query(f"SELECT a FROM b START WITH t = 1 CONNECT BY {options} t = 2, level = 3 STOP WITH c")
        option, *more = found.options
        assert [option.keyword, *(one.keyword for one in more)] == [word, *(["UNIQUE"] if options != written else [])]
        same(option.argument, expr(argument) if argument else None)
        same(found.connect, script("t = 2; level = 3").statements)


@each_row("syntax/groups", "script", "grouped")
def test_what_belongs_together(script: str, grouped: str) -> None:
    """Operators, and queries without parentheses: AS ends a query; what follows belongs to the outside."""
    same(expr(script), expr(grouped))


# --- places ----------------------------------------------------------------------------------------------


SPANNED = [
    "  a  + b*(c - 1) ;", "x = [1, 'zwei', [], -3][0]; # comment\n y{5.0} = f(a, n = n + 1)",
    "IF(a == b AND NOT c; d; e, (f))", "a OR (b XOR c) OR v{-2.0}[1:]",
    "spheres = SELECT obj, n.this, n.mass FROM n = space, f(a) WHERE isSphere(this) AND 1 NOT IN x AS list;",
    "SELECT count(*) FROM (SELECT b FROM c) GROUP BY a HAVING d ORDER BY e DESC, f LIMIT 3",
    "SELECT a FROM b START WITH t = [1] CONNECT BY COST f(t) NO  CYCLE MAXIMUM (5) t = g(t) STOP WITH []==t AS l(x=1)",
]  # fmt: skip
PARTS = (ast.Script, ast.From, ast.Option, ast.OrderKey, ast.Representation, ast.Star)  # which cannot stand alone


@pytest.mark.parametrize("written", SPANNED)
def test_the_text_of_a_span_is_the_node(written: str) -> None:
    whole, *found = (node for node, *_ in nodes(script(written), 0, 0))
    assert isinstance(whole, ast.Script)
    assert len(found) > 5
    for node in found:
        assert node.span.text == node.span.text.strip()
        if not isinstance(node, PARTS):
            same(expr(node.span.text), node)
        if isinstance(node, ast.Assign):
            assert node.name_span.text == node.name
        if isinstance(node, ast.Operator):
            assert node.span.start <= node.place.start < node.place.end <= node.span.end


def test_spans_of_the_other_nodes() -> None:
    written = (
        "SELECT * FROM n = a, (b) START WITH t = 1 CONNECT BY no  cycle MAXIMUM (5) t = 2"
        " ORDER BY (c) DESC, d AS f( 1 )"
    )
    found = query(written)
    parts = (*found.columns, *found.sources, *found.options, *found.order, found.representation, found)
    texts = ["*", "n = a", "(b)", "no  cycle", "MAXIMUM (5)", "(c) DESC", "d", "AS f( 1 )", written]
    assert [part.span.text for part in parts if part is not None] == texts
    assert script(" a ; b ").span.text == " a ; b "
    assert expr("ﬁnd").span.text == "ﬁnd"


# --- names and keywords ----------------------------------------------------------------------------------

WORDS = [*sorted(tokenizer.CONTEXTUAL), "LIST", "VALUE", "LEVEL", "SET", "RATIO", "INDEX"]
POSITIONS = [
    "{0}", "{0} = 1", "{0} == {0}", "{0} + {0}({0}, {0} = {0})[{0}:{0}]", "{0}.{0} + {0}.this",
    "{0}{{}} + {0}{{{0}}}", "{0}{{5.0}} = {0}", "[{0}, -{0}, NOT {0}, ({0})]", "IF({0}; {0}, {0} = {0}; {0})",
    "SELECT {0}, {0} FROM x", "SELECT x FROM {0}", "SELECT x FROM {0}, {0} = {0}, {0}.{0}",
    "SELECT x FROM {0} WHERE {0} AND {0} IN {0}",
    "SELECT {0} FROM {0} START WITH {0} = {0} CONNECT BY {0} = {0} STOP WITH {0} == 7",
    "SELECT x FROM x START WITH {0} = 1, {0} = 2 CONNECT BY {0} = {0} + 1, {0} = {0}",
    "SELECT x FROM x START WITH y = 1 CONNECT BY UNIQUE {0} = {0}, y = {0}",
    "SELECT x FROM x START WITH y = 1 CONNECT BY COST {0} {0} = {0}",
    "SELECT x FROM x START WITH y = 1 CONNECT BY NO CYCLE MEMORIZE {0} = {0}",
    "SELECT x FROM x START WITH y = 1 CONNECT BY MEMORIZE ({0}) MAXIMUM 3 {0} = {0}",
    "SELECT x FROM x START WITH y = 1 CONNECT BY HEURISTIC {0} + 1 DEPTH FIRST {0} # word\n /* and */ = {0}",
    *(f"SELECT x FROM x START WITH y = 1 CONNECT BY UNIQUE {{0}}{gap}= 1, y = 2" for gap in
      ("", "\n", " # sign\n", " /* sign */ ")),
    "SELECT x FROM {0} GROUP BY {0}, {0} HAVING {0}", "SELECT x FROM {0} ORDER BY {0}, {0} DESC, {0} ASC",
    "SELECT x FROM {0} LIMIT {0}", "SELECT x FROM {0} LIMIT {0} GROUP BY {0} ORDER BY {0} AS {0}",
    "SELECT x FROM x AS {0}({0}, {0} = {0})",
    "SELECT {0} FROM {0} WHERE {0} GROUP BY {0} HAVING {0} ORDER BY {0} DESC LIMIT {0} AS {0}",
]  # fmt: skip


def rename(node: Any, old: str, new: str) -> Any:
    """The tree with one name changed everywhere."""
    if is_dataclass(node) and not isinstance(node, Span | type):
        values = {field.name: getattr(node, field.name) for field in fields(node)}
        return type(node)(**{key: rename(value, old, new) for key, value in values.items()})
    if isinstance(node, tuple):
        return tuple(rename(part, old, new) for part in node)
    return new if node == old and isinstance(node, str) else node


@pytest.mark.parametrize("word", WORDS)
def test_other_keywords_are_names_wherever_a_name_can_stand(word: str) -> None:
    for written in (word, word.lower(), word.capitalize()):
        for position in POSITIONS:
            if word == "PRIOR" and "{0} {0}" in position:  # which is the value of the step before
                continue
            plain = script(position.format("zz"))
            same(script(position.format(written)), rename(plain, "zz", written))


@pytest.mark.parametrize("word", sorted(tokenizer.RESERVED))
def test_reserved_words_are_no_names_in_any_case(word: str) -> None:
    for written in (word, word.lower(), word.capitalize()):
        for position in ("{} = 1", "SELECT a FROM b AS {}"):
            with pytest.raises(ParseError):
                script(position.format(written))

"""The tokenizer: the limit on size, names, numbers, strings, comments.

It works without recursion, so any text, however large or odd, is safe. Unreadable characters become tokens of a kind
that the grammar lacks; the parser stops there, and `explain_unreadable` gives the error.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Iterator
from itertools import pairwise
from typing import BinaryIO

from ss2sql.errors import ParseError, Source, Span
from ss2sql.fast_dataclasses import dataclass

MAX_BYTES = 256 * 1024
END = "$END"  # the kind of the last token
RESERVED = frozenset(("SELECT", "FROM", "AS", "IF", "AND", "OR", "XOR", "NOT", "IN", "TRUE", "FALSE", "NONE", "THIS"))
CONTEXTUAL = frozenset((
    "WHERE", "START", "WITH", "CONNECT", "BY", "STOP", "GROUP", "HAVING", "ORDER", "ASC", "DESC", "LIMIT", "DEPTH",
    "BREADTH", "FIRST", "NO", "CYCLE", "UNIQUE", "COST", "HEURISTIC", "PROBABILITY", "MAXIMUM", "MEMORIZE",
    "IS", "NULL", "BETWEEN", "LIKE", "CASE", "WHEN", "THEN", "ELSE", "END", "DISTINCT", "LEFT", "JOIN", "ON", "OFFSET",
    "LAST", "PRIOR", "EACH", "SIBLINGS",
))  # fmt: skip
# The keywords of two words.
PAIRS = {
    "START": "WITH", "STOP": "WITH", "CONNECT": "BY", "GROUP": "BY", "ORDER": "BY", "DEPTH": "FIRST",
    "BREADTH": "FIRST", "NO": "CYCLE", "LEFT": "JOIN", "CASE": "WHEN", "SIBLINGS": "BY",
}  # fmt: skip
OPENING = {"(": ")", "[": "]", "{": "}"}
CLOSING = {")": "(", "]": "[", "}": "{"}


@dataclass(slots=True)
class Token:
    """A token: `kind` is its symbol in the grammar.

    A contextual keyword starts as a NAME with `keyword` set; the parser changes `kind` where the grammar expects the
    keyword. Signs and keywords have their own text, in upper case, as kind.
    """

    kind: str
    text: str
    start: int
    end: int
    keyword: str | None = None


COMMENT = r"\#[^\r\n]*|--(?:[^\S\r\n][^\r\n]*)?(?![^\r\n])|/\*[\s\S]*?\*/"  # 5--3 is 8
_TOKEN = re.compile(
    rf"(?P<SKIP>\s+|{COMMENT})"
    r"""
    |(?P<WORD>[^\x00-@\[-^`{-\x7f\s][^\x00-/:-@\[-^`{-\x7f\s]*)
    |(?P<FLOAT>(?:[0-9]+\.[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|[0-9]+[eE][+-]?[0-9]+)
    |(?P<INTEGER>[0-9]+)
    |(?P<STRING>"(?:[^"\\\r\n]|\\(?:\r\n|[\s\S]))*"|'(?:[^'\\\r\n]|\\(?:\r\n|[\s\S]))*')
    |(?P<OPEN_COMMENT>/\*[\s\S]*)
    |(?P<SIGN>==|!=|<>|<=|>=|[-+*/%^()\[\]{},;:.=<>])
    |(?P<OPEN_STRING>["'][^\r\n]*)
    |(?P<OTHER>\|\||&&|[\s\S])""",
    re.VERBOSE,
)
_TAIL = re.compile(r"\w+")  # what makes a number unreadable
_UNREADABLE = re.compile("[\0\ud800-\udfff]")

_INSTEAD = {
    "||": "join strings with +; the logical or is OR", "&&": "the logical and is AND", "&": "the logical and is AND",
    "|": "the logical or is OR", "!": "the logical not is NOT", "~": "the logical not is NOT",
    "`": "a name stands as it is; a key with other characters is read by x[\"key\"]",
    "@": "a name that the script does not set is a parameter: write it without a sign",
    "$": "a name that the script does not set is a parameter: write it without a sign",
    "?": "a choice is IF(condition; then; else); a parameter is a name that the script does not set",
    "\\": "a statement goes on in the next line without a sign",
    "“": 'strings stand in " or \'', "”": 'strings stand in " or \'', "„": 'strings stand in " or \'',
    "‘": 'strings stand in " or \'', "’": 'strings stand in " or \'',
    "≠": "write !=", "≤": "write <=", "≥": "write >=", "×": "write *", "·": "write *", "÷": "write /",
    "−": "write - (minus)", "–": "write - (minus)", "—": "write - (minus)",
}  # fmt: skip
_SQL_SIGNS = frozenset(("||", "&&", "!"))


def tokenize(source: Source) -> list[Token]:
    """The tokens of a script, closed by one of kind `END`.

    Raises ParseError: P003 for text that is no script at all, P004 for one that is too large.
    """
    _check_script_text(source)
    found = list(iterate_tokens(source.text))
    end = found[-1].end if found else 0
    found.append(Token(END, "", end, end))
    _turn_words_into_names(found)
    return found


def read_script(stream: BinaryIO, name: str) -> Source:
    """The script in a stream of bytes, read up to the greatest size of a script.

    Raises ParseError P004 for a larger script, UnicodeDecodeError for bytes that are no text, and OSError.
    """
    found = stream.read(MAX_BYTES + 1)
    if len(found) > MAX_BYTES:
        raise make_script_size_error(f"the script {name}")
    return Source(found.decode("utf-8"), name)


def make_script_size_error(script: str, span: Span | None = None) -> ParseError:
    """The error for a script that is larger than `MAX_BYTES`."""
    return ParseError(
        "P004", f"{script} is larger than 256 KiB", span,
        ["give data to the session from Python, as a variable or a table, instead of writing it into the script"],
    )  # fmt: skip


def _check_script_text(source: Source) -> None:
    text = source.text
    if len(text) > MAX_BYTES or len(text.encode("utf-8", "surrogatepass")) > MAX_BYTES:
        raise make_script_size_error("the script", Span(source, 0, 0))
    if bad := _UNREADABLE.search(text):
        what = "a NUL character" if bad[0] == "\0" else f"half of a character, {_show_token_character(bad[0])}"
        raise ParseError(
            "P003", f"this is not text: it contains {what}", Span(source, bad.start(), bad.end()),
            ["a script is Unicode text; read its file with encoding='utf-8', and do not pass a binary file"],
        )  # fmt: skip


def iterate_tokens(text: str, start: int = 0) -> Iterator[Token]:
    """The tokens of any text from `start` on, read one at a time."""
    last: Token | None = None
    for match in _TOKEN.finditer(text, 1 if start == 0 and text.startswith("\ufeff") else start):
        kind = match.lastgroup or ""
        if kind == "SKIP" or (last is not None and match.start() < last.end):  # the letters after a number
            continue
        found, begin, end = match[0], match.start(), match.end()
        if kind == "WORD":
            for last in _tokenize_word(found, begin):
                yield last
            continue
        if kind == "SIGN":
            if found == "=" and last is not None:
                last.keyword = None  # a keyword before a single = is a name
            last = Token(found, found, begin, end)
        elif kind in ("FLOAT", "INTEGER") and (tail := _TAIL.match(text, end)):
            last = Token("BAD_NUMBER", found + tail[0], begin, tail.end())
        else:
            last = Token(kind, found, begin, end)
        yield last


# Words that could be names, and what has to follow for them to be keywords.
VALUES = frozenset(("NAME", "INTEGER", "FLOAT", "STRING", "THIS", "TRUE", "FALSE", "NONE"))
_BEGINS = VALUES | {"SELECT", "NOT", "IF"}
_FOLLOWED = {
    "CASE": frozenset(("WHEN",)), "DISTINCT": _BEGINS | {"(", "[", "-", "*"}, "PRIOR": VALUES,
    "LAST": _BEGINS | {"[", "-", "*"},
}  # fmt: skip
OPTIONS = frozenset(("DEPTH", "BREADTH", "NO", "UNIQUE", "COST", "HEURISTIC", "PROBABILITY", "MAXIMUM", "MEMORIZE"))
# Other names for options of searches.
OTHER_OPTIONS = {
    "BFS": "BREADTH FIRST", "DFS": "DEPTH FIRST", "IDDFS": "BREADTH FIRST", "BIDIRECTIONAL": "BREADTH FIRST",
    "DISTINCT": "UNIQUE", "LIMIT": "MAXIMUM", "TOP": "MAXIMUM",
    "ASTAR": "COST 1 HEURISTIC 0", "DIJKSTRA": "COST 1", "A": "COST 1 HEURISTIC 0", "GREEDY": "HEURISTIC 0",
    "NOCYCLE": "NO CYCLE",
    "WEIGHT": "COST in its place, and a comma behind its value",
}  # fmt: skip
_NUMBERED = frozenset(("MAXIMUM", "MEMORIZE"))
_VALUED = frozenset(("COST", "HEURISTIC", "PROBABILITY"))
_BEHIND_NAMES = frozenset(("AND", "OR", "XOR", "NOT", ",", ")", "]", ";"))
_INFIX = frozenset(("==", "!=", "<>", "<", "<=", ">", ">=", "+", "*", "/", "%", "^", ".", "[", "IN"))


def _turn_words_into_names(found: list[Token]) -> None:
    """Makes names of words that are followed like names: `cost + 1`, `last(x)`, `SELECT prior, a`."""
    for place, (token, after) in enumerate(pairwise(found)):
        word = token.keyword
        if word in _FOLLOWED:
            named = not _FOLLOWED[word] & {after.kind, after.keyword}
            named = named or (word == "PRIOR" and _begins_clause(after, found[min(place + 2, len(found) - 1)]))
        elif word in OPTIONS:
            named = _is_name(word, token, after, found[min(place + 2, len(found) - 1)])
        else:
            continue
        if named:
            token.keyword = None


def _is_name(word: str, token: Token, after: Token, following: Token) -> bool:
    """Whether the word of an option is a name: `COST -1` has a value, `cost - 1` and `cost-1` are differences."""
    kind = after.kind
    if kind in _INFIX or (word in _VALUED and kind in _BEHIND_NAMES):
        return True
    if kind == "-" and word not in _NUMBERED:
        return not (token.end < after.start and after.end == following.start)
    return word in PAIRS and after.keyword != PAIRS[word] and kind not in VALUES and kind != END


def _begins_clause(token: Token, after: Token) -> bool:
    """Whether a word is the first of a clause, and no name."""
    alone = token.keyword in ("WHERE", "HAVING", "LIMIT", "ASC", "DESC")
    return alone or (token.keyword in PAIRS and after.keyword in (PAIRS[token.keyword], "SIBLINGS"))


def _tokenize_word(text: str, start: int) -> Iterator[Token]:
    """A word as a token; as two where it has characters that are not allowed in names."""
    if text.isascii():
        upper = text.upper()
        if upper in RESERVED:
            yield Token(upper, text, start, start + len(text))
        else:
            yield Token("NAME", text, start, start + len(text), upper if upper in CONTEXTUAL else None)
        return
    length = 0
    while length < len(text) and (text[length] if length == 0 else "a" + text[length]).isidentifier():
        length += 1
    if length:
        yield Token("NAME", text[:length], start, start + length)
    if length < len(text):
        yield Token("OTHER", text[length], start + length, start + length + 1)


def explain_unreadable(source: Source, token: Token) -> ParseError | None:
    """The error (P003, P006) for a token that the language lacks; None for any other."""
    span = Span(source, token.start, token.end)
    text = token.text
    if token.kind == "OPEN_COMMENT":
        return ParseError(
            "P003", "this comment is not closed", Span(source, token.start, token.start + 2), ["write */"]
        )
    if token.kind == "OPEN_STRING":
        hint = f"write {text[0]} at its end, on the same line; a line break inside is \\n"
        return ParseError("P003", "this string is not closed", span, [hint])
    if token.kind == "BAD_NUMBER":
        hints = ["a name starts with a letter; numbers are written 7, 1.5 or 1e3, without units or separators"]
        return ParseError("P003", f"'{shorten_text(text)}' is neither a number nor a name", span, hints)
    if token.kind != "OTHER":
        return None
    hints = [_INSTEAD.get(text, "leave it out, or put it into a string")]
    if text == "||":
        return None  # frontend/syntax/foreign_spellings.py shows the right form
    if text in _SQL_SIGNS:
        return ParseError("P006", f"there is no operator {text}", span, hints)
    return ParseError("P003", f"the language has no character {_show_token_character(text)}", span, hints)


def _show_token_character(char: str) -> str:
    code = f"U+{ord(char[0]):04X}"
    name = unicodedata.name(char[0], "")
    if not char.isprintable() or char.isspace():
        return f"{code} {name}".strip()
    return f"'{char}'" if char.isascii() else f"'{char}' ({code} {name})"


def shorten_text(text: str) -> str:
    """A text for an error message: at most thirty characters, on one line."""
    text = " ".join(text.split())
    return text if len(text) <= 30 else text[:27] + "..."


def shorten_query(text: str) -> str:
    """The text of a query for a hint, or a form of one where it is long."""
    return text if len(text) <= 60 else "SELECT ..."


_ESCAPE = re.compile(
    r"\\(?:(?P<line>\r\n|[\r\n])|(?P<plain>[\\'\"abfnrtv])|(?P<octal>[0-7]{1,3})"
    r"|x(?P<x>[0-9a-fA-F]{2})|u(?P<u>[0-9a-fA-F]{4})|U(?P<U>[0-9a-fA-F]{8})|N\{(?P<name>[^}]*)\}|(?P<bad>[xuUN]))"
)
_PLAIN = {"\\": "\\", "'": "'", '"': '"', "a": "\a", "b": "\b", "f": "\f", "n": "\n", "r": "\r", "t": "\t", "v": "\v"}


def unescape_string(source: Source, token: Token) -> str:
    """The value of a string token, its escapes read as Python reads them.

    Raises ParseError (P003) for a malformed escape and for one that is not a character.
    """
    if "\\" not in token.text:
        return token.text[1:-1]

    def decode_escape(match: re.Match[str]) -> str:
        kind, text = match.lastgroup, match[match.lastgroup or 0]
        if kind == "line":
            return ""
        if kind == "plain":
            return _PLAIN[text]
        try:
            found = unicodedata.lookup(text) if kind == "name" else chr(int(text, 8 if kind == "octal" else 16))
            found.encode()
        except (KeyError, ValueError):  # not complete, no such name, beyond Unicode, or half of a character
            span = Span(source, token.start + match.start(), token.start + match.end())
            hints = ["\\x41, \\u0041 and \\N{LATIN CAPITAL LETTER A} are the letter A", "a backslash is written \\\\"]
            raise ParseError("P003", f"{shorten_text(match[0])} is not a character", span, hints) from None
        return found

    return _ESCAPE.sub(decode_escape, token.text)[1:-1]

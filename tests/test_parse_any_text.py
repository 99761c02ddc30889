"""The parser on any text whatever: a tree, or errors of ours whose places lie inside the text."""

from __future__ import annotations

import time
from dataclasses import fields, is_dataclass
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from listings import HANOI, ROBOT, SPACE

from ss2sql.errors import CODES, ParseError, Source, Span
from ss2sql.frontend import ast, text
from ss2sql.frontend.parser import parse

WORDS = [word.lower() for word in sorted(text.RESERVED | text.CONTEXTUAL)]
SIGNS = [*"()[]{},;:.=<>+-*/%^", "==", "!=", "<>", "<=", ">="]
FOREIGN = [
    "is", "like", "between", "distinct", "join", "union", "case", "when", "mod", "null", "insert", "selct", "wher",
    "||", "&&", "!", "--", "**", "$", "`", "@", "?", "#", "/*", "*/", "\\", "→", "²", "\u200b",
]  # fmt: skip
VALUES = ["a", "b", "f", "list", "1", "2.5", "1e999", "9223372036854775808", "3x", "'s'", '"s"', "'", '"', "'\\x'", "é"]
ANYTHING = WORDS + SIGNS + FOREIGN + VALUES
PHRASES = ["SELECT a FROM b", "SELECT * FROM", "START WITH x =", "CONNECT BY", "STOP WITH", "AS list", "IF(a; b; c)"]
SCRIPTS = [
    *HANOI.values(),
    ROBOT,
    SPACE,
    "x = SELECT a, n.this FROM n = f(b), [1] WHERE NOT a IN c OR d[1:] ^ -2 >= 3 GROUP BY a HAVING count(*) > 1"
    " ORDER BY a DESC, b LIMIT 3 AS plane('x', s = 1); v{5.0} = IF(a; b, c = 1;) + v{}[0, 1]; f(-1, 'a\\n')",
]


def outcome(source: str) -> ast.Script | ParseError:
    """The tree of a script, or its error."""
    try:
        return parse(Source(source))
    except ParseError as error:
        return error


def judge(source: str) -> None:
    """Parses, and checks what a tree and what every error promises."""
    found = outcome(source)
    if isinstance(found, ast.Script):
        inside(found, 0, len(source))
        return
    assert found.errors[0] is found
    assert len(found.errors) <= 10
    assert str(found).count("error[") == len(found.errors)
    for error in found.errors:
        assert error.code in CODES
        assert error.code.startswith("P")
        assert error.message
        assert error.hints
        for span in (error.span, *(span for span, _ in error.related)):
            assert span is not None
            assert 0 <= span.start <= span.end <= len(source)


def inside(node: Any, start: int, end: int) -> None:
    """Every node lies inside its parent."""
    if isinstance(node, tuple):
        for part in node:
            inside(part, start, end)
    elif is_dataclass(node) and not isinstance(node, Span):
        span: Span = getattr(node, "span")  # noqa: B009 - the type of nodes is open here
        assert start <= span.start < span.end <= end or not span.source.text.strip()
        for field in fields(node):
            inside(getattr(node, field.name), span.start, span.end)


@given(st.text())
def test_any_text(source: str) -> None:
    judge(source)


@given(st.text(st.characters()))
def test_any_text_with_lone_surrogates(source: str) -> None:
    judge(source)


@settings(max_examples=400)
@given(
    st.lists(st.sampled_from(WORDS + SIGNS + FOREIGN + VALUES + PHRASES), max_size=25), st.sampled_from([" ", "\n", ""])
)
def test_the_words_of_the_language_in_any_order(words: list[str], gap: str) -> None:
    judge(gap.join(words))


@settings(max_examples=300)
@given(st.sampled_from(SCRIPTS), st.data())
def test_scripts_with_a_word_lost_or_another_one_put_in(source: str, data: st.DataObject) -> None:
    words = [token.text for token in text.tokens(Source(source))]
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.integers(0, len(words) - 1))
        words[place : place + data.draw(st.integers(0, 2))] = data.draw(st.lists(st.sampled_from(ANYTHING), max_size=2))
    judge(" ".join(words))


@settings(max_examples=200)
@given(st.sampled_from(SCRIPTS), st.data())
def test_scripts_cut_off_anywhere(source: str, data: st.DataObject) -> None:
    start = data.draw(st.integers(0, len(source)))
    judge(source[start : data.draw(st.integers(start, len(source)))])


@pytest.mark.parametrize("source", SCRIPTS)
def test_scripts_without_one_word(source: str) -> None:
    words = [token.text for token in text.tokens(Source(source))]
    for place in range(len(words)):
        judge(" ".join(words[:place] + words[place + 1 :]))


LONG = [
    "$", "→", "a ", "a b;", "x=(1;", "selct a from b;", "f(a b);", "x[1:2,", "if(a;", "'", "\"'", "'\n", "/*", "not ",
    "-", "select ", "a=", "=", ",", ")", "v{", ":", ".", "where ", "a;", "\\", "#\n", "union ", "1", "1.", "a^", "[",
    "'x''y'", "select a from b where ", "select a from b as list ", "start with ", "-- ", "\n",
]  # fmt: skip


@pytest.mark.parametrize("part", LONG)
def test_long_texts_take_time_in_proportion_to_their_length(part: str) -> None:
    def seconds(size: int) -> float:
        source = "a " + part * (size // len(part)) + " b"
        best = float("inf")
        for _ in range(3):
            begin = time.perf_counter()
            judge(source)
            best = min(best, time.perf_counter() - begin)
        return best

    assert seconds(64_000) < 4 * 4 * seconds(16_000) + 0.05


def test_a_megabyte_of_anything_is_refused_at_once() -> None:
    for part in ("a", "(", "\0", "é", "SELECT "):
        begin = time.perf_counter()
        judge(part * (1_000_000 // len(part)))
        assert time.perf_counter() - begin < 5

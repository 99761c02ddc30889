"""The parser on any text whatever: a tree, or errors of ours whose places lie inside the text; and what it costs."""

from __future__ import annotations

import time
from timeit import repeat

import pytest
from fuzz_judge import inside, is_ours
from hypothesis import given, settings
from hypothesis import strategies as st
from listings import HANOI, ROBOT, SPACE
from trees import calls_of

from ss2sql.errors import ParseError, Source
from ss2sql.frontend.syntax import tokenizer
from ss2sql.frontend.syntax.parser import parse

WORDS = [
    *(word.lower() for word in sorted(tokenizer.RESERVED | tokenizer.CONTEXTUAL)),
    *"()[]{},;:.=<>+-*/%^", "==", "!=", "<>", "<=", ">=",
    "is", "like", "between", "distinct", "join", "union", "case", "when", "mod", "null", "insert", "selct", "wher",
    "||", "&&", "!", "--", "**", "$", "`", "@", "?", "#", "/*", "*/", "\\", "→", "²", "\u200b",
    "a", "b", "f", "list", "1", "2.5", "1e999", "9223372036854775808", "3x", "'s'", '"s"', "'", '"', "'\\x'", "é",
]  # fmt: skip
PHRASES = ["SELECT a FROM b", "SELECT * FROM", "START WITH x =", "CONNECT BY", "STOP WITH", "AS list", "IF(a; b; c)"]
SCRIPTS = [
    *HANOI.values(),
    ROBOT,
    SPACE,
    "x = SELECT a, n.this FROM n = f(b), [1] WHERE NOT a IN c OR d[1:] ^ -2 >= 3 GROUP BY a HAVING count(*) > 1"
    " ORDER BY a DESC, b LIMIT 3 AS plane('x', s = 1); v{5.0} = IF(a; b, c = 1;) + v{}[0, 1]; f(-1, 'a\\n')",
]


def judge(source: str) -> None:
    """Parses, and checks what a tree and what every error promises."""
    try:
        inside(parse(Source(source)), 0, len(source))
    except ParseError as error:
        found = error
    else:
        return
    is_ours(found, source)
    assert all(one.code.startswith("P") for one in found.errors)
    assert len(found.errors) <= 10
    assert str(found).count("error[") == len(found.errors)


@given(st.text() | st.text(st.characters()))
def test_any_text_with_lone_surrogates_or_without(source: str) -> None:
    judge(source)


@settings(max_examples=200)
@given(st.lists(st.sampled_from(WORDS + PHRASES), max_size=25), st.sampled_from([" ", "\n", ""]))
def test_the_words_of_the_language_in_any_order(words: list[str], gap: str) -> None:
    judge(gap.join(words))


def words_of(source: str) -> list[str]:
    return [token.text for token in tokenizer.tokenize(Source(source))]


@settings(max_examples=120)
@given(st.sampled_from(SCRIPTS), st.data())
def test_scripts_with_a_word_lost_or_another_one_put_in(source: str, data: st.DataObject) -> None:
    words = words_of(source)
    for _ in range(data.draw(st.integers(1, 3))):
        place = data.draw(st.integers(0, len(words) - 1))
        words[place : place + data.draw(st.integers(0, 2))] = data.draw(st.lists(st.sampled_from(WORDS), max_size=2))
    judge(" ".join(words))


@settings(max_examples=200)
@given(st.sampled_from(SCRIPTS), st.data())
def test_scripts_cut_off_anywhere(source: str, data: st.DataObject) -> None:
    start = data.draw(st.integers(0, len(source)))
    judge(source[start : data.draw(st.integers(start, len(source)))])


LONG = [
    "$", "→", "a ", "a b;", "x=(1;", "selct a from b;", "f(a b);", "x[1:2,", "if(a;", "'", "\"'", "'\n", "/*", "not ",
    "-", "select ", "a=", "=", ",", ")", "v{", ":", ".", "where ", "a;", "\\", "#\n", "union ", "1", "1.", "a^", "[",
    "'x''y'", "select a from b where ", "select a from b as list ", "start with ", "-- ", "\n",
    "a = f(b, 1)[0] + 2;", "1, ", "SELECT a FROM b WHERE c == 'd' AS list;", "[[1, 2], x];",
]  # fmt: skip


def long(part: str, size: int) -> str:
    return "a " + part * (size // len(part)) + " b"


@pytest.mark.parametrize("part", LONG)
def test_long_texts_take_calls_in_proportion_to_their_length(part: str) -> None:
    few, many = (calls_of(lambda size=size: judge(long(part, size))) for size in (1_000, 4_000))
    assert many <= 4.5 * few


@pytest.mark.slow
@pytest.mark.parametrize("part", LONG)
def test_long_texts_take_time_in_proportion_to_their_length(part: str) -> None:
    """What a single call of C does to a text shows in its time alone."""
    few, many = (min(repeat(lambda size=size: judge(long(part, size)), number=1)) for size in (16_000, 64_000))
    assert many < 4 * 4 * few + 0.05


@pytest.mark.parametrize("part", ["a", "(", "\0", "é", "SELECT "])
def test_a_megabyte_of_anything_is_refused_at_once(part: str) -> None:
    begin = time.process_time()
    judge(part * (1_000_000 // len(part)))
    assert time.process_time() - begin < 5

"""The parser: which words are keywords, where."""

from __future__ import annotations

from dataclasses import fields, is_dataclass
from typing import Any

import pytest
from trees import NOWHERE, assign, lit, query, same, script

from ss2sql.errors import ParseError, Span
from ss2sql.frontend import ast, text

WORDS = [*sorted(text.CONTEXTUAL), "LIST", "VALUE", "LEVEL", "SET", "RATIO", "INDEX"]
POSITIONS = [
    "{0}",
    "{0} = 1",
    "{0} == {0}",
    "{0} + {0}({0}, {0} = {0})[{0}:{0}]",
    "{0}.{0} + {0}.this",
    "{0}{{}} + {0}{{{0}}}",
    "{0}{{5.0}} = {0}",
    "[{0}, -{0}, NOT {0}, ({0})]",
    "IF({0}; {0}, {0} = {0}; {0})",
    "SELECT {0}, {0} FROM x",
    "SELECT x FROM {0}",
    "SELECT x FROM {0}, {0} = {0}, {0}.{0}",
    "SELECT x FROM {0} WHERE {0} AND {0} IN {0}",
    "SELECT {0} FROM {0} START WITH {0} = {0} CONNECT BY {0} = {0} STOP WITH {0} == 7",
    "SELECT x FROM x START WITH {0} = 1, {0} = 2 CONNECT BY {0} = {0} + 1, {0} = {0}",
    "SELECT x FROM x START WITH y = 1 CONNECT BY UNIQUE {0} = {0}, y = {0}",
    "SELECT x FROM x START WITH y = 1 CONNECT BY COST {0} {0} = {0}",
    "SELECT x FROM x START WITH y = 1 CONNECT BY NO CYCLE MEMORIZE {0} = {0}",
    "SELECT x FROM x START WITH y = 1 CONNECT BY MEMORIZE ({0}) MAXIMUM 3 {0} = {0}",
    "SELECT x FROM x START WITH y = 1 CONNECT BY HEURISTIC {0} + 1 DEPTH FIRST {0} # word\n /* and */ = {0}",
    "SELECT x FROM {0} GROUP BY {0}, {0} HAVING {0}",
    "SELECT x FROM {0} ORDER BY {0}, {0} DESC, {0} ASC",
    "SELECT x FROM {0} LIMIT {0}",
    "SELECT x FROM {0} LIMIT {0} GROUP BY {0} ORDER BY {0} AS {0}",
    "SELECT x FROM x AS {0}({0}, {0} = {0})",
    "SELECT {0} FROM {0} WHERE {0} GROUP BY {0} HAVING {0} ORDER BY {0} DESC LIMIT {0} AS {0}",
]


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
    for written in (word.lower(), word.capitalize()):
        for position in POSITIONS:
            plain = script(position.format("zz"))
            same(script(position.format(written)), rename(plain, "zz", written))


@pytest.mark.parametrize("word", WORDS)
def test_a_word_before_a_single_equals_sign_is_a_name(word: str) -> None:
    for gap in ("", " ", "\n", " # sign\n", " /* sign */ "):
        found = query(f"SELECT a FROM b START WITH t = 1 CONNECT BY UNIQUE {word}{gap}= 1, t = 2")
        same(found.connect[0], assign(word, lit(1)))
        same(found.options, (ast.Option("UNIQUE", None, span=NOWHERE),))


@pytest.mark.parametrize("word", sorted(text.RESERVED))
def test_reserved_words_are_no_names_in_any_case(word: str) -> None:
    for written in (word, word.lower(), word.capitalize()):
        with pytest.raises(ParseError):
            script(f"{written} = 1")
        with pytest.raises(ParseError):
            script(f"SELECT a FROM b AS {written}")


def test_keywords_are_read_in_any_case() -> None:
    upper = "SELECT A FROM B WHERE NOT C START WITH D = 1 CONNECT BY NO CYCLE D = 2 STOP WITH D ORDER BY A DESC LIMIT 1"
    lower = query(upper.lower())
    assert lower.options[0].keyword == "NO CYCLE"
    assert lower.order[0].descending
    for old in "abcd":
        lower = rename(lower, old, old.upper())
    same(lower, query(upper))

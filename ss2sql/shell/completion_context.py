"""The completion context: what may follow at the cursor, and the visible sources, variables and calls.

The grammar's own automaton runs over the statement up to the cursor and gives the tokens that fit. Names come from the
whole statement, since FROM follows the columns.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import field

from ss2sql.editor.keyword_tokens import mark_keywords
from ss2sql.editor.keywords import list_words
from ss2sql.errors import ParseError, Source
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.syntax import tokenizer
from ss2sql.frontend.syntax.parse_failure import CLAUSES, ParseFailure
from ss2sql.frontend.syntax.parse_table import load_parse_table
from ss2sql.frontend.syntax.parser import run_automaton
from ss2sql.frontend.syntax.query_builder import Builder
from ss2sql.frontend.syntax.tokenizer import CLOSING, OPENING, Token


@dataclass(frozen=True, slots=True)
class SourceName:
    """A source of FROM: its name in the query, and its origin: a table's or variable's name, or a query's columns."""

    name: str
    origin: str
    columns: tuple[str, ...] = ()


@dataclass(slots=True)
class CompletionContext:
    """The context of the cursor."""

    word: str = ""  # the beginning of the word at the cursor
    owner: str = ""  # the name before its dot
    in_string: bool = False
    expected: frozenset[str] | None = None  # tokens that the grammar accepts; None: the text before does not fit it
    clause: str = ""  # the current clause, as errors name it
    after: str = ""
    seen: tuple[str, ...] = ()  # the keywords of this query before the cursor
    sources: list[SourceName] = field(default_factory=list)
    states: list[str] = field(default_factory=list)

    @property
    def wants_value(self) -> bool:
        """Whether an expression could begin here."""
        return self.expected is None or {"NAME", "INTEGER"} <= self.expected


def find_context(statement: str, cursor: int) -> CompletionContext:
    """The context of a position in a statement."""
    before = list(tokenizer.iterate_tokens(statement[:cursor]))
    if _is_in_string(before, statement, cursor):
        return CompletionContext(in_string=True)
    found = CompletionContext()
    if before and before[-1].end == cursor and _is_word(before[-1]):
        found.word = before.pop().text
    if before and before[-1].kind == ".":
        found.owner = before[-2].text if len(before) > 1 and before[-2].kind in ("NAME", "THIS") else "?"
    found.after = (before[-1].keyword or before[-1].kind) if before else ""
    _find_expected_tokens(found, statement[: before[-1].end if before else 0])
    _collect_names(found, statement, cursor)
    return found


def _is_word(token: Token) -> bool:
    return token.kind == "NAME" or token.kind in list_words()


def _is_in_string(before: Sequence[Token], statement: str, cursor: int) -> bool:
    """Whether the cursor is in a string or a comment, or after a number that may continue."""
    if before and before[-1].kind in ("OPEN_STRING", "OPEN_COMMENT", "BAD_NUMBER"):
        return True
    if before and before[-1].kind in ("INTEGER", "FLOAT") and before[-1].end == cursor:
        return True
    line = statement.rfind("\n", 0, cursor) + 1
    start = max(line, before[-1].end if before else 0)
    return bool(re.search(tokenizer.COMMENT, statement[start:cursor]))


def _find_expected_tokens(found: CompletionContext, before: str) -> None:
    source = Source(before)
    try:
        tokens = tokenizer.tokenize(source)
    except ParseError:
        return
    outcome = run_automaton(load_parse_table(), Builder(source), tokens, 0, len(tokens) - 1)
    if isinstance(outcome, ParseFailure) and outcome.index == len(tokens) - 1:
        found.expected, found.clause = outcome.expected, outcome.clause


def _collect_names(found: CompletionContext, statement: str, cursor: int) -> None:
    tokens = mark_keywords(statement)
    groups = _find_groups(tokens)
    around = _list_enclosing(tokens, cursor)
    start = cursor - len(found.word)
    own = [token for token, group in zip(tokens, groups, strict=True) if group == around[-1]]
    begun = max((token.start for token in own if token.kind == "SELECT" and token.start < start), default=-1)
    found.seen = tuple(token.kind for token in own if begun <= token.start < start and token.kind in list_words())
    for group in reversed(around):  # the innermost query first
        for index, token in enumerate(tokens):
            if groups[index] == group and token.kind == "FROM":
                found.sources += _find_sources(tokens, groups, index)
            elif groups[index] == group and token.kind == "START":
                found.states += _find_assigned(tokens, groups, index)


def _find_groups(tokens: Sequence[Token]) -> list[int]:
    """For each token the index of the bracket around it, or -1; a bracket is outside of itself."""
    groups: list[int] = []
    stack = [-1]
    for index, token in enumerate(tokens):
        if token.kind in CLOSING and len(stack) > 1:
            stack.pop()
        groups.append(stack[-1])
        if token.kind in OPENING:
            stack.append(index)
    return groups


def _list_enclosing(tokens: Sequence[Token], cursor: int) -> list[int]:
    """The indices of the brackets around the cursor, the outermost first, after a -1."""
    stack = [-1]
    for index, token in enumerate(tokens):
        if token.start >= cursor:
            break
        if token.kind in OPENING:
            stack.append(index)
        elif token.kind in CLOSING and len(stack) > 1:
            stack.pop()
    return stack


def _split_at_commas(
    tokens: Sequence[Token], groups: Sequence[int], start: int, group: int, ends: Sequence[str] = CLAUSES
) -> list[list[int]]:
    """The parts between the commas of a clause from `start` on: indices of tokens, without the inside of brackets."""
    found: list[list[int]] = [[]]
    for index in range(start, len(tokens)):
        kind = tokens[index].kind
        if groups[index] < group or (groups[index] == group and (kind in ends or kind == ";")):
            break
        if groups[index] == group and kind in (",", "JOIN"):
            found.append([])
        elif groups[index] == group:
            found[-1].append(index)
    return [part for part in found if part]


def _find_sources(tokens: Sequence[Token], groups: Sequence[int], place: int) -> list[SourceName]:
    found = []
    for part in _split_at_commas(tokens, groups, place + 1, groups[place]):
        kinds = [tokens[index].kind for index in part]
        named = kinds[:2] == ["NAME", "="]
        name = tokens[part[0]].text if kinds[0] == "NAME" else ""
        rest = part[2:] if named else part
        words_of_rest = [tokens[index].text for index in rest]
        kinds = kinds[2:] if named else kinds
        if kinds[:3] == ["NAME", ".", "NAME"]:
            found.append(SourceName(name if named else words_of_rest[2], ".".join(words_of_rest[::2][:2])))
        elif kinds[:1] == ["NAME"]:
            found.append(SourceName(name, words_of_rest[0]))
        elif kinds[:1] == ["("]:
            found.append(SourceName(name, "", _find_query_columns(tokens, groups, rest[0])))
        elif named:
            found.append(SourceName(name, ""))
    return found


def _find_query_columns(tokens: Sequence[Token], groups: Sequence[int], bracket: int) -> tuple[str, ...]:
    """The names of the columns of a query in parentheses, as far as they are written."""
    if bracket + 1 >= len(tokens) or tokens[bracket + 1].kind != "SELECT":
        return ()
    found = []
    for part in _split_at_commas(tokens, groups, bracket + 2, bracket, ("FROM",)):
        kinds = [tokens[index].kind for index in part]
        if kinds[-2:] == ["AS", "NAME"] or kinds == ["NAME"] or kinds == ["NAME", ".", "NAME"]:
            found.append(tokens[part[-1]].text)
        elif kinds[:3] == ["NAME", "(", ")"]:
            naming = tokens[part[0]].text == "to" and tokens[part[-1] - 1].kind == "NAME"
            found.append(tokens[part[-1] - 1].text if naming else tokens[part[0]].text)
    return tuple(found)


def _find_assigned(tokens: Sequence[Token], groups: Sequence[int], place: int) -> list[str]:
    """The names that START WITH at an index assigns to; its `WITH` may be missing."""
    start = place + 2 if place + 1 < len(tokens) and tokens[place + 1].kind == "WITH" else place + 1
    parts = _split_at_commas(tokens, groups, start, groups[place])
    return [tokens[part[0]].text for part in parts if [tokens[index].kind for index in part[:2]] == ["NAME", "="]]


@dataclass(frozen=True, slots=True)
class OpenCall:
    """The call around the cursor: its name, the number of the current argument, whether it follows AS."""

    name: str
    argument: int
    is_representation: bool


def find_open_call(statement: str, cursor: int) -> OpenCall | None:
    """The innermost call around a position of a statement."""
    tokens = list(tokenizer.iterate_tokens(statement[:cursor]))
    for bracket in reversed(_list_enclosing(tokens, cursor + 1)[1:]):
        ahead = tokens[bracket - 1] if bracket else None
        if tokens[bracket].kind != "(" or ahead is None or ahead.kind != "NAME":
            continue
        groups = _find_groups(tokens)
        commas = sum(token.kind == "," and group == bracket for token, group in zip(tokens, groups, strict=True))
        return OpenCall(ahead.text, commas, bracket > 1 and tokens[bracket - 2].kind == "AS")
    return None

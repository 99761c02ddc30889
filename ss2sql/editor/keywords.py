"""The keywords of the grammar, and the tokens of any text with its keywords marked.

`maximum` is a keyword among the options of CONNECT BY and a name elsewhere; only the grammar can decide. So its
automaton runs over the text, and resumes after the next `;` where something does not fit. Words up to that `;` are
classified by themselves, since text that is being written rarely fits.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import cache
from typing import Literal, TypeAlias

from ss2sql.errors import ParseError, Source
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.resolve.search_clauses import ORDERS, REPEATS
from ss2sql.frontend.syntax import ast, tokenizer
from ss2sql.frontend.syntax.parse_failure import ALONE, CLAUSES
from ss2sql.frontend.syntax.parser import find_resume_point, load_parse_table, run_automaton
from ss2sql.frontend.syntax.tokenizer import END, OPTIONS, PAIRS, RESERVED, VALUES, Token
from ss2sql.frontend.syntax.tree_builder import Builder

Sort: TypeAlias = Literal["clause", "option", "operator", "constant", "other"]

# The descriptions of keywords in completions and help. A test compares the keys with the grammar.
TEXTS = {
    "SELECT": "the columns of the result",
    "FROM": "the sources; the last one varies fastest",
    "WHERE": "which rows are results; in a search: which step is a goal",
    "START WITH": "the state in which a search starts: name = value, ...",
    "CONNECT BY": "makes the query a search: options, which steps there are, name = the value in the next state, ...",
    "STOP WITH": "which step is the last of its path",
    "GROUP BY": "one row, or one part of the result, for each value",
    "HAVING": "which groups are kept",
    "ORDER BY": "the order of the result, ASC or DESC",
    "LIMIT": "at most so many rows, groups or paths",
    "AS": "what the result becomes; it ends the query",
    "DEPTH FIRST": "every path, children before siblings",
    "BREADTH FIRST": "every path, shorter before longer",
    "LAST": "of a search: the row of each path's last step, in place of the path",
    "EACH": "EACH name IN list: the search starts once for each element",
    "PRIOR": "what it was in the step before, None in the first",
    "SIBLINGS BY": "ORDER SIBLINGS BY: the order of the steps from one state",
    "COST": "the cost of a step, at least 0; cheapest paths first",
    "HEURISTIC": "with COST: what the rest of the path costs at least; alone: the smallest estimate first",
    "PROBABILITY": "the probability of a step; likeliest paths first",
    "NO CYCLE": "no row occurs twice on a path",
    "UNIQUE": "each row is reached once in the whole search",
    "MAXIMUM": "the search ends with so many results",
    "MEMORIZE": "every path without a repeated row, from a graph that is built once; a number bounds the steps",
    "BY": "UNIQUE BY key, NO CYCLE BY key, MEMORIZE BY key: what is compared in place of the row",
    "ASC": "rising",
    "DESC": "falling",
    "DISTINCT": "each row once, or each value in count(DISTINCT x)",
    "JOIN": "FROM a JOIN b ON condition: the pairs that meet it",
    "LEFT JOIN": "FROM a LEFT JOIN b ON condition: all of a; what b has none of is None",
    "ON": "which pairs JOIN gives",
    "OFFSET": "LIMIT n OFFSET m: n after the first m",
    "IF": "IF(condition; then; else)",
    "AND": "both; the right side is evaluated only if the left one is true",
    "OR": "one or both; the right side is evaluated only if the left one is false",
    "XOR": "one of both",
    "NOT": "the other truth",
    "IN": "whether a list, a dict or a string has it",
    "IS": "x IS NULL, x IS NOT NULL: whether it is None",
    "NULL": "None, after IS",
    "BETWEEN": "x BETWEEN a AND b: a <= x AND x <= b",
    "LIKE": "x LIKE 'a%': % is any text, _ any character, and case counts",
    "CASE WHEN": "CASE WHEN condition THEN value ... ELSE value END",
    "WHEN": "another condition of CASE",
    "THEN": "the value where the condition is true",
    "ELSE": "the value where none is; without it None",
    "END": "ends CASE",
    "this": "the element of the first source",
    "True": "the truth",
    "False": "its opposite",
    "None": "no value",
}
_SPELLED = {word.upper(): word for word in ("this", "True", "False", "None")}
CONSTANTS = VALUES & RESERVED
ONE_OF = (frozenset(ORDERS), frozenset(REPEATS))  # options of which a search has at most one


@dataclass(frozen=True, slots=True)
class Keyword:
    """A keyword of one word or two. `reserved` ones are never names."""

    text: str
    sort: Sort
    about: str
    reserved: bool


@cache
def list_words() -> frozenset[str]:
    """Every word of the grammar, in capitals."""
    kinds = {symbol for row in load_parse_table().rows for symbol in row if symbol.isalpha() and symbol.isupper()}
    return frozenset(kinds - (VALUES - RESERVED))


@cache
def keywords() -> dict[str, Keyword]:
    """The keywords by their first word, in capitals, in alphabetical order."""
    seconds = set(PAIRS.values()) - ALONE
    found = {}
    for word in sorted(list_words() - seconds):
        text = f"{word} {PAIRS[word]}" if word in PAIRS else _SPELLED.get(word, word)
        found[word] = Keyword(text, _classify_keyword(word), TEXTS.get(text, ""), word in RESERVED)
    return found


def _classify_keyword(word: str) -> Sort:
    if word in CLAUSES:
        return "clause"
    if word in OPTIONS:
        return "option"
    if word in CONSTANTS:
        return "constant"
    return "operator" if word in (RESERVED | {"IS", "BETWEEN", "LIKE"}) - {"IF"} else "other"


# --- the tokens of any text, with words marked as keywords where they are
_COMMENT = re.compile(tokenizer.COMMENT)
_SECONDS = {word: tuple(first for first in PAIRS if PAIRS[first] == word) for word in set(PAIRS.values()) - ALONE}


def mark_keywords(script: str) -> list[Token]:
    """The tokens of a text without its end; the kind of a keyword is its word in capitals."""
    source = Source(script)
    try:
        tokens = tokenizer.tokenize(source)
    except ParseError:  # too large, too deep, or no text
        tokens = [*tokenizer.iterate_tokens(script), Token(END, "", len(script), len(script))]
        _mark_keywords_between(tokens, 0, len(tokens))
        return tokens[:-1]
    position = 0
    while position < len(tokens):
        outcome = run_automaton(Builder(source), tokens, position, len(tokens))
        if isinstance(outcome, ast.Script):
            break
        after = find_resume_point(outcome)
        _mark_keywords_between(tokens, max(outcome.index - 1, position), after)
        position = after
    return tokens[:-1]


def find_comments(script: str, start: int, end: int) -> Iterator[tuple[int, int]]:
    """The comments between two tokens, as places in the text."""
    return (match.span() for match in _COMMENT.finditer(script, start, end))


def _mark_keywords_between(tokens: list[Token], start: int, end: int) -> None:
    """Marks likely keywords: both words of a pair beside each other, and single ones."""
    for index in range(start, end):
        token = tokens[index]
        word = token.keyword
        if token.kind != "NAME" or word is None:
            continue
        ahead = tokens[index - 1] if index else token
        following = tokens[min(index + 1, len(tokens) - 1)]
        if word in PAIRS:
            belongs = following.keyword == PAIRS[word]
        elif word in _SECONDS:
            belongs = ahead.keyword in _SECONDS[word]
        else:
            belongs = ahead.kind != "." and not (following.kind in (".", "[", "{") and following.start == token.end)
        if belongs:
            token.kind = word

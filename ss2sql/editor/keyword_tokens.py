"""The tokens of any text, with words marked as keywords where they are.

`maximum` is a keyword among the options of CONNECT BY and a name elsewhere; only the grammar can decide. So its
automaton runs over the text, and resumes after the next `;` where something does not fit. Words up to that `;` are
classified by themselves, since text that is being written rarely fits.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from ss2sql.errors import ParseError, Source
from ss2sql.frontend.syntax import ast, tokenizer
from ss2sql.frontend.syntax.parse_failure import ALONE, PAIRS
from ss2sql.frontend.syntax.parse_table import END, load_parse_table
from ss2sql.frontend.syntax.parser import find_resume_point, run_automaton
from ss2sql.frontend.syntax.query_builder import Builder
from ss2sql.frontend.syntax.tokenizer import Token

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
        outcome = run_automaton(load_parse_table(), Builder(source), tokens, position, len(tokens))
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

"""The tokens of any text, with words marked as keywords where they are.

`maximum` is a keyword among the options of CONNECT BY and a name elsewhere; only the grammar can decide. So its
automaton runs over the text, and resumes after the next `;` where something does not fit. Words up to that `;` are
classified by themselves, since text that is being written rarely fits.
"""

from __future__ import annotations

import re
from collections.abc import Iterator

from ss2sql.errors import ParseError, Source
from ss2sql.frontend import ast, text
from ss2sql.frontend.parser import read, resume
from ss2sql.frontend.query_builder import Builder
from ss2sql.frontend.table import END, load
from ss2sql.frontend.text import Token
from ss2sql.frontend.trouble import ALONE, PAIRS

_COMMENT = re.compile(text.COMMENT)
_SECONDS = {word: tuple(first for first in PAIRS if PAIRS[first] == word) for word in set(PAIRS.values()) - ALONE}


def marked(script: str) -> list[Token]:
    """The tokens of a text without its end; the kind of a keyword is its word in capitals."""
    source = Source(script)
    try:
        tokens = text.tokens(source)
    except ParseError:  # too large, too deep, or no text
        tokens = [*text.cut(script), Token(END, "", len(script), len(script))]
        _judge(tokens, 0, len(tokens))
        return tokens[:-1]
    position = 0
    while position < len(tokens):
        outcome = read(load(), Builder(source), tokens, position, len(tokens))
        if isinstance(outcome, ast.Script):
            break
        after = resume(outcome)
        _judge(tokens, max(outcome.index - 1, position), after)
        position = after
    return tokens[:-1]


def comments(script: str, start: int, end: int) -> Iterator[tuple[int, int]]:
    """The comments between two tokens, as places in the text."""
    return (match.span() for match in _COMMENT.finditer(script, start, end))


def _judge(tokens: list[Token], start: int, end: int) -> None:
    """Marks likely keywords: both words of a pair beside each other, and single ones."""
    for index in range(start, end):
        token = tokens[index]
        word = token.keyword
        if token.kind != "NAME" or word is None:
            continue
        ahead = tokens[index - 1] if index else token
        behind = tokens[min(index + 1, len(tokens) - 1)]
        if word in PAIRS:
            belongs = behind.keyword == PAIRS[word]
        elif word in _SECONDS:
            belongs = ahead.keyword in _SECONDS[word]
        else:
            belongs = ahead.kind != "." and not (behind.kind in (".", "[", "{") and behind.start == token.end)
        if belongs:
            token.kind = word

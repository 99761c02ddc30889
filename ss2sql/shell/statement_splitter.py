"""Typed text, split into statements and dot commands."""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterator

from ss2sql.errors import Source
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.syntax.tokenizer import CLOSING, COMMENT, OPENING, Token, iterate_tokens

_NOTHING = re.compile(rf"(?:[\s;]+|{COMMENT})*")
_COMMAND = re.compile(r"\.[A-Za-z][^\r\n]*")
MOST_LINES = 100_000  # of a pipe that are counted; a script may be 256 KiB, and the lines before it are part of it


@dataclass(frozen=True, slots=True)
class TypedPiece:
    """A statement with its `;`, or the line of a dot command, and where it begins.

    `complete` is false without an end, `hopeless` true where no end could help, as after an open string.
    """

    text: str
    start: int
    complete: bool = True
    is_unfinishable: bool = False

    @property
    def is_command(self) -> bool:
        return _COMMAND.match(self.text) is not None

    @property
    def end(self) -> int:
        return self.start + len(self.text)

    def make_source(self, whole: str, name: str, lines_before: int = 0) -> Source:
        """The piece as a script, with its line and column in the input."""
        lines = lines_before + whole.count("\n", 0, self.start)
        column = self.start - (whole.rfind("\n", 0, self.start) + 1)
        blank = "\n" * lines + " " * column if lines <= MOST_LINES else ""
        return Source(blank + self.text, name)


def split_statements(text: str) -> Iterator[TypedPiece]:
    """The statements and commands of a text, one after the other. A command begins where a statement could."""
    position = _skip_typed_blanks(text, 0)
    while position < len(text):
        command = _COMMAND.match(text, position)
        found = TypedPiece(command[0].rstrip(), position) if command else _read_typed_statement(text, position)
        yield found
        position = _skip_typed_blanks(text, found.end)


def _skip_typed_blanks(text: str, position: int) -> int:
    match = _NOTHING.match(text, position)
    return match.end() if match else position


def _read_typed_statement(text: str, start: int) -> TypedPiece:
    depth, hopeless, last = 0, False, start
    for token in iterate_tokens(text, start):
        last = token.end
        if token.kind == "OPEN_STRING" and not _can_typed_line_continue(token, text):
            hopeless = True
            if token.text.rstrip().endswith(";"):  # the string has most likely swallowed the end
                return TypedPiece(text[start:last], start)
        depth = max(0, depth + (token.kind in OPENING) - (token.kind in CLOSING))
        if token.kind == ";" and depth == 0:
            return TypedPiece(text[start:last], start)
    return TypedPiece(text[start:].rstrip(), start, False, hopeless)


def _can_typed_line_continue(token: Token, text: str) -> bool:
    """Whether a string that is not closed may continue in the next line."""
    hidden = len(token.text) - len(token.text.rstrip("\\"))
    return hidden % 2 == 1 and not text[token.end :].strip()


def is_typed_input_ready(text: str) -> bool:
    """Whether the input can run: it is complete, or more lines would not help.

    An empty line after a `;` ends the input, even in an open bracket.
    """
    last = next(iter(deque(split_statements(text), maxlen=1)), None)
    if last is None:
        return not text.strip() or text.rstrip().endswith(";")
    if last.complete or last.is_unfinishable:
        return True
    before, line_end, line = text.rpartition("\n")
    return bool(line_end) and not line.strip() and before.rstrip().endswith(";")


def find_statement_at(text: str, cursor: int) -> TypedPiece:
    """The piece that the cursor is in or right after; blanks and comments where a new one would begin."""
    start = 0
    for piece in split_statements(text):
        if piece.start <= cursor and (cursor < piece.end or not piece.text.endswith(";") or not piece.complete):
            following = text[piece.end : cursor]
            if not following.strip() and ("\n" not in following or not piece.is_command):
                return piece
        start = min(piece.end, cursor)
    return TypedPiece(text[start:cursor], start, False)

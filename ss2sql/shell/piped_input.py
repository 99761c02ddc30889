"""The shell without a terminal: statements from a pipe or a file, each run as soon as it is complete."""

from __future__ import annotations

from codecs import getincrementaldecoder
from collections.abc import Iterator
from typing import BinaryIO

from ss2sql.errors import SessionError
from ss2sql.frontend.syntax.tokenizer import MAX_BYTES, make_size_error
from ss2sql.shell.shell import ExitRequest, Shell
from ss2sql.shell.statement_splitter import TypedPiece, split_statements

NAME = "<stdin>"


def run_piped(shell: Shell, stream: BinaryIO) -> None:
    """Runs the statements of the stream up to its end, `.exit` or Ctrl-C, also after an error."""
    pending, lines = "", 0
    try:
        for text in _read_lines(stream):
            pending += text
            # Searching the end of a statement only where there may be one keeps the time of long ones linear.
            if ";" in text or pending.lstrip().startswith("."):
                pending, lines = _run_complete(shell, pending, lines)
            if shell.cancelled:
                return
            if len(pending) > MAX_BYTES and len(pending.strip()) > MAX_BYTES:
                raise make_size_error("a statement on the standard input")
        for piece in split_statements(pending):
            _run_piece(shell, piece, pending, lines)
    except ExitRequest:
        return


def _run_complete(shell: Shell, pending: str, lines: int) -> tuple[str, int]:
    """Runs what is complete; gives the rest, and the number of lines before it."""
    after = 0
    for piece in split_statements(pending):
        if not piece.complete:
            break
        _run_piece(shell, piece, pending, lines)
        after = piece.end
    done = pending.rfind("\n", 0, after) + 1  # the rest keeps its place on its line
    head = pending[done:after]
    return " " * len(head) + pending[after:], lines + pending.count("\n", 0, done)


def _run_piece(shell: Shell, piece: TypedPiece, pending: str, lines: int) -> None:
    if not shell.cancelled:
        shell.run_piece(piece, pending, NAME, lines)


def _read_lines(stream: BinaryIO) -> Iterator[str]:
    """The lines of a stream; long ones in parts, so that at most a script's limit is read."""
    decoder = getincrementaldecoder("utf-8-sig")()
    number = 1
    try:
        while part := stream.readline(MAX_BYTES):
            yield decoder.decode(part)
            number += part.endswith(b"\n")
        yield decoder.decode(b"", final=True)
    except UnicodeDecodeError as error:
        raise SessionError("S002", f"line {number} of the standard input cannot be read: {error}") from error
    except OSError as error:
        raise SessionError("S002", f"the standard input cannot be read: {error}") from error

"""The shell without a terminal: statements from a pipe or a file, each run as soon as it is complete."""

from __future__ import annotations

from typing import BinaryIO

from ss2sql.errors import SessionError
from ss2sql.shell.pieces import Piece, pieces
from ss2sql.shell.shell import Leave, Shell

NAME = "<stdin>"


def run_piped(shell: Shell, stream: BinaryIO) -> None:
    """Runs what the stream gives up to its end, `.exit` or Ctrl-C. After an error the next statement follows."""
    pending, lines = "", 0
    try:
        for number, line in enumerate(stream):
            text = _decoded(line, number)
            pending += text
            # Looking for the end of a statement only where there may be one keeps long ones from costing their square.
            if ";" in text or pending.lstrip().startswith("."):
                pending, lines = _run_complete(shell, pending, lines)
            if shell.cancelled:
                return
        for piece in pieces(pending):
            _run(shell, piece, pending, lines)
    except Leave:
        return


def _run_complete(shell: Shell, pending: str, lines: int) -> tuple[str, int]:
    """Runs what is complete; gives the rest, and the number of lines in front of it."""
    after = 0
    for piece in pieces(pending):
        if not piece.complete:
            break
        _run(shell, piece, pending, lines)
        after = piece.end
    done = pending.rfind("\n", 0, after) + 1  # the rest keeps its place on its line
    head = pending[done:after]
    return " " * len(head) + pending[after:], lines + pending.count("\n", 0, done)


def _run(shell: Shell, piece: Piece, pending: str, lines: int) -> None:
    if not shell.cancelled:
        shell.run_piece(piece, pending, NAME, lines)


def _decoded(line: bytes, number: int) -> str:
    try:
        return line.decode("utf-8-sig" if number == 0 else "utf-8")
    except UnicodeDecodeError as error:
        raise SessionError("S002", f"line {number + 1} of the standard input cannot be read: {error}") from error

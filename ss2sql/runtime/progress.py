"""One line on the terminal that says how far a long run is.

It appears after a second, is written anew ten times a second at the most, and is gone in the end. It has neither
colours nor control codes but for the carriage return, so it looks the same everywhere.
"""

from __future__ import annotations

import os
import shutil
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Protocol

from ss2sql.errors import SessionError

if TYPE_CHECKING:
    from ss2sql.runtime.run import Run

FIRST = 1.0  # seconds before the line appears
AGAIN = 0.1  # seconds until it is written anew


class Stream(Protocol):
    """Where the line goes."""

    def write(self, text: str, /) -> object: ...
    def flush(self) -> object: ...


def check_progress(wanted: str | bool) -> None:
    """Raises SessionError S002 for anything but "auto", True and False."""
    if wanted is not True and wanted is not False and wanted != "auto":
        raise SessionError("S002", f'progress is "auto", True or False, not {wanted!r}')


def progress_of(run: Run, wanted: str | bool) -> Progress | None:
    """The line for a run; None where nobody would see it."""
    stream = sys.stderr
    if stream is None or wanted is False:
        return None
    if wanted == "auto" and (not stream.isatty() or os.environ.get("TERM") == "dumb"):
        return None
    return Progress(run, stream, time.monotonic, lambda: shutil.get_terminal_size().columns)


class Progress:
    """The line of one run. `show` is called again and again while it works, `end` when it is over."""

    def __init__(self, run: Run, stream: Stream, clock: Callable[[], float], width: Callable[[], int]) -> None:
        self._run = run
        self._stream = stream
        self._clock = clock
        self._width = width
        self._started = clock()
        self._due = self._started + FIRST
        self.entered = 0  # steps of the search that SQLite runs
        self._shown = 0  # characters of the line as it stands there

    def show(self) -> None:
        """Writes the line if it is time to."""
        now = self._clock()
        if now >= self._due:
            self._due = now + AGAIN
            self._write(progress_text(self._run, now - self._started, self.entered))

    def end(self) -> None:
        """Takes the line away."""
        if self._shown:
            self._write("")

    def _write(self, text: str) -> None:
        text = text[: max(self._width() - 1, 1)]
        blanks = " " * max(self._shown - len(text), 0)
        self._shown = len(text)
        self._stream.write(f"\r{text}{blanks}" if text else f"\r{blanks}\r")
        self._stream.flush()


def progress_text(run: Run, seconds: float, entered: int = 0) -> str:
    """What a run has done in so many seconds; `entered` counts the steps of a search that are not yet in its stats."""
    stats, graph = run.stats, run.graph
    parts = [f"{seconds:.0f} s"]
    if graph is not None:
        parts.append(f"{_count(len(stats.levels), 'level')} of MEMORIZE")
        parts.append(_count(len(graph.rows) - 1, "row"))
    steps = stats.generated or entered
    if steps:
        parts.append(f"{_count(steps, 'step')}, {steps / seconds:,.0f}/s")
    if run.sink is not None:
        rows = run.sink[0]
        parts.append(_count(len((rows.rows if rows.paths is None else rows.paths) or ()), "result"))
    return " | ".join(parts)


def _count(number: int, word: str) -> str:
    return f"{number:,} {word}" if number == 1 else f"{number:,} {word}s"

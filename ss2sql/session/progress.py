"""One line on the terminal that says how far a long run is.

    12 s | [####......] 42% | 402,116 steps, 33,509/s | 12 results

It appears after a second, is written anew ten times a second at the most, and is gone in the end. It has neither
colours nor control codes but for the carriage return, so it looks the same everywhere. The bar is there where the total
is known: of the elements of the first source, or of the results that a search ends with.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TextIO

from ss2sql.errors import SessionError
from ss2sql.language import plan
from ss2sql.results import count_words

if TYPE_CHECKING:
    from ss2sql.runtime.run.run_state import Run
    from ss2sql.runtime.sqlite.search_functions import SearchState

FIRST_SECONDS = 1.0  # seconds before the line appears
REPEAT_SECONDS = 0.1  # seconds until it is written anew
BAR_WIDTH = 10  # characters of the bar


def check_progress_option(wanted: str | bool) -> None:
    """Raises SessionError S002 for anything but "auto", True and False."""
    if wanted is not True and wanted is not False and wanted != "auto":
        raise SessionError("S002", f'progress is "auto", True or False, not {wanted!r}')


def make_progress(run: Run, wanted: str | bool) -> Progress | None:
    """The line for a run; None where nobody would see it."""
    stream = sys.stderr
    if stream is None or wanted is False:
        return None
    if wanted == "auto" and (not stream.isatty() or os.environ.get("TERM") == "dumb"):
        return None
    from shutil import get_terminal_size  # takes 2 ms

    return Progress(run, stream, time.monotonic, lambda: get_terminal_size().columns)


class Progress:
    """The line of one run. `show_line` is called again and again while it works, `remove_line` when it is over.

    Executors say here how far they are: `search` is the state of the search that SQLite runs.
    """

    def __init__(self, run: Run, stream: TextIO, clock: Callable[[], float], width: Callable[[], int]) -> None:
        self._run = run
        self._stream = stream
        self._clock = clock
        self._width = width
        self._started = clock()
        self._due = self._started + FIRST_SECONDS
        self._shown = 0  # characters of the line as it stands there
        self._walked: tuple[Any, int, int] | None = None  # what is walked, how much of it is done, and of how much
        self.search: SearchState | None = None

    def note_progress(self, cursor: Any, search: SearchState) -> None:
        """Notes where the statement is that SQLite runs; `cursor` walks the first list that it reads."""
        self.search = search
        if cursor is not None:
            self.note_walk(cursor, cursor.position, cursor.length)

    def note_walk(self, source: object, done: int, total: int) -> None:
        """Notes how many elements of a source are done; those of the first one count, all others are inside of it."""
        if self._walked is None or self._walked[0] is source or self._walked[1] >= self._walked[2]:
            self._walked = (source, done, total)

    def begin_statement(self) -> None:
        """Forgets what the statement before has noted."""
        self._walked = self.search = None

    def show_line(self) -> None:
        """Writes the line if it is time to."""
        now = self._clock()
        if now >= self._due:
            self._due = now + REPEAT_SECONDS
            self._write_line(self.describe_progress(now - self._started))

    def remove_line(self) -> None:
        self.begin_statement()
        if self._shown:
            self._write_line("")

    def _write_line(self, text: str) -> None:
        text = text[: max(self._width() - 1, 1)]
        blanks = " " * max(self._shown - len(text), 0)
        self._shown = len(text)
        self._stream.write(f"\r{text}{blanks}" if text else f"\r{blanks}\r")
        self._stream.flush()

    def describe_progress(self, seconds: float) -> str:
        """What the run has done in so many seconds."""
        stats, graph = self._run.stats, self._run.graph
        found = None if self._run.sink is None else self._run.sink.rows
        results = None if found is None else len((found.rows if found.paths is None else found.paths) or ())
        parts = [f"{seconds:.0f} s"]
        part = self._estimate_part(results or 0)
        if part is not None:
            parts.append(f"[{'#' * int(part * BAR_WIDTH):.<{BAR_WIDTH}}] {part:.0%}")
        if graph is not None:
            parts.append(f"{count_words(len(stats.levels), 'level')} of MEMORIZE")
            parts.append(count_words(len(graph.rows) - 1, "row"))
        steps = stats.generated or (0 if self.search is None else self.search.entered)
        if steps:
            parts.append(f"{count_words(steps, 'step')}, {steps / seconds:,.0f}/s")
        if results is not None:
            rate = f", {results / seconds:,.0f}/s" if results and not steps else ""
            parts.append(count_words(results, "result") + rate)
        return " | ".join(parts)

    def _estimate_part(self, results: int) -> float | None:
        """How much is done, from 0 to 1; None where nobody can know."""
        bound = find_progress_end(self._run)
        parts = [results / bound] if bound else []
        query = None if self._run.sink is None else self._run.sink.query
        flat = query is None or query.search is None  # a search walks its sources again for every step
        if flat and self._walked is not None and self._walked[1] < self._walked[2]:
            parts.append(self._walked[1] / self._walked[2])
        return min(max(parts), 1.0) if parts else None


def find_progress_end(run: Run) -> int | None:
    """How many results the query that runs ends with, as far as the script or the run say so."""
    query = None if run.sink is None else run.sink.query
    if query is None:
        return None
    bounds: list[plan.Expr | None] = []
    if query.search is not None:
        bounds.append(query.search.maximum)
    if not query.order and not query.grouped:
        bounds.append(query.limit)
    known = [bound.value for bound in bounds if isinstance(bound, plan.Constant) and type(bound.value) is int]
    if run.maximum is not None and query.search is not None:
        known.append(run.maximum)
    return min(known, default=None)

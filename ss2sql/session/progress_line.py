"""One line on the terminal that says how far a long run is."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TextIO

from ss2sql.results import count_words

if TYPE_CHECKING:
    from ss2sql.runtime.run.run_state import Run
    from ss2sql.runtime.sqlite.search_functions import SearchState

FIRST_SECONDS = 1.0  # seconds before the line appears
REPEAT_SECONDS = 0.1  # seconds until it is written anew


class Progress:
    """The line of one run. `show_line` is called again and again while it works, `remove_line` when it is over.

    `search` is the state of the search that SQLite runs.
    """

    def __init__(self, run: Run, stream: TextIO, clock: Callable[[], float], width: Callable[[], int]) -> None:
        self._run = run
        self._stream = stream
        self._clock = clock
        self._width = width
        self._started = clock()
        self._due = self._started + FIRST_SECONDS
        self._shown = 0  # characters of the line as it stands there
        self.search: SearchState | None = None

    def show_line(self) -> None:
        """Writes the line if it is time to."""
        now = self._clock()
        if now >= self._due:
            self._due = now + REPEAT_SECONDS
            self._write_line(self.describe_progress(now - self._started))

    def remove_line(self) -> None:
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

"""Places in scripts: a script's source with its name, and spans of it."""

from __future__ import annotations

from bisect import bisect_right
from functools import cached_property

from ss2sql.fast_dataclasses import dataclass


@dataclass(frozen=True)
class Source:
    """A script's text with the name that errors show for it (a file name, or `<script>`)."""

    text: str
    name: str = "<script>"

    @cached_property
    def _line_starts(self) -> list[int]:
        starts = [0]
        starts.extend(i + 1 for i, char in enumerate(self.text) if char == "\n")
        return starts

    def find_line_column(self, offset: int) -> tuple[int, int]:
        """The line and column, both counted from 1, of a character offset."""
        line = bisect_right(self._line_starts, offset)
        return line, offset - self._line_starts[line - 1] + 1

    def get_line(self, number: int) -> str:
        """The text of a line, counted from 1, without its end."""
        start = self._line_starts[number - 1]
        end = self._line_starts[number] - 1 if number < len(self._line_starts) else len(self.text)
        return self.text[start:end].rstrip("\r")

    def find_offset(self, line: int, column: int) -> int:
        """The character offset of a line and column, both counted from 1."""
        return self._line_starts[line - 1] + column - 1


@dataclass(frozen=True)
class Span:
    """A stretch of a script: character offsets `start` (included) to `end` (not included)."""

    source: Source
    start: int
    end: int

    @property
    def line(self) -> int:
        return self.source.find_line_column(self.start)[0]

    @property
    def column(self) -> int:
        return self.source.find_line_column(self.start)[1]

    @property
    def text(self) -> str:
        return self.source.text[self.start : self.end]

    @property
    def place(self) -> str:
        """`name:line:column`, as errors print it."""
        return f"{self.source.name}:{self.line}:{self.column}"

    def extend_to(self, other: Span) -> Span:
        """The stretch from the start of this span to the end of the other."""
        return Span(self.source, self.start, max(self.end, other.end))

"""What runs the statements of a search: the tables of one run, in some database."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, Protocol

Row = tuple[Any, ...]


class Tables(Protocol):
    """The tables of one run. Texts are SQL of the dialect; `:name` in them stands for a value."""

    def run(self, text: str, **values: int) -> None:
        """Runs a statement."""

    def rows(self, text: str, **values: int) -> Iterator[Row]:
        """The rows of a query, read in blocks; another statement may run meanwhile."""

    def add(self, table: str, columns: Sequence[Sequence[Any]]) -> None:
        """Adds rows to a table, given by columns."""

    def interrupt(self) -> None:
        """Ends the statement that runs in another thread."""

    def close(self) -> None:
        """Lets go of everything."""

"""The paths of a search on the database: they share their rows and are put together when somebody reads them."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import TypeAlias, overload

from ss2sql.runtime.rows import Row

# A result: the number of its parent, 0 for none, and its own row.
End: TypeAlias = tuple[int, Row]


class Paths(Sequence[list[Row]]):
    """A list of paths, each a list of rows.

    `kept` holds for each step that others come from its parent's number and its row in SQL values; `decode`
    makes a row of them. A path is walked back from its end until it meets the one that was read before: so
    neighbours, which share their beginnings, cost their differences. A million paths of eight rows take 60 MB
    like this, and 250 MB as lists.
    """

    def __init__(
        self, kept: Callable[[int], tuple[int, Row]], decode: Callable[[Row], Row], ends: Sequence[End] = ()
    ) -> None:
        self._kept = kept
        self._decode = decode
        self._ends: list[End] = list(ends)

    def add(self, parent: int, row: Row) -> None:
        """One more result."""
        self._ends.append((parent, row))

    def extend(self, results: Iterable[Row]) -> None:
        """More results, as a search gives them: the number of the step, its parent's, and the row."""
        self._ends.extend((raw[1], raw[2:]) for raw in results)

    def chosen(self, positions: Sequence[int]) -> Paths:
        """The paths at these positions."""
        if isinstance(positions, range) and positions == range(len(self)):
            return self
        return Paths(self._kept, self._decode, [self._ends[position] for position in positions])

    def clear(self) -> None:
        self._ends.clear()

    def __len__(self) -> int:
        return len(self._ends)

    @overload
    def __getitem__(self, position: int) -> list[Row]: ...
    @overload
    def __getitem__(self, position: slice) -> list[list[Row]]: ...
    def __getitem__(self, position: int | slice) -> list[Row] | list[list[Row]]:
        if isinstance(position, slice):
            return list(self._read(self._ends[position]))
        return next(self._read([self._ends[position]]))

    def __iter__(self) -> Iterator[list[Row]]:
        return self._read(self._ends)

    def _read(self, ends: Sequence[End]) -> Iterator[list[Row]]:
        kept, decode = self._kept, self._decode
        steps: list[int] = []  # the steps of the path that was read last, without its end, and their rows
        rows: list[Row] = []
        places: dict[int, int] = {}
        for parent, row in ends:
            if not steps or parent != steps[-1]:
                new: list[tuple[int, Row]] = []
                step = parent
                while step and step not in places:
                    before, raw = kept(step)
                    new.append((step, raw))
                    step = before
                shared = places[step] + 1 if step else 0
                for gone in steps[shared:]:
                    del places[gone]
                del steps[shared:], rows[shared:]
                for step, raw in reversed(new):
                    places[step] = len(steps)
                    steps.append(step)
                    rows.append(decode(raw))
            yield [*rows, row]


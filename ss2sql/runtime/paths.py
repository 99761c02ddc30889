"""The paths of a search on the database: they share their rows and are put together when somebody reads them."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import islice
from operator import itemgetter
from typing import Any, TypeAlias, overload

from ss2sql.runtime.rows import Row

# A result as the statement gives it: the number of the step, that of its parent (0: none), and its row.
End: TypeAlias = tuple[Any, ...]

# The numbers of the parents, and the rows, of steps by their numbers, which a list counts from 1.
Kept: TypeAlias = Sequence[tuple[int, Row]] | Mapping[int, tuple[int, Row]]


def lengths_of(paths: Sequence[Sequence[Row]]) -> Iterator[int]:
    """The number of rows of each path."""
    return paths.lengths() if isinstance(paths, Paths) else map(len, paths)


class Paths(Sequence[list[Row]]):
    """A list of paths, each a list of rows.

    `kept` has each step that others come from, its parent's number and its row in SQL values, which `decode` makes a
    row; it is None where every such step is a result itself. A path is walked back from its end until it
    meets the one that was read before: so neighbours, which share their beginnings, cost their differences.
    """

    def __init__(
        self,
        kept: Kept | None,
        decode: Callable[[Row], Row],
        ends: Sequence[End] = (),
        all_ends: Sequence[End] | None = None,
    ) -> None:
        self._all_kept = kept
        self._kept = None if kept is None else kept.__getitem__
        self._decode = decode
        self._ends: list[End] = list(ends)
        self._all_ends = self._ends if all_ends is None else all_ends
        self._places: dict[int, int] = {}  # of steps among all results, made when first needed

    def add(self, end: End) -> None:
        """One more result."""
        self._ends.append(end)

    def extend(self, ends: Iterable[End]) -> None:
        """More results; those that came before an error are kept."""
        self._ends.extend(ends)

    def chosen(self, positions: Sequence[int]) -> Paths:
        """The paths at these positions."""
        if isinstance(positions, range) and positions == range(len(self)):
            return self
        ends = [self._ends[position] for position in positions]
        return Paths(self._all_kept, self._decode, ends, self._all_ends)

    def cells(self) -> Iterator[list[Any]]:
        """The paths, each as one flat list of values, row after row; nobody may change one before the last is made."""
        if self._kept is not None:
            for path, row in self._read(self._ends, flat=True):
                yield [*path, *row]
            return
        steps: list[int] = []  # on the path that was made last; depth first, the next one grows from one of them
        made: list[list[Any]] = []
        for end in self._ends:
            parent = end[1]
            while steps and steps[-1] != parent:
                steps.pop()
                made.pop()
            if steps or not parent:
                cells = [*made[-1], *end[2:]] if steps else [*end[2:]]
            else:
                cells = next([*path, *row] for path, row in self._read([end], flat=True))
            yield cells
            steps.append(end[0])
            made.append(cells)

    def lengths(self) -> Iterator[int]:
        """The number of rows of each path, without putting it together: every step is looked at once."""
        known = {0: 0}
        for number, parent, *_ in self._ends:
            new: list[int] = []
            step = parent
            while step not in known:
                new.append(step)
                step = self._parent(step)
            length = known[step]
            for step in reversed(new):
                length += 1
                known[step] = length
            if self._kept is None:
                known[number] = length + 1
            yield length + 1

    def kept_by_level(self) -> Counter[int]:
        """How many steps were kept at each distance from the start; a step has a greater number than its parent."""
        kept = self._all_kept or {}
        entered = kept.items() if isinstance(kept, Mapping) else islice(enumerate(kept), 1, None)
        steps: Iterable[tuple[int, int]] = ((number, parent) for number, (parent, _) in entered)
        if isinstance(kept, Mapping):
            steps = sorted({*steps, *((end[0], end[1]) for end in self._all_ends)})
        levels = {0: 0}
        for number, parent in steps:
            levels[number] = levels[parent] + 1
        counts = Counter(levels.values())
        del counts[0]
        return counts

    def depth(self, most: int) -> tuple[int, bool]:
        """How far from the start the last result is, where every step is one; whether that is all, after `most` looks.

        A step has a greater number than its parent; breadth first the results are in the order of their numbers, depth
        first the parent of one is not far before it.
        """
        ends, place, depth = self._ends, len(self._ends) - 1, 0
        wanted = ends[-1][0] if ends and self._kept is None else 0
        for _ in range(most):
            if not wanted or place < 0:
                break
            if ends[place][0] == wanted:
                wanted, depth, place = ends[place][1], depth + 1, place - 1
                continue
            found = bisect_left(ends, wanted, 0, place, key=itemgetter(0))
            place = found if ends[found][0] == wanted else place - 1
        return depth, not wanted

    def __len__(self) -> int:
        return len(self._ends)

    @overload
    def __getitem__(self, position: int) -> list[Row]: ...
    @overload
    def __getitem__(self, position: slice) -> list[list[Row]]: ...
    def __getitem__(self, position: int | slice) -> list[Row] | list[list[Row]]:
        chosen = self._ends[position] if isinstance(position, slice) else [self._ends[position]]
        paths = [[*path, row] for path, row in self._read(chosen, flat=False)]
        return paths if isinstance(position, slice) else paths[0]

    def __iter__(self) -> Iterator[list[Row]]:
        for path, row in self._read(self._ends, flat=False):
            yield [*path, row]

    def _read(self, ends: Sequence[End], flat: bool) -> Iterator[tuple[list[Any], Row]]:
        """For each result the rows before its own, as one list that changes from result to result, and its own."""
        shared: list[Any] = []  # the rows, or their cells, of the steps
        steps: list[int] = []  # on the path that was read last
        places: dict[int, int] = {}
        known = self._kept is None  # then the last result may be the parent of the next one
        width = len(ends[0]) - 2 if ends and flat else 1
        for end in ends:
            parent = end[1]
            if not steps or parent != steps[-1]:
                new: list[tuple[int, Row]] = []
                step = parent
                while step and step not in places:
                    before, row = self._step(step)
                    new.append((step, row))
                    step = before
                left = places[step] + 1 if step else 0
                for gone in steps[left:]:
                    del places[gone]
                del steps[left:], shared[left * width :]
                for step, row in reversed(new):
                    self._follow(step, row, steps, places, shared, flat)
            row = end[2:]
            yield shared, row
            if known:
                self._follow(end[0], row, steps, places, shared, flat)

    @staticmethod
    def _follow(step: int, row: Row, steps: list[int], places: dict[int, int], shared: list[Any], flat: bool) -> None:
        places[step] = len(steps)
        steps.append(step)
        if flat:
            shared.extend(row)
        else:
            shared.append(row)

    def _step(self, step: int) -> tuple[int, Row]:
        """The parent's number and the row of a step on the way to a result."""
        if self._kept is not None:
            parent, row = self._kept(step)
            return parent, self._decode(row)
        end = self._end(step)
        return end[1], end[2:]

    def _parent(self, step: int) -> int:
        """The number of a step's parent, 0 where it is the first."""
        return self._end(step)[1] if self._kept is None else self._kept(step)[0]

    def _end(self, step: int) -> End:
        """The result that a step is."""
        if not self._places:
            self._places = {end[0]: place for place, end in enumerate(self._all_ends)}
        return self._all_ends[self._places[step]]

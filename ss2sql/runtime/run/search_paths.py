"""The paths of a search: from a step back to its start, and on the database, where paths share their rows."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from itertools import chain
from typing import Any, NamedTuple, TypeAlias, overload

from ss2sql.language.rows import Row

# A step with its backpointer: that of the step before it (None: the start), its row. Paths share their beginnings, so
# that the cost of a step does not depend on the length of its path.
Backpointer: TypeAlias = tuple[Any, Row]

# The same with its frozen row and its depth: what `PathKeys` asks for.
KeyedBackpointer: TypeAlias = tuple[Any, Row, Hashable, int]

START = object()  # what is before the first row of a path


Path: TypeAlias = list[Row] | Backpointer | KeyedBackpointer | None


def follow_backpointers(backpointer: Backpointer | KeyedBackpointer | None) -> tuple[Row, ...]:
    """The rows from the start to the end of a path.

    They are a tuple, for the garbage collector soon leaves tuples of plain rows alone, but not lists. Where there are
    many paths, a third of the time of a search went into looking through them.
    """
    rows: list[Row] = []
    while backpointer is not None:
        rows.append(backpointer[1])
        backpointer = backpointer[0]
    if rows and rows[-1] is None:  # of a start that has a key
        rows.pop()
    return tuple(rows[::-1])


def make_start_backpointer(key: Hashable) -> KeyedBackpointer:
    """The place of a start that counts as visited."""
    return None, None, key, 0  # type: ignore[return-value]


def collect_path_by_parents(
    before: dict[Any, Any], key: Any, rows: dict[Any, Row] | None, last: bool
) -> tuple[Row, ...]:
    """The rows from the start to one, or the `last` one alone.

    `rows` has those of keys that are no rows, and those made so far of keys that are their only values, else is None.
    """
    path: list[Row] = []
    while key is not START:
        if rows is None:
            path.append(key)
        else:
            row = rows.get(key)
            if row is None:
                row = rows[key] = (key,)
            path.append(row)
        if last:
            break
        key = before[key]
    return tuple(path[::-1])


class PathKeys:
    """The frozen rows on the path to one place, for NO CYCLE.

    The set of rows follows the search from place to place: it gives up what lies only on the old path and
    takes what lies only on the new one. In depth-first order that is a row or two for each move, and in no
    order more than the two paths.
    """

    def __init__(self) -> None:
        self.keys: set[Hashable] = set()
        self._place: KeyedBackpointer | None = None

    def move_to(self, place: KeyedBackpointer | None) -> None:
        """Makes `keys` those of the path to a place."""
        old, new = self._place, place
        self._place = place
        gained: list[Hashable] = []
        while old is not new:
            # The deeper of the two goes back a step, until both are the same place.
            if new is None or (old is not None and old[3] >= new[3]):
                assert old is not None
                self.keys.discard(old[2])
                old = old[0]
            else:
                gained.append(new[2])
                new = new[0]
        self.keys.update(gained)


# --- the paths of a search on the database: they share their rows and are put together when somebody reads them
# A result as the statement gives it: the number of the step, that of its parent (0: none), and its row.
End: TypeAlias = tuple[Any, ...]


class KeptSteps(NamedTuple):
    """Steps by their numbers, from 1: the numbers of their parents, and their rows in SQL values."""

    parents: list[int]
    rows: list[Row]


def measure_path_lengths(paths: Sequence[Sequence[Row]]) -> Iterator[int]:
    """The number of rows of each path."""
    return paths.iterate_lengths() if isinstance(paths, SearchPaths) else map(len, paths)


class SearchPaths(Sequence[list[Row]]):
    """A list of paths, each a list of rows.

    `kept` has each step that others come from, of whose SQL values `decode` makes a row; it is None where every such
    step is a result itself. A path is walked back from its end until it meets the one that was read before: so
    neighbours, which share their beginnings, cost their differences, whether all are read in a row or one by one.
    """

    def __init__(
        self,
        kept: KeptSteps | None,
        decode: Callable[[Row], Row],
        ends: Sequence[End] = (),
        all_ends: Sequence[End] | None = None,
    ) -> None:
        self._kept = kept
        self._decode = decode  # `tuple` for rows that are values already
        self._ends: list[End] = list(ends)
        self._list_all_ends = self._ends if all_ends is None else all_ends
        self._places: dict[int, int] = {}  # of steps among all results, made when first needed
        # Stands where the path ends that was read last; another thread begins its own.
        self._idle: list[_BackpointerWalk] = []

    def add_result(self, end: End) -> None:
        self._ends.append(end)

    def add_results(self, ends: Iterable[End]) -> None:
        """More results; those that came before an error are kept."""
        self._ends.extend(ends)

    def choose_paths(self, positions: Sequence[int]) -> SearchPaths:
        """The paths at these positions."""
        if isinstance(positions, range) and positions == range(len(self)):
            return self
        ends = [self._ends[position] for position in positions]
        return SearchPaths(self._kept, self._decode, ends, self._list_all_ends)

    def iterate_cells(self) -> Iterator[list[Any]]:
        """The paths, each as one flat list of values, row after row; nobody may change one before the last is made."""
        if self._kept is not None:
            for path, row in self._read_paths(self._ends, flat=True):
                yield [*path, *row]
            return
        walk = self._make_walk(self._width)
        made: dict[int, list[Any]] = {0: []}  # the next ones grow from them
        for end in self._ends:
            before = made.get(end[1])
            if before is None:  # its parent is not among these results
                before = walk.collect_rows_before(end)
            made[end[0]] = cells = [*before, *end[2:]]
            yield cells

    def iterate_lengths(self) -> Iterator[int]:
        """The number of rows of each path, without putting it together: every step is looked at once."""
        known, parent_of = {0: 0}, self._parent_of
        for number, parent, *_ in self._ends:
            new: list[int] = []
            step = parent
            while step not in known:
                new.append(step)
                step = parent_of(step)
            length = known[step]
            for step in reversed(new):
                length += 1
                known[step] = length
            if self._kept is None:
                known[number] = length + 1
            yield length + 1

    def count_kept_by_level(self) -> Counter[int]:
        """How many steps were kept at each distance from the start; a step has a greater number than its parent."""
        kept, levels = self._kept, {0: 0}
        steps = sorted(end[:2] for end in self._list_all_ends) if kept is None else enumerate(kept.parents[1:], 1)
        for number, parent in steps:
            levels[number] = levels[parent] + 1
        counts = Counter(levels.values())
        del counts[0]
        return counts

    def __len__(self) -> int:
        return len(self._ends)

    @property
    def _width(self) -> int:
        return len(self._ends[0]) - 2 if self._ends else 0

    @overload
    def __getitem__(self, position: int) -> list[Row]: ...
    @overload
    def __getitem__(self, position: slice) -> list[list[Row]]: ...
    def __getitem__(self, position: int | slice) -> list[Row] | list[list[Row]]:
        if isinstance(position, slice):
            return [[*path, row] for path, row in self._read_paths(self._ends[position], flat=False)]
        end = self._ends[position]
        try:
            walk = self._idle.pop()
        except IndexError:
            walk = self._make_walk(0)
        path = [*walk.collect_rows_before(end), end[2:]]
        self._idle = [walk]
        return path

    def __iter__(self) -> Iterator[list[Row]]:
        for path, row in self._read_paths(self._ends, flat=False):
            yield [*path, row]

    def _read_paths(self, ends: Sequence[End], flat: bool) -> Iterator[tuple[list[Any], Row]]:
        """For each result the rows before its own, as one list that changes from result to result, and its own."""
        walk = self._make_walk(self._width if flat else 0)
        known = self._kept is None  # then the last result may be the parent of the next one
        for end in ends:
            yield walk.collect_rows_before(end), end[2:]
            if known:
                walk.add_step(end[0], end[2:])

    def _make_walk(self, width: int) -> _BackpointerWalk:
        """A walk from path to path that gives cells, `width` of a row, or rows where that is 0."""
        if self._kept is None:
            return _BackpointerWalk(self._parent_of, lambda step: self._get_end(step)[2:], None, width)
        decode = None if self._decode is tuple else self._decode
        return _BackpointerWalk(self._parent_of, self._kept.rows.__getitem__, decode, width)

    @property
    def _parent_of(self) -> Callable[[int], int]:
        """What gives the number of a step's parent, 0 where it is the first."""
        return (lambda step: self._get_end(step)[1]) if self._kept is None else self._kept.parents.__getitem__

    def _get_end(self, step: int) -> End:
        if not self._places:
            self._places = {end[0]: place for place, end in enumerate(self._list_all_ends)}
        return self._list_all_ends[self._places[step]]


class _BackpointerWalk:
    """From path to path: the rows before the end of the one that was read last, or their cells, `width` of a row.

    `parent_of` gives the number of a step's parent, `row_of` its row, which `decode` makes values.
    """

    __slots__ = ("_decode", "_parent_of", "_places", "_row_of", "_shared", "_steps", "_width")

    def __init__(
        self,
        parent_of: Callable[[int], int],
        row_of: Callable[[int], Row],
        decode: Callable[[Row], Row] | None,
        width: int,
    ) -> None:
        self._parent_of = parent_of
        self._row_of = row_of
        self._decode = decode
        self._width = width
        self._shared: list[Any] = []
        self._steps: list[int] = []  # those on the path
        self._places: dict[int, int] = {}  # of these on it; the last ones are noted when they are needed

    def collect_rows_before(self, end: End) -> list[Any]:
        """The rows, or the cells, on the path to the parent of a result; the list changes with the next call."""
        step, steps, parent_of = end[1], self._steps, self._parent_of
        if steps and step == steps[-1]:
            return self._shared
        places = self._places
        places.update(zip(steps[len(places) :], range(len(places), len(steps)), strict=True))
        new: list[int] = []
        while step and step not in places:
            new.append(step)
            step = parent_of(step)
        left = places[step] + 1 if step else 0
        for gone in steps[left:]:
            del places[gone]
        del steps[left:], self._shared[left * (self._width or 1) :]
        new.reverse()
        steps += new
        rows = map(self._row_of, new)
        decoded = rows if self._decode is None else map(self._decode, rows)
        self._shared.extend(chain.from_iterable(decoded) if self._width else decoded)
        return self._shared

    def add_step(self, step: int, row: Row) -> None:
        """One more step on the path, which is a result."""
        self._steps.append(step)
        if self._width:
            self._shared.extend(row)
        else:
            self._shared.append(row)

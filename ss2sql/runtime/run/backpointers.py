"""Backpointers: the path from a step of a search back to its start, and the rows on the path to it for NO CYCLE."""

from __future__ import annotations

from collections.abc import Hashable
from typing import Any, NamedTuple, TypeAlias

from ss2sql.language.rows import Row

# A step with its backpointer: that of the step before it (None: the start), its row. Paths share their beginnings, so
# that the cost of a step does not depend on the length of its path.
Backpointer: TypeAlias = tuple[Any, Row]

# The same with its frozen row and its depth: what `PathKeys` asks for.
KeyedBackpointer: TypeAlias = tuple[Any, Row, Hashable, int]

START = object()  # what is before the first row of a path


class Parents(NamedTuple):
    """A row that is reached once, with the key of the row before each such row."""

    before: dict[Any, Any]
    key: Any


Path: TypeAlias = list[Row] | Backpointer | KeyedBackpointer | Parents | None


def follow_backpointers(backpointer: Backpointer | KeyedBackpointer | None) -> tuple[Row, ...]:
    """The rows from the start to the end of a way.

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


def measure_depth(path: Path, most: float = float("inf")) -> tuple[int, bool]:
    """The number of steps from the start, `most` at the most, and whether these are all."""
    if type(path) is list:
        return len(path), True
    if type(path) is tuple and len(path) == 4:
        return path[3], True
    depth, end = 0, None
    at: Any = path
    before: dict[Any, Any] | None = None
    if isinstance(path, Parents):
        end, (before, at) = START, path
    while at is not end and depth < most:
        at = at[0] if before is None else before[at]
        depth += 1
    return depth, at is end


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

"""Helper functions of the SQL that lowering writes: they build, take apart and collect values of the pool."""

from __future__ import annotations

from collections.abc import Callable
from operator import itemgetter
from typing import Any

from ss2sql.kinds import Kind
from ss2sql.language.operations import GROUPS
from ss2sql.runtime.element_columns import column_of
from ss2sql.runtime.pool import Pool
from ss2sql.runtime.representations.base import Table
from ss2sql.runtime.representations.rows_as_values import as_set
from ss2sql.runtime.sources import elements
from ss2sql.runtime.values import normalise
from ss2sql.vtables.frames.frame import Frame
from ss2sql.vtables.sequences import Walked

WHOLE = 2**63  # more rows than any query has


def make_list(pool: Pool, *items: Any) -> Any:
    """`list(a, b)`: a list literal."""
    return pool.made(list(map(pool.decode, items)))


def record(pool: Pool, *pairs: Any) -> Any:
    """`record('name', value, ...)`: a row as a dict."""
    return pool.made(dict(zip(pairs[::2], map(pool.decode, pairs[1::2]), strict=True)))


def in_turn(pool: Pool, *values: Any) -> Any:
    """`in_turn(a, b)`: b, after a has been evaluated."""
    return values[-1]


def key_of(pool: Pool, value: Any) -> Any:
    """`as_key(a)`: the same SQL value for all values that equal a, for SQLite's own equality."""
    return pool.key(value)


SCALAR_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "list": make_list,
    "record": record,
    "in_turn": in_turn,
    "as_key": key_of,
}


def element_columns(pool: Pool, value: Any, columns: tuple[str, ...]) -> Walked:
    """The elements of a source's value as columns of SQL values: the elements themselves, then their `columns`."""
    given = pool.decode(value)
    encode = pool.encode
    if isinstance(given, Frame):
        return _frame_columns(pool, value, given, columns)
    items = elements(given)
    dicts: bool | None = None  # whether they are; nobody knows yet

    def make(number: int) -> list[Any]:
        nonlocal dicts
        if number and dicts is None:
            dicts = set(map(type, items)) == {dict}
        parts = _parts_of(items, columns[number - 1], dicts is True) if number else items
        return parts if NUMBERS.issuperset(map(type, parts)) else list(map(encode, parts))

    return Walked(value, len(items), len(columns) + 1, make)


def _parts_of(items: list[Any], name: str, dicts: bool) -> list[Any]:
    """A column of elements, with None where one lacks it; of 10,000 dicts it takes 0.15 ms, one by one 3 ms."""
    if dicts:
        try:
            return list(map(itemgetter(name), items))
        except KeyError:
            return [item.get(name) for item in items]
    return [_part_of(item, name) for item in items]


def _frame_columns(pool: Pool, handle: Any, frame: Frame, columns: tuple[str, ...]) -> Walked:
    """The columns of a data frame as they are read; numbers and texts are SQL values already."""

    def make(number: int) -> list[Any]:
        if number == 0:
            return list(map(pool.encode, frame.elements()))
        column = frame.columns[columns[number - 1]]
        return column.values if column.type.only(_AS_IT_IS) else list(map(pool.encode, column.values))

    return Walked(handle, frame.length, len(columns) + 1, make)


NUMBERS = frozenset({int, float, type(None)})  # which are SQL values as they are
_AS_IT_IS = Kind.NONE | Kind.INT | Kind.FLOAT | Kind.STR


def _part_of(element: Any, name: str) -> Any:
    """The column of an element; that of a list is one of its own elements, see lowering/positions.py."""
    if type(element) is list:
        return element[int(name.removeprefix("this_"))]
    return column_of(element, name, None)


class Collect:
    """`collect(a, b)`: all values, row after row, as one list."""

    def __init__(self, pool: Pool) -> None:
        self.pool = pool
        self.values: list[Any] = []
        self.room = pool.sizes.rows_of_a_list()

    def step(self, *row: Any) -> None:
        if self.has_room():
            self.values.extend(map(self.pool.decode, row))

    def has_room(self) -> bool:
        """Whether one more row is none too many. What raises here would not end the statement, so the run does."""
        self.room -= 1
        if self.room < 0:
            self.pool.sizes.refused = self.pool.sizes.too_many_rows()
        return self.room >= 0

    def final(self) -> Any:
        """The value. What this raises ends no statement: apsw goes on and complains of the exception that is under way.

        It calls no function of the user any more. The run raises what was refused in place of that complaint.
        """
        sizes = self.pool.sizes
        try:
            if sizes.refused is not None:
                raise sizes.refused
            return self.value()
        except Exception as error:
            sizes.refused = error
            raise

    def value(self) -> Any:
        return self.pool.made(self.values)


class CollectRows(Collect):
    """`collect_rows(a, b)`: a list of rows, each a list."""

    def step(self, *row: Any) -> None:
        if self.has_room():
            self.values.append(list(map(self.pool.decode, row)))


class CollectRecords(Collect):
    """`collect_records('a', a, 'b', b)`: a list of rows, each a dict."""

    def step(self, *pairs: Any) -> None:
        if self.has_room():
            self.values.append(dict(zip(pairs[::2], map(self.pool.decode, pairs[1::2]), strict=True)))


class CollectSet(CollectRows):
    """`collect_set(a, b)`: the different values; inside a script a set is a sorted list."""

    def value(self) -> Any:
        rows = [tuple(row) for row in self.values]
        return self.pool.made(normalise(as_set(Table((), rows)), "AS set"))


class CollectNothing(Collect):
    """`collect_nothing(a, b)`: the rows are evaluated, the value is None."""

    def __init__(self, pool: Pool) -> None:
        super().__init__(pool)
        self.room = WHOLE if pool.sizes.rows is None else pool.sizes.rows

    def step(self, *row: Any) -> None:
        self.has_room()

    def value(self) -> Any:
        return None


class CollectValue(Collect):
    """`collect_value(a, b)`: a of the first row, after all rows have been evaluated; nobody keeps the others."""

    def step(self, *row: Any) -> None:
        if not self.values:
            self.values.append(row[0])

    def value(self) -> Any:
        return self.values[0] if self.values else None


def _aggregate(name: str) -> Callable[[Pool], Collect]:
    """`group_sum(value, place)` and its kin: the language's aggregates over a group."""

    class Aggregate(Collect):
        place = ""

        def step(self, value: Any, place: str) -> None:
            self.place = place
            self.values.append(self.pool.decode(value))

        def value(self) -> Any:
            return self.pool.encode(GROUPS[name].of_group(self.values))

    return Aggregate


AGGREGATE_FUNCTIONS: dict[str, Callable[[Pool], Collect]] = {
    "collect": Collect,
    "collect_rows": CollectRows,
    "collect_records": CollectRecords,
    "collect_set": CollectSet,
    "collect_nothing": CollectNothing,
    "collect_value": CollectValue,
    **{f"group_{name}": _aggregate(name) for name in GROUPS},
}

"""Helper functions of the SQL that lowering writes: they build, take apart and collect values of the pool."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ss2sql.runtime.builtins import AGGREGATES
from ss2sql.runtime.pool import Pool
from ss2sql.runtime.representations import Table, sets
from ss2sql.runtime.sources import column_of, elements
from ss2sql.runtime.values import truth


def make_list(pool: Pool, *items: Any) -> Any:
    """`list(a, b)`: a list literal."""
    return pool.encode(list(map(pool.decode, items)))


def record(pool: Pool, *pairs: Any) -> Any:
    """`record('name', value, ...)`: a row as a dict."""
    return pool.encode(dict(zip(pairs[::2], map(pool.decode, pairs[1::2]), strict=True)))


def truth_of(pool: Pool, value: Any) -> int:
    """`truth(value)`: Python's truth as 0 or 1."""
    return int(truth(pool.decode(value)))


def in_turn(pool: Pool, *values: Any) -> Any:
    """`in_turn(a, b)`: b, after a has been evaluated."""
    return values[-1]


SCALAR_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "list": make_list,
    "record": record,
    "truth": truth_of,
    "in_turn": in_turn,
}


def element_columns(pool: Pool, value: Any, columns: tuple[str, ...]) -> list[list[Any]]:
    """The elements of a source's value as columns of SQL values: the elements themselves, then their `columns`."""
    items = elements(pool.decode(value))
    encode = pool.encode
    return [list(map(encode, items)), *([encode(_part_of(item, name)) for item in items] for name in columns)]


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

    def step(self, *row: Any) -> None:
        self.values.extend(map(self.pool.decode, row))

    def final(self) -> Any:
        return self.pool.encode(self.values)


class CollectRows(Collect):
    """`collect_rows(a, b)`: a list of rows, each a list."""

    def step(self, *row: Any) -> None:
        self.values.append(list(map(self.pool.decode, row)))


class CollectRecords(Collect):
    """`collect_records('a', a, 'b', b)`: a list of rows, each a dict."""

    def step(self, *pairs: Any) -> None:
        self.values.append(dict(zip(pairs[::2], map(self.pool.decode, pairs[1::2]), strict=True)))


class CollectSet(CollectRows):
    """`collect_set(a, b)`: the different values; inside a script a set is a sorted list."""

    def final(self) -> Any:
        rows = [tuple(row) for row in self.values]
        return self.pool.encode_foreign(sets.represent(Table((), rows)), "AS set")


class CollectValue(CollectRows):
    """`collect_value(a, b)`: a of the first row, after all rows have been evaluated."""

    def final(self) -> Any:
        return self.pool.encode(self.values[0][0] if self.values else None)


class CollectNothing(Collect):
    """`collect_nothing(a, b)`: the rows are evaluated, the value is None."""

    def step(self, *row: Any) -> None:
        return

    def final(self) -> None:
        return None


def _aggregate(name: str) -> Callable[[Pool], Collect]:
    """`group_sum(value, place)` and its kin: the language's aggregates over a group."""

    class Aggregate(Collect):
        place = ""

        def step(self, value: Any, place: str) -> None:
            self.place = place
            self.values.append(self.pool.decode(value))

        def final(self) -> Any:
            return self.pool.encode(AGGREGATES[name](self.values))

    return Aggregate


AGGREGATE_FUNCTIONS: dict[str, Callable[[Pool], Collect]] = {
    "collect": Collect,
    "collect_rows": CollectRows,
    "collect_records": CollectRecords,
    "collect_set": CollectSet,
    "collect_nothing": CollectNothing,
    "collect_value": CollectValue,
    **{f"group_{name}": _aggregate(name) for name in AGGREGATES},
}

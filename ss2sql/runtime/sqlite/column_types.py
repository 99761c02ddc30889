"""What the data of a table or view show of its columns: the kinds of values, and bounds of the numbers.

SQLite does not enforce declared types, so all rows are looked at, once for each state of the database. For a million
rows of three numbers and a text that takes 0.16 s, for one column of integers 0.08 s. A column that is the rowid takes
none. Columns that a script does not read are not looked at.

What a view computes may have no end, so it is looked at for a while only. That is counted in steps of SQLite's virtual
machine: one that is too long for this is so on every machine, and its columns may then hold values of all kinds.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import apsw

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.kinds import Kind, Type, widen_number_type

_KINDS = {"null": Kind.NONE, "integer": Kind.INT, "real": Kind.FLOAT, "text": Kind.STR, "blob": Kind.OBJECT}
NUMBER = Kind.INT | Kind.FLOAT
STORED = NUMBER | Kind.NONE | Kind.STR | Kind.OBJECT
# As of two million steps, which take 0.05 s: some 150,000 rows of a view of four columns.
EVERY, TIMES = 10_000, 200


class _TooManyStepsError(Exception):
    """A view takes longer than somebody who only wants to know its columns waits. It never leaves this module."""


@dataclass(frozen=True, slots=True)
class DatabaseColumn:
    """A column with its declared type. `leads_index`: an index, or the table itself, is sorted by its values."""

    name: str
    declared: str = ""
    leads_index: bool = False
    rowid: bool = False

    @property
    def quoted(self) -> str:
        return quote_sqlite_name(self.name)

    @property
    def numeric(self) -> bool:
        """Whether SQLite makes numbers of texts that it is compared with."""
        declared = self.declared.upper()
        others = ("CHAR", "CLOB", "TEXT", "BLOB")
        return "INT" in declared or (declared != "" and not any(word in declared for word in others))


def quote_sqlite_name(name: str) -> str:
    """A name as SQL reads it whatever characters it has."""
    return '"' + name.replace('"', '""') + '"'


def infer_table_types(connection: apsw.Connection, table: str, columns: Sequence[DatabaseColumn]) -> dict[str, Type]:
    """The types of the columns of a table. Raises what apsw raises."""
    kinds = _find_column_kinds(connection, table, columns)
    return {name: Type(found) for name, found in kinds.items()} | _find_sqlite_bounds(connection, table, columns, kinds)


def infer_view_types(connection: apsw.Connection, view: str, columns: Sequence[DatabaseColumn]) -> dict[str, Type]:
    """The same of a view, without bounds: what it computes may change with every look at it, as random() does.

    Infinities are looked for all the same: `a * 0` is None in SQLite where `a` is infinite, and NaN in Python.
    """
    try:
        with _limit_sqlite_steps(connection):
            found = infer_table_types(connection, view, columns)
    except _TooManyStepsError:
        return {column.name: Type(STORED) for column in columns}
    return {name: Type(known.kinds) for name, known in found.items()}


@contextmanager
def _limit_sqlite_steps(connection: apsw.Connection) -> Iterator[None]:
    left = TIMES

    def count_step() -> bool:
        nonlocal left
        left -= 1
        if left < 0:
            raise _TooManyStepsError
        return False

    connection.set_progress_handler(count_step, EVERY, id=count_step)
    try:
        yield
    finally:
        connection.set_progress_handler(None, id=count_step)


def _find_column_kinds(connection: apsw.Connection, table: str, columns: Sequence[DatabaseColumn]) -> dict[str, Kind]:
    kinds = {column.name: Kind.INT if column.rowid else Kind(0) for column in columns}
    tested = [column for column in columns if not column.rowid]
    tests = ", ".join(f"typeof({column.quoted})" for column in tested)
    found: list[tuple[Any, ...]] = []
    if tested:
        found = connection.execute(f"SELECT DISTINCT {tests} FROM {table}").fetchall()
    for row in found:
        for column, word in zip(tested, row, strict=True):
            kinds[column.name] |= _KINDS[word]
    return kinds


def _find_sqlite_bounds(
    connection: apsw.Connection, table: str, columns: Sequence[DatabaseColumn], kinds: Mapping[str, Kind]
) -> dict[str, Type]:
    """The types of the columns that hold numbers and None alone.

    In a query that asks for one end only, SQLite takes it from an index that begins with the column.
    """
    numbers = [one for one in columns if kinds[one.name] & NUMBER and not kinds[one.name] & ~(NUMBER | Kind.NONE)]
    if not numbers:
        return {}
    terms = []
    for column in numbers:
        ends = [f"{end}({column.quoted})" for end in ("min", "max")]
        terms += [f"(SELECT {end} FROM {table})" for end in ends] if column.leads_index else ends
    walked = "" if all(column.leads_index for column in numbers) else f" FROM {table}"
    found: tuple[Any, ...]
    (found,) = connection.execute(f"SELECT {', '.join(terms)}{walked}").fetchall()
    return {
        column.name: widen_number_type(kinds[column.name], low, high)
        for column, low, high in zip(numbers, found[::2], found[1::2], strict=True)
    }

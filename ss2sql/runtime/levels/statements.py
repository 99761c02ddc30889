"""Statements over whole tables, written once and printed for each dialect."""

from __future__ import annotations

from functools import cache
from typing import Any, TypeAlias

import sqlglot

from ss2sql.lowering.dialects import Dialect
from ss2sql.records import dataclass


@dataclass(frozen=True, slots=True)
class Create:
    """Makes an empty table; `columns` are names with their types."""

    table: str
    columns: str

    @property
    def text(self) -> str:
        return f"CREATE TABLE {self.table}({self.columns})"


@dataclass(frozen=True, slots=True)
class Make:
    """Makes a table of the rows of a query."""

    table: str
    select: str

    @property
    def text(self) -> str:
        return f"CREATE TABLE {self.table} AS {self.select}"


@dataclass(frozen=True, slots=True)
class Number:
    """Makes a table of the rows of a query and a column `step`, which counts them in `order` from `:before` + 1."""

    table: str
    select: str
    order: str = "place"

    @property
    def query(self) -> str:
        return _numbered(self.select, self.order)

    @property
    def text(self) -> str:
        return f"CREATE TABLE {self.table} AS {self.query}"


@dataclass(frozen=True, slots=True)
class Walk:
    """Makes a table of the rows of `first`, and of `then` as long as it has any; there the rows before are `walk`."""

    table: str
    columns: str
    first: str
    then: str

    @property
    def text(self) -> str:
        walk = f"WITH RECURSIVE walk({self.columns}) AS ({self.first} UNION ALL {self.then})"
        return f"CREATE TABLE {self.table} AS {walk} SELECT {self.columns} FROM walk"


@dataclass(frozen=True, slots=True)
class Add:
    """Adds the rows of a query to a table."""

    table: str
    select: str

    @property
    def text(self) -> str:
        return f"INSERT INTO {self.table} {self.select}"


@dataclass(frozen=True, slots=True)
class AddNumbered:
    """Adds the rows of a query to a table, numbered as by `Number`; `columns` are those of the table."""

    table: str
    columns: str
    select: str

    @property
    def text(self) -> str:
        return f"INSERT INTO {self.table} SELECT {self.columns} FROM ({_numbered(self.select, 'place')}) AS numbered"


@dataclass(frozen=True, slots=True)
class Drop:
    table: str

    @property
    def text(self) -> str:
        return f"DROP TABLE {self.table}"


@dataclass(frozen=True, slots=True)
class Ask:
    """A query whose rows are wanted; `simple` if there is one way to run it, however many rows the tables have."""

    select: str
    simple: bool = False

    @property
    def text(self) -> str:
        return self.select


Statement: TypeAlias = Create | Make | Number | Walk | Add | AddNumbered | Drop | Ask

Value: TypeAlias = int | float | str | list[Any] | None  # what stands in a statement for `:name`


def _numbered(select: str, order: str) -> str:
    return f"SELECT ROW_NUMBER() OVER (ORDER BY {order}) + :before AS step, * FROM ({select}) AS unnumbered"


def listed(*columns: object) -> str:
    return ", ".join(map(str, columns))


def columns_of(written: str) -> list[tuple[str, str]]:
    """The names and the types of columns that are written as in `Create`."""
    return [(name, kind) for name, kind in (column.split() for column in written.split(", "))]


@cache
def printed(dialect: Dialect, text: str) -> str:
    """A text, written for DuckDB, in a dialect; to read and to write one takes a millisecond."""
    return dialect.print(sqlglot.parse_one(text, read="duckdb"))

"""Statements over whole tables: written once, for DuckDB, and printed for each dialect."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from typing import Any, TypeAlias

import sqlglot

from ss2sql.lowering.dialects import Dialect
from ss2sql.lowering.portable.search_steps import TypedColumn

Value: TypeAlias = int | float | str | list[Any] | None  # what stands in a statement for `:name`


def join_names(*columns: object) -> str:
    return ", ".join(map(str, columns))


def list_names(columns: Iterable[TypedColumn]) -> list[str]:
    return [column.name for column in columns]


@cache
def translate_sql(dialect: Dialect, text: str) -> str:
    """A text, written for DuckDB, in a dialect; to read and to write one takes a millisecond."""
    return dialect.print_tree(sqlglot.parse_one(text, read="duckdb"))

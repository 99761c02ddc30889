"""Statements over whole tables, written once for DuckDB and Spark: their ends, and columns as those of Arrow."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any, TypeAlias

import sqlglot

from ss2sql.lowering.portable.search_steps import TypedColumn
from ss2sql.lowering.sql_builder import Dialect
from ss2sql.runtime.run.run_state import Run

if TYPE_CHECKING:
    import pyarrow as pa  # type: ignore[import-untyped]


Value: TypeAlias = int | float | str | list[Any] | None  # what stands in a statement for `:name`


def join_column_names(*columns: object) -> str:
    return ", ".join(map(str, columns))


def list_duckdb_columns(columns: Iterable[TypedColumn]) -> list[str]:
    return [column.name for column in columns]


@cache
def translate_duckdb_sql(dialect: Dialect, text: str) -> str:
    """A text, written for DuckDB, in a dialect; to read and to write one takes a millisecond."""
    return dialect.print_tree(sqlglot.parse_one(text, read="duckdb"))


def build_batch(columns: Sequence[TypedColumn], values: Sequence[Sequence[Any]]) -> pa.RecordBatch:
    import pyarrow as pa

    schema = make_schema(tuple(columns))
    arrays = [pa.array(column, field.type) for column, field in zip(values, schema, strict=True)]
    return pa.record_batch(arrays, schema=schema)


def batch_of_rows(columns: Sequence[TypedColumn], rows: Sequence[Sequence[Any]]) -> pa.RecordBatch:
    return build_batch(columns, list(zip(*rows, strict=True)) or [()] * len(columns))


def table_of_rows(columns: Sequence[TypedColumn], rows: Sequence[Sequence[Any]]) -> pa.Table:
    import pyarrow as pa

    return pa.Table.from_batches([batch_of_rows(columns, rows)])


def number_rows(columns: Sequence[TypedColumn], rows: pa.Table) -> pa.Table:
    """The rows with their numbers in front; `columns` says what the columns are."""
    import numpy as np
    import pyarrow as pa

    return pa.table([pa.array(np.arange(len(rows))), *rows.columns], schema=make_schema(tuple(columns)))


@cache
def make_schema(columns: tuple[TypedColumn, ...]) -> pa.Schema:
    """The columns as those of Arrow."""
    import pyarrow as pa

    return pa.schema([(column.name, _get_duckdb_arrow_type(column.type)) for column in columns])


def _get_duckdb_arrow_type(kind: str) -> pa.DataType:
    import pyarrow as pa

    if kind.endswith("[]"):
        return pa.list_(_get_duckdb_arrow_type(kind.removesuffix("[]")))
    if kind.startswith("STRUCT("):
        fields = (field.split(" ") for field in kind[len("STRUCT(") : -1].split(", "))
        return pa.struct([(name, _get_duckdb_arrow_type(inner)) for name, inner in fields])
    scalars = {
        "BIGINT": pa.int64(),
        "BLOB": pa.binary(),
        "BOOLEAN": pa.bool_(),
        "DOUBLE": pa.float64(),
        "VARCHAR": pa.string(),
    }
    return scalars[kind]


# --- ending a statement that works on whole tables when its run has to end
CHECK_SECONDS = 0.02  # seconds


@contextmanager
def interrupt_when_due(run: Run, interrupt: Callable[[], object]) -> Iterator[None]:
    """Has a thread of its own look whether the run is interrupted or late, for as long as it takes.

    `interrupt` ends the statement that runs; it may be called again until the run has ended.
    """
    over = threading.Event()

    def watch_run() -> None:
        while not over.wait(CHECK_SECONDS):
            if run.interrupted or (run.bounds.deadline is not None and time.monotonic() >= run.bounds.deadline):
                interrupt()  # again and again: it may have come between two statements

    thread = threading.Thread(target=watch_run, daemon=True)
    thread.start()
    try:
        yield
    except Exception:
        run.check()  # what the database says about it comes second
        raise
    finally:
        over.set()
        thread.join()

"""The elements of values as tables for DuckDB."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ss2sql.language.element_columns import read_column
from ss2sql.lowering.portable.portable_from import NUMBER_COLUMN
from ss2sql.lowering.portable.pushdown import LoadedTable
from ss2sql.lowering.portable.search_steps import TypedColumn
from ss2sql.lowering.portable.sql_types import get_column_type
from ss2sql.runtime.external.arrow_columns import build_batch
from ss2sql.runtime.run.elements import list_elements
from ss2sql.vtables.frames.frame import Frame


def collect_loaded_columns(table: LoadedTable, value: Any) -> list[Sequence[Any]]:
    """The numbers of the elements of a value, and what is read of them, by columns."""
    if isinstance(value, Frame):
        return [range(value.length), *(value.columns[key].values for key in table.columns if key is not None)]
    rows = list_elements(value)
    found = (rows if key is None else [read_column(row, key, None) for row in rows] for key in table.columns)
    return [range(len(rows)), *found]


def build_arrow_table(table: LoadedTable, columns: list[Sequence[Any]]) -> Any:
    import pyarrow as pa  # type: ignore[import-untyped]

    typed = [TypedColumn(name, get_column_type(kind) or "") for name, kind in table.columns.values()]
    return pa.Table.from_batches([build_batch([TypedColumn(NUMBER_COLUMN, "BIGINT"), *typed], columns)])

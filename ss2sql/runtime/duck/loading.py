"""The elements of values as tables for DuckDB."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ss2sql.lowering.portable.here import Loaded
from ss2sql.lowering.portable.sources import NUMBER
from ss2sql.lowering.portable.steps import Typed
from ss2sql.lowering.portable.types import column_type
from ss2sql.runtime.element_columns import column_of
from ss2sql.runtime.levels.arrow import batch
from ss2sql.runtime.sources import elements
from ss2sql.vtables.frames.frame import Frame


def columns_of(table: Loaded, value: Any) -> list[Sequence[Any]]:
    """The numbers of the elements of a value, and what is read of them, by columns."""
    if isinstance(value, Frame):
        return [range(value.length), *(value.columns[key].values for key in table.columns if key is not None)]
    rows = elements(value)
    found = (rows if key is None else [column_of(row, key, None) for row in rows] for key in table.columns)
    return [range(len(rows)), *found]


def as_arrow(table: Loaded, columns: list[Sequence[Any]]) -> Any:
    import pyarrow as pa  # type: ignore[import-untyped]

    typed = [Typed(name, column_type(kind) or "") for name, kind in table.columns.values()]
    return pa.Table.from_batches([batch([Typed(NUMBER, "BIGINT"), *typed], columns)])

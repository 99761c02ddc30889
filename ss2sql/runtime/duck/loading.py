"""The elements of values as tables for DuckDB."""

from __future__ import annotations

from typing import Any

from ss2sql.lowering.portable.here import Loaded
from ss2sql.lowering.portable.sources import NUMBER
from ss2sql.lowering.portable.types import column_type
from ss2sql.runtime.sources import column_of, elements
from ss2sql.vtables.frames.frame import Frame


def columns_of(table: Loaded, value: Any) -> dict[str, list[Any]]:
    """What is read of the elements of a value, by columns with a number for each element."""
    if isinstance(value, Frame):
        found = {name: value.columns[key].values for key, (name, _) in table.columns.items() if key is not None}
        return {NUMBER: list(range(value.length)), **found}
    rows = elements(value)
    found = {
        name: rows if key is None else [column_of(row, key, None) for row in rows]
        for key, (name, _) in table.columns.items()
    }
    return {NUMBER: list(range(len(rows))), **found}


def as_arrow(table: Loaded, columns: dict[str, list[Any]]) -> Any:
    import pyarrow as pa  # type: ignore[import-untyped]

    kinds = {NUMBER: "BIGINT", **{name: column_type(kind) or "" for name, kind in table.columns.values()}}
    return pa.table({name: pa.array(values, arrow_type(kinds[name])) for name, values in columns.items()})


def arrow_type(kind: str) -> Any:
    """The type of Arrow for a column."""
    import pyarrow as pa

    if kind.endswith("[]"):
        return pa.list_(arrow_type(kind.removesuffix("[]")))
    return {"BIGINT": pa.int64(), "BOOLEAN": pa.bool_(), "DOUBLE": pa.float64(), "VARCHAR": pa.string()}[kind]

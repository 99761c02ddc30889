"""Columns of tables as those of Arrow."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from ss2sql.lowering.portable.search_steps import TypedColumn

if TYPE_CHECKING:
    import pyarrow as pa  # type: ignore[import-untyped]


def build_batch(columns: Sequence[TypedColumn], values: Sequence[Sequence[Any]]) -> pa.RecordBatch:
    import pyarrow as pa

    schema = _make_schema(tuple(columns))
    arrays = [pa.array(column, field.type) for column, field in zip(values, schema, strict=True)]
    return pa.record_batch(arrays, schema=schema)


def batch_of_rows(columns: Sequence[TypedColumn], rows: Sequence[Sequence[Any]]) -> pa.RecordBatch:
    return build_batch(columns, list(zip(*rows, strict=True)) or [()] * len(columns))


@cache
def _make_schema(columns: tuple[TypedColumn, ...]) -> pa.Schema:
    import pyarrow as pa

    return pa.schema([(column.name, _get_arrow_type(column.type)) for column in columns])


def _get_arrow_type(kind: str) -> pa.DataType:
    import pyarrow as pa

    if kind.endswith("[]"):
        return pa.list_(_get_arrow_type(kind.removesuffix("[]")))
    if kind.startswith("STRUCT("):
        fields = (field.split(" ") for field in kind[len("STRUCT(") : -1].split(", "))
        return pa.struct([(name, _get_arrow_type(inner)) for name, inner in fields])
    scalars = {
        "BIGINT": pa.int64(),
        "BLOB": pa.binary(),
        "BOOLEAN": pa.bool_(),
        "DOUBLE": pa.float64(),
        "VARCHAR": pa.string(),
    }
    return scalars[kind]

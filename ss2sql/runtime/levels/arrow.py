"""Columns of tables as those of Arrow."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any

from ss2sql.runtime.levels.statements import columns_of

if TYPE_CHECKING:
    import pyarrow as pa  # type: ignore[import-untyped]


def batch(written: str, columns: Sequence[Sequence[Any]]) -> pa.RecordBatch:
    """Values by columns, which are written as in `Create`."""
    import pyarrow as pa

    made = schema(written)
    arrays = [pa.array(values, field.type) for values, field in zip(columns, made, strict=True)]
    return pa.record_batch(arrays, schema=made)


@cache
def schema(written: str) -> pa.Schema:
    import pyarrow as pa

    return pa.schema([(name, _arrow(kind)) for name, kind in columns_of(written)])


def _arrow(kind: str) -> pa.DataType:
    """The type of Arrow for a column."""
    import pyarrow as pa

    if kind.endswith("[]"):
        return pa.list_(_arrow(kind.removesuffix("[]")))
    scalars = {
        "BIGINT": pa.int64(),
        "BLOB": pa.binary(),
        "BOOLEAN": pa.bool_(),
        "DOUBLE": pa.float64(),
        "VARCHAR": pa.string(),
    }
    return scalars[kind]

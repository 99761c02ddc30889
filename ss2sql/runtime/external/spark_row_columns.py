"""Columns of rows that are bytes, made by the executors of Spark: what they consist of, and their values."""

from __future__ import annotations

import pickle
from collections.abc import Iterator, Sequence
from functools import reduce
from marshal import loads
from typing import TYPE_CHECKING, Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.column_shapes import NONE, Shape, get_shape, is_untyped, make_arrow_type, merge_shapes, to_floats
from ss2sql.language.values import format_value

if TYPE_CHECKING:
    import pyarrow as pa  # type: ignore[import-untyped]
    from pyspark.sql.types import StructType


@dataclass(frozen=True, slots=True)
class ColumnShape:
    """What the values of a column have in common; the text of one of them, and of one that is of another kind."""

    shape: Shape
    first: str | None = None
    other: str | None = None

    def merge_shapes(self, more: ColumnShape) -> ColumnShape:
        shape = merge_shapes(self.shape, more.shape)
        other = self.other or more.other
        if other is None and is_untyped(shape) and self.first is not None:
            other = more.first
        return ColumnShape(shape, self.first or more.first, other)


NO_SHAPE = ColumnShape(NONE)


def infer_shape(values: Sequence[Any]) -> ColumnShape:
    """What is told of some values."""
    found = get_shape(values)
    first = next((value for value in values if value is not None), None)
    if first is None:
        return ColumnShape(found)
    if not is_untyped(found):
        return ColumnShape(found, format_value(first))
    return reduce(
        ColumnShape.merge_shapes,
        (ColumnShape(get_shape([value]), format_value(value)) for value in values if value is not None),
    )


def read_shapes(part: bytes) -> list[ColumnShape]:
    """What a task has told of all columns."""
    told: list[ColumnShape] = pickle.loads(part)
    return told


def describe_row_shapes(batches: Iterator[pa.RecordBatch], width: int) -> Iterator[pa.RecordBatch]:
    """What a task tells of the rows in so many columns, as one answer."""
    import pyarrow as pa

    told = [NO_SHAPE] * width
    for block in batches:
        columns = _transpose_rows(block.column(0), width)
        told = [before.merge_shapes(infer_shape(values)) for before, values in zip(told, columns, strict=True)]
    yield pa.record_batch([pa.array([pickle.dumps(told)], pa.binary())], names=["told"])


def unpickle_rows_in_spark(batches: Iterator[pa.RecordBatch], pickled: bytes) -> Iterator[pa.RecordBatch]:
    """Path, step and row, with the row as columns of these shapes."""
    import pyarrow as pa

    shapes: list[Shape] = pickle.loads(pickled)
    for block in batches:
        columns = _transpose_rows(block.column(2), len(shapes))
        arrays = [
            pa.array([to_floats(value, shape) for value in values], make_arrow_type(pa, shape))
            for values, shape in zip(columns, shapes, strict=True)
        ]
        yield pa.record_batch([block.column(0), block.column(1), *arrays], schema=_build_schema(shapes))


def _transpose_rows(rows: pa.Array, width: int) -> list[tuple[Any, ...]]:
    """Rows by columns, also where there are none."""
    return list(zip(*map(loads, rows.to_pylist()), strict=True)) or [()] * width


def _build_schema(shapes: Sequence[Shape]) -> pa.Schema:
    import pyarrow as pa

    own = [(f"c{number}", make_arrow_type(pa, shape)) for number, shape in enumerate(shapes)]
    return pa.schema([("path", pa.int64()), ("step", pa.int64()), *own])


def build_spark_types(shapes: Sequence[Shape]) -> StructType:
    """The types of Spark for path, step and columns of these shapes."""
    from pyspark.sql.pandas.types import from_arrow_schema

    return from_arrow_schema(_build_schema(shapes))

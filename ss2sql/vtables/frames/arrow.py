"""Tables and record batches of Arrow, objects that export such tables, and data frames of Polars."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import TYPE_CHECKING, Any

from ss2sql.language.kinds import INT_MIN
from ss2sql.vtables.frames import Column, Frame, name_frame_columns
from ss2sql.vtables.frames.array_columns import (
    convert_array,
    make_frame_nulls,
    make_frame_objects,
    make_frame_times,
    make_text_column,
)

if TYPE_CHECKING:
    from ss2sql.vtables.frames import Reader

pyarrow: Any = import_module("pyarrow")


def reader(source: Any, name: str) -> Reader:
    """The reader of a table, which reads it once, since it is immutable."""
    return cache(lambda: _read_arrow(source, name))


def _read_arrow(table: Any, name: str) -> Frame:
    names = name_frame_columns(table.schema.names, name)
    parts = zip(names, table.columns, strict=True)
    columns = {word: convert_arrow_column(part, f"the column '{word}' of '{name}'") for word, part in parts}
    return Frame(columns, table.num_rows)


def polars_reader(source: Any, name: str) -> Reader:
    """The reader of a frame of Polars, which reads it anew every time, since it is mutable."""
    return lambda: _read_polars(source.clone(), name)


def _read_polars(frame: Any, name: str) -> Frame:
    names = name_frame_columns(frame.columns, name)
    columns = {
        word: _convert_polars_series(frame.get_column(word), f"the column '{word}' of '{name}'") for word in names
    }
    return Frame(columns, frame.height)


def _convert_polars_series(series: Any, place: str) -> Column:
    polars: Any = import_module("polars")
    if series.dtype in (polars.Object, polars.Int128, getattr(polars, "UInt128", None)):  # which Arrow lacks
        return make_frame_objects(series.to_list(), place)
    return convert_arrow_column(series.to_arrow(compat_level=polars.CompatLevel.oldest()), place)


def convert_arrow_column(array: Any, place: str) -> Column:
    """The column for an array, in one piece or in several."""
    types = pyarrow.types
    kind, length = array.type, len(array)
    if types.is_dictionary(kind):
        array, kind = array.cast(kind.value_type), kind.value_type
    array = array.combine_chunks() if isinstance(array, pyarrow.ChunkedArray) else array
    missing = array.is_null().to_numpy(zero_copy_only=False) if array.null_count else None
    if types.is_null(kind):
        return make_frame_nulls(length)
    if types.is_string(kind) or types.is_large_string(kind):
        return make_text_column(missing, array.to_pylist)
    if types.is_boolean(kind):
        return convert_array(array.fill_null(False).to_numpy(zero_copy_only=False), missing, place)
    if types.is_integer(kind) or types.is_floating(kind):
        return convert_array(array.fill_null(0).to_numpy(zero_copy_only=False), missing, place)
    if types.is_date(kind):
        return convert_array(_count_arrow_ticks(array.cast(pyarrow.date32()), 32).view("M8[D]"), missing, place)
    if types.is_timestamp(kind):
        suffix = "" if kind.tz is None else "+00:00"
        return convert_array(_count_arrow_ticks(array, 64).view(f"M8[{kind.unit}]"), missing, place, suffix)
    if types.is_duration(kind):
        return convert_array(_count_arrow_ticks(array, 64).view(f"m8[{kind.unit}]"), missing, place)
    if types.is_time(kind):
        return make_frame_times(
            _count_arrow_ticks(array, 32 if types.is_time32(kind) else 64).view(f"M8[{kind.unit}]"), missing
        )
    return make_frame_objects(array.to_pylist(), place)


def _count_arrow_ticks(array: Any, bits: int) -> Any:
    """The ticks of times as integers of 64 bits, NaT where they are missing."""
    counted = array.cast(pyarrow.int32()).cast(pyarrow.int64()) if bits == 32 else array.cast(pyarrow.int64())
    return counted.fill_null(INT_MIN).to_numpy(zero_copy_only=False)

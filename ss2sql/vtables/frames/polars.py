"""Data frames of Polars."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ss2sql.language.kinds import INT_MIN
from ss2sql.vtables.frames.array_columns import (
    convert_array,
    make_frame_nulls,
    make_frame_objects,
    make_frame_texts,
    make_frame_times,
)
from ss2sql.vtables.frames.frame import Column, Frame, name_frame_columns

if TYPE_CHECKING:
    from ss2sql.vtables.frames import Reader

polars: Any = import_module("polars")


def reader(source: Any, name: str) -> Reader:
    """The reader of a frame, which reads it anew every time, since it is mutable."""
    return lambda: _read_polars(source.clone(), name)


def _read_polars(frame: Any, name: str) -> Frame:
    names = name_frame_columns(frame.columns, name)
    columns = {
        word: _convert_polars_series(frame.get_column(word), f"the column '{word}' of '{name}'") for word in names
    }
    return Frame(columns, frame.height)


def _convert_polars_series(series: Any, place: str) -> Column:
    kind = series.dtype
    missing = series.is_null().to_numpy() if series.null_count() else None
    match kind:
        case polars.Null():
            return make_frame_nulls(len(series))
        case polars.String() | polars.Categorical() | polars.Enum():
            return make_frame_texts(missing, series.to_list)
        case polars.Boolean():
            return convert_array(series.fill_null(False).to_numpy(), missing, place)
        case polars.Date():
            return convert_array(_count_polars_ticks(series).view("M8[D]"), missing, place)
        case polars.Datetime():
            suffix = "" if kind.time_zone is None else "+00:00"
            return convert_array(_count_polars_ticks(series).view(f"M8[{kind.time_unit}]"), missing, place, suffix)
        case polars.Duration():
            return convert_array(_count_polars_ticks(series).view(f"m8[{kind.time_unit}]"), missing, place)
        case polars.Time():
            return make_frame_times(_count_polars_ticks(series).view("M8[ns]"), missing)
    if kind.is_float() or (kind.is_integer() and kind not in (polars.Int128, getattr(polars, "UInt128", None))):
        return convert_array(series.fill_null(0).to_numpy(), missing, place)
    return make_frame_objects(series.to_list(), place)


def _count_polars_ticks(series: Any) -> Any:
    """The ticks of times as integers of 64 bits, NaT where they are missing."""
    return series.to_physical().cast(polars.Int64).fill_null(INT_MIN).to_numpy()

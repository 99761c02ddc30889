"""Data frames of Polars, whose columns are read as those of Arrow."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ss2sql.errors import require_package
from ss2sql.vtables.frames import Column, Frame, name_frame_columns
from ss2sql.vtables.frames.array_columns import make_frame_objects

if TYPE_CHECKING:
    from ss2sql.vtables.frames import Reader

polars: Any = import_module("polars")
NOT_IN_ARROW = (polars.Object, polars.Int128, getattr(polars, "UInt128", None))


def reader(source: Any, name: str) -> Reader:
    """The reader of a frame, which reads it anew every time, since it is mutable."""
    require_package("pyarrow", "df", "to read a DataFrame of Polars, ss2sql")
    return lambda: _read_polars(source.clone(), name)


def _read_polars(frame: Any, name: str) -> Frame:
    names = name_frame_columns(frame.columns, name)
    columns = {
        word: _convert_polars_series(frame.get_column(word), f"the column '{word}' of '{name}'") for word in names
    }
    return Frame(columns, frame.height)


def _convert_polars_series(series: Any, place: str) -> Column:
    from ss2sql.vtables.frames.arrow import convert_arrow_column

    if series.dtype in NOT_IN_ARROW:
        return make_frame_objects(series.to_list(), place)
    return convert_arrow_column(series.to_arrow(compat_level=polars.CompatLevel.oldest()), place)

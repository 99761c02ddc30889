"""Data frames of pandas."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ss2sql.vtables.frames import Column, Frame, name_frame_columns
from ss2sql.vtables.frames.array_columns import convert_array, make_frame_objects

if TYPE_CHECKING:
    from ss2sql.vtables.frames import Reader

pandas: Any = import_module("pandas")


def reader(source: Any, name: str) -> Reader:
    """The reader of a frame, which reads it anew every time, since it is mutable."""
    return lambda: _read_pandas(source, name)


def _read_pandas(source: Any, name: str) -> Frame:
    """The present frame. An index with a name is a column."""
    # Where pandas copies on write, a shallow copy is a snapshot at no cost.
    frame = source.copy(deep=int(pandas.__version__.partition(".")[0]) < 3)
    levels = [level for level in range(frame.index.nlevels) if frame.index.names[level] is not None]
    parts = [frame.index.get_level_values(level).to_series() for level in levels]
    parts += [frame.iloc[:, position] for position in range(frame.shape[1])]
    names = name_frame_columns([*(frame.index.names[level] for level in levels), *frame.columns], name)
    columns = {
        word: _convert_series(part, f"the column '{word}' of '{name}'") for word, part in zip(names, parts, strict=True)
    }
    return Frame(columns, len(frame))


def _convert_series(series: Any, place: str) -> Column:
    kind = series.dtype
    if isinstance(kind, pandas.DatetimeTZDtype):
        return convert_array(series.dt.tz_convert("UTC").dt.tz_localize(None).to_numpy(), None, place, "+00:00")
    if isinstance(kind, pandas.ArrowDtype) or getattr(kind, "storage", "") == "pyarrow":
        from ss2sql.vtables.frames.arrow import convert_arrow_column

        return convert_arrow_column(series.array.__arrow_array__(), place)
    if isinstance(kind, pandas.api.extensions.ExtensionDtype):
        numbers = getattr(kind, "numpy_dtype", None)
        if numbers is not None and numbers.kind in "biuf":  # Int64, boolean and their like
            return convert_array(series.to_numpy(dtype=numbers, na_value=0), series.isna().to_numpy(), place)
        return make_frame_objects(series.astype(object).tolist(), place)
    return convert_array(series.to_numpy(), None, place)

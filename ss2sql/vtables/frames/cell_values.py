"""Conversion of single cells of data frames, for columns that are no arrays of numbers."""

from __future__ import annotations

import datetime
import sys
from decimal import Decimal
from typing import Any

_PLAIN = frozenset({type(None), bool, int, str})


def convert_frame_cells(values: list[Any]) -> list[Any]:
    """The values of a column, with None for missing ones."""
    return values if set(map(type, values)) <= _PLAIN else list(map(convert_frame_cell, values))


def convert_frame_cell(value: Any) -> Any:
    """The value of a cell, or of a part of one: NaN and its like as None, times as text, decimals as numbers."""
    kind = type(value)
    if kind in _PLAIN:
        return value
    if isinstance(value, float):
        return None if value != value else value
    if isinstance(value, (list, tuple)):
        return list(map(convert_frame_cell, value))
    if isinstance(value, dict):
        return {key: convert_frame_cell(item) for key, item in value.items()}
    if kind.__name__ in ("NAType", "NaTType") and kind.__module__.startswith("pandas."):
        return None
    if isinstance(value, datetime.datetime):
        return (value if value.tzinfo is None else value.astimezone(datetime.UTC)).isoformat()
    if isinstance(value, (datetime.date, datetime.time)):
        return value.isoformat()
    if isinstance(value, datetime.timedelta):
        return value.total_seconds()
    if isinstance(value, Decimal):
        return convert_decimal(value)
    return _convert_numpy(value)


def convert_decimal(value: Decimal) -> int | float | None:
    """A decimal as a number: an integer if it has no decimal places."""
    if value.is_nan():
        return None
    exponent = value.as_tuple().exponent
    return int(value) if isinstance(exponent, int) and exponent >= 0 else float(value)


def _convert_numpy(value: Any) -> Any:
    """Converts arrays in cells, and scalars of NumPy; other values are converted later."""
    numpy = sys.modules.get("numpy")
    if numpy is None or not isinstance(value, (numpy.ndarray, numpy.generic)):
        return value
    if value.dtype.kind in "mM":
        from ss2sql.vtables.frames.array_columns import convert_array

        array = value.reshape(-1) if isinstance(value, numpy.ndarray) else numpy.array([value])
        converted = convert_array(array, None, "a cell").values
        return converted if isinstance(value, numpy.ndarray) else converted[0]
    return convert_frame_cell(value.tolist())

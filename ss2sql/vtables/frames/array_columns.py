"""Columns of data frames from arrays of NumPy: their types from the arrays, their values when they are read.

Missing values are None: NaN, NaT, and what the library of the frame marks as missing. Dates and times are strings in
ISO 8601, which sort like the times; durations are seconds.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable
from decimal import Decimal
from typing import TYPE_CHECKING, Any

import numpy

from ss2sql.errors import ExecutionError
from ss2sql.language.conversion import convert_value
from ss2sql.language.kinds import INT_MAX, INT_MIN, Kind, Type, type_of, widen_number_type
from ss2sql.vtables.frames import Column, Frame, name_frame_columns

if TYPE_CHECKING:
    from ss2sql.vtables.frames import Reader


_PLAIN = frozenset({type(None), bool, int, str})


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
    if isinstance(value, Decimal):  # an integer if it has no decimal places
        exponent = value.as_tuple().exponent
        whole = isinstance(exponent, int) and exponent >= 0
        return None if value.is_nan() else int(value) if whole else float(value)
    if not isinstance(value, (numpy.ndarray, numpy.generic)):
        return value  # it is converted later
    if value.dtype.kind in "mM":
        array = value.reshape(-1) if isinstance(value, numpy.ndarray) else numpy.array([value])
        converted = convert_array(array, None, "a cell").values
        return converted if isinstance(value, numpy.ndarray) else converted[0]
    return convert_frame_cell(value.tolist())


Array = numpy.ndarray[Any, Any]
_FRACTIONS = ("s", "ms", "us", "ns")


def convert_array(array: Array, missing: Array | None, place: str, suffix: str = "") -> Column:
    """The column for an array.

    Args:
        array: the values, in one dimension.
        missing: True where there is no value; None where no value is missing.
        place: "the column 'x' of 't'", for errors.
        suffix: the time zone after every time.

    Raises:
        ExecutionError: X004 for infinities, complex numbers, and integers beyond 64 bits.
    """
    match array.dtype.kind:
        case "b":
            return _make_frame_column(Kind.BOOL, array, missing)
        case "i" | "u":
            return _make_frame_numbers(Kind.INT, array, missing, place)
        case "f":
            doubles = array.astype(numpy.float64) if array.dtype != numpy.float64 else array
            return _make_frame_numbers(Kind.FLOAT, doubles, _join_nulls(missing, numpy.isnan(doubles)), place)
        case "M":
            return make_text_column(
                _join_nulls(missing, numpy.isnat(array)), lambda: _format_frame_times(array, suffix)
            )
        case "m":
            if numpy.datetime_data(array.dtype)[0] in ("Y", "M"):
                hints = ("convert it to days or seconds",)
                raise ExecutionError("X004", f"{place} holds durations in months, which have no length", hints=hints)
            return convert_array(array / numpy.timedelta64(1, "s"), _join_nulls(missing, numpy.isnat(array)), place)
    return make_frame_objects(array.tolist(), place)


def make_frame_objects(values: list[Any], place: str) -> Column:
    cells = values if set(map(type, values)) <= _PLAIN else list(map(convert_frame_cell, values))
    known = convert_value(cells, place)
    return Column(type_of(known).element or Type(), lambda: known)


def make_text_column(missing: Array | None, make: Callable[[], list[Any]]) -> Column:
    """The column for strings that UTF-8 can encode. `make` gives them, with any value where they are missing."""
    return Column(Type(Kind.STR | _find_nulls(missing)), lambda: _insert_nulls(make(), missing))


def make_frame_nulls(length: int) -> Column:
    return Column(Type(Kind.NONE), lambda: [None] * length)


def make_frame_times(array: Array, missing: Array | None) -> Column:
    """The column for times of the day, given as times of the first day."""
    return make_text_column(missing, lambda: [text.partition("T")[2] for text in _format_frame_times(array, "")])


def _make_frame_numbers(kind: Kind, array: Array, missing: Array | None, place: str) -> Column:
    present = array if missing is None else array[~missing]
    if not present.size:
        return _make_frame_column(kind, array, missing)
    low, high = present.min().item(), present.max().item()
    least, greatest = (INT_MIN, INT_MAX) if kind is Kind.INT else (-numpy.finfo(float).max, numpy.finfo(float).max)
    if low < least or high > greatest:
        wrong = (array < least) | (array > greatest) if kind is Kind.FLOAT else array > numpy.uint64(INT_MAX)
        row = int(numpy.flatnonzero(wrong if missing is None else wrong & ~missing)[0])
        values: list[Any] = [None] * row + [array[row].item()]
        convert_value(values, place)  # raises, with the row's number
    return _make_frame_column(kind, array, missing, widen_number_type(kind | _find_nulls(missing), low, high))


def _make_frame_column(kind: Kind, array: Array, missing: Array | None, known: Type | None = None) -> Column:
    if known is None:
        known = Type(kind | _find_nulls(missing), 0, 1) if kind is Kind.BOOL else Type(kind | _find_nulls(missing))
    return Column(known, lambda: _insert_nulls(array.tolist(), missing))


def _find_nulls(missing: Array | None) -> Kind:
    return Kind.NONE if missing is not None and missing.any() else Kind(0)


def _join_nulls(missing: Array | None, also: Array) -> Array | None:
    both = also if missing is None else missing | also
    return both if both.any() else None


def _insert_nulls(values: list[Any], missing: Array | None) -> list[Any]:
    """The values with None where they are missing; the list is changed in place."""
    if missing is not None:
        for row in numpy.flatnonzero(missing).tolist():
            values[row] = None
    return values


def _format_frame_times(array: Array, suffix: str) -> list[str]:
    """Dates as 2024-02-01, times as 2024-02-01T12:30:00, with six or nine places of a second where it has any."""
    unit = numpy.datetime_data(array.dtype)[0]
    if unit in ("Y", "M", "W", "D", "generic"):
        return numpy.datetime_as_string(array.astype("M8[D]")).tolist()  # type: ignore[no-any-return]
    known = array if unit in _FRACTIONS else array.astype("M8[s]" if unit in ("h", "m") else "M8[ns]")
    written = numpy.datetime_as_string(known).tolist()
    return [_trim_zeros(text) + suffix for text in written] if known.dtype != "M8[s]" else [t + suffix for t in written]


def _trim_zeros(text: str) -> str:
    whole, _, digits = text.partition(".")
    if not digits.strip("0"):
        return whole
    return f"{whole}.{digits[:6] if digits.endswith('000') and len(digits) == 9 else digits.ljust(6, '0')}"


def reader(source: Any, name: str) -> Reader | None:
    """What reads the array; None where it is a list to scripts."""
    return (lambda: _read_array(source.copy(), name)) if source.dtype.names and source.ndim == 1 else None


def _read_array(array: Any, name: str) -> Frame:
    names = name_frame_columns(array.dtype.names, name)
    columns = {word: convert_array(array[word], None, f"the column '{word}' of '{name}'") for word in names}
    return Frame(columns, len(array))

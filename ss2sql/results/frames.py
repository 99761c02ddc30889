"""Results as data frames of pandas and Polars, as Arrow tables, and as text: CSV, JSON and Parquet files."""

from __future__ import annotations

import csv
import datetime
import json
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from functools import reduce
from operator import or_
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ss2sql.errors import RepresentationError, require_package
from ss2sql.language.cancellation import iterate_with_check
from ss2sql.language.kinds import ANY, Kind, Type, is_encodable
from ss2sql.language.values import format_value
from ss2sql.results import get_all_result_rows, get_result_rows

if TYPE_CHECKING:
    from ss2sql.results.result import Result


# The types of pandas for columns without None and with it, and the names of those of Arrow, by kinds of values.
_TYPES = {
    Kind.BOOL: ("bool", "boolean", "bool_"),
    Kind.INT: ("int64", "Int64", "int64"),
    Kind.FLOAT: ("float64", "float64", "float64"),
    Kind.INT | Kind.FLOAT: ("float64", "float64", "float64"),
    Kind.STR: ("", "", "string"),  # pandas has a text type of its own in each version
}
_KINDS = {bool: Kind.BOOL, int: Kind.INT, float: Kind.FLOAT, str: Kind.STR}
EXACT = 2**53  # floats hold whole numbers up to this one


def read_result_columns(result: Result) -> list[tuple[str, list[Any], Type]]:
    """The columns with their values, and the types that the plan promises where there are none."""
    rows = get_all_result_rows(result)
    parts = zip(*rows, strict=True) if rows else [()] * len(result.columns)
    columns = zip(result.columns, parts, result.promised_types, strict=True)
    return [(name, list(values), kind) for name, values, kind in columns]


def to_pandas(result: Result) -> Any:
    """A pandas DataFrame: bool, int64, float64 and text for columns without None, Int64 and boolean with None."""
    pandas = require_package("pandas", "df", "df()")
    columns = [_make_pandas_series(pandas, values, promised) for _, values, promised in read_result_columns(result)]
    frame = pandas.DataFrame(dict(enumerate(columns)), index=pandas.RangeIndex(len(columns[0])))
    frame.columns = list(result.columns)
    return frame


def _make_pandas_series(pandas: Any, values: list[Any], promised: Type) -> Any:
    there = [value for value in values if value is not None]
    kinds = promised.kinds & ~Kind.NONE
    if there:
        kinds = reduce(or_, (_KINDS.get(kind, Kind.OBJECT) for kind in set(map(type, there))))
    if set(map(type, there)) == {datetime.datetime} and all(value.tzinfo is None for value in there):
        return pandas.Series(values, dtype="datetime64[us]")
    large = kinds == Kind.INT | Kind.FLOAT and any(type(value) is int and abs(value) > EXACT for value in there)
    if kinds not in _TYPES or large or (kinds == Kind.STR and not all(map(is_encodable, there))):
        return _make_object_series(pandas, values)
    if kinds == Kind.STR:
        return pandas.Series(values, dtype=pandas.Series([""]).dtype)  # the text type of this pandas
    if kinds & Kind.FLOAT:
        values = [None if value is None else float(value) for value in values]
    return pandas.Series(values, dtype=_TYPES[kinds][len(there) < len(values)])


def _make_object_series(pandas: Any, values: Sequence[Any]) -> Any:
    """A series of objects, each in its cell: pandas looks into none of them."""
    import numpy

    cells = numpy.empty(len(values), dtype=object)
    for index, value in enumerate(values):
        cells[index] = value
    return pandas.Series(cells, dtype=object)


def to_polars(result: Result) -> Any:
    """A Polars DataFrame; columns without a type in Polars get its type Object."""
    polars, arrow = require_package("polars", "df", "pl()"), require_package("pyarrow", "df", "pl()")
    columns = []
    for name, values, promised in read_result_columns(result):
        made = _make_arrow_array(arrow, values, promised)
        if made is None or any(arrow.types.is_struct(kind) and not kind.num_fields for kind in _walk_types(made.type)):
            columns.append(polars.Series(name, values, dtype=polars.Object))
        else:
            columns.append(polars.Series(name, made))
    return polars.DataFrame(columns)


def to_arrow(result: Result) -> Any:
    """A table of pyarrow. Raises RepresentationError V001 for a column without a type in Arrow."""
    arrow = require_package("pyarrow", "df", "arrow()")
    arrays, names = [], []
    for name, values, promised in read_result_columns(result):
        made = _make_arrow_array(arrow, values, promised)
        if made is None:
            raise _build_type_error(arrow, name, values)
        arrays.append(made)
        names.append(name)
    return arrow.Table.from_arrays(arrays, names=names)


def _make_arrow_array(arrow: Any, values: list[Any], promised: Type) -> Any:
    """The values as an array of Arrow, of the promised type where they do not tell it; None where they have no type."""
    try:
        made = arrow.array(values)
        kinds = list(_walk_types(made.type))
        if any(map(arrow.types.is_null, kinds)):
            with suppress(arrow.ArrowException):
                made = arrow.array(values, type=_make_arrow_type(arrow, promised))
    except (arrow.ArrowException, UnicodeError, OverflowError):
        return None
    plain = {arrow.null(), arrow.bool_(), arrow.int64(), arrow.float64(), arrow.string()}
    odd = {kind for kind in kinds if not (arrow.types.is_list(kind) or arrow.types.is_struct(kind))} - plain
    if not odd:
        return made
    # Arrow makes a day of a time beside days, and bytes of text beside bytes.
    known = odd <= {arrow.binary(), arrow.date32(), arrow.timestamp("us")}
    return made if known and made.to_pylist() == values else None


def _walk_types(kind: Any) -> Iterator[Any]:
    """A type of Arrow, and those inside of it."""
    yield kind
    for number in range(kind.num_fields):
        yield from _walk_types(kind.field(number).type)


def _make_arrow_type(arrow: Any, promised: Type) -> Any:
    """The type of Arrow for all values of a type; null where the type does not say it."""
    kinds = promised.kinds & ~Kind.NONE
    if kinds == Kind.LIST:
        return arrow.list_(arrow.null() if promised.element is None else _make_arrow_type(arrow, promised.element))
    if kinds == Kind.DICT and promised.columns:
        return arrow.struct([(name, _make_arrow_type(arrow, column)) for name, column in promised.columns])
    return getattr(arrow, _TYPES[kinds][2])() if kinds in _TYPES else arrow.null()


def _build_type_error(arrow: Any, name: str, values: Iterable[Any]) -> RepresentationError:
    """The error for a column that has no type in Arrow."""
    hint = "select what can be told of it, such as its name, or take df(), whose columns hold any object"
    for value in values:
        if _make_arrow_array(arrow, [value], ANY) is None:
            message = f"Arrow has no type for {format_value(value)} in the column '{name}'"
            return RepresentationError("V001", message, hints=(hint,))
    message = f"the column '{name}' has values of several kinds; a column of Arrow has one"
    hints = ("make them alike in SELECT, with str(...) or float(...)", hint)
    return RepresentationError("V001", message, hints=hints)


# --- results as text for other programs: CSV and JSON, and Parquet files
MOMENTS = (datetime.date, datetime.time)  # a datetime is a date


def format_csv(result: Result) -> str:
    """A line of names and one for each row; None is empty, lists and dicts are JSON."""
    lines = _Lines()
    writer = csv.writer(lines, lineterminator="\r\n")
    writer.writerow(result.columns)
    with result.while_reading() as check:
        writer.writerows(
            [_format_csv_field(value) for value in r] for r in iterate_with_check(get_result_rows(result), check)
        )
    return "".join(lines)


class _Lines(list[str]):
    """Lines with newlines from a writer whose line ends are "\\r\
", so that it quotes carriage returns, too."""

    def write(self, line: str) -> None:
        self.append(line.removesuffix("\r\n") + "\n")


def _format_csv_field(value: Any) -> Any:
    if value is None or type(value) in (int, float, str):
        return value
    if isinstance(value, MOMENTS):
        return value.isoformat()
    return format_json(value) if isinstance(value, (bool, list, dict)) else str(value)


def format_json(value: Any) -> str:
    """A value as JSON on one line; see `make_json_value`."""
    return json.dumps(make_json_value(value), ensure_ascii=False)


def make_json_value(value: Any) -> Any:
    """The value for JSON: sets and arrays as lists, tuples as keys as JSON lists, dates in ISO 8601, others as text."""
    match value:
        case None | bool() | int() | float() | str():
            return value
        case list() | tuple():
            return list(map(make_json_value, value))
        case datetime.date() | datetime.time():
            return value.isoformat()
        case set():
            return sorted(map(make_json_value, value), key=repr)
        case dict():
            return {_make_json_key(key): make_json_value(item) for key, item in value.items()}
        case _ if type(value).__module__.partition(".")[0] == "numpy" or hasattr(value, "__array_interface__"):
            return value.tolist()
        case _:
            return repr(value)


def _make_json_key(key: Any) -> Any:
    made = make_json_value(key)
    return json.dumps(made, ensure_ascii=False) if isinstance(made, list) else made


def write_or_return(text: str, path: str | Path | None) -> str | None:
    """Writes the text to a file, or gives it back where there is no path.

    A lone surrogate, which cannot be encoded, becomes its escape, which JSON reads back.
    """
    if path is None:
        return text
    Path(path).write_text(text, encoding="utf-8", errors="backslashreplace", newline="")
    return None


def write_parquet(result: Result, path: str | Path) -> None:
    """Writes a Parquet file. Raises RepresentationError V001 for a column without a type in Arrow."""
    parquet = require_package("pyarrow.parquet", "df", "parquet()")
    parquet.write_table(to_arrow(result), path)

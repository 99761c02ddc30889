"""Results as data frames of pandas and Polars, as Arrow tables, and as text: CSV, JSON and Parquet files."""

from __future__ import annotations

import csv
import datetime
import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ss2sql.errors import require_package
from ss2sql.language.cancellation import iterate_with_check
from ss2sql.language.column_shapes import (
    ListOf,
    Scalar,
    Shape,
    Struct,
    build_type_error,
    convert_value_to_shape,
    infer_column_shape,
    infer_shape,
    is_untyped,
    make_arrow_type,
)
from ss2sql.language.kinds import INT
from ss2sql.results import get_all_result_rows, get_result_rows

if TYPE_CHECKING:
    from ss2sql.results.result import Result


def read_result_columns(result: Result) -> list[tuple[str, list[Any], Shape]]:
    rows = get_all_result_rows(result)
    parts = zip(*rows, strict=True) if rows else [()] * len(result.columns)
    types = {} if result.answer is None else result.answer.types
    own = result.columns if result.answer is None else result.answer.rows.columns
    numbers = [INT] * (len(result.columns) - len(own))  # the path and the step, of a search
    return [
        (name, list(values), infer_column_shape(values, promised))
        for name, values, promised in zip(result.columns, parts, [*numbers, *map(types.get, own)], strict=True)
    ]


def to_pandas(result: Result) -> Any:
    """A pandas DataFrame: bool, int64, float64 and text for columns without None, Int64 and boolean with None."""
    pandas = require_package("pandas", "df", "df()")
    columns = [_make_pandas_series(pandas, values, shape) for _, values, shape in read_result_columns(result)]
    frame = pandas.DataFrame(dict(enumerate(columns)), index=pandas.RangeIndex(len(columns[0])))
    frame.columns = list(result.columns)
    return frame


def _make_pandas_series(pandas: Any, values: list[Any], shape: Shape) -> Any:
    missing = any(value is None for value in values)
    match shape:
        case Scalar("bool"):
            return pandas.Series(values, dtype="boolean" if missing else "bool")
        case Scalar("int"):
            return pandas.Series(values, dtype="Int64" if missing else "int64")
        case Scalar("float"):
            return pandas.Series([None if value is None else float(value) for value in values], dtype="float64")
        case Scalar("str"):
            return pandas.Series(values, dtype=pandas.Series([""]).dtype)  # the text type of this pandas
        case Scalar("datetime"):
            return pandas.Series(values, dtype="datetime64[us]")
        case _:
            return _make_object_series(pandas, values)


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
    for name, values, shape in read_result_columns(result):
        if is_untyped(shape) or _has_empty_struct(shape):
            columns.append(polars.Series(name, values, dtype=polars.Object))
        else:
            made = arrow.array(
                [convert_value_to_shape(value, shape) for value in values], type=make_arrow_type(arrow, shape)
            )
            columns.append(polars.Series(name, made))
    return polars.DataFrame(columns)


def _has_empty_struct(shape: Shape) -> bool:
    match shape:
        case ListOf(item):
            return _has_empty_struct(item)
        case Struct(fields):
            return not fields or any(_has_empty_struct(field) for _, field in fields)
        case _:
            return False


def to_arrow(result: Result) -> Any:
    """A table of pyarrow. Raises RepresentationError V001 for a column without a type in Arrow."""
    arrow = require_package("pyarrow", "df", "arrow()")
    arrays, fields = [], []
    for name, values, shape in read_result_columns(result):
        if is_untyped(shape):
            hint = "select what can be told of it, such as its name, or take df(), whose columns hold any object"
            raise build_type_error("Arrow", name, infer_shape(values), hint)
        kind = make_arrow_type(arrow, shape)
        arrays.append(arrow.array([convert_value_to_shape(value, shape) for value in values], type=kind))
        fields.append(arrow.field(name, kind))
    return arrow.Table.from_arrays(arrays, schema=arrow.schema(fields))


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

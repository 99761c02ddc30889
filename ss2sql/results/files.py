"""Results as text for other programs: CSV and JSON, and Parquet files."""

from __future__ import annotations

import csv
import datetime
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ss2sql.language.cancellation import iterate_with_check
from ss2sql.results import get_rows, require_package
from ss2sql.results.frames import to_arrow

if TYPE_CHECKING:
    from ss2sql.results.result import Result

MOMENTS = (datetime.date, datetime.time)  # a datetime is a date


def format_csv(result: Result) -> str:
    """A line of names and one for each row; None is empty, lists and dicts are JSON."""
    lines = _Lines()
    writer = csv.writer(lines, lineterminator="\r\n")
    writer.writerow(result.columns)
    with result.while_reading() as check:
        writer.writerows([_format_csv_field(value) for value in r] for r in iterate_with_check(get_rows(result), check))
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

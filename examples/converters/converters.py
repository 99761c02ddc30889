"""A library of converters: functions, each with the data format that it takes and the one that it gives.

A converter also has a price, roughly the microseconds that a row of three values takes. None knows of any other; which
of them fit behind each other is what the scripts of this example find out.
"""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from typing import Any, TypeVar

import numpy as np

F = TypeVar("F", bound=Callable[[Any], Any])


@dataclass(frozen=True)
class Converter:
    """A function and its entry in the library."""

    name: str
    takes: str
    gives: str
    price: float
    function: Callable[[Any], Any]


LIBRARY: dict[str, Converter] = {}


def converter(takes: str, gives: str, price: float, needs: str | None = None) -> Callable[[F], F]:
    """Puts a function into the library, unless it needs a package that is not installed."""

    def enter(function: F) -> F:
        if needs is None or find_spec(needs):
            LIBRARY[function.__name__] = Converter(function.__name__, takes, gives, price, function)
        return function

    return enter


@converter("csv", "rows", 0.7)
def csv_to_rows(data: Any) -> Any:
    return list(csv.reader(io.StringIO(data)))


@converter("rows", "columns", 1.0)
def rows_to_columns(data: Any) -> Any:
    names, *rows = data
    columns = zip(*rows, strict=True)
    return {name: list(map(float, values)) for name, values in zip(names, columns, strict=True)}


@converter("columns", "rows", 0.1)
def columns_to_rows(data: Any) -> Any:
    return [list(data), *map(list, zip(*data.values(), strict=True))]


@converter("rows", "csv", 0.8)
def rows_to_csv(data: Any) -> Any:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(data)
    return text.getvalue()


@converter("csv", "numpy", 2.7)
def csv_to_numpy(data: Any) -> Any:
    return np.genfromtxt(io.StringIO(data), delimiter=",", skip_header=1)


@converter("columns", "numpy", 0.1)
def columns_to_numpy(data: Any) -> Any:
    return np.column_stack(list(data.values()))


@converter("columns", "dicts", 1.0)
def columns_to_dicts(data: Any) -> Any:
    return [dict(zip(data, values, strict=True)) for values in zip(*data.values(), strict=True)]


@converter("dicts", "columns", 0.1)
def dicts_to_columns(data: Any) -> Any:
    return {name: [row[name] for row in data] for name in data[0]}


@converter("dicts", "json", 1.9)
def dicts_to_json(data: Any) -> Any:
    return json.dumps(data)


@converter("json", "dicts", 1.5)
def json_to_dicts(data: Any) -> Any:
    return json.loads(data)


@converter("csv", "frame", 0.2, needs="pandas")
def csv_to_frame(data: Any) -> Any:
    import pandas

    return pandas.read_csv(io.StringIO(data))


@converter("frame", "numpy", 0.01, needs="pandas")
def frame_to_numpy(data: Any) -> Any:
    return data.to_numpy()


@converter("columns", "frame", 0.2, needs="pandas")
def columns_to_frame(data: Any) -> Any:
    import pandas

    return pandas.DataFrame(data)


@converter("frame", "columns", 0.7, needs="pandas")
def frame_to_columns(data: Any) -> Any:
    return data.to_dict(orient="list")

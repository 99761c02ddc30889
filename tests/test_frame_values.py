"""What stands in the cells of data frames, as values of the language, and what columns are called."""

from __future__ import annotations

import datetime
import math
from decimal import Decimal
from typing import Any

import numpy
import pandas
import polars
import pyarrow
import pytest
from sessions import both

import ss2sql


def values(ss: ss2sql.Session, source: Any) -> dict[str, list[Any]]:
    """The columns of a frame as both engines read them."""
    ss.attach("t", source)
    found = [ss.run("SELECT * FROM t;", engine=engine).value for engine in ("database", "native")]
    assert repr(found[0]) == repr(found[1])
    return {name: [row[name] for row in found[0]] for name in found[0][0]}


TIMES = [
    datetime.datetime(2024, 2, 1, 12, 30),
    None,
    datetime.datetime(1960, 1, 1, 0, 0, 0, 250_000),
]
WRITTEN = ["2024-02-01T12:30:00", None, "1960-01-01T00:00:00.250000"]


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
def test_times_are_texts_that_sort_as_they_do(ss: ss2sql.Session, unit: Any) -> None:
    array = numpy.array(TIMES, dtype=f"M8[{unit}]")
    assert values(ss, pandas.DataFrame({"t": array}))["t"] == WRITTEN
    assert values(ss, polars.DataFrame({"t": polars.Series(TIMES).dt.cast_time_unit(unit)}))["t"] == WRITTEN
    assert values(ss, pyarrow.table({"t": pyarrow.array(TIMES, pyarrow.timestamp(unit))}))["t"] == WRITTEN
    assert values(ss, numpy.array(list(zip(array)), dtype=[("t", f"M8[{unit}]")]))["t"] == WRITTEN
    assert values(ss, pandas.DataFrame({"t": pandas.Series(TIMES, dtype=object)}))["t"] == WRITTEN


def test_times_with_a_zone_are_those_of_utc(ss: ss2sql.Session) -> None:
    berlin = pandas.DatetimeIndex(["2024-07-01 12:00", None]).tz_localize("Europe/Berlin")
    written = ["2024-07-01T10:00:00+00:00", None]
    frame = pandas.DataFrame({"t": berlin})
    assert values(ss, frame)["t"] == written
    assert values(ss, frame.astype(object))["t"] == written
    assert values(ss, polars.from_pandas(frame))["t"] == written
    assert values(ss, pyarrow.Table.from_pandas(frame))["t"] == written


def test_dates_times_of_the_day_and_durations(ss: ss2sql.Session) -> None:
    day, clock = datetime.date(2024, 2, 29), datetime.time(23, 5, 0, 500_000)
    given = {"day": [day, None], "clock": [clock, None], "took": [datetime.timedelta(seconds=90.5), None]}
    written = {"day": ["2024-02-29", None], "clock": ["23:05:00.500000", None], "took": [90.5, None]}
    assert values(ss, polars.DataFrame(given)) == written
    assert values(ss, pyarrow.table(given)) == written
    assert values(ss, pandas.DataFrame(given)) == written
    assert values(ss, pandas.DataFrame(given, dtype=object)) == written


def test_nanoseconds_are_kept(ss: ss2sql.Session) -> None:
    array = numpy.array(["2024-01-01T00:00:00.000000001"], "M8[ns]")
    written = ["2024-01-01T00:00:00.000000001"]
    assert values(ss, pandas.DataFrame({"t": array}))["t"] == written
    assert values(ss, polars.DataFrame({"t": array}))["t"] == written
    assert values(ss, pyarrow.table({"t": array}))["t"] == written


def test_categories_decimals_lists_and_structs(ss: ss2sql.Session) -> None:
    nested = [{"k": [1.5, math.nan]}, None]
    plain = [{"k": [1.5, None]}, None]
    decimals, numbers = [Decimal("1.50"), None], [1.5, None]
    table = pyarrow.table(
        {
            "nested": nested,
            "decimal": decimals,
            "whole": pyarrow.array([Decimal(7), None], pyarrow.decimal128(5, 0)),
            "kind": pyarrow.array(["u", None]).dictionary_encode(),
            "nothing": pyarrow.nulls(2),
            "bytes": [b"\x00", None],
        }
    )
    expected = {"nested": plain, "decimal": numbers, "whole": [7, None], "kind": ["u", None], "nothing": [None, None]}
    assert values(ss, table) == {**expected, "bytes": [b"\x00", None]}
    kinds = pandas.Series(["u", None]).astype("category")
    counts = pandas.Series([7, None]).astype("Int64").astype("category")
    frame = pandas.DataFrame({"nested": nested, "decimal": decimals, "kind": kinds, "count": counts})
    assert values(ss, frame) == {"nested": plain, "decimal": numbers, "kind": ["u", None], "count": [7, None]}
    lazy = {
        "nested": [[1, None], None],
        "decimal": decimals,
        "kind": polars.Series(["u", None], dtype=polars.Categorical),
    }
    assert values(ss, polars.DataFrame(lazy)) == {"nested": [[1, None], None], "decimal": numbers, "kind": ["u", None]}


def test_what_stands_for_missing_is_none(ss: ss2sql.Session) -> None:
    missing = [math.nan, pandas.NA, pandas.NaT, None, numpy.float32("nan"), numpy.datetime64("NaT")]
    assert values(ss, pandas.DataFrame({"x": pandas.Series(missing, dtype=object)}))["x"] == [None] * 6
    assert values(ss, pandas.DataFrame({"x": numpy.array([1, math.nan], "f4")}))["x"] == [1.0, None]


def test_small_numbers_of_numpy(ss: ss2sql.Session) -> None:
    given = {kind: numpy.array([1, 2], kind) for kind in ("u1", "i2", "f2", "f4", "u8", "?")}
    found = values(ss, pandas.DataFrame(given))
    assert repr(found) == repr({kind: array.tolist() for kind, array in given.items()})


def test_arrays_that_are_not_structured_are_lists(ss: ss2sql.Session) -> None:
    ss.attach("grid", numpy.array([[1, 2], [3, 4]]))
    assert ss.eval("SELECT this[1] FROM grid AS list;") == [2, 4]


# --- what cannot be ------------------------------------------------------------------------------------


@both
@pytest.mark.parametrize(
    ("column", "words"),
    [
        (numpy.array([1, 2**63], "u8"), "9223372036854775808 at [1]"),
        (numpy.array([1.0, 2.0, math.inf]), "inf at [2]"),
        (pandas.Series([1, -math.inf], dtype=object), "-inf at [1]"),
        (numpy.array([1j]), "complex number"),
    ],
)
def test_numbers_that_are_no_values(ss: ss2sql.Session, column: Any, words: str, engine: Any) -> None:
    """Whether they are read or not, as in a list of dicts."""
    ss.attach("t", pandas.DataFrame({"x": column, "y": 1}))
    with pytest.raises(ss2sql.ExecutionError) as caught:
        ss.run("SELECT y FROM t;", engine=engine)
    assert caught.value.code == "X004"
    assert "the column 'x' of 't' holds" in str(caught.value)
    assert words in str(caught.value)


def test_two_columns_of_one_name(ss: ss2sql.Session) -> None:
    ss.attach("t", pandas.DataFrame([[1, 2]], columns=["x", "x"]))
    with pytest.raises(ss2sql.ExecutionError, match="two columns called 'x'"):
        ss.run("SELECT x FROM t;")


@pytest.mark.parametrize(
    ("source", "cure"),
    [
        (polars.LazyFrame({"x": [1]}), "collect()"),
        (pandas.Series([1]), "to_frame()"),
        (polars.Series([1]), "to_frame()"),
        (pyarrow.chunked_array([[1]]), "to_pylist()"),
    ],
)
def test_parts_of_frames_are_refused_with_the_cure(ss: ss2sql.Session, source: Any, cure: str) -> None:
    with pytest.raises(ss2sql.Error) as caught:
        ss.attach("t", source)
    assert caught.value.code == "S002"
    assert cure in str(caught.value)


# --- names ---------------------------------------------------------------------------------------------


@both
def test_any_name_of_a_column_can_be_reached(ss: ss2sql.Session, engine: Any) -> None:
    ss.attach(
        "t", pandas.DataFrame({"odd name": [1], "from": [2], "X": [3], "x": [4], "this": [5], "rowid": [6], 7: [8]})
    )
    names = 'this["odd name"], this["from"], X, t.x, t.this["this"], rowid, this["7"]'
    assert ss.run(f"SELECT {names} FROM t AS list;", engine=engine).value == [1, 2, 3, 4, 5, 6, 8]


@both
def test_a_column_called_rowid_does_not_change_the_order(ss: ss2sql.Session, engine: Any) -> None:
    ss.attach("t", pandas.DataFrame({"rowid": [3, 1, 2], "k": ["b", "a", "b"]}))
    assert ss.run("SELECT k, sum(rowid) FROM t GROUP BY k AS rows;", engine=engine).value == [("b", 5), ("a", 1)]
    assert ss.run("SELECT rowid FROM t AS list;", engine=engine).value == [3, 1, 2]


def test_an_index_with_a_name_is_a_column(ss: ss2sql.Session) -> None:
    frame = pandas.DataFrame({"x": [1, 2]}, index=pandas.Index(["a", "b"], name="key"))
    assert values(ss, frame) == {"key": ["a", "b"], "x": [1, 2]}
    assert values(ss, frame.rename_axis(None)) == {"x": [1, 2]}
    deep = frame.assign(k=[1, 2]).set_index("k", append=True)
    assert values(ss, deep) == {"key": ["a", "b"], "k": [1, 2], "x": [1, 2]}


def test_columns_of_several_levels(ss: ss2sql.Session) -> None:
    frame = pandas.DataFrame([[1, 2]], columns=pandas.MultiIndex.from_tuples([("a", "min"), ("a", "max")]))
    assert values(ss, frame) == {"a_min": [1], "a_max": [2]}

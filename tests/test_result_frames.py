"""Results as frames, Arrow tables and files: what goes in comes out, with its types."""

from __future__ import annotations

import csv
import datetime
import io
import json
import math
import sys
from collections.abc import Iterator
from decimal import Decimal
from pathlib import Path
from typing import Any

import duckdb
import pandas
import polars
import pyarrow
import pyarrow.parquet
import pytest
from hypothesis import given
from hypothesis import strategies as st
from programs.drawn import FEWEST, drawn
from random_values import FLOATS, INTEGERS

import ss2sql
from ss2sql.extras import install_line

TEXTS = st.text(st.characters(codec="utf-8"), max_size=4)
ALIKE = st.one_of([st.just(kind) for kind in (st.booleans(), INTEGERS, FLOATS, TEXTS)])
COLUMN = st.recursive(
    ALIKE,
    lambda inner: st.one_of(
        inner.map(lambda values: st.lists(st.none() | values, max_size=3)),
        inner.map(lambda values: st.fixed_dictionaries({"a": st.none() | values, "b": values})),
    ),
    max_leaves=3,
)


@pytest.fixture(scope="module")
def ss() -> Iterator[ss2sql.Session]:
    with ss2sql.connect() as session:
        yield session


def result_of(ss: ss2sql.Session, values: list[Any], engine: Any = "auto") -> ss2sql.Result:
    ss.attach("t", [{"k": index, "v": value} for index, value in enumerate(values)])
    return ss.run("SELECT k, v FROM t;", engine=engine)


def in_order(value: Any) -> Any:
    """The value with the keys of dicts sorted: a struct has one order for all."""
    if isinstance(value, list):
        return list(map(in_order, value))
    return {key: in_order(value[key]) for key in sorted(value)} if isinstance(value, dict) else value


def without_nan(value: Any) -> Any:
    return None if (isinstance(value, float) and math.isnan(value)) or value is pandas.NA else value


@pytest.mark.drawn
@drawn(FEWEST)
@given(data=st.data())
def test_columns_of_one_kind_survive(ss: ss2sql.Session, data: st.DataObject) -> None:
    kind = data.draw(COLUMN)
    values = data.draw(st.lists(st.none() | kind, min_size=1, max_size=5).map(in_order))
    result = result_of(ss, values)
    wanted = [repr(value) for value in values]
    assert list(map(repr, result.arrow()["v"].to_pylist())) == wanted
    assert list(map(repr, result.pl()["v"].to_list())) == wanted
    assert [repr(without_nan(value)) for value in result.df()["v"].tolist()] == wanted
    assert result.arrow().column_names == list(result.pl().columns) == list(result.df().columns) == ["k", "v"]


MIXED_VALUES = st.none() | st.booleans() | INTEGERS | FLOATS | TEXTS | st.lists(INTEGERS, max_size=2)


@pytest.mark.drawn
@drawn(FEWEST)
@given(values=st.lists(MIXED_VALUES, min_size=1, max_size=4))
def test_whatever_pandas_gets_is_equal(ss: ss2sql.Session, values: list[Any]) -> None:
    result = result_of(ss, values)
    assert [without_nan(value) for value in result.df()["v"].tolist()] == values
    polar = result.pl()["v"]
    assert polar.to_list() == values
    if polar.dtype not in (polars.Float64, polars.List(polars.Float64)):
        assert repr(polar.to_list()) == repr(values)


@pytest.mark.parametrize(
    ("values", "dtype", "kind", "arrow"),
    [
        ([True, False], "bool", polars.Boolean, pyarrow.bool_()),
        ([True, None], "boolean", polars.Boolean, pyarrow.bool_()),
        ([1, 2**63 - 1], "int64", polars.Int64, pyarrow.int64()),
        ([1, None], "Int64", polars.Int64, pyarrow.int64()),
        ([1.5, None], "float64", polars.Float64, pyarrow.float64()),
        ([1, 2.5], "float64", polars.Float64, pyarrow.float64()),
        (["a", None], pandas.Series([""]).dtype, polars.String, pyarrow.string()),
        ([[1], [], None], "object", polars.List(polars.Int64), pyarrow.list_(pyarrow.int64())),
        ([[1], [2.5]], "object", polars.List(polars.Float64), pyarrow.list_(pyarrow.float64())),
        ([{"a": 1}, {"b": "x"}], "object", polars.Struct({"a": polars.Int64, "b": polars.String}),
         pyarrow.struct([("a", pyarrow.int64()), ("b", pyarrow.string())])),
    ],
    ids=repr,
)  # fmt: skip
def test_column_types(ss: ss2sql.Session, values: list[Any], dtype: Any, kind: Any, arrow: Any, engine: Any) -> None:
    result = result_of(ss, values, engine)
    assert (result.df()["v"].dtype, result.pl()["v"].dtype) == (dtype, kind)
    assert result.arrow().schema.field("v").type == arrow


def test_an_empty_result_has_the_types_that_the_script_promises(ss: ss2sql.Session) -> None:
    ss.attach("t", [{"n": 1, "x": 0.5, "s": "a", "b": True, "l": [1]}])
    result = ss.run("SELECT n, x, s, b, l, n == 1, str(n) FROM t WHERE n > 1;")
    assert len(result) == 0
    assert [str(kind) for kind in result.arrow().schema.types] == [
        "int64", "double", "string", "bool", "list<item: int64>", "bool", "string"]  # fmt: skip
    assert list(map(str, result.pl().dtypes)) == [
        "Int64", "Float64", "String", "Boolean", "List(Int64)", "Boolean", "String"]  # fmt: skip
    text = pandas.Series([""]).dtype
    assert result.df().dtypes.tolist() == ["int64", "float64", text, "bool", "object", "bool", text]
    assert result.df().shape == result.pl().shape == result.arrow().shape == (0, 7)
    paths = ss.run("SELECT s AS path, x FROM t WHERE n == 9 START WITH m = 0 CONNECT BY m = m + 1 STOP WITH m == 2;")
    assert paths.columns == ("path", "step", "path_2", "x")
    assert list(map(str, paths.arrow().schema.types)) == ["int64", "int64", "string", "double"]
    assert list(map(str, paths.pl().dtypes)) == ["Int64", "Int64", "String", "Float64"]
    assert paths.df().dtypes.tolist() == ["int64", "int64", text, "float64"]


def test_a_search_is_one_row_per_step(ss: ss2sql.Session) -> None:
    search = "SELECT {} FROM [1, 2] WHERE n == 2 START WITH n = 1 CONNECT BY n = n + 1 STOP WITH n == 2;"
    result = ss.run(search.format("this, n"))
    rows = [(1, 1, 1, 1), (1, 2, 1, 2), (2, 1, 1, 1), (2, 2, 2, 2), (3, 1, 2, 1), (3, 2, 1, 2), (4, 1, 2, 1),
            (4, 2, 2, 2)]  # fmt: skip
    assert list(result) == result.pl().rows() == rows
    assert list(result.df().itertuples(index=False, name=None)) == rows
    named = ss.run(search.format("to(this, 'path'), to(n, 'step')"))
    assert named.columns == ("path", "step", "path_2", "step_2")
    assert named.arrow().column_names == list(named.columns)
    nothing = ss.run("SELECT this FROM [1] WHERE False START WITH n = 1 CONNECT BY n = n STOP WITH True;")
    assert (nothing.pl().shape, nothing.df().shape, nothing.arrow().shape) == ((0, 3),) * 3
    assert ss.run("[1, 2];").arrow().to_pylist() == [{"value": [1, 2]}]  # any value is a row


def test_objects(ss: ss2sql.Session) -> None:
    thing, day = object(), datetime.date(2024, 5, 1)
    result = result_of(ss, [thing, None])
    assert result.df()["v"].tolist() == result.pl()["v"].to_list() == [thing, None]
    with pytest.raises(ss2sql.RepresentationError, match=r"V001.*Arrow has no type for <object") as caught:
        result.arrow()
    assert "column 'v'" in str(caught.value)
    dates = result_of(ss, [day, None])
    assert dates.arrow()["v"].to_pylist() == dates.pl()["v"].to_list() == dates.df()["v"].tolist() == [day, None]
    moment = datetime.datetime(2024, 5, 1, 12, 30)
    assert result_of(ss, [moment]).df()["v"].tolist() == [pandas.Timestamp(moment)]
    frame = pandas.DataFrame({"x": [1]})
    assert result_of(ss, [[frame]]).df()["v"][0][0] is frame


@pytest.mark.parametrize(
    "values", [[1, "a"], [True, 1], [[1], 2], [2**53 + 1, 0.5], [[1], ["a"]], [Decimal(1)], ["\ud800"]]
)
def test_values_of_several_kinds(ss: ss2sql.Session, values: list[Any]) -> None:
    result = result_of(ss, values)
    assert repr(result.df()["v"].tolist()) == repr(result.pl()["v"].to_list()) == repr(values)
    with pytest.raises(ss2sql.RepresentationError) as caught:
        result.arrow()
    assert caught.value.hints


def test_csv_and_json(ss: ss2sql.Session, tmp_path: Path) -> None:
    result = result_of(ss, [None, True, 0.1, 'a,"b"\n', [1, None], {"x": "ü"}])
    text = result.csv()
    assert text is not None
    fields = ["", "true", "0.1", 'a,"b"\n', "[1, null]", '{"x": "ü"}']
    assert list(csv.reader(io.StringIO(text))) == [["k", "v"], *([str(k), v] for k, v in enumerate(fields))]
    assert json.loads(str(result.json())) == result.value
    assert (result.csv(tmp_path / "r.csv"), result.json(str(tmp_path / "r.json"))) == (None, None)
    assert (tmp_path / "r.csv").read_text("utf-8") == text
    assert json.loads((tmp_path / "r.json").read_text("utf-8")) == result.value
    lonely = result_of(ss, ["\ud800"])
    lonely.json(tmp_path / "s.json")
    assert json.loads((tmp_path / "s.json").read_text("utf-8"))[0]["v"] == "\ud800"
    assert ss.run("SELECT this FROM [2, 1, 2] AS set;").json() == "[1, 2]"
    assert ss.run("SELECT [0.5, 0.5], this FROM [3] AS plane('XY', [0, 0], [2, 1, 1]);").json() == "[[3.0, 0.0]]"
    result = result_of(ss, [[1, None], None])
    result.parquet(tmp_path / "r.parquet")
    assert pyarrow.parquet.read_table(tmp_path / "r.parquet").to_pylist() == result.value


@pytest.mark.parametrize(
    ("package", "use", "extra"),
    [("pandas", "df", "df"), ("polars", "pl", "df"), ("pyarrow", "arrow", "df"), ("matplotlib.pyplot", "plot", "plot"),
     ("networkx", "graph", "plot")],
)  # fmt: skip
def test_missing_extra(ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch, package: str, use: str, extra: str) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    result = ss.run("SELECT this FROM [1] START WITH n = 1 CONNECT BY n = n STOP WITH True;")
    with pytest.raises(ss2sql.SessionError) as caught:
        getattr(result, use)()
    assert caught.value.code == "S003"
    assert caught.value.hints == (install_line(extra),)


MIXED = "SELECT k, to(k > 0, b), to([k], l), to(IF(k > 0; k; None), n) FROM t;"


def test_one_object_for_all_libraries(ss: ss2sql.Session) -> None:
    ss.attach("t", [{"k": 0}, {"k": 1}])
    result = ss.run(MIXED)
    rows = [(0, False, [0], None), (1, True, [1], 1)]
    assert polars.DataFrame(result).rows() == rows
    assert polars.DataFrame(result).schema == result.pl().schema
    assert pyarrow.table(result) == result.arrow()
    assert duckdb.sql("SELECT * FROM result").fetchall() == rows
    assert list(map(str, duckdb.sql("SELECT * FROM result").types)) == ["BIGINT", "BOOLEAN", "BIGINT[]", "BIGINT"]
    assert duckdb.sql("SELECT sum(k) FROM result WHERE b").fetchall() == [(1,)]
    frame = pandas.DataFrame(result)
    assert list(frame.columns) == list(pandas.DataFrame(list(result)).columns) == ["k", "b", "l", "n"]
    assert pandas.DataFrame(result, columns=list("wxyz")).columns.tolist() == list("wxyz")
    assert pandas.DataFrame(ss.run("7;")).to_dict("list") == {"value": [7]}
    assert [tuple(map(without_nan, row)) for row in frame.itertuples(index=False)] == rows


def test_duckdb_reads_paths_and_empty_results(ss: ss2sql.Session) -> None:
    paths = ss.run("SELECT this FROM [1, 2] WHERE n == 2 START WITH n = 1 CONNECT BY n = n + 1 STOP WITH n == 2;")
    assert len(paths.paths) == 4
    assert list(pandas.DataFrame(paths).columns) == ["path", "step", "this"]
    assert duckdb.sql("SELECT path, max(step) FROM paths GROUP BY path ORDER BY path").fetchall() == [
        (number, 2) for number in range(1, 5)
    ]
    ss.attach("t", [{"k": 0}])
    none = ss.run("SELECT k, to(k > 0, b) FROM t WHERE k > 5;")
    relation = duckdb.sql("SELECT * FROM none")
    assert (relation.columns, list(map(str, relation.types))) == (["k", "b"], ["BIGINT", "BOOLEAN"])
    assert relation.fetchall() == []
    if hasattr(pandas.DataFrame, "from_arrow"):  # from pandas 3 on
        assert pandas.DataFrame.from_arrow(none).dtypes.astype(str).to_dict() == {"k": "int64", "b": "bool"}


def test_rows_are_tuples_that_know_their_columns(ss: ss2sql.Session) -> None:
    ss.attach("t", [{"k": 0}, {"k": 1}])
    first, second = ss.run("SELECT k, to([k], l) FROM t;")
    assert (first, second) == ((0, [0]), (1, [1]))
    assert (repr(first), isinstance(first, tuple), type(first) is type(second)) == ("(0, [0])", True, True)
    ss.attach("again", [first, second])
    assert ss.eval("SELECT l, k FROM again AS list;") == [[0], 0, [1], 1]  # as all named tuples


def test_dates_look_like_dates(ss: ss2sql.Session) -> None:
    day, moment = datetime.date(2024, 5, 1), datetime.datetime(2024, 5, 1, 12, 30)
    ss.attach("t", [{"d": day, "m": moment, "l": [day]}])
    result = ss.run("SELECT d, m, l FROM t;")
    assert json.loads(str(result.json())) == [{"d": "2024-05-01", "m": "2024-05-01T12:30:00", "l": ["2024-05-01"]}]
    assert str(result.csv()).splitlines()[1] == '2024-05-01,2024-05-01T12:30:00,"[""2024-05-01""]"'
    assert "│ 2024-05-01 │ 2024-05-01T12:30:00 │" in repr(result)

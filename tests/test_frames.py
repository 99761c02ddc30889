"""Data frames as sources: whatever library they come from, they are the same rows as a list of dicts."""

from __future__ import annotations

import datetime
import math
import pickle
import re
from decimal import Decimal
from types import SimpleNamespace
from typing import Any

import numpy
import pandas
import polars
import pyarrow
import pytest
from hypothesis import given
from hypothesis import strategies as st
from programs.drawn import amount, drawn
from sessions import ENGINES

import ss2sql
from ss2sql.vtables import frames

ROWS = [
    {"x": 1, "y": 1.5, "name": "a", "ok": True},
    {"x": 2, "y": None, "name": None, "ok": False},
    {"x": -3, "y": 0.25, "name": "ü", "ok": True},
]
DTYPES = {"x": "int32", "y": "float64", "name": "object", "ok": "bool"}
MAKERS = {
    "pandas": lambda: pandas.DataFrame(ROWS),
    "pandas of nullable types": lambda: pandas.DataFrame(ROWS).convert_dtypes(),
    "pandas of Arrow's types": lambda: pandas.DataFrame(ROWS).convert_dtypes(dtype_backend="pyarrow"),
    "Polars": lambda: polars.DataFrame(ROWS),
    "Arrow table": lambda: pyarrow.Table.from_pylist(ROWS),
    "Arrow table in pieces": lambda: pyarrow.concat_tables([pyarrow.Table.from_pylist([row], SCHEMA) for row in ROWS]),
    "Arrow batch": lambda: pyarrow.RecordBatch.from_pylist(ROWS),
    "Arrow stream": lambda: pyarrow.Table.from_pylist(ROWS).to_reader(),
    "NumPy": lambda: numpy.array(
        [(1, 1.5, "a", True), (2, math.nan, None, False), (-3, 0.25, "ü", True)], dtype=list(DTYPES.items())
    ),
}
SCHEMA = pyarrow.Table.from_pylist(ROWS).schema
every = pytest.mark.parametrize("make", MAKERS.values(), ids=MAKERS)


# --- the same rows -------------------------------------------------------------------------------------


def outcome(ss: ss2sql.Session, query: str, engine: Any) -> str:
    try:
        return repr(ss.run(query, engine=engine).value)
    except ss2sql.Error as error:
        return error.code


@every
def test_a_frame_gives_its_rows(ss: ss2sql.Session, make: Any, engine: Any) -> None:
    """Elsewhere it is a dict of columns."""
    ss.attach("t", make())
    assert repr(ss.run("SELECT * FROM t;", engine=engine).value) == repr(ROWS)
    assert repr(ss.run("SELECT this FROM t AS list;", engine=engine).value) == repr(ROWS)
    assert ss.run("copy = t; SELECT x FROM copy AS list;", engine=engine).value == [1, 2, -3]
    assert ss.run("SELECT t.x, name FROM t WHERE ok AS rows;", engine=engine).value == [(1, "a"), (-3, "ü")]
    script = "SELECT n.x, (SELECT x FROM t WHERE x < n.x AS list) FROM n = t WHERE n.ok AS rows;"
    assert ss.run(script, engine=engine).value == [(1, [-3]), (-3, [])]
    assert ss.run("t;", engine=engine).value == {name: [row[name] for row in ROWS] for name in ROWS[0]}
    script = "IF(len(t) == 4; SELECT x + sum(t['x']) FROM t WHERE x IN t['x'] AS list);"
    assert ss.run(script, engine=engine).value == [1, 2, -3]
    way = "START WITH at = 'a' CONNECT BY UNIQUE at = 'ü'"
    script = f"SELECT m.x FROM m = (SELECT x, name FROM t WHERE name == at) {way} AS list;"
    assert ss.run(script, engine=engine).value == [[1], [1, -3]]
    assert ss.run("SELECT eval('x + 1;') FROM t AS list;", engine="native").value == [2, 3, -2]


@every
def test_columns_have_the_types_and_bounds_of_their_data(ss: ss2sql.Session, make: Any) -> None:
    """So arithmetic and comparisons are SQLite's own."""
    ss.attach("t", make())
    sql = " ".join(str(ss.run("SELECT x + 1 FROM t WHERE x * 2 > 2 AND name == 'a';").sql).split())
    assert sql == "SELECT t.x + 1 FROM elements_x_y_name_ok(:t) AS t WHERE t.x * 2 > 2 AND t.name IS 'a'"


VALUES: dict[str, st.SearchStrategy[Any]] = {
    "int": st.integers(-5, 5) | st.integers(-(2**63), 2**63 - 1),
    "float": st.floats(allow_nan=False, allow_infinity=False) | st.sampled_from([0.0, 1.0, -2.5]),
    "bool": st.booleans(),
    "str": st.text(st.characters(codec="utf-8", exclude_characters="\0"), max_size=3) | st.sampled_from(["a", "b"]),
}
PANDAS = {"int": "Int64", "float": "Float64", "bool": "boolean", "str": "string"}
ARROW = {"int": pyarrow.int64(), "float": pyarrow.float64(), "bool": pyarrow.bool_(), "str": pyarrow.string()}
POLARS = {"int": polars.Int64, "float": polars.Float64, "bool": polars.Boolean, "str": polars.String}
QUERIES = (
    "SELECT * FROM t;", "SELECT a, this FROM t WHERE b == a OR a != None AS rows;",
    "SELECT a + 1, b FROM t WHERE a != None AND b AS list;", "SELECT a * a FROM t AS list;",
    "SELECT a FROM t WHERE a > 0 AS list;", "SELECT b, count(*), min(a) FROM t GROUP BY b;",
    "SELECT a, b FROM t ORDER BY b DESC, a AS rows;", "SELECT n.a, m.this FROM n = t, m = t WHERE n.a == m.b AS list;",
    "SELECT b FROM t START WITH at = 1 CONNECT BY UNIQUE at = a STOP WITH a == None AS list;",
    "SELECT a, (SELECT b FROM m = t WHERE m.a == n.b AS list) FROM n = t AS rows;",
    "SELECT m.a FROM m = (SELECT a, b FROM t WHERE b == at) START WITH at = True CONNECT BY UNIQUE at = m.a AS list;",
    "SELECT a FROM t WHERE b == a START WITH at = 1 CONNECT BY NO CYCLE COST 4 at = a STOP WITH b == 1 AS list;",
)  # fmt: skip


@st.composite
def columns(draw: Any) -> tuple[dict[str, str], list[dict[str, Any]]]:
    """Kinds of two columns, and rows with values of these kinds or None."""
    kinds = {name: draw(st.sampled_from(sorted(VALUES))) for name in "ab"}
    rows = st.fixed_dictionaries({name: VALUES[kind] | st.none() for name, kind in kinds.items()})
    drawn = draw(st.lists(rows, min_size=1, max_size=5))
    return kinds, [{name: row[name] for name in kinds} for row in drawn]


def frames_of(kinds: dict[str, str], rows: list[dict[str, Any]]) -> dict[str, Any]:
    lists = {name: [row[name] for row in rows] for name in kinds}
    table = pyarrow.table(lists, schema=pyarrow.schema([(name, ARROW[kind]) for name, kind in kinds.items()]))
    return {
        "pandas": pandas.DataFrame({name: pandas.Series(lists[name], dtype=PANDAS[kinds[name]]) for name in kinds}),
        "objects": pandas.DataFrame({name: pandas.Series(lists[name], dtype=object) for name in kinds}),
        "polars": polars.DataFrame(lists, schema={name: POLARS[kind] for name, kind in kinds.items()}),
        "arrow": table,
        "batch": table.to_batches()[0],
        "stream": table.to_reader(),
        "numpy": numpy.array([tuple(row.values()) for row in rows], dtype=[(name, object) for name in kinds]),
    }


@pytest.mark.drawn
@drawn(amount(0.2))
@given(columns(), st.sampled_from(QUERIES), st.sampled_from(["auto", "native"]))
def test_random_frames_are_the_same_as_lists_of_dicts(given: Any, query: str, engine: str) -> None:
    kinds, rows = given
    with ss2sql.connect() as ss:
        ss.attach("t", rows)
        wanted = outcome(ss, query, "native")
        for library, source in frames_of(kinds, rows).items():
            ss.attach("t", source)
            assert outcome(ss, query, engine) == wanted, library


@every
def test_an_empty_frame_has_columns_and_no_rows(ss: ss2sql.Session, make: Any, engine: Any) -> None:
    source = make()
    if isinstance(source, pyarrow.RecordBatchReader):
        source = source.read_all()
    empty = source.iloc[:0] if isinstance(source, pandas.DataFrame) else source[:0]
    ss.attach("t", empty)
    assert ss.run("SELECT x + 1, name FROM t WHERE y > 0;", engine=engine).value == []
    assert ss.run("SELECT * FROM t;", engine=engine).columns == ("x", "y", "name", "ok")


def test_a_frame_without_columns_and_with_new_ones(ss: ss2sql.Session, engine: Any) -> None:
    ss.attach("nothing", pandas.DataFrame())
    ss.attach("rows", pandas.DataFrame(index=range(2)))
    assert ss.run("SELECT this FROM nothing AS list;", engine=engine).value == []
    assert ss.run("SELECT this FROM rows AS list;", engine=engine).value == [{}, {}]
    frame = pandas.DataFrame({"x": [1]})
    ss.attach("t", frame)
    query = ss.compile("SELECT * FROM t;", engine=engine)
    assert query.run().value == [{"x": 1}]
    frame["y"] = ["a"]
    assert query.run().value == [{"x": 1, "y": "a"}]
    frame["x"] = ["b"]
    assert query.run().value == [{"x": "b", "y": "a"}]


# --- when a frame is read ------------------------------------------------------------------------------


def fill(source: Any, name: str, values: list[int]) -> None:
    """Changes a column in place."""
    for row, value in enumerate(values):
        if isinstance(source, pandas.DataFrame):
            source.loc[row, name] = value
        elif isinstance(source, polars.DataFrame):
            source[row, name] = value
        else:
            source[name][row] = value


@pytest.mark.parametrize("library", ["pandas", "NumPy", "Polars"])
def test_each_run_sees_the_frame_as_it_is_and_keeps_what_it_read(ss: ss2sql.Session, library: str, engine: Any) -> None:
    source: Any = MAKERS[library]()
    ss.attach("t", source)
    ss.function("spoil", lambda x: fill(source, "x", [0, 0, 0]) or x, volatility="stable")
    query = ss.compile("SELECT x + 1 FROM t AS list;", engine=engine)
    assert query.run().value == [2, 3, -2]
    fill(source, "x", [2**30, -5, 7])  # beyond the bounds that the plan was made for
    assert query.run().value == [2**30 + 1, -4, 8]
    assert ss.run("SELECT spoil(x) FROM t AS list;", engine=engine).value == [2**30, -5, 7]
    assert query.run().value == [1, 1, 1]


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Counts conversions of columns."""
    count = SimpleNamespace(columns=0)
    begin = frames.Column.__init__

    def counting(self: Any, kind: Any, make: Any) -> None:
        def counted() -> list[Any]:
            count.columns += 1
            return list(make())

        begin(self, kind, counted)

    monkeypatch.setattr(frames.Column, "__init__", counting)
    return count


@every
def test_columns_are_converted_once_per_run(ss: ss2sql.Session, make: Any, engine: Any, made: SimpleNamespace) -> None:
    source = make()
    ss.attach("t", source)
    query = ss.compile("SELECT n.x, m.x, n.ok FROM n = t, m = t WHERE n.x == m.x AND n.ok;", engine=engine)
    assert made.columns == 0  # types need no values
    query.run()
    assert made.columns == 2
    query.run()
    cannot_change = isinstance(source, (pyarrow.Table, pyarrow.RecordBatch, pyarrow.RecordBatchReader))
    assert made.columns == (2 if cannot_change else 4)


# --- what stands in cells ------------------------------------------------------------------------------


def values(ss: ss2sql.Session, *sources: Any) -> dict[str, list[Any]]:
    """The columns that all these frames have on both engines."""
    found = []
    for source in sources:
        ss.attach("t", source)
        found += [ss.run("SELECT * FROM t;", engine=engine).value for engine in ENGINES]
    assert len(set(map(repr, found))) == 1
    return {name: [row[name] for row in found[0]] for name in found[0][0]}


TIMES = [datetime.datetime(2024, 2, 1, 12, 30), None, datetime.datetime(1960, 1, 1, 0, 0, 0, 250_000)]


@pytest.mark.parametrize("unit", ["ms", "us", "ns"])
def test_times_are_texts_that_sort_as_they_do(ss: ss2sql.Session, unit: Any) -> None:
    array = numpy.array(TIMES, dtype=f"M8[{unit}]")
    assert values(
        ss,
        pandas.DataFrame({"t": array}),
        pandas.DataFrame({"t": pandas.Series(TIMES, dtype=object)}),
        polars.DataFrame({"t": polars.Series(TIMES).dt.cast_time_unit(unit)}),
        pyarrow.table({"t": pyarrow.array(TIMES, pyarrow.timestamp(unit))}),
        numpy.array(list(zip(array)), dtype=[("t", f"M8[{unit}]")]),
    ) == {"t": ["2024-02-01T12:30:00", None, "1960-01-01T00:00:00.250000"]}


def test_zones_dates_durations_and_nanoseconds(ss: ss2sql.Session) -> None:
    frame = pandas.DataFrame({"t": pandas.DatetimeIndex(["2024-07-01 12:00", None]).tz_localize("Europe/Berlin")})
    sources = (frame, frame.astype(object), polars.from_pandas(frame), pyarrow.Table.from_pandas(frame))
    assert values(ss, *sources) == {"t": ["2024-07-01T10:00:00+00:00", None]}
    day, clock = datetime.date(2024, 2, 29), datetime.time(23, 5, 0, 500_000)
    given = {"day": [day, None], "clock": [clock, None], "took": [datetime.timedelta(seconds=90.5), None]}
    written = {"day": ["2024-02-29", None], "clock": ["23:05:00.500000", None], "took": [90.5, None]}
    frames = (pandas.DataFrame(given), pandas.DataFrame(given, dtype=object))
    assert values(ss, polars.DataFrame(given), pyarrow.table(given), *frames) == written
    given = {"t": numpy.array(["2024-01-01T00:00:00.000000001"], "M8[ns]")}
    sources = (pandas.DataFrame(given), polars.DataFrame(given), pyarrow.table(given))
    assert values(ss, *sources) == {"t": ["2024-01-01T00:00:00.000000001"]}


def test_categories_decimals_lists_and_structs(ss: ss2sql.Session) -> None:
    nested, plain = [{"k": [1.5, math.nan]}, None], [{"k": [1.5, None]}, None]
    given = {"nested": nested, "decimal": [Decimal("1.50"), None]}
    table = pyarrow.table({
        **given,
        "kind": pyarrow.array(["u", None]).dictionary_encode(),
        "whole": pyarrow.array([Decimal(7), None], pyarrow.decimal128(5, 0)),
        "nothing": pyarrow.nulls(2),
        "bytes": [b"\x00", None],
    })  # fmt: skip
    expected = {"nested": plain, "decimal": [1.5, None], "kind": ["u", None]}
    more = {"whole": [7, None], "nothing": [None, None], "bytes": [b"\x00", None]}
    assert values(ss, table) == {**expected, **more}
    kinds = pandas.Series(["u", None]).astype("category")
    counts = pandas.Series([7, None]).astype("Int64").astype("category")
    assert values(ss, pandas.DataFrame({**given, "kind": kinds, "n": counts})) == {**expected, "n": [7, None]}
    given["nested"] = expected["nested"] = [[1, None], None]
    kinds = polars.Series(["u", None], dtype=polars.Categorical)
    assert values(ss, polars.DataFrame({**given, "kind": kinds})) == expected


def test_missing_values_small_numbers_and_plain_arrays(ss: ss2sql.Session) -> None:
    missing = [math.nan, pandas.NA, pandas.NaT, None, numpy.float32("nan"), numpy.datetime64("NaT")]
    assert values(ss, pandas.DataFrame({"x": pandas.Series(missing, dtype=object)})) == {"x": [None] * 6}
    assert values(ss, pandas.DataFrame({"x": numpy.array([1, math.nan], "f4")})) == {"x": [1.0, None]}
    given = {kind: numpy.array([1, 2], kind) for kind in ("u1", "i2", "f2", "f4", "u8", "?")}
    found = values(ss, pandas.DataFrame(given))
    assert repr(found) == repr({kind: array.tolist() for kind, array in given.items()})
    ss.attach("grid", numpy.array([[1, 2], [3, 4]]))
    assert ss.eval("SELECT this[1] FROM grid AS list;") == [2, 4]


@pytest.mark.parametrize(
    ("column", "words"),
    [(numpy.array([1, 2**63], "u8"), "9223372036854775808 at [1]"), (numpy.array([1.0, 2.0, math.inf]), "inf at [2]"),
     (pandas.Series([1, -math.inf], dtype=object), "-inf at [1]"), (numpy.array([1j]), "complex number")],
)  # fmt: skip
def test_numbers_that_are_no_values(ss: ss2sql.Session, column: Any, words: str, engine: Any) -> None:
    """Whether they are read or not, as in a list of dicts."""
    ss.attach("t", pandas.DataFrame({"x": column, "y": 1}))
    with pytest.raises(ss2sql.ExecutionError, match=f"X004.*the column 'x' of 't' holds.*{re.escape(words)}"):
        ss.run("SELECT y FROM t;", engine=engine)


@pytest.mark.parametrize(
    ("source", "cure"),
    [(polars.LazyFrame({"x": [1]}), "collect()"), (pandas.Series([1]), "to_frame()"),
     (polars.Series([1]), "to_frame()"), (pyarrow.chunked_array([[1]]), "to_pylist()")],
)  # fmt: skip
def test_parts_of_frames_are_refused_with_the_cure(ss: ss2sql.Session, source: Any, cure: str) -> None:
    with pytest.raises(ss2sql.Error, match=rf"S002[\s\S]*{re.escape(cure)}"):
        ss.attach("t", source)


# --- what columns are called ---------------------------------------------------------------------------


def test_columns_may_have_any_name_even_rowid(ss: ss2sql.Session, engine: Any) -> None:
    names = ("odd name", "from", "X", "x", "this", "rowid", 7)
    ss.attach("t", pandas.DataFrame({name: [number] for number, name in enumerate(names)}))
    read = 'this["odd name"], this["from"], X, t.x, t.this["this"], rowid, this["7"]'
    assert ss.run(f"SELECT {read} FROM t AS list;", engine=engine).value == [0, 1, 2, 3, 4, 5, 6]
    ss.attach("t", pandas.DataFrame({"rowid": [3, 1, 2], "k": ["b", "a", "b"]}))
    assert ss.run("SELECT k, sum(rowid) FROM t GROUP BY k AS rows;", engine=engine).value == [("b", 5), ("a", 1)]
    assert ss.run("SELECT rowid FROM t AS list;", engine=engine).value == [3, 1, 2]


def test_names_of_an_index_and_of_several_levels(ss: ss2sql.Session) -> None:
    frame = pandas.DataFrame({"x": [1, 2]}, index=pandas.Index(["a", "b"], name="key"))
    assert values(ss, frame) == {"key": ["a", "b"], "x": [1, 2]}
    assert values(ss, frame.rename_axis(None)) == {"x": [1, 2]}
    deep = frame.assign(k=[1, 2]).set_index("k", append=True)
    assert values(ss, deep) == {"key": ["a", "b"], "k": [1, 2], "x": [1, 2]}
    levels = pandas.MultiIndex.from_tuples([("a", "min"), ("a", "max")])
    assert values(ss, pandas.DataFrame([[1, 2]], columns=levels)) == {"a_min": [1], "a_max": [2]}
    ss.attach("t", pandas.DataFrame([[1, 2]], columns=["x", "x"]))
    with pytest.raises(ss2sql.ExecutionError, match="two columns called 'x'"):
        ss.run("SELECT x FROM t;")


def test_columns_of_a_frame_that_a_function_makes_are_explained(ss: ss2sql.Session) -> None:
    ss.function("load", lambda: pandas.DataFrame({"x": [1, 2]}), volatility="stable")
    with pytest.raises(ss2sql.ResolveError, match=re.escape("let a function return to_dict('list')")):
        ss.run("log = load(); SELECT x FROM log WHERE x > 1;")


@pytest.mark.parametrize(
    ("make", "cure"),
    [
        (lambda: pandas.DataFrame({"x": [1, 2]}), 'to_dict("list")'),
        (lambda: polars.DataFrame({"x": [1, 2]}), "to_dicts()"),
        (lambda: pyarrow.table({"x": [1, 2]}), "to_pylist()"),
    ],
)
def test_a_frame_that_a_function_gives_says_how_it_becomes_a_list(ss: ss2sql.Session, make: Any, cure: str) -> None:
    ss.function("load", make, volatility="stable")
    ss.function("load_list", lambda: eval(f"frame.{cure}", {"frame": make()}), volatility="stable")
    with pytest.raises(ss2sql.ExecutionError) as caught:
        ss.run("SELECT x FROM load();")
    assert caught.value.hints == (f"let the function return frame.{cure}",)
    assert ss.eval("SELECT x FROM load_list() AS list;") == [1, 2]


@pytest.mark.parametrize("make", [pandas.DataFrame, polars.DataFrame, pyarrow.table], ids=["pandas", "polars", "arrow"])
def test_a_frame_or_series_may_be_set_or_given_to_a_run(ss: ss2sql.Session, engine: Any, make: Any) -> None:
    frame = make({"t": [1.0, None], "x": [3, 4]})
    script = "SELECT t, x FROM log WHERE x >= least AS rows;"
    ss.set("log", frame)
    for names in ({"least": 4}, {"least": 4, "log": frame}):
        assert ss.run(script, engine=engine, **names).value == [(None, 4)]
    assert ss.run("max(log['x']);", engine=engine, log=frame).value == 4
    if make is not pyarrow.table:
        assert ss.run("SELECT this FROM log WHERE this > 3 AS list;", engine=engine, log=frame["x"]).value == [4]


def test_what_has_no_rows_cannot_be_given(ss: ss2sql.Session) -> None:
    with pytest.raises(ss2sql.SessionError, match=r"collect\(\)"):
        ss.run("SELECT * FROM log;", log=polars.LazyFrame({"x": [1]}))


def test_a_result_over_a_frame_can_be_pickled(ss: ss2sql.Session, engine: Any) -> None:
    ss.attach("log", pandas.DataFrame({"g": ["a", None], "x": [1.0, 2.0]}))
    result = ss.run("SELECT * FROM log AS rows;", engine=engine)
    copied = pickle.loads(pickle.dumps(result))
    assert copied.value == [("a", 1.0), (None, 2.0)]
    assert copied.sql.parameters["log"].make_value() == {"g": ["a", None], "x": [1.0, 2.0]}

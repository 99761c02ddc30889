"""Data frames as sources: whatever library they come from, they are the same rows as a list of dicts."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy
import pandas
import polars
import pyarrow
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sessions import both

import ss2sql
from ss2sql.vtables.frames import frame

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


@both
@every
def test_a_frame_gives_its_rows(ss: ss2sql.Session, make: Any, engine: Any) -> None:
    ss.attach("t", make())
    assert repr(ss.run("SELECT * FROM t;", engine=engine).value) == repr(ROWS)
    assert repr(ss.run("SELECT this FROM t AS list;", engine=engine).value) == repr(ROWS)
    assert ss.run("SELECT t.x, name, ok FROM t WHERE ok AS rows;", engine=engine).value == [
        (1, "a", True),
        (-3, "ü", True),
    ]
    assert ss.run("SELECT m.x FROM n = t, m = t WHERE n.y == m.y AND n.x < m.x + 9 AS list;", engine=engine).value == [
        1,
        2,
        -3,
    ]


@both
@every
def test_a_frame_is_a_dict_of_columns_elsewhere(ss: ss2sql.Session, make: Any, engine: Any) -> None:
    ss.attach("t", make())
    assert ss.run('sum(t["x"]);', engine=engine).value == 0
    assert ss.run("t;", engine=engine).value == {name: [row[name] for row in ROWS] for name in ROWS[0]}
    assert ss.run("copy = t; SELECT x FROM copy AS list;", engine=engine).value == [1, 2, -3]
    assert ss.run("IF(len(t) == 4; SELECT x FROM t WHERE x IN t['x'] AS list);", engine=engine).value == [1, 2, -3]


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
    "SELECT * FROM t;",
    "SELECT a, this FROM t WHERE b == a OR a != None AS rows;",
    "SELECT a + 1, b FROM t WHERE a != None AND b AS list;",
    "SELECT a * a FROM t AS list;",
    "SELECT a FROM t WHERE a > 0 AS list;",
    "SELECT b, count(*), min(a) FROM t GROUP BY b;",
    "SELECT a, b FROM t ORDER BY b DESC, a AS rows;",
    "SELECT n.a, m.this FROM n = t, m = t WHERE n.a == m.b AS list;",
    "SELECT b FROM t START WITH at = 1 CONNECT BY UNIQUE at = a STOP WITH a == None AS list;",
)


@st.composite
def columns(draw: Any) -> tuple[dict[str, str], list[dict[str, Any]]]:
    """Kinds of two columns, and rows with values of these kinds or None."""
    kinds = {name: draw(st.sampled_from(sorted(VALUES))) for name in "ab"}
    rows = st.fixed_dictionaries({name: VALUES[kind] | st.none() for name, kind in kinds.items()})
    drawn = draw(st.lists(rows, min_size=1, max_size=5))
    return kinds, [{name: row[name] for name in kinds} for row in drawn]


def frames_of(kinds: dict[str, str], rows: list[dict[str, Any]]) -> dict[str, Any]:
    lists = {name: [row[name] for row in rows] for name in kinds}
    return {
        "pandas": pandas.DataFrame({name: pandas.Series(lists[name], dtype=PANDAS[kinds[name]]) for name in kinds}),
        "objects": pandas.DataFrame({name: pandas.Series(lists[name], dtype=object) for name in kinds}),
        "polars": polars.DataFrame(lists, schema={name: POLARS[kind] for name, kind in kinds.items()}),
        "arrow": pyarrow.table(lists, schema=pyarrow.schema([(name, ARROW[kind]) for name, kind in kinds.items()])),
        "numpy": numpy.array([tuple(row.values()) for row in rows], dtype=[(name, object) for name in kinds]),
    }


def outcome(ss: ss2sql.Session, query: str, engine: Any) -> str:
    try:
        return repr(ss.run(query, engine=engine).value)
    except ss2sql.Error as error:
        return error.code


@settings(max_examples=40, deadline=None)
@given(columns(), st.sampled_from(QUERIES))
def test_random_frames_are_the_same_as_lists_of_dicts(given: Any, query: str) -> None:
    kinds, rows = given
    with ss2sql.connect() as ss:
        ss.attach("t", rows)
        expected = outcome(ss, query, "native")
        for library, source in frames_of(kinds, rows).items():
            ss.attach("t", source)
            for engine in ("auto", "native"):
                assert outcome(ss, query, engine) == expected, (library, engine)


@both
@every
def test_an_empty_frame_has_columns_and_no_rows(ss: ss2sql.Session, make: Any, engine: Any) -> None:
    source = make()
    if isinstance(source, pyarrow.RecordBatchReader):
        source = source.read_all()
    empty = source.iloc[:0] if isinstance(source, pandas.DataFrame) else source[:0]
    ss.attach("t", empty)
    assert ss.run("SELECT x + 1, name FROM t WHERE y > 0;", engine=engine).value == []
    assert ss.run("SELECT * FROM t;", engine=engine).columns == ("x", "y", "name", "ok")


@both
def test_a_frame_without_columns(ss: ss2sql.Session, engine: Any) -> None:
    ss.attach("nothing", pandas.DataFrame())
    ss.attach("rows", pandas.DataFrame(index=range(2)))
    assert ss.run("SELECT this FROM nothing AS list;", engine=engine).value == []
    assert ss.run("SELECT this FROM rows AS list;", engine=engine).value == [{}, {}]


@both
def test_a_search_over_a_frame_of_edges(ss: ss2sql.Session, engine: Any) -> None:
    edges = pandas.DataFrame({"src": ["a", "b", "b", "c"], "dst": ["b", "c", "d", "d"], "km": [1, 2, 5, 1]})
    ss.attach("edges", edges)
    cheapest = (
        "SELECT dst FROM edges WHERE dst == 'd' START WITH at = 'a', way = 0"
        " CONNECT BY COST km MAXIMUM 1 at = dst STOP WITH src != at OR dst == 'd' AS list;"
    )
    ss.attach("listed", edges.to_dict("records"))
    expected = ss.run(cheapest.replace("FROM edges", "FROM listed"), engine=engine).value
    assert ss.run(cheapest, engine=engine).value == expected
    reached = (
        "SELECT e.dst FROM e = (SELECT dst, src FROM edges WHERE src == at) START WITH at = 'a'"
        " CONNECT BY UNIQUE at = e.dst AS list;"
    )
    assert ss.run(reached, engine=engine).value == [["b"], ["b", "c"], ["b", "d"]]


@both
def test_a_frame_in_nested_queries_and_texts(ss: ss2sql.Session, engine: Any) -> None:
    ss.attach("t", pandas.DataFrame(ROWS))
    ss.attach("u", polars.DataFrame({"k": [1, -3, 1]}))
    nested = "SELECT k, (SELECT x FROM t WHERE x == k AS list) FROM u AS rows;"
    assert ss.run(nested, engine=engine).value == [(1, [1]), (-3, [-3]), (1, [1])]
    assert ss.run("SELECT eval('x + 1;') FROM t AS list;", engine="native").value == [2, 3, -2]


# --- when a frame is read ------------------------------------------------------------------------------


@both
def test_every_run_sees_the_frame_as_it_is(ss: ss2sql.Session, engine: Any) -> None:
    for source in (pandas.DataFrame({"x": [1, 2]}), numpy.array([(1,), (2,)], dtype=[("x", "i8")])):
        ss.attach("t", source)
        query = ss.compile("SELECT x + 1 FROM t AS list;", engine=engine)
        assert query.run().value == [2, 3]
        source["x"] = [2**40, -5]  # beyond the bounds that the plan was made for
        assert query.run().value == [2**40 + 1, -4]
    series = polars.DataFrame({"x": [1, 2]})
    ss.attach("t", series)
    series[0, "x"] = 9
    assert ss.run("SELECT x FROM t AS list;", engine=engine).value == [9, 2]


@both
def test_new_columns_are_seen(ss: ss2sql.Session, engine: Any) -> None:
    frame = pandas.DataFrame({"x": [1]})
    ss.attach("t", frame)
    query = ss.compile("SELECT * FROM t;", engine=engine)
    assert query.run().value == [{"x": 1}]
    frame["y"] = ["a"]
    assert query.run().value == [{"x": 1, "y": "a"}]
    frame["x"] = ["b"]
    assert query.run().value == [{"x": "b", "y": "a"}]


@both
@pytest.mark.parametrize(
    "make", [MAKERS["pandas"], MAKERS["NumPy"], MAKERS["Polars"]], ids=["pandas", "NumPy", "Polars"]
)
def test_a_run_keeps_what_it_has_read(ss: ss2sql.Session, make: Any, engine: Any) -> None:
    source = make()

    def spoil(x: int) -> int:
        if isinstance(source, pandas.DataFrame):
            source.loc[:, "x"] = 0
        elif isinstance(source, polars.DataFrame):
            for row in range(3):
                source[row, "x"] = 0
        else:
            source["x"] = 0
        return x

    ss.attach("t", source)
    ss.function("spoil", spoil, volatility="volatile")
    assert ss.run("SELECT spoil(x) FROM t AS list;", engine=engine).value == [1, 2, -3]
    assert ss.run("SELECT x FROM t AS list;", engine=engine).value == [0, 0, 0]


@pytest.fixture
def made(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """Counts conversions of columns."""
    count = SimpleNamespace(columns=0)
    begin = frame.Column.__init__

    def counting(self: Any, kind: Any, make: Any) -> None:
        def counted() -> list[Any]:
            count.columns += 1
            return list(make())

        begin(self, kind, counted)

    monkeypatch.setattr(frame.Column, "__init__", counting)
    return count


@both
@every
def test_columns_that_are_read_are_converted_once_per_run(
    ss: ss2sql.Session, make: Any, engine: Any, made: SimpleNamespace
) -> None:
    source = make()
    ss.attach("t", source)
    query = ss.compile("SELECT n.x, m.x, n.ok FROM n = t, m = t WHERE n.x == m.x AND n.ok;", engine=engine)
    assert made.columns == 0  # types need no values
    query.run()
    assert made.columns == 2
    query.run()
    cannot_change = isinstance(source, (pyarrow.Table, pyarrow.RecordBatch, pyarrow.RecordBatchReader))
    assert made.columns == (2 if cannot_change else 4)


def test_a_frame_gives_way_to_whatever_takes_its_name(ss: ss2sql.Session) -> None:
    source = pandas.DataFrame({"x": [1]})
    ss.attach("t", source)
    assert ss.get("t") is source
    assert ss.eval("SELECT x FROM t AS list;") == [1]
    assert ss.eval("t = [2]; SELECT this FROM t AS list;") == [2]
    ss.attach("t", [{"x": 3}])
    assert ss.eval("SELECT x FROM t AS list;") == [3]
    ss.attach("t", source)
    ss.detach("t")
    with pytest.raises(ss2sql.ResolveError):
        ss.eval("SELECT x FROM t AS list;")


@both
def test_functions_that_take_arrays(ss: ss2sql.Session, engine: Any) -> None:
    ss.attach("t", pandas.DataFrame({"x": range(100)}))
    blocks = []

    def double(x: Any) -> Any:
        blocks.append(len(x))
        return x * 2

    ss.function("double", double, vectorized=True)
    assert ss.run("SELECT double(x) FROM t AS list;", engine=engine).value == [2 * x for x in range(100)]
    assert len(blocks) < 20

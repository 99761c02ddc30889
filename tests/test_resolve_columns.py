"""Columns of sources that are known only when the script runs, and lists that mention sources."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pytest
from resolving import engines, errors, message, query_of
from resolving import fixture_tables as fixture_tables

import ss2sql
from ss2sql import plan

# --- columns that are not known yet --------------------------------------------------------------------


@dataclass
class Body:
    mass: float


@engines
def test_columns_are_those_of_all_elements(ss: ss2sql.Session, engine: Any) -> None:
    ss.attach("mixed", [{"a": 1}, {"b": 2}, {"a": None, "b": 3}])
    assert ss.run("SELECT a, b FROM mixed AS rows;", engine=engine).value == [(1, None), (None, 2), (None, 3)]
    assert ss.run("SELECT * FROM mixed;", engine=engine).columns == ("a", "b")
    ss.attach("plain", [1, {"a": 1}])
    assert ss.run("SELECT * FROM plain;", engine=engine).columns == ("plain",)
    with pytest.raises(ss2sql.ResolveError):
        ss.run("SELECT a FROM plain;", engine=engine)
    ss.attach("bodies", [Body(1.5), Body(2.5)])
    assert ss.run("SELECT mass FROM bodies AS list;", engine=engine).value == [1.5, 2.5]
    ss.attach("empty", [])
    assert ss.run("SELECT this FROM empty AS list;", engine=engine).value == []


@engines
@pytest.mark.parametrize("forms", [("rows = f();", "rows"), ("rows = IF(True; f());", "rows"), ("r = [f()];", "r[0]")])
def test_columns_of_a_variable_that_the_script_assigns(ss: ss2sql.Session, engine: Any, forms: tuple[str, str]) -> None:
    before, source = forms
    ss.function("f", lambda: [{"a": 50, "mass": 70, "z": 90}], volatility="volatile")
    ss.function("mass", lambda row: "function")
    for script, value in (
        (f"{before} SELECT z FROM x = {source} AS list;", [90]),
        (f"{before} SELECT mass FROM x = {source} AS list;", [70]),
        (f"a = 1; {before} SELECT a FROM x = {source} AS list;", [50]),
        (f"{before} SELECT (SELECT a FROM x = {source} AS value) FROM t AS list;", [50, 50]),
        (f"{before} SELECT (SELECT b FROM x = {source} AS value) FROM t AS list;", [2, 4]),
        (f"{before} SELECT (SELECT z FROM [1] AS value) FROM x = {source} AS list;", [90]),
        (f"{before} SELECT a FROM x = {source}, [1] AS list;", [50]),
        (f"{before} y = [1]; SELECT a FROM x = {source}, y AS list;", [50]),
        (f"{before} SELECT * FROM x = {source};", [{"a": 50, "mass": 70, "z": 90}]),
        (f"{before} SELECT x.z FROM x = {source} WHERE z == 90 ORDER BY mass AS list;", [90]),
        (
            f"{before} SELECT a FROM x = {source} WHERE True START WITH a = 3 CONNECT BY a = a STOP WITH True AS list;",
            [[3]],
        ),
    ):
        assert ss.run(script, engine=engine).value == value, script
    for script in (f"{before} SELECT other FROM x = {source};", f"{before} SELECT x.other FROM x = {source};"):
        with pytest.raises(ss2sql.Error) as caught:
            ss.run(script, engine=engine)
        assert caught.value.code in ("R001", "X008")
        assert caught.value.span is not None
    with pytest.raises(ss2sql.ResolveError) as caught:
        ss.run(f"{before} SELECT z FROM x = {source}, y = {source};", engine=engine)
    assert caught.value.code == "R004"


@engines
def test_columns_of_what_a_function_gives(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("f", lambda: [{"z": 90}, {"z": 91}], volatility="immutable")
    ss.function("g", lambda: [{"z": 90}, {"y": 91}, 5, Body(1.0)], volatility="immutable")
    ss.function("empty", list, volatility="immutable")
    assert ss.run("SELECT z FROM f() WHERE f.z > 90 AS list;", engine=engine).value == [91]
    assert ss.run("SELECT x.z, y.z FROM x = f(), y = f() WHERE x.z != y.z AS rows;", engine=engine).value == [
        (90, 91), (91, 90)]  # fmt: skip
    assert ss.run("SELECT (SELECT z FROM [1] AS value) FROM f() AS list;", engine=engine).value == [90, 91]
    assert ss.run("SELECT * FROM f();", engine=engine).value == [{"z": 90}, {"z": 91}]
    assert ss.run("SELECT * FROM empty();", engine=engine).columns == ("empty",)
    assert ss.run("SELECT z FROM empty() AS list;", engine=engine).value == []
    for script in ("SELECT y FROM f();", "SELECT z FROM g();", "SELECT g.mass FROM g();"):
        with pytest.raises(ss2sql.ExecutionError, match="has no column") as caught:
            ss.run(script, engine=engine)
        assert caught.value.code == "X008"
        assert caught.value.span is not None
    assert errors(ss, "SELECT z FROM x = f(), y = f();") == [("R004", "z")]
    assert "write x.z or y.z" in message(ss, "SELECT z FROM x = f(), y = f();")


@engines
def test_star(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("f", lambda: [{"p": 1}, {"q": 2}], volatility="immutable")
    ss.function("values", lambda: [{"p": 1}, 2], volatility="immutable")
    assert ss.run("SELECT * FROM t, u WHERE a == 1 AS dict;", engine=engine).value == [
        {"a": 1, "b": 2, "b_2": 20, "c": 30}
    ]
    assert ss.run("SELECT * FROM f(), n = [7];", engine=engine).value == [
        {"p": 1, "q": None, "n": 7}, {"p": None, "q": 2, "n": 7}]  # fmt: skip
    assert ss.run("SELECT * FROM values();", engine=engine).value == [{"values": {"p": 1}}, {"values": 2}]
    assert ss.run("SELECT * FROM (SELECT a, b FROM t WHERE a > 1);", engine=engine).value == [{"a": 3, "b": 4}]
    assert ss.run("SELECT * FROM x = (SELECT a FROM t AS list) AS rows;", engine=engine).value == [(1,), (3,)]


# --- late lists ----------------------------------------------------------------------------------------


@engines
def test_a_list_that_mentions_sources_is_read_for_each_row(ss: ss2sql.Session, engine: Any) -> None:
    before = "pairs = [[a.this, b.this], [b.this, a.this]]; "
    inner = "(SELECT this FROM pairs WHERE this[0] < this[1] AS list)"
    script = f"{before} SELECT {inner} FROM a = [1, 2], b = [1, 2] AS list;"
    assert ss.run(script, engine=engine).value == [[], [[1, 2]], [[1, 2]], []]
    assert ss.run(f"SELECT {inner} FROM a = [5], b = [6] AS list;", engine=engine).value == [[[5, 6]]]
    assert ss.run(f"pairs = [this + 1]; SELECT {inner.replace('this[0] < this[1]', 'True')} FROM [1, 2] AS list;",
                  engine=engine).value == [[2], [3]]  # fmt: skip
    assert ss.run("names = [t.a, len([t.b])]; SELECT (SELECT this FROM names AS list) FROM t AS rows;",
                  engine=engine).value == [([1, 1],), ([3, 1],)]  # fmt: skip


def test_a_list_that_mentions_sources_has_no_value_elsewhere(ss: ss2sql.Session) -> None:
    before = "pairs = [a.this, 1]; "
    for script, place in (
        ("pairs;", "pairs"),
        ("len(pairs);", "pairs"),
        ("SELECT this FROM pairs;", "pairs"),
        ("SELECT pairs FROM a = [1];", "pairs"),
        ("SELECT (SELECT this FROM pairs AS list) FROM b = [1];", "pairs"),
    ):
        assert errors(ss, before + script) == [("R011", place)]
        assert "the list stands here" in message(ss, before + script)
    assert ss.eval(before) is None
    assert errors(ss, "pairs;") == [("R011", "pairs")]
    assert ss.eval("pairs = 3; pairs;") == 3
    assert ss.eval(before + "pairs{5} = 4; pairs;") == 4
    assert ss.eval(before + "IF(True; pairs = [7]); SELECT this FROM pairs AS list;") == [7]


def test_only_a_list_alone_is_late(ss: ss2sql.Session) -> None:
    assert errors(ss, "x = [a.this] + [1];") == [("R003", "a.this")]
    assert ss.eval("x = [SELECT this FROM [1] AS list]; x;") == [[1]]
    assert errors(ss, "SELECT (x = [a.this]) FROM t;") == [("R003", "a.this")]


@pytest.mark.parametrize("shape", ["list", "rows"])
def test_a_path_has_no_columns(ss: ss2sql.Session, shape: str) -> None:
    search = f"(SELECT a FROM t START WITH n = 1 CONNECT BY NO CYCLE n = n AS {shape})"
    assert errors(ss, f"SELECT p.a FROM p = {search};") == [("R001", "p.a")]
    assert errors(ss, f"ways = {search}; SELECT p.a FROM p = ways;") == [("R001", "p.a")]


def test_a_data_frame_is_not_read_whole(ss: ss2sql.Session) -> None:
    pandas = pytest.importorskip("pandas")
    ss.attach("people", pandas.DataFrame({"a": [1]}))
    for script, frame in (("SELECT a FROM people", True), ("people = [2]; SELECT this FROM people", False)):
        source = query_of(ss, script).sources[0]
        assert isinstance(source, plan.ValueSource)
        assert isinstance(source.value, plan.Variable)
        assert source.value.frame is frame

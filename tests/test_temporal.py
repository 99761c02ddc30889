"""Temporal variables: `v{5.0} = x` keeps a history. The clock of these tests is set by hand."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import apsw
import pytest
from sessions import Clock

import ss2sql


@pytest.fixture
def clock() -> Clock:
    return Clock(100.0)


@pytest.fixture
def ss(ss: ss2sql.Session, clock: Clock) -> ss2sql.Session:
    ss.function("getTime", clock)
    return ss


def store(ss: ss2sql.Session, clock: Clock, **values: Any) -> None:
    """Stores values at moments `at_100=...`, each kept for five seconds."""
    for moment, value in values.items():
        clock.now = float(moment.removeprefix("at_").replace("_", "."))
        ss.run("v{5.0} = x;", x=value)


def test_a_temporal_assignment_has_its_value(ss: ss2sql.Session) -> None:
    assert ss.eval("v{5.0} = 1 + 1;") == 2
    assert ss.eval("[v, (v{1} = 3), v];") == [2, 3, 3]
    assert ss.get("v") == 3
    assert ss.variables() == {"v": 3}


def test_the_name_alone_is_the_latest_value_however_old(ss: ss2sql.Session, clock: Clock) -> None:
    store(ss, clock, at_100="a", at_101="b")
    clock.now = 1e9
    assert ss.eval("v;") == "b"
    assert ss.eval("v{};") == ["b"]
    assert ss.eval("v{-1.0};") == ["b"]
    assert ss.eval("v{};") == ["b"]


def test_what_was_in_force_is_kept(ss: ss2sql.Session, clock: Clock) -> None:
    store(ss, clock, at_100="a", at_102="b", at_104="c")
    assert ss.eval("v{};") == ["a", "b", "c"]
    clock.now = 107.0  # a was in force until 102, which is 5 seconds ago: the bound is inclusive
    assert ss.eval("v{};") == ["a", "b", "c"]
    clock.now = 107.001
    assert ss.eval("v{};") == ["b", "c"]
    clock.now = 109.0
    assert ss.eval("v{};") == ["b", "c"]
    clock.now = 109.5
    assert ss.eval("v{};") == ["c"]


def test_the_last_seconds(ss: ss2sql.Session, clock: Clock) -> None:
    store(ss, clock, at_100="a", at_101="b", at_102="c", at_103="d")
    clock.now = 104.0
    assert ss.eval("v{-0.5};") == ["d"]
    assert ss.eval("v{-1.0};") == ["c", "d"]  # d was stored 1 second ago, at that moment c was in force
    assert ss.eval("v{-1.5};") == ["c", "d"]  # c was stored before, but in force
    assert ss.eval("v{-2};") == ["b", "c", "d"]
    assert ss.eval("v{-2.0};") == ["b", "c", "d"]
    assert ss.eval("v{-100};") == ["a", "b", "c", "d"]
    assert ss.eval("v{0 - 1};") == ["c", "d"]


def test_a_moment(ss: ss2sql.Session, clock: Clock) -> None:
    store(ss, clock, at_100="a", at_101="b", at_103="c")
    for moment, value in (
        (99.9, None),
        (100, "a"),
        (100.5, "a"),
        (101, "b"),
        (102.9, "b"),
        (103.0, "c"),
        (1e6, "c"),
        (0, None),
    ):
        assert ss.eval("v{moment};", moment=moment) == value
    clock.now = 106.5
    assert ss.eval("v{100.5};") is None  # it is no longer kept
    assert ss.eval("v{101};") == "b"


def test_values_of_the_same_moment(ss: ss2sql.Session, clock: Clock) -> None:
    store(ss, clock, at_100="a")
    store(ss, clock, at_100="b")
    assert ss.eval("v{};") == ["a", "b"]
    assert ss.eval("v{100};") == "b"
    assert ss.eval("v{-0.001};") == ["a", "b"]
    clock.now = 105.0
    assert ss.eval("v{};") == ["a", "b"]
    clock.now = 105.1
    assert ss.eval("v{};") == ["b"]


def test_the_time_to_keep_is_that_of_the_last_assignment(ss: ss2sql.Session, clock: Clock) -> None:
    store(ss, clock, at_100="a", at_101="b")
    clock.now = 102.0
    ss.run("v{0} = 'c';")
    assert ss.eval("v{};") == ["b", "c"]
    clock.now = 102.1
    assert ss.eval("v{};") == ["c"]
    ss.run("v{1000} = 'd';")
    clock.now = 1000.0
    assert ss.eval("v{};") == ["c", "d"]


def test_the_same_inside_of_queries(ss: ss2sql.Session, clock: Clock) -> None:
    store(ss, clock, at_100=1, at_102=2)
    assert ss.eval("SELECT this FROM v{} AS list;") == [1, 2]
    assert ss.eval("SELECT this, v, v{101} FROM [7] AS rows;") == [(7, 2, 1)]
    assert ss.eval("SELECT (w{10} = this) FROM [5, 6] AS list;") == [5, 6]
    assert ss.eval("w{};") == [5, 6]
    for script in ("SELECT v{101} FROM [1];", "SELECT (v{1} = this) FROM [1];"):
        with pytest.raises(ss2sql.UnsupportedError):
            ss.run(script, engine="database")
        assert ss.run(script).engine == "native"


def test_kept_values_are_not_shared(ss: ss2sql.Session, clock: Clock) -> None:
    ss.run("v{5} = x;", x=[1])
    ss.eval("v{};")[0].append(2)
    ss.eval("v;").append(2)
    assert ss.eval("[v, v{}, v{100}];") == [[1], [[1]], [1]]


@pytest.mark.parametrize(
    ("script", "code"),
    [("v{'a'} = 1;", "X007"), ("v{-1} = 1;", "X007"), ("v{True} = 1;", "X007"), ("v{5} = 1; v{'a'};", "X007"),
     ("v{5} = 1; v{[1]};", "X007"), ("w = 1; w{};", "X007"), ("w = 1; w{-1};", "X007"), ("w{};", "R001"),
     ("v{1 / 0} = 1;", "X002"), ("v{5} = 2 ^ 70;", "X004")],
)  # fmt: skip
def test_wrong_uses(ss: ss2sql.Session, script: str, code: str) -> None:
    with pytest.raises(ss2sql.Error) as caught:
        ss.run(script)
    assert caught.value.code == code
    assert caught.value.span is not None
    assert ss.eval("1 + 1;") == 2


def test_a_new_meaning_of_the_name_ends_the_history(ss: ss2sql.Session, clock: Clock) -> None:
    store(ss, clock, at_100="a", at_101="b")
    ss.run("v = 7;")
    assert ss.eval("v;") == 7
    with pytest.raises(ss2sql.ExecutionError, match="'v' is not a temporal variable"):
        ss.run("v{};")
    store(ss, clock, at_102="c")
    assert ss.eval("v{};") == ["c"]
    ss.set("v", 1)
    assert ss.eval("v;") == 1
    store(ss, clock, at_103="d")
    ss.run("clear();")
    assert ss.variables() == {}
    with pytest.raises(ss2sql.ResolveError):
        ss.run("v;")


def test_the_clock_is_getTime(ss: ss2sql.Session, clock: Clock) -> None:  # noqa: N802 - the language's name
    assert ss.eval("getTime();") == 100.0
    clock.now = 7.5
    assert ss.eval("SELECT getTime() FROM [1] AS value;") == 7.5
    with ss2sql.connect() as other:
        assert isinstance(other.eval("getTime();"), float)
        other.run("v{5} = 1;")
        assert other.eval("v{getTime()};") == 1


# --- in a file -----------------------------------------------------------------------------------------


def session(path: Path, clock: Clock, **options: Any) -> ss2sql.Session:
    ss = ss2sql.connect(path, **options)
    ss.function("getTime", clock)
    return ss


VALUES = [1, 1.0, True, -0.0, None, "text ä \u2028", "\ud800", [1, [2.5, False]], {"a": [None], "b": {}}, 2**63 - 1]


def test_temporal_variables_outlive_the_session(tmp_path: Path, clock: Clock) -> None:
    path = tmp_path / "robot.db"
    with session(path, clock) as ss:
        for value in VALUES:
            clock.now += 0.25
            ss.run("v{60} = x;", x=value)
        ss.run("plain = 1;")
    with session(path, clock) as ss:
        assert repr(ss.eval("v{};")) == repr(VALUES)
        assert repr(ss.eval("v;")) == repr(VALUES[-1])
        assert ss.eval("v{100.6};") == 1.0
        assert ss.variables() == {"v": VALUES[-1]}
        clock.now += 60
        assert len(ss.eval("v{};")) == 2
        ss.run("v{1} = 'last';")
        clock.now += 5
    with session(path, clock) as ss:
        assert ss.eval("v{};") == ["last"]
        ss.run("v = 3;")
    with session(path, clock) as ss:
        assert ss.variables() == {}
        with pytest.raises(ss2sql.ResolveError):
            ss.run("v;")


def test_the_table_of_the_file_is_not_in_the_way(tmp_path: Path, clock: Clock) -> None:
    path = tmp_path / "robot.db"
    with session(path, clock) as ss:
        ss.run("a{5} = 1; b{5} = 2;")
        with pytest.raises(ss2sql.ResolveError) as caught:
            ss.run("SELECT this FROM ss2sql;")
        assert "ss2sql_temporal" not in str(caught.value)
    with closing(sqlite3.connect(path)) as plain, plain:
        rows = plain.execute("SELECT name, time, value, keep FROM ss2sql_temporal ORDER BY name").fetchall()
    plain.close()
    assert rows == [("a", 100.0, "1", 5.0), ("b", 100.0, "2", 5.0)]


@pytest.mark.parametrize("value", [object(), [object()], {1: "a"}, {(1, 2): 3}])
def test_values_without_a_form_in_the_file_live_in_memory_only(tmp_path: Path, clock: Clock, value: Any) -> None:
    path = tmp_path / "robot.db"
    with session(path, clock) as ss:
        ss.run("v{5} = 1;")
        ss.run("v{5} = x;", x=value)
        assert ss.eval("v;") == value
        assert len(ss.eval("v{};")) == 2
    with session(path, clock) as ss:
        assert ss.variables() == {}


def test_reading_only_starts_with_what_was_kept_and_writes_nothing(tmp_path: Path, clock: Clock) -> None:
    path = tmp_path / "robot.db"
    with session(path, clock) as ss:
        ss.run("v{5} = 1;")
    before = path.read_bytes()
    with session(path, clock, read_only=True) as ss:
        clock.now += 1
        assert ss.eval("v{5} = 2; v{};") == [1, 2]
    assert path.read_bytes() == before


def test_a_locked_file_is_an_error_of_the_script(tmp_path: Path, clock: Clock, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ss2sql.runtime.opening.BUSY_MILLISECONDS", 10)
    path = tmp_path / "robot.db"
    with session(path, clock) as ss:
        ss.run("v{5} = 1;")
        writer = apsw.Connection(str(path))  # the locks of two copies of SQLite in one process do not see each other
        writer.execute("BEGIN IMMEDIATE")
        with pytest.raises(ss2sql.ExecutionError, match="'v' cannot be kept in the file: database is locked") as caught:
            ss.run("1; v{5} = 2;")
        assert caught.value.code == "X009"
        assert caught.value.span is not None
        writer.execute("ROLLBACK")
        writer.close()
        assert ss.eval("v{5} = 3; v;") == 3

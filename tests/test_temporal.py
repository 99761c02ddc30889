"""Temporal variables, `v{5.0} = x`, beside what tests/cases/temporal shows of them: in Python, and in files."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from sessions import Clock, code_of

import ss2sql


@pytest.fixture
def clock() -> Clock:
    return Clock(100.0)


@pytest.fixture
def ss(ss: ss2sql.Session, clock: Clock) -> ss2sql.Session:
    ss.function("getTime", clock)
    return ss


def test_what_scripts_keep_is_a_variable(ss: ss2sql.Session) -> None:
    ss.run("v{5} = x;", x=[1])
    ss.eval("v{};")[0].append(2)
    ss.eval("v;").append(2)
    assert ss.eval("[v, v{}, v{100}];") == [[1], [[1]], [1]]
    assert ss.get("v") == [1]
    assert ss.variables() == {"v": [1]}


@pytest.mark.parametrize("script", ["SELECT v{101} FROM [1];", "SELECT (v{1} = this) FROM [1];"])
def test_queries_that_read_or_write_histories_are_native(ss: ss2sql.Session, script: str) -> None:
    ss.run("v{5.0} = 1;")
    assert code_of(ss.run, script, engine="database") == "U001"
    assert ss.run(script).engine == "native"


def test_python_gives_a_name_another_meaning_too(ss: ss2sql.Session) -> None:
    ss.run("v{5.0} = 'a';")
    ss.set("v", 1)
    assert ss.eval("v;") == 1
    assert ss.eval("v{5.0} = 'b'; v{};") == ["b"]
    ss.run("clear();")
    assert ss.variables() == {}
    assert code_of(ss.run, "v;") == "R001"


def test_without_a_clock_of_the_user() -> None:
    with ss2sql.connect() as ss:
        assert isinstance(ss.eval("getTime();"), float)
        ss.run("v{5} = 1;")
        assert ss.eval("v{getTime()};") == 1


# --- in a file -----------------------------------------------------------------------------------------


def session(path: Path, clock: Clock, **options: Any) -> ss2sql.Session:
    ss = ss2sql.connect(path, **options)
    ss.function("getTime", clock)
    return ss


VALUES = [1, 1.0, True, -0.0, None, "text ä \u2028", "\ud800", [1, [2.5, False]], {"a": [None], "b": {}}, 2**63 - 1]


def test_temporal_variables_outlive_the_session(file: Path, clock: Clock) -> None:
    with session(file, clock) as ss:
        for value in VALUES:
            clock.now += 0.25
            ss.run("v{60} = x;", x=value)
        ss.run("plain = 1;")
    with session(file, clock) as ss:
        assert repr(ss.eval("v{};")) == repr(VALUES)
        assert repr(ss.eval("v;")) == repr(VALUES[-1])
        assert ss.eval("v{100.6};") == 1.0
        assert ss.variables() == {"v": VALUES[-1]}
        clock.now += 60
        assert len(ss.eval("v{};")) == 2
        ss.run("v{1} = 'last';")
        clock.now += 5
    with session(file, clock) as ss:
        assert ss.eval("v{};") == ["last"]
        ss.run("v = 3;")
    with session(file, clock) as ss:
        assert ss.variables() == {}
        assert code_of(ss.run, "v;") == "R001"


def test_the_table_of_the_file_is_not_in_the_way(file: Path, clock: Clock) -> None:
    with session(file, clock) as ss:
        ss.run("a{5} = 1; b{5} = 2;")
        with pytest.raises(ss2sql.ResolveError) as caught:
            ss.run("SELECT this FROM ss2sql;")
        assert "ss2sql_temporal" not in str(caught.value)
    with closing(sqlite3.connect(file)) as plain:
        rows = plain.execute("SELECT name, time, value, keep FROM ss2sql_temporal ORDER BY name").fetchall()
    assert rows == [("a", 100.0, "1", 5.0), ("b", 100.0, "2", 5.0)]


@pytest.mark.parametrize("value", [object(), [object()], {1: "a"}, {(1, 2): 3}], ids=range(4))
def test_values_without_a_form_in_the_file_live_in_memory_only(file: Path, clock: Clock, value: Any) -> None:
    with session(file, clock) as ss:
        ss.run("v{5} = 1;")
        ss.run("v{5} = x;", x=value)
        assert ss.eval("v;") == value
        assert len(ss.eval("v{};")) == 2
    with session(file, clock) as ss:
        assert ss.variables() == {}


def test_reading_only_starts_with_what_was_kept_and_writes_nothing(file: Path, clock: Clock) -> None:
    with session(file, clock) as ss:
        ss.run("v{5} = 1;")
    before = file.read_bytes()
    with session(file, clock, read_only=True) as ss:
        clock.now += 1
        assert ss.eval("v{5} = 2; v{};") == [1, 2]
    assert file.read_bytes() == before

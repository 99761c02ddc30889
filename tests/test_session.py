"""The session: what it opens, how it runs scripts, also from within functions, and its variables."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pandas
import pytest
from sessions import code_of, write

import ss2sql

# --- opening and closing -------------------------------------------------------------------------------


def test_a_session_on_a_file(staff: Path, tmp_path: Path) -> None:
    """One that does not exist is made, unless it may only be read."""
    for options in ({}, {"read_only": True}):
        with ss2sql.connect(str(staff), **options) as ss:  # type: ignore[arg-type]
            assert ss.eval("SELECT this FROM staff LIMIT 1 AS value;") == {"id": 1, "boss": None, "name": "Ada"}
            assert ss.eval("SELECT name FROM chiefs AS list;") == ["Ada"]
    assert code_of(ss2sql.connect, tmp_path / "new.db", read_only=True) == "S002"
    with ss2sql.connect(tmp_path / "new.db") as ss:
        ss.eval("v{5.0} = 1;")
    assert (tmp_path / "new.db").exists()


def test_a_closed_session_says_so() -> None:
    with ss2sql.connect() as ss:
        query = ss.compile("1 + 1;")
        assert query.run().value == 2
    ss.close()
    calls = (lambda: ss.run("1;"), lambda: ss.eval("1;"), lambda: ss.compile("1;"), query.run, lambda: ss.set("x", 1),
             lambda: ss.attach("x", [1]), lambda: ss.function("f", abs), lambda: ss.representation("form"))  # fmt: skip
    for call in calls:
        with pytest.raises(ss2sql.SessionError, match="closed") as caught:
            call()
        assert caught.value.code == "S001"
        assert "ss2sql.connect()" in caught.value.hints[0]


def test_sessions_and_queries_tell_what_they_are(tmp_path: Path) -> None:
    with ss2sql.connect() as ss:
        assert repr(ss) == "<session in memory>"
        ss.set("limit", 1)
        ss.attach("towns", ["Ulm"])
        assert repr(ss) == "<session in memory, knows limit, towns>"
        assert repr(ss.compile("1 +\n  1;\n")) == "<query 1 + 1>"
        assert repr(ss.compile("SELECT this FROM towns WHERE this > k;")) == (
            "<query SELECT this FROM towns WHERE this > k; takes k>"
        )
        assert len(repr(ss.compile(" + ".join(["1"] * 99)))) == 78
        for number in range(20):
            ss.set(f"x{number}", 1)
        assert len(repr(ss)) < 100
    with ss2sql.connect(tmp_path / "new.db") as ss:
        pass
    assert repr(ss) == f"<session on {tmp_path / 'new.db'}, closed>"


# --- running -------------------------------------------------------------------------------------------


def test_values_given_to_one_run_end_with_it(ss: ss2sql.Session, engine: Any) -> None:
    ss.set("x", 1)
    assert ss.run("SELECT this + x FROM [0] AS list;", engine=engine, x=10).value == [10]
    assert ss.run("x = x + 1; x;", engine=engine, x=10).value == 11
    assert ss.get("x") == 1
    assert ss.run("SELECT this + x FROM [0] AS list;", engine=engine).value == [1]
    assert ss.variables() == {"x": 1}


def test_a_script_may_be_a_file(ss: ss2sql.Session, tmp_path: Path) -> None:
    path = tmp_path / "query.ss"
    path.write_text("# größer\nx = 3;\nSELECT this FROM [1, x]\nAS list;\n", encoding="utf-8")
    assert ss.run(path).value == [1, 3]
    path.write_text("SELECT this\nFROM nowhere;", encoding="utf-8")
    with pytest.raises(ss2sql.ResolveError, match=r"query\.ss:2:6"):
        ss.run(path)


def test_scripts_that_cannot_be_read(ss: ss2sql.Session, tmp_path: Path) -> None:
    (tmp_path / "binary.ss").write_bytes(b"\xff\xfe\x00")
    for script in (tmp_path / "missing.ss", tmp_path / "binary.ss", tmp_path, 7, None):
        for call in (ss.run, ss.compile):
            named = re.escape(str(script)) if isinstance(script, Path) else type(script).__name__
            with pytest.raises(ss2sql.SessionError, match=f"S002.*{named}"):
                call(script)


def test_the_engine_can_be_chosen(ss: ss2sql.Session) -> None:
    flat = "SELECT this FROM [1, 2];"
    memorize = "SELECT this FROM [1] START WITH n = 0 CONNECT BY MEMORIZE 2 n = n + 1;"
    assert ss.run(flat).engine == "native"
    assert ss.run(flat, engine="database").engine == "database"
    assert ss.run(flat, engine="native").engine == "native"
    assert ss.run(memorize).engine == "native"
    with pytest.raises(ss2sql.UnsupportedError, match=r"U001.*MEMORIZE"):
        ss.run(memorize, engine="database")
    query = ss.compile(flat, engine="native")
    assert query.run().engine == "native"
    assert query.run(engine="database").engine == "database"
    assert query.run().engine == "native"
    for call in (ss.run, ss.compile):
        with pytest.raises(ss2sql.SessionError, match="did you mean 'database'"):
            call(flat, engine="databas")
    assert code_of(query.run, engine="sqlite") == "S002"


# --- functions that run scripts ------------------------------------------------------------------------


@pytest.mark.parametrize("inner", ["database", "native"])
def test_a_function_may_run_a_script_of_the_same_session(ss: ss2sql.Session, engine: Any, inner: Any) -> None:
    @ss.function(volatility="stable")
    def neighbours(node):
        return ss.run("SELECT b FROM edges WHERE a == node AS list;", engine=inner, node=node).value

    ss.attach("edges", [{"a": 1, "b": 2}, {"a": 1, "b": 3}, {"a": 2, "b": 4}])
    result = ss.run("SELECT this, neighbours(this) FROM [1, 2, 4] AS rows;", engine=engine)
    assert result.value == [(1, [2, 3]), (2, [4]), (4, [])]
    assert result.stats.calls == {"neighbours": 3}


def test_an_error_of_an_inner_script_leaves_both_usable(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("inner", lambda x: ss.run("SELECT 1 / this FROM [x];", engine=engine, x=x).value, volatility="stable")
    script = "SELECT inner(this) FROM [1, 0, 2] AS list;"
    with pytest.raises(ss2sql.ExecutionError) as caught:
        ss.run(script, engine=engine)
    assert caught.value.code == "X002"
    assert caught.value.span is not None
    assert caught.value.span.source.text == "SELECT 1 / this FROM [x];"
    assert ss.run("SELECT inner(this) FROM [1] AS list;", engine=engine).value == [[{"1 / this": 1.0}]]


def test_an_error_that_is_kept_does_not_lock_the_file(staff: Path, engine: Any) -> None:
    with ss2sql.connect(staff) as ss:
        with pytest.raises(ss2sql.ExecutionError) as caught:
            ss.run("SELECT id FROM staff;", engine=engine, max_rows=1)
        write(staff, "DELETE FROM staff")
        assert caught.value.code == "X010"
        assert ss.eval("SELECT id FROM staff AS list;") == []


# --- variables -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["", "1x", "a b", "x;", "select", "From", "THIS", "none"])
def test_names_that_no_script_can_use_are_refused(ss: ss2sql.Session, name: str) -> None:
    for call in (ss.set, ss.attach):
        assert code_of(call, name, 1) == "S002"
    assert code_of(ss.function, name, lambda x: x) == "S002"
    assert code_of(ss.representation, name) == "S002"


def test_variables_are_copies(ss: ss2sql.Session) -> None:
    given = [[1], 2.0]
    ss.set("x", given)
    given[0].append(9)
    assert ss.get("x") == [[1], 2.0]
    ss.get("x")[0].append(9)
    ss.variables()["x"][0].append(9)
    assert ss.eval("x;") == [[1], 2.0]
    ss.eval("x;")[0].append(9)
    assert ss.eval("x;") == [[1], 2.0]


def test_variables_of_scripts_are_those_of_python(ss: ss2sql.Session) -> None:
    ss.eval("b = 2; a = [b, b];")
    assert ss.variables() == {"a": [2, 2], "b": 2}
    assert list(ss.variables()) == ["a", "b"]
    assert ss.get("a") == [2, 2]
    with pytest.raises(KeyError):
        ss.get("c")
    assert ss.eval("clear(); var();") == {}
    assert ss.variables() == {}


@pytest.mark.parametrize("value", [float("nan"), float("inf"), 2**63, 1j, [float("nan")], np.array([np.nan])])
def test_what_is_no_value_is_refused_by_name(ss: ss2sql.Session, value: Any) -> None:
    with pytest.raises(ss2sql.ExecutionError, match=r"X004.*the variable 'x'"):
        ss.set("x", value)
    ss.attach("x", value)
    assert code_of(ss.run, "SELECT this FROM x;") == "X004"
    assert code_of(ss.run, "x;", x=value) == "X004"
    assert ss.eval("1 + 1;") == 2


def test_tables_are_all_that_from_finds(ss: ss2sql.Session) -> None:
    ss.host.connection.execute("CREATE TABLE staff(id INTEGER)")
    ss.set("xs", [{"a": 1, "b": "x"}, {"a": 2.5, "b": None}])
    ss.set("n", 3)
    ss.attach("log", pandas.DataFrame({"t": [1.5]}))
    ss.attach("empty", [])
    found = {name: (about.kind, about.columns, about.rows) for name, about in ss.tables().items()}
    assert found == {
        "staff": ("table", ("id",), None),
        "xs": ("list", ("a", "b"), 2),
        "log": ("data frame", ("t",), 1),
        "empty": ("list", ("this",), 0),
    }
    assert ss.describe("xs") == "FROM xs\n  a  int or float 1..2.5\n  b  none or str"
    assert ss.describe("log") == "FROM log\n  t  float 1..2"
    assert ss.describe("n") == "FROM n\n  this  int 3..3"
    with pytest.raises(ss2sql.SessionError, match="did you mean 'log'"):
        ss.describe("lag")

"""What docs/security.md promises: what a script reaches, what its statement may do in SQLite, what a terminal sees."""

from __future__ import annotations

import contextlib
import io
from pathlib import Path
from typing import Any

import apsw
import pytest

import ss2sql
from ss2sql.errors import Error, ExecutionError, ResolveError
from ss2sql.errors.exceptions import escape_controls

REFUSED = (
    "ATTACH 'x' AS y", "PRAGMA user_version = 3", "CREATE TABLE u(a)", "CREATE TEMP VIEW u AS SELECT 1",
    "INSERT INTO t VALUES (1)", "UPDATE t SET a = 1", "DELETE FROM t", "DROP TABLE t", "BEGIN", "SAVEPOINT s",
    "ANALYZE", "REINDEX", "VACUUM", "SELECT load_extension('x')", "SELECT randomblob(9)", "SELECT zeroblob(9)",
    "SELECT printf('%d', a) FROM t", "SELECT sqlite_version()", "SELECT * FROM sqlite_schema",
    "SELECT * FROM SQLITE_MASTER", "SELECT * FROM t WHERE a IN (SELECT name FROM sqlite_schema)",
    "SELECT 1; DROP TABLE t",
)  # fmt: skip


@pytest.fixture
def guarded(tmp_path: Path) -> ss2sql.Session:
    path = tmp_path / "data.db"
    apsw.Connection(str(path)).execute("CREATE TABLE t(a); CREATE INDEX i ON t(a); INSERT INTO t VALUES (7)")
    return ss2sql.connect(path)


@pytest.mark.parametrize("text", REFUSED)
def test_sqlite_refuses_what_a_statement_of_a_script_never_does(guarded: ss2sql.Session, text: str) -> None:
    with pytest.raises(apsw.Error):
        guarded.host.database.guard.execute_reading(text, {}).fetchall()
    assert guarded.eval("SELECT a FROM t AS list") == [7]


def test_reading_and_functions_that_are_registered_are_allowed(guarded: ss2sql.Session) -> None:
    guarded.function("twice", lambda x: 2 * x)
    assert guarded.run("SELECT twice(a) FROM t AS list", engine="database").value == [14]
    with guarded.host.connection:  # what ss2sql does itself is not looked at
        guarded.host.connection.execute("INSERT INTO t VALUES (8)")
    assert guarded.eval("SELECT a FROM t AS list") == [7, 8]


def test_a_function_may_run_a_script_that_writes_a_temporal_variable(guarded: ss2sql.Session) -> None:
    guarded.function("noted", lambda x: guarded.eval("seen{1.0} = 3; SELECT a FROM t AS value"), volatility="stable")
    assert guarded.run("SELECT noted(a) FROM t AS list", engine="database").value == [7]
    assert guarded.eval("seen") == 3


def test_views_of_a_strange_file_call_nothing_that_has_effects(tmp_path: Path, engine: Any) -> None:
    path = tmp_path / "strange.db"
    view = "CREATE VIEW v{0} AS SELECT {1} AS x FROM t"
    calls = ("twice(a)", "print(a, '1:1')", "load_extension('x')", "upper('x')")
    connection = apsw.Connection(str(path))
    connection.execute("CREATE TABLE t(a); INSERT INTO t VALUES (7)")
    for number, call in enumerate(calls):
        connection.execute(view.format(number, call))
    connection.close()
    called: list[int] = []
    ss = ss2sql.connect(path)
    ss.function("twice", lambda x: called.append(x))
    for number in range(3):
        with pytest.raises(ExecutionError, match=r"unsafe use|no such function"):
            ss.run(f"SELECT x FROM v{number}", engine=engine)
    assert not called
    assert ss.run("SELECT x FROM v3 AS list", engine=engine).value == ["X"]


@pytest.mark.parametrize(
    "source",
    [
        *("sqlite_master", "sqlite_schema", "main.sqlite_schema", "SQLITE_MASTER", "pragma_table_list", "dbstat"),
        *("words", "words_data", "boxes", "boxes_node", "json_each"),
    ],
)
def test_what_sqlite_keeps_and_virtual_tables_are_no_sources(tmp_path: Path, source: str) -> None:
    path = tmp_path / "data.db"
    connection = apsw.Connection(str(path))
    connection.execute("CREATE VIRTUAL TABLE words USING fts5(x); CREATE VIRTUAL TABLE boxes USING rtree(i, a, b)")
    connection.close()
    with pytest.raises(ResolveError):
        ss2sql.connect(path).run(f"SELECT * FROM {source}")


@pytest.mark.parametrize(
    "name", ['x"; DROP TABLE t; --', "x'y", "a\0b", "SELECT", "", "ä ö", "x" * 10_000, "]", "`", "--"]
)
def test_names_that_look_like_sql_are_names(guarded: ss2sql.Session, name: str) -> None:
    guarded.attach("rows", [{name: 5}])
    result = guarded.run("SELECT rows.this, to(a, 'm') FROM rows, t", engine="database")
    assert result.value == [{"rows": {name: 5}, "m": 7}]
    assert guarded.run("SELECT * FROM rows AS dict").value == [{name: 5}]
    assert guarded.eval("SELECT a FROM t AS list") == [7]


def test_lists_whose_columns_look_alike_to_sqlite_are_walked_apart() -> None:
    ss = ss2sql.connect()
    for rows in ([{"a_b": 1}], [{"a": 1, "b": 2}], [{"C": 1}], [{"c": 2}], [{"a, b": 1}], [{"^c": 1}], [{"\ud800": 1}]):
        assert ss.run("SELECT * FROM r", r=rows, engine="database").value == rows
    both = ss.run("SELECT r.C, q.c FROM r, q", r=[{"C": 1}], q=[{"c": 4}], engine="database")
    assert both.value == [{"C": 1, "c": 4}]
    script = "SELECT to(x[0], 'a\\0b') FROM (SELECT to(r.this['a'], 'x') FROM r)"
    assert ss.run(script, r=[{"a": [3]}], engine="database").value == [{"a\0b": 3}]


# --- terminals -----------------------------------------------------------------------------------------

BAD = "\x1b]0;title\x07\r\x9b\u202e\x00"


def test_text_for_terminals_shows_what_a_terminal_would_obey() -> None:
    assert escape_controls(BAD) == r"\x1b]0;title\x07\r\x9b\u202e\x00"
    assert escape_controls("a\tb\nä \u4e2d") == "a\tb\nä \u4e2d"
    assert escape_controls("\ud800") == r"\ud800"


SHOWN = (
    "print(bad)", "print([bad], bad)", "help(bad)", "var(bad)", "eval(bad)", "bad + 1", "int(bad)", "d[bad]",
    "rows[0]['x']",    "SELECT bad FROM [1]", "SELECT * FROM rows", "SELECT y FROM rows",
    "SELECT this FROM [bad] GROUP BY this", "d",
    f"SELECT to(1, {BAD.encode('unicode_escape').decode()!r}) FROM [1]",
    f'SELECT x."{BAD[:6]}" FROM [1]',
    f"'{BAD[:4]}' + 1",
)  # fmt: skip


@pytest.mark.parametrize("script", SHOWN)
def test_nothing_that_is_shown_moves_the_cursor(script: str) -> None:
    ss = ss2sql.connect()
    ss.set("bad", BAD)
    ss.set("d", {BAD[:4]: 1})
    ss.attach("rows", [{BAD: BAD}])
    output = io.StringIO()
    with contextlib.redirect_stdout(output):
        try:
            result = ss.run(script)
        except Error as error:
            print(error)
        else:
            print(repr(result))
            print(result.explain())
    assert not {c for c in output.getvalue() if (not c.isprintable() and c not in "\n") or c == "\u202e"}

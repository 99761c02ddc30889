"""Tables and views of a SQLite file as sources."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import apsw
import pytest
from sessions import both, write

import ss2sql


@pytest.fixture
def ss(file: Path) -> Iterator[ss2sql.Session]:
    with ss2sql.connect(file) as session:
        yield session


# --- what is read --------------------------------------------------------------------------------------


@both
def test_values_keep_their_kinds_whatever_the_column_declares(ss: ss2sql.Session, file: Path, engine: Any) -> None:
    write(file, "CREATE TABLE t(a, b INTEGER, c REAL, d TEXT)")
    write(
        file, "INSERT INTO t VALUES (1, 'one', 2, 3), (1.5, 2.5, 'x', NULL), ('a', NULL, 4.0, 'd'), (x'00ff', 1, 1, 1)"
    )
    result = ss.run("SELECT a, b, c, d FROM t AS rows;", engine=engine)
    assert repr(result.value) == repr(
        [(1, "one", 2.0, "3"), (1.5, 2.5, "x", None), ("a", None, 4.0, "d"), (b"\x00\xff", 1, 1.0, "1")]
    )
    assert ss.run("SELECT this FROM t WHERE b == 2.5 AS value;", engine=engine).value == {
        "a": 1.5,
        "b": 2.5,
        "c": "x",
        "d": None,
    }
    assert ss.run("SELECT * FROM t LIMIT 1;", engine=engine).value == [{"a": 1, "b": "one", "c": 2.0, "d": "3"}]


@both
def test_affinity_converts_nothing(ss: ss2sql.Session, file: Path, engine: Any) -> None:
    """SQLite would make a number of the text '1' when it compares it with an INTEGER column."""
    write(file, "CREATE TABLE t(number INTEGER, word TEXT); INSERT INTO t VALUES (1, '1'), (2, '2')")
    ss.attach("words", ["1", 1, 1.0, True])
    assert ss.run("SELECT number FROM t WHERE number == '1' AS list;", engine=engine).value == []
    assert ss.run("SELECT number FROM t WHERE word == 1 OR number == word AS list;", engine=engine).value == []
    assert ss.run("SELECT number FROM t WHERE number IN ['1', 2.0] AS list;", engine=engine).value == [2]
    script = "SELECT words.this FROM words, t WHERE words.this == number AS list;"
    assert repr(ss.run(script, engine=engine).value) == "[1, 1.0, True]"
    script = "SELECT words.this FROM words, t WHERE words.this == word AS list;"
    assert ss.run(script, engine=engine).value == ["1"]


@both
def test_text_is_compared_as_it_is_whatever_the_collation(ss: ss2sql.Session, file: Path, engine: Any) -> None:
    write(file, "CREATE TABLE t(a TEXT COLLATE NOCASE PRIMARY KEY, b TEXT COLLATE RTRIM)")
    write(file, "INSERT INTO t VALUES ('b', 'x '), ('A', 'x'), ('C', 'y')")
    assert ss.run("SELECT a FROM t WHERE a == 'a' AS list;", engine=engine).value == []
    assert ss.run("SELECT a FROM t WHERE b == 'x' AS list;", engine=engine).value == ["A"]
    assert ss.run("SELECT a FROM t WHERE b IN ['x'] OR a < 'B' AS list;", engine=engine).value == ["A"]
    assert ss.run("SELECT a FROM t ORDER BY a AS list;", engine=engine).value == ["A", "C", "b"]
    assert ss.run("SELECT b, count(*) FROM t GROUP BY b AS rows;", engine=engine).value == [
        ("x ", 1),
        ("x", 1),
        ("y", 1),
    ]
    assert ss.run("SELECT max(a), min(a) FROM t GROUP BY 1 AS rows;", engine=engine).value == [("b", "A")]


@both
def test_rows_come_in_the_order_of_the_table(ss: ss2sql.Session, file: Path, engine: Any) -> None:
    write(file, "CREATE TABLE t(key INTEGER PRIMARY KEY, a); INSERT INTO t VALUES (3, 'x'), (1, 'y'), (2, 'x')")
    write(file, "CREATE INDEX by_a ON t(a)")
    write(
        file, "CREATE TABLE w(a, b, PRIMARY KEY (b DESC, a)) WITHOUT ROWID; INSERT INTO w VALUES (1, 1), (2, 1), (1, 2)"
    )
    write(file, "CREATE VIEW v AS SELECT a FROM t ORDER BY key DESC")
    assert ss.run("SELECT key FROM t AS list;", engine=engine).value == [1, 2, 3]
    assert ss.run("SELECT key FROM t WHERE a == 'x' AS list;", engine=engine).value == [2, 3]
    assert ss.run("SELECT a.key, b.key FROM a = t, b = t WHERE a.a == b.a AS rows;", engine=engine).value == [
        (1, 1), (2, 2), (2, 3), (3, 2), (3, 3)]  # fmt: skip
    rows = ss.run("SELECT a, b FROM w AS rows;", engine=engine).value
    assert rows == [(1, 1), (2, 1), (1, 2)]
    assert ss.run("SELECT a FROM v AS list;", engine=engine).value == ["x", "x", "y"]
    assert ss.run("SELECT n.this, a FROM n = [1, 2], t ORDER BY a AS rows;", engine=engine).value == [
        (1, "x"), (1, "x"), (2, "x"), (2, "x"), (1, "y"), (2, "y")]  # fmt: skip


@both
def test_columns_that_are_called_like_the_row_number(ss: ss2sql.Session, file: Path, engine: Any) -> None:
    write(file, "CREATE TABLE t(rowid, Oid, a); INSERT INTO t VALUES ('z', 9, 1), ('y', 8, 2)")
    write(file, "CREATE TABLE u(rowid, oid, _rowid_); INSERT INTO u VALUES (3, 2, 1), (1, 2, 3)")
    assert ss.run("SELECT rowid, Oid, a FROM t AS rows;", engine=engine).value == [("z", 9, 1), ("y", 8, 2)]
    assert ss.run("SELECT rowid, oid, _rowid_ FROM u AS rows;", engine=engine).value == [(3, 2, 1), (1, 2, 3)]
    assert ss.run("SELECT t.a, u.oid FROM t, u AS rows;", engine=engine).value == [(1, 2), (1, 2), (2, 2), (2, 2)]


@both
def test_generated_columns_and_strict_tables(ss: ss2sql.Session, file: Path, engine: Any) -> None:
    write(file, "CREATE TABLE t(a INTEGER, double INTEGER AS (2 * a), stored TEXT AS (a || '!') STORED) STRICT")
    write(file, "INSERT INTO t(a) VALUES (1), (2)")
    assert ss.run("SELECT * FROM t AS rows;", engine=engine).value == [(1, 2, "1!"), (2, 4, "2!")]


@both
def test_an_empty_table(ss: ss2sql.Session, file: Path, engine: Any) -> None:
    write(file, "CREATE TABLE t(a, b)")
    assert ss.run("SELECT a, b + 1 FROM t WHERE a < b AS rows;", engine=engine).value == []
    assert ss.run("SELECT count(*), sum(a) FROM t GROUP BY b AS rows;", engine=engine).value == []
    assert ss.run("SELECT a FROM t START WITH n = 0 CONNECT BY n = a;", engine=engine).value == []


@both
@pytest.mark.parametrize("name", ["my table", 'say "x"', "größe", "order", "t.u", "x'; --"])
def test_odd_names_of_tables_and_columns(ss: ss2sql.Session, file: Path, engine: Any, name: str) -> None:
    quoted = '"' + name.replace('"', '""') + '"'
    write(file, f"CREATE TABLE plain({quoted}, b); INSERT INTO plain VALUES (1, 2)")
    write(file, f"CREATE TABLE {quoted}(a); INSERT INTO {quoted} VALUES (5)")
    assert ss.run("SELECT * FROM plain;", engine=engine).value == [{name: 1, "b": 2}]
    assert ss.run("SELECT this FROM plain AS value;", engine=engine).value == {name: 1, "b": 2}
    if name.isidentifier():
        assert ss.run(f"SELECT a FROM {name} AS list;", engine=engine).value == [5]
        assert ss.run(f"SELECT {name} FROM plain AS list;", engine=engine).value == [1]


def test_names_are_case_sensitive(ss: ss2sql.Session, file: Path) -> None:
    write(file, "CREATE TABLE Staff(Name); INSERT INTO Staff VALUES ('Ada')")
    assert ss.eval("SELECT Name FROM Staff AS list;") == ["Ada"]
    with pytest.raises(ss2sql.ResolveError, match="did you mean 'Staff'"):
        ss.run("SELECT Name FROM staff;")
    with pytest.raises(ss2sql.ResolveError, match="did you mean 'Name'"):
        ss.run("SELECT name FROM Staff;")


@pytest.mark.parametrize("name", ["sqlite_schema", "sqlite_master", "pragma_table_list", "json_each", "elements"])
def test_what_is_sqlites_own_is_no_source(ss: ss2sql.Session, name: str) -> None:
    ss.run("SELECT this FROM [1];", engine="database")
    with pytest.raises(ss2sql.ResolveError) as caught:
        ss.run(f"SELECT * FROM {name};")
    assert caught.value.code == "R003"


def test_variables_come_before_tables(ss: ss2sql.Session, file: Path) -> None:
    write(file, "CREATE TABLE t(a); INSERT INTO t VALUES (1)")
    assert ss.eval("SELECT * FROM t;") == [{"a": 1}]
    assert ss.eval("t = [7]; SELECT this FROM t AS list;") == [7]
    assert ss.eval("SELECT a FROM main.t AS list;") == [1]
    ss.eval("clear();")
    assert ss.eval("SELECT a FROM t AS list;") == [1]


# --- several files -------------------------------------------------------------------------------------


@both
def test_the_same_name_in_two_files(ss: ss2sql.Session, file: Path, tmp_path: Path, engine: Any) -> None:
    write(file, "CREATE TABLE t(a); INSERT INTO t VALUES ('main')")
    write(
        tmp_path / "other.db",
        "CREATE TABLE t(a); INSERT INTO t VALUES ('other'); CREATE TABLE u(b); INSERT INTO u VALUES (2)",
    )
    ss.attach("other", tmp_path / "other.db")
    assert ss.run("SELECT a FROM t AS list;", engine=engine).value == ["main"]
    assert ss.run("SELECT x.a, y.a, b FROM x = t, y = other.t, u AS rows;", engine=engine).value == [
        ("main", "other", 2)
    ]
    script = "SELECT t.a, n FROM t = other.t START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 1 AS rows;"
    assert ss.run(script.replace("STOP WITH n == 1", "STOP WITH n == 2"), engine=engine).value == [
        [("other", 0)], [("other", 0), ("other", 1)]]  # fmt: skip
    for name in ("other.v", "another.t", "main.u"):
        with pytest.raises(ss2sql.ResolveError) as caught:
            ss.run(f"SELECT 1 FROM {name};")
        assert caught.value.code == "R003"
    with pytest.raises(ss2sql.ResolveError) as caught:
        ss.run("SELECT 1 FROM other;")
    assert caught.value.hints == ("'other' is a file: name one of its tables, FROM other.table",)


# --- what goes wrong -----------------------------------------------------------------------------------


def test_a_view_that_cannot_be_read(ss: ss2sql.Session, file: Path) -> None:
    write(file, "CREATE TABLE gone(a); CREATE VIEW v AS SELECT a FROM gone")
    query = ss.compile("SELECT a FROM v;")
    write(file, "DROP TABLE gone")
    for call in (query.run, lambda: ss.run("SELECT a FROM v;")):
        with pytest.raises(ss2sql.ExecutionError, match="the view 'v' cannot be read: no such table") as caught:
            call()
        assert caught.value.code == "X009"
        assert caught.value.span is not None
        assert caught.value.span.text == "v"
    assert ss.eval("1 + 1;") == 2


@both
def test_a_file_that_somebody_writes(ss: ss2sql.Session, file: Path, engine: Any) -> None:
    write(file, "CREATE TABLE t(a); INSERT INTO t VALUES (1)")
    ss.host.connection.set_busy_timeout(10)
    query = ss.compile("SELECT a FROM t AS list;")
    assert query.run(engine=engine).value == [1]
    writer = apsw.Connection(str(file))
    writer.execute("BEGIN EXCLUSIVE; UPDATE t SET a = 2")
    for call in (lambda: query.run(engine=engine), lambda: ss.run("SELECT a FROM t;", engine=engine)):
        with pytest.raises(ss2sql.ExecutionError, match="database is locked") as caught:
            call()
        assert caught.value.code == "X009"
    writer.execute("COMMIT")
    writer.close()
    assert query.run(engine=engine).value == [2]


@both
def test_columns_that_do_not_exist(ss: ss2sql.Session, file: Path, engine: Any) -> None:
    write(file, "CREATE TABLE t(mass, size)")
    for script, hint in (("SELECT mas FROM t;", "mass"), ("SELECT t.sise FROM t;", "size")):
        with pytest.raises(ss2sql.ResolveError, match=f"did you mean '{hint}'") as caught:
            ss.run(script, engine=engine)
        assert caught.value.code == "R001"


# --- searches ------------------------------------------------------------------------------------------


@both
@pytest.mark.parametrize("option", ["", "BREADTH FIRST", "NO CYCLE", "UNIQUE"])
def test_a_search_over_a_table_of_edges(ss: ss2sql.Session, file: Path, engine: Any, option: str) -> None:
    write(file, "CREATE TABLE edges(src, dst)")
    write(file, "INSERT INTO edges VALUES ('d', 'e'), ('a', 'c'), ('a', 'b'), ('b', 'd'), ('c', 'd')")
    for source in ("(SELECT * FROM edges WHERE src == node)", "edges"):
        where = "" if source != "edges" else "OR src != node"
        script = f"""SELECT dst FROM {source} WHERE dst == 'e' AND src == node START WITH node = 'a'
        CONNECT BY {option} node = dst STOP WITH dst == 'e' {where} AS list;"""
        found = ss.run(script, engine=engine).value
        assert found == ([["c", "d", "e"]] if option == "UNIQUE" else [["c", "d", "e"], ["b", "d", "e"]])

"""What is known of the columns of tables and views: never too little, and found out within limits."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import apsw
import pandas
import pytest
from golden import each_row
from hypothesis import given
from hypothesis import strategies as st
from sessions import code_of, write

import ss2sql
from ss2sql.errors import Source
from ss2sql.frontend.syntax.ast import collect_syntax_columns
from ss2sql.frontend.syntax.parser import parse
from ss2sql.language.kinds import Kind, Type, is_supertype, type_of
from ss2sql.runtime.sqlite.database_tables import STORED

ENDLESS = "WITH RECURSIVE r(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM r) SELECT n FROM r"
ROWS = 20_000
BIG = f"WITH RECURSIVE r(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM r LIMIT {ROWS}) SELECT n, n * 0.5, 'x' || n FROM r"


@pytest.fixture
def ss(file: Path) -> Iterator[ss2sql.Session]:
    with ss2sql.connect(file) as session:
        yield session


def steps_of(ss: ss2sql.Session, work: Callable[[], object]) -> int:
    """The steps of SQLite's virtual machine that some work takes, in hundreds."""
    count = 0

    def counting() -> bool:
        nonlocal count
        count += 1
        return False

    ss.host.connection.set_progress_handler(counting, 100, id="test")
    try:
        work()
    finally:
        ss.host.connection.set_progress_handler(None, id="test")
    return count


# --- views ---------------------------------------------------------------------------------------------


@pytest.mark.timeout(60)
@pytest.mark.parametrize(
    "view",
    [ENDLESS, f"SELECT n FROM ({ENDLESS}) ORDER BY n", f"SELECT count(*) AS n FROM ({ENDLESS})",
     f"SELECT DISTINCT n % 3 AS n FROM ({ENDLESS})",
     f"SELECT a.n FROM ({ENDLESS}) AS a, ({ENDLESS}) AS b WHERE a.n < 0",
     f"WITH c AS MATERIALIZED ({ENDLESS}) SELECT n FROM c", f"SELECT n FROM t, ({ENDLESS}) WHERE t.a = n"],
)  # fmt: skip
def test_a_view_without_an_end(ss: ss2sql.Session, file: Path, view: str) -> None:
    write(file, f"CREATE TABLE t(a); INSERT INTO t VALUES (1); CREATE VIEW v AS {view}")
    assert {name: about.columns for name, about in ss.tables().items()} == {"t": ("a",), "v": ("n",)}
    assert ss.describe("v") == "FROM v\n  n  none or int or float or str or object"
    query = ss.compile("SELECT n FROM v;")
    for call in (query.run, lambda **named: ss.run("SELECT n FROM v WHERE n > 1;", **named)):
        for engine in ("database", "native"):
            assert code_of(call, engine=engine, timeout=0.2) == "T001"
    assert ss.eval("SELECT a FROM t AS list;") == [1]


def test_the_first_rows_of_a_view_without_an_end(ss: ss2sql.Session, file: Path, engine: Any) -> None:
    write(file, f"CREATE VIEW v AS {ENDLESS}")
    script = "SELECT n + 1 FROM v WHERE n > 4 LIMIT 3 AS list;"
    if engine == "database":
        assert ss.run(script, engine=engine).value == [6, 7, 8]
    else:
        assert code_of(ss.run, script, engine=engine, timeout=0.2) == "T001"


def test_a_view_that_begins_to_take_long(ss: ss2sql.Session, file: Path) -> None:
    """What is known holds for what was looked at, and a change never leaves too little known."""
    write(file, f"CREATE TABLE t(a); INSERT INTO t VALUES (5); CREATE VIEW v AS SELECT n FROM t, ({ENDLESS} LIMIT t.a)")
    write(file, "DROP VIEW v; CREATE VIEW v AS SELECT n FROM (WITH RECURSIVE r(n) AS (SELECT 1 UNION ALL SELECT n + 1"
                " FROM r WHERE n < (SELECT a FROM t)) SELECT n FROM r)")  # fmt: skip
    assert _kinds(ss, "v") == Kind.INT
    write(file, "UPDATE t SET a = 1000000")
    assert _kinds(ss, "v") == STORED
    write(file, "UPDATE t SET a = 5")
    assert ss.eval("SELECT n + n FROM v AS list;") == [2, 4, 6, 8, 10]


def _kinds(ss: ss2sql.Session, table: str) -> Kind:
    source = ss.host.tables.find_table(None, table)
    assert source is not None
    return source.columns[0][1].kinds


@pytest.mark.parametrize("call", ["run", "compile", "describe"])
def test_a_look_ends_with_the_timeout_and_when_interrupted(file: Path, call: str) -> None:
    write(file, f"CREATE TABLE big AS {BIG}")
    argument = "big" if call == "describe" else "SELECT n FROM big;"
    with ss2sql.connect(file, timeout=0.0) as ss:
        assert code_of(getattr(ss, call), argument) == "T001"
        assert ss.tables()["big"].columns[0] == "n"
    with ss2sql.connect(file) as ss:
        ss.host.connection.set_progress_handler(ss.interrupt, 1000, id="test")
        assert code_of(getattr(ss, call), argument) == "T002"
        ss.host.connection.set_progress_handler(None, id="test")
        getattr(ss, call)(argument)


# --- after a change -------------------------------------------------------------------------------------


def test_only_what_is_read_is_looked_at_and_once_for_each_state_of_the_file(ss: ss2sql.Session, file: Path) -> None:
    write(file, "CREATE TABLE t(id INTEGER PRIMARY KEY, s TEXT, n INTEGER); CREATE TABLE other(a)")
    write(file, f"INSERT INTO t SELECT n, 'x' || n, n FROM ({BIG})")
    find = ss.host.tables.find_table
    for read, least, most in ((["id"], 0, 10), (["s"], ROWS // 100, ROWS // 9), ([], 0, 10)):
        for _ in range(2):
            assert least <= steps_of(ss, lambda read=read: find(None, "t", read)) < most
            assert steps_of(ss, lambda read=read: find(None, "t", read)) < 2
            write(file, "INSERT INTO other VALUES (1)")
    source = find(None, "t", ["s"])
    assert source is not None
    assert {name: kind.kinds for name, kind in source.columns} == {"id": Kind.INT, "s": Kind.STR, "n": STORED}


VALUES: Any = st.one_of(
    st.none(), st.integers(-5, 40), st.sampled_from([-(2**63), 2**53 + 1, 2**63 - 1, 2.0, 0.5, -7.25, 1e300, -1e308]),
    st.sampled_from([float("inf"), "", "a", "7", "7.5", "é", b"", b"7"])
)  # fmt: skip
DECLARED = ("", "INTEGER", "REAL", "TEXT", "NUMERIC", "BLOB", "FLOATING POINT", "TEXT COLLATE NOCASE", "DOUBLE")
CHANGES = st.lists(st.tuples(st.sampled_from(["insert", "update", "delete"]), VALUES, VALUES), max_size=4)


@given(
    st.tuples(st.sampled_from(DECLARED), st.sampled_from(DECLARED)),
    st.sampled_from(["", "CREATE INDEX i ON t(a)", "CREATE INDEX i ON t(b, a)", "CREATE INDEX i ON t(a DESC)",
                     "CREATE INDEX i ON t(a) WHERE a > 3", "CREATE INDEX i ON t(b COLLATE RTRIM)"]),
    st.sampled_from(["", ", id INTEGER PRIMARY KEY"]),
    st.lists(st.tuples(VALUES, VALUES), max_size=4),
    st.lists(CHANGES, max_size=4),
)  # fmt: skip
def test_known_types_cover_all_values(
    declared: tuple[str, str], index: str, key: str, rows: list[tuple[Any, Any]], changes: list[Any]
) -> None:
    """Of a table, and of a view of it, after every change."""
    with ss2sql.connect() as ss:
        own = ss.host.connection
        own.execute(f"CREATE TABLE t(a {declared[0]}, b {declared[1]}{key}); {index}; CREATE VIEW v AS SELECT * FROM t")
        own.executemany("INSERT INTO t(a, b) VALUES (?, ?)", rows)
        for change in [[], *changes]:
            for kind, a, b in change:
                if kind == "insert":
                    own.execute("INSERT INTO t(a, b) VALUES (?, ?)", (a, b))
                elif kind == "update":
                    own.execute("UPDATE t SET a = ?, b = ? WHERE rowid % 2", (a, b))
                else:
                    own.execute("DELETE FROM t WHERE a IS ?", (a,))
            for source in ("t", "v"):
                check_types(ss, source)


def check_types(ss: ss2sql.Session, source: str) -> None:
    found = ss.host.tables.find_table(None, source)
    assert found is not None
    for name, known in found.columns:
        for (value,) in ss.host.connection.execute(f"SELECT {name} FROM {source}"):
            infinite = isinstance(value, float) and abs(value) == float("inf")
            if infinite and (source == "v" or known.may_be(Kind.STR)):
                continue  # only in columns of numbers alone they are looked for
            assert is_supertype(known, Type(Kind.FLOAT | Kind.OBJECT) if infinite else type_of(value)), (
                name,
                known,
                value,
            )


# --- which columns a script reads ----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("script", "read"),
    [("SELECT a, t.b + 1 FROM t WHERE f(c) ORDER BY d;", {"a", "b", "c", "d", "t"}), ("SELECT * FROM t;", None),
     ("SELECT t.this FROM t;", None), ("SELECT a FROM t WHERE this IN [1];", None), ("SELECT eval('a') FROM t;", None),
     ("SELECT count(*) FROM t GROUP BY 1;", {"t"})],
)  # fmt: skip
def test_names_that_may_be_columns(script: str, read: set[str] | None) -> None:
    assert collect_syntax_columns(parse(Source(script))) == read


def test_columns_that_only_a_list_or_a_text_reads(ss: ss2sql.Session, engine: Any) -> None:
    ss.host.connection.execute("CREATE TABLE t(a, b); INSERT INTO t VALUES (1, 2)")
    ss.run("late = [t.a + t.b]; word = 'b + a';")
    assert ss.run("SELECT (SELECT this FROM late AS value) FROM t AS list;", engine=engine).value == [3]
    assert ss.run("SELECT eval(word) FROM t AS list;", engine="native").value == [3]
    assert ss.run("SELECT count(*) FROM t GROUP BY 1 AS value;", engine=engine).value == 1


@each_row("tables/without-rows", "query", "told")
@pytest.mark.parametrize("table", ["list", "frame", "database"])
def test_a_column_without_rows_may_be_of_any_kind(
    ss: ss2sql.Session, file: Path, engine: Any, table: str, query: str, told: str
) -> None:
    if table == "list":
        ss.set("t", {"a": [], "b": []})
    elif table == "frame":
        ss.attach("t", pandas.DataFrame({"a": [], "b": []}, dtype=object))
    else:
        write(file, "CREATE TABLE t(a INT, b)")
    ss.set("u", [{"a": 1}])
    assert repr(ss.run(query, engine=engine).value) == told


def test_a_view_that_cannot_be_read_has_no_columns(ss: ss2sql.Session, file: Path) -> None:
    write(file, "CREATE TABLE gone(a); CREATE VIEW v AS SELECT a FROM gone; CREATE VIEW w AS SELECT a FROM v")
    write(file, "DROP TABLE gone; CREATE TABLE t(a)")
    assert [about.columns for about in ss.tables().values()] == [("a",), (), ()]
    assert code_of(ss.run, "SELECT 1 FROM v;") == "X009"
    with pytest.raises(apsw.SQLError):
        ss.host.connection.execute("SELECT * FROM w")

"""Tables and views of a SQLite file as sources, and the bounds of the numbers in their columns."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from golden import each_row
from sessions import write

import ss2sql
from ss2sql.runtime.sqlite.database_tables import Tables


@pytest.fixture
def ss(file: Path) -> Iterator[ss2sql.Session]:
    with ss2sql.connect(file) as session:
        yield session


# --- names ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["my table", 'say "x"', "größe", "order", "t.u", "x'; --"])
def test_odd_names_of_tables_and_columns(ss: ss2sql.Session, file: Path, engine: Any, name: str) -> None:
    quoted = '"' + name.replace('"', '""') + '"'
    write(file, f"CREATE TABLE plain({quoted}, b); INSERT INTO plain VALUES (1, 2)")
    write(file, f"CREATE TABLE {quoted}(a); INSERT INTO {quoted} VALUES (5)")
    assert ss.run("SELECT * FROM plain;", engine=engine).value == [{name: 1, "b": 2}]
    assert ss.run("SELECT this FROM plain AS value;", engine=engine).value == {name: 1, "b": 2}
    text = "'" + name.replace("'", "\\'") + "'"
    assert ss.run(f"SELECT a FROM main[{text}] AS list;", engine=engine).value == [5]
    assert ss.run(f"SELECT p.a FROM p = main[{text}] AS list;", engine=engine).value == [5]
    assert ss.run("main = [[7]]; SELECT this FROM main[0] AS list;", engine=engine).value == [7]
    if name.isidentifier():
        assert ss.run(f"SELECT a FROM {name} AS list;", engine=engine).value == [5]
        assert ss.run(f"SELECT {name} FROM plain AS list;", engine=engine).value == [1]


@each_row("tables/missing", "script", "told")
def test_what_is_not_there(ss: ss2sql.Session, file: Path, engine: Any, script: str, told: str) -> None:
    """Nor is what is SQLite's own."""
    code, hint = ast.literal_eval(told)
    write(file, "CREATE TABLE t(mass, size); CREATE TABLE stock(mass)")
    write(file.with_name("other.db"), "CREATE TABLE t(a); CREATE TABLE u(b)")
    ss.attach("other", file.with_name("other.db"))
    ss.run("SELECT this FROM [1];", engine="database")
    with pytest.raises(ss2sql.ResolveError, match=rf"{code}[\s\S]*(?<!\S){hint}"):
        ss.run(script, engine=engine)


def test_the_same_name_in_two_files(ss: ss2sql.Session, file: Path, engine: Any) -> None:
    write(file, "CREATE TABLE t(a); INSERT INTO t VALUES ('main')")
    other = file.with_name("other.db")
    write(other, "CREATE TABLE t(a); INSERT INTO t VALUES ('other'); CREATE TABLE u(b); INSERT INTO u VALUES (2)")
    ss.attach("other", other)
    for script, value in (
        ("SELECT a FROM t AS list;", ["main"]),
        ("t = [7]; SELECT this FROM t AS list;", [7]),  # variables come before tables
        ("SELECT a FROM main.t AS list;", ["main"]),
        ("clear();", None),
        ("SELECT a FROM t AS list;", ["main"]),
    ):
        assert ss.run(script, engine=engine).value == value
    joined = ss.run("SELECT x.a, y.a, b FROM x = t, y = other.t, u AS rows;", engine=engine)
    assert joined.value == [("main", "other", 2)]
    script = "SELECT t.a, n FROM t = other.t START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 2 AS rows;"
    assert ss.run(script, engine=engine).value == [[("other", 0)], [("other", 0), ("other", 1)]]


def test_rows_of_a_table_without_numbers_come_by_its_key(ss: ss2sql.Session, file: Path, engine: Any) -> None:
    """Rising, also where the key is declared to fall."""
    write(file, "CREATE TABLE w(a, b, PRIMARY KEY (b DESC, a)) WITHOUT ROWID")
    write(file, "INSERT INTO w VALUES (1, 1), (2, 1), (1, 2)")
    assert ss.run("SELECT a, b FROM w AS rows;", engine=engine).value == [(1, 1), (2, 1), (1, 2)]
    write(file, "CREATE TABLE x(a INTEGER PRIMARY KEY, b) WITHOUT ROWID; CREATE INDEX by_b ON x(b)")
    write(file, "INSERT INTO x VALUES (1, 30), (2, 10), (3, 20)")
    for script in ("SELECT b FROM (SELECT b FROM x) AS list", "SELECT x.b FROM [1], x AS list"):
        assert ss.run(script, engine=engine).value == [30, 10, 20]
    for script, value in (
        ("SELECT y.a FROM x = w LEFT JOIN y = x ON x.a == y.a AS list", [1, 2, 1]),
        ("SELECT x.b FROM x = w, z = (SELECT y.b FROM y = x WHERE y.a >= x.a LIMIT 1) LIMIT 2 AS list", [1, 1]),
        ("SELECT z.b FROM x, z = (SELECT y.b FROM y = w WHERE y.a == x.a) AS list", [1, 2, 1]),
    ):
        assert ss.run(script, engine=engine).value == value, script


def test_a_column_that_is_called_rowid(ss: ss2sql.Session, file: Path, engine: Any) -> None:
    write(file, "CREATE TABLE u(k INTEGER PRIMARY KEY, w INT); CREATE TABLE g(a INTEGER, rowid TEXT)")
    write(file, "INSERT INTO u VALUES (1, 1), (2, 2); INSERT INTO g VALUES (1, 'z'), (2, 'y'), (1, 'x')")
    for script in (
        "SELECT k, g.rowid FROM u LEFT JOIN g ON u.w == g.a AS rows",
        "SELECT k, g.rowid FROM u JOIN g ON u.w + 0 == g.a + 0 AS rows",
    ):
        assert ss.run(script, engine=engine).value == [(1, "z"), (1, "x"), (2, "y")], script


# --- what cannot be read -------------------------------------------------------------------------------


def test_a_view_that_cannot_be_read(ss: ss2sql.Session, file: Path) -> None:
    write(file, "CREATE TABLE gone(a); CREATE VIEW v AS SELECT a FROM gone")
    query = ss.compile("SELECT a FROM v;")
    write(file, "DROP TABLE gone")
    for call in (query.run, lambda: ss.run("SELECT a FROM v;")):
        with pytest.raises(ss2sql.ExecutionError, match=r"X009.*the view 'v' cannot be read: no such table") as caught:
            call()
        assert caught.value.span is not None
        assert caught.value.span.text == "v"
    assert ss.eval("1 + 1;") == 2


# --- bounds of the numbers in columns: what they are, and that they are never stale --------------------------


def bounds(values: list[Any], more: str = "", source: str = "t") -> tuple[float | None, float | None]:
    """Those of a column `a` of a new table with these values."""
    with ss2sql.connect() as ss:
        ss.host.connection.execute(f"CREATE TABLE t(a, b); {more}")
        ss.host.connection.executemany("INSERT INTO t VALUES (?, 1)", [(value,) for value in values])
        table = ss.host.tables.find_table(None, source)
    assert table is not None
    kind = dict(table.columns)["a"]
    return kind.low, kind.high


@pytest.mark.parametrize(
    ("values", "low", "high"),
    [([1], 1, 1), ([0, 1], 0, 1), ([3, 100], 2, 128), ([-5, None], -8, -4), ([-1, 33], -1, 64), ([0.25, 7.5], 0, 8),
     ([-0.25, 2], -1, 2), ([2**62], 2**62, 2**62), ([-(2**63), 2**63 - 1], None, None), ([1e308], 2**1023, None),
     ([1, "one"], None, None), ([None], None, None), ([], None, None)],
)  # fmt: skip
def test_bounds_are_powers_of_two(values: list[Any], low: float | None, high: float | None) -> None:
    assert bounds(values) == bounds(values, "CREATE INDEX i ON t(a)") == (low, high)


def test_views_have_no_bounds() -> None:
    """The values of this one are others at each look."""
    assert bounds([1], "CREATE VIEW v AS SELECT random() AS a", "v") == (None, None)


def test_a_row_within_the_bounds_changes_no_plan(ss: ss2sql.Session, file: Path) -> None:
    write(file, "CREATE TABLE t(a INTEGER); INSERT INTO t VALUES (40), (60)")
    query = ss.compile("SELECT a + 1 FROM t AS list;")
    (statement,) = query.statements()
    assert query.run().value == [41, 61]
    for number, kept in ((50, True), (33, True), (64, True), (65, False)):
        plan = statement.statement
        write(file, f"INSERT INTO t VALUES ({number})")
        assert query.run().value[-1] == number + 1
        assert (statement.statement is plan) is kept


LARGE = 2**53 + 1  # no float; a third of it is one
THIRDS = "SELECT a / 3 FROM t AS list;"


def test_bounds_are_never_stale(ss: ss2sql.Session, file: Path, tmp_path: Path, engine: Any) -> None:
    """SQLite divides floats, which is right for small integers only."""
    write(file, "CREATE TABLE t(a INTEGER); INSERT INTO t VALUES (6)")
    write(tmp_path / "other.db", "CREATE TABLE u(a INTEGER); INSERT INTO u VALUES (6)")
    ss.attach("other", tmp_path / "other.db")
    own = ss.host.connection
    changes: list[tuple[str, Callable[[str], Any]]] = [
        ("t", lambda text: write(file, text)), ("t", own.execute),
        ("u", lambda text: write(tmp_path / "other.db", text)), ("u", own.execute),
    ]  # fmt: skip
    for table, change in changes:
        query = ss.compile(THIRDS.replace("FROM t", f"FROM {table}"))
        assert query.run(engine=engine).value == [2.0]
        change(f"INSERT INTO {table} VALUES ({LARGE})")
        assert query.run(engine=engine).value == [2.0, 3002399751580331.0]
        change(f"UPDATE {table} SET a = 9 WHERE a > 6")
        assert query.run(engine=engine).value == [2.0, 3.0]
        change(f"DELETE FROM {table} WHERE a == 9")
    own.execute(f"INSERT INTO t VALUES ({LARGE}); BEGIN; DELETE FROM t WHERE a = {LARGE}")
    query = ss.compile(THIRDS)
    assert query.run(engine=engine).value == [2.0]
    own.execute("ROLLBACK")
    assert query.run(engine=engine).value == [2.0, 3002399751580331.0]


def test_sqlite_computes_with_small_numbers_by_itself(ss: ss2sql.Session, file: Path) -> None:
    write(file, "CREATE TABLE t(a INTEGER, b REAL); INSERT INTO t VALUES (3, 0.5)")
    query = ss.compile("SELECT a + 1, a * b, a - b FROM t AS rows;", engine="database")
    assert query.run().value == [(4, 1.5, 2.5)]
    assert "CASE" not in query.sql
    write(file, f"INSERT INTO t VALUES ({2**62 + 1}, 1)")
    assert query.run().value[1] == (2**62 + 2, float(2**62), float(2**62))
    assert "CASE" in query.sql


def test_texts_of_a_file_in_utf_16(tmp_path: Path) -> None:
    path = tmp_path / "wide.db"
    write(path, "PRAGMA encoding = 'UTF-16le'; CREATE TABLE t(i, a);"
                "INSERT INTO t VALUES (1, 'größe'), (2, CAST(x'00d8' AS TEXT)), (3, x'00d8')")  # fmt: skip
    with ss2sql.connect(path) as ss:
        assert ss.run("SELECT i FROM t WHERE a == 'größe' AS list;", engine="native").value == [1]
        assert ss.run("SELECT a FROM t WHERE i == 1 AS list;", engine="native").value == ["größe"]
        assert ss.run("SELECT a FROM t WHERE i == 3 AS list;", engine="native").value == [b"\x00\xd8"]


# --- what Python reads of tables -----------------------------------------------------------------------

DAYS = """
    CREATE TABLE visits(id INTEGER, who TEXT COLLATE NOCASE, day DATE, x REAL, n);
    CREATE INDEX visit ON visits(id); CREATE INDEX of_day ON visits(day);
    CREATE VIEW guests AS SELECT * FROM visits;
    INSERT INTO visits VALUES
        (3, 'Ada', '2019-05-01', 1, 1), (1, 'ada', '2020-05-01', NULL, '1'), (3, 'Bob', '2021-05-01', 0, 1.0);
"""  # fmt: skip


@each_row("tables/read", "script", "told")
def test_sqlite_leaves_out_what_where_drops(
    ss: ss2sql.Session, file: Path, monkeypatch: pytest.MonkeyPatch, script: str, told: str
) -> None:
    write(file, DAYS)
    ss.set("three", 3)
    ss.set("year", "2021")
    ss.function("later", lambda n: True, volatility="volatile")
    found: list[str] = []

    def read_rows(tables: Tables, source: Any, wanted: Any = None) -> Any:
        rows = real(tables, source, wanted)
        found.append(" ".join([str(len(rows)), *(name for name, _ in source.columns)]))
        return rows

    real = Tables.read_rows
    monkeypatch.setattr(Tables, "read_rows", read_rows)
    value = ss.run(script, engine="native").value
    assert f"{', '.join(found)}: {value}" == told
    assert ss.run(script).value == value


# --- the order of rows, whatever SQLite finds them by ---------------------------------------------------


@pytest.mark.parametrize("index", ["i", "j, s", "s DESC", "i, j, s", "s, i, j"])
def test_no_index_changes_the_order_of_rows(ss: ss2sql.Session, file: Path, index: str) -> None:
    rows = [(7, 2, 1, "a"), (3, 0, 3, "b"), (5, 2, 2, "c"), (1, 1, 1, "a"), (8, 0, 2, "b"), (2, 2, 3, "a")]
    values = ", ".join(map(str, rows))
    write(file, "".join(f"CREATE TABLE {t}(id INTEGER, i INTEGER, j INTEGER, s TEXT);" for t in "tu"))
    write(file, f"INSERT INTO t VALUES {values}; INSERT INTO u VALUES {values}; CREATE INDEX ti ON t({index})")
    write(file, f"CREATE INDEX ui ON u({index}); CREATE VIEW v AS SELECT * FROM u WHERE j > 0; ANALYZE")
    groups = "(SELECT j, s, count(*) AS i FROM u GROUP BY j, s)"
    for script in (
        f"SELECT b.j FROM a = {groups} JOIN b = t ON b.s == a.s AS rows",
        f"SELECT a.s, b.i FROM a = u JOIN b = v ON b.j == 1, c = {groups} WHERE a.i IN [0, 2] AS rows",
        "SELECT a.j, b.j, count(*) FROM a = u, b = v GROUP BY a.j, b.j AS rows",
        "SELECT a.i FROM a = v WHERE a.s IN ['a', 'c'] ORDER BY a.j DESC AS rows",
        "SELECT DISTINCT a.i FROM a = v LEFT JOIN b = t ON b.j == a.j WHERE a.j > 0 LIMIT 2 AS rows",
        "SELECT a.i, b.i FROM a = v, b = v WHERE a.j >= b.j LIMIT 9 AS rows",
    ):
        assert ss.run(script, engine="database").value == ss.run(script, engine="native").value, script

"""Queries that are no searches in DuckDB, and its tables as sources: what the other engines give, in their order."""

from __future__ import annotations

import contextlib
import io
import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import golden
import pytest
from agreement import Outcome, exact, reference_outcome, session_for
from hypothesis import HealthCheck, Phase, given, seed, settings
from hypothesis import strategies as st
from programs import ProgramCase, programs
from second_opinion import DECISIONS, TYPES, Twin, twin
from sessions import code_of

import ss2sql

duckdb = pytest.importorskip("duckdb")

COUNT = int(os.environ.get("SS2SQL_PROGRAMS", "1000")) // 10
SEED = int(os.environ.get("SS2SQL_SEED", "2015"))
OWN = duckdb.connect(config={"threads": 1})  # to connect takes 20 ms
SETTINGS: dict[str, Any] = {
    "deadline": None,
    "database": None,
    "phases": [Phase.generate],
    "suppress_health_check": list(HealthCheck),
}


@pytest.fixture
def own() -> Iterator[Any]:
    with duckdb.connect(config={"threads": 1}) as connection:
        yield connection


@pytest.fixture
def ss(own: Any) -> Iterator[ss2sql.Session]:
    with ss2sql.connect(engine="duckdb", session=own) as session:
        yield session


def outcome(ss: ss2sql.Session, script: str, engines: Counter[str]) -> Outcome | None:
    """What a script comes to; None where the session's engine refuses it."""
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        try:
            result = ss.run(script)
            engines[result.engine] += 1
            return Outcome(exact(result.value), printed=printed.getvalue().rstrip("\n"))
        except ss2sql.UnsupportedError:
            return None
        except ss2sql.Error as error:
            return Outcome(error=error.code, printed=printed.getvalue().rstrip("\n"))
        except Exception as error:
            return Outcome(error=type(error).__name__, printed=printed.getvalue().rstrip("\n"))


# --- the same answers ------------------------------------------------------------------------------------


@pytest.mark.parametrize("case", golden.flat_queries(), ids=lambda case: case.name)
def test_golden_cases(case: golden.Case) -> None:
    assert golden.run(case, "duckdb").verdict == golden.run(case, "native").verdict


def test_random_programs() -> None:
    engines: Counter[str] = Counter()

    @seed(SEED)
    @settings(max_examples=COUNT, **SETTINGS)
    @given(programs())
    def run(case: ProgramCase) -> None:
        with session_for(case, engine="duckdb", session=OWN) as ss:
            found = outcome(ss, case.script, engines)
        # A list function on what is certainly no list is refused before the run; the reference notices it later.
        assert found is None or found.error == "R008" or found == reference_outcome(case)

    run()
    assert engines["duckdb"] > COUNT // 10


@pytest.mark.parametrize("kept", ["variables", "tables", "views"])
def test_random_queries(kept: str) -> None:
    engines: Counter[str] = Counter()

    @seed(SEED)
    @settings(max_examples=COUNT, **SETTINGS)
    @given(st.binary(min_size=DECISIONS, max_size=DECISIONS).map(twin))
    def run(made: Twin) -> None:
        case = made.case
        with duckdb.connect() if kept == "variables" else OWN.cursor() as own:
            for name, rows in case.tables.items():
                columns = ", ".join(f"{column} {kind}" for column, kind in TYPES.items())
                stored = name if kept == "tables" else f"stored_{name}"
                own.execute(f"DROP VIEW IF EXISTS {name}" if kept == "views" else f"DROP TABLE IF EXISTS {name}")
                own.execute(f"CREATE OR REPLACE TABLE {stored}({columns})")
                own.executemany(f"INSERT INTO {stored} VALUES (?, ?, ?, ?)", [tuple(row.values()) for row in rows])
                if kept == "views":
                    own.execute(f"CREATE VIEW {name} AS FROM {stored}")
            with ss2sql.connect(engine="duckdb", session=own) as ss:
                for name, rows in case.tables.items() if kept == "variables" else ():
                    ss.set(name, rows)
                assert outcome(ss, case.script, engines) == reference_outcome(case)
            for name in case.tables:
                own.execute(f"DROP VIEW IF EXISTS {name}" if kept == "views" else f"DROP TABLE IF EXISTS {name}")

    run()
    assert engines["duckdb"] > COUNT // 4


@pytest.mark.parametrize(
    ("script", "value"),
    [
        # ORDER BY is stable, None comes first and with DESC last.
        ("SELECT n FROM rows ORDER BY k AS list", [4, 1, 3, 2]),
        ("SELECT n FROM rows ORDER BY k DESC AS list", [2, 1, 3, 4]),
        (
            "SELECT a.n, b.n FROM a = rows, b = rows WHERE a.k == b.k ORDER BY a.k LIMIT 3 AS rows",
            [(4, 4), (1, 1), (1, 3)],
        ),
        # Groups come as they first appear, also of several sources.
        ("SELECT k, count(*) FROM rows GROUP BY k AS rows", [("a", 2), ("b", 1), (None, 1)]),
        ("SELECT b.n % 2 FROM a = [1, 2], b = rows GROUP BY b.n % 2 AS list", [1, 0]),
        # Of equal numbers the first is shown, and the least is the first of the least.
        ("SELECT x, count(*) FROM zeros GROUP BY x AS rows", [(-0.0, 2), (1.5, 1)]),
        ("SELECT min(x), max(x) FROM zeros GROUP BY 1 AS rows", [(-0.0, 1.5)]),
        ("SELECT max(-x) FROM zeros WHERE x < 1 GROUP BY 1 AS list", [0.0]),
        ("SELECT count(k), sum(n), min(k) FROM rows WHERE n > 3 GROUP BY n AS rows", [(0, 4, None)]),
        ("SELECT this FROM range(10) LIMIT 0 AS list", []),
        ("SELECT this * 2 FROM range(5) WHERE this > least LIMIT most AS list", [4, 6]),
    ],
)
def test_order_and_equal_values(ss: ss2sql.Session, script: str, value: Any) -> None:
    ss.set("rows", [{"n": 1, "k": "a"}, {"n": 2, "k": "b"}, {"n": 3, "k": "a"}, {"n": 4, "k": None}])
    ss.set("zeros", [{"x": -0.0}, {"x": 1.5}, {"x": 0.0}])
    result = ss.run(script, least=1, most=2)
    assert result.engine == "duckdb"
    assert exact(result.value) == exact(value)


@pytest.mark.parametrize(
    "text", ["it's", '"', "\\", "a\\'b", "$least", "?", "-- x", "/*", "ä", "\U0001f600", "\n", "\0", "%", "x'; DROP"]
)
def test_texts_are_texts(ss: ss2sql.Session, text: str) -> None:
    written = ss.run("SELECT this FROM [t] WHERE this == t AS list", t=text)
    assert (written.engine, written.value) == ("duckdb", [text])
    literal = repr(text)
    assert ss.eval(f"SELECT this + {literal} FROM [{literal}, 'b'] WHERE this == {literal} AS list") == [text + text]


@pytest.mark.parametrize("threads", [1, 2])
def test_sums_of_floats_are_rounded_once(own: Any, threads: int) -> None:
    own.execute(f"SET threads = {threads}")
    own.execute("""
        CREATE TABLE t AS
        SELECT i % 3 AS k, (i * 7919 % 100003) / 10.0::DOUBLE * 10 ** (i % 17) AS x, i / 7::DOUBLE AS y, i % 1000 AS n
        FROM range(200000) AS r(i)
    """)
    script = """
        SELECT k, sum(x), average(y), average(n), average(IF(n > 990; y; None)) FROM t
        GROUP BY k HAVING average(y) > 1 ORDER BY sum(y) DESC AS rows
    """
    with ss2sql.connect(engine="duckdb", session=own) as ss:
        found = ss.run(script)
        assert found.engine == "duckdb"
        assert exact(found.value) == exact(ss.run(script, engine="native").value)
        assert own.execute("SELECT count(*) FROM duckdb_functions() WHERE function_name LIKE 'ss2sql%'").fetchall() == [
            (0,)
        ]


def test_a_sum_that_is_too_large_on_its_way(ss: ss2sql.Session) -> None:
    ss.set("t", [{"x": 1.5e308}, {"x": 1.5e308}, {"x": -1.5e308}])
    result = ss.run("SELECT sum(x) FROM t GROUP BY 1 AS list")
    assert (result.engine, result.value) == ("native", [1.5e308])
    assert "a sum of floats becomes too large on its way" in str(result.explain())
    assert code_of(ss.run, "SELECT sum(x) FROM t WHERE x > 0 GROUP BY 1 AS list") == "X004"


def test_a_sum_of_nothing_is_a_whole_number(ss: ss2sql.Session) -> None:
    ss.set("t", [{"k": 1, "x": 0.5}, {"k": 2, "x": None}, {"k": 1, "x": None}])
    whole = ss.run("SELECT k, sum(x) FROM t GROUP BY k AS rows")
    assert (whole.engine, exact(whole.value)) == ("native", exact([(1, 0.5), (2, 0)]))
    floats = ss.run("SELECT k, sum(x), average(x) FROM t WHERE k == 1 GROUP BY k AS rows")
    assert (floats.engine, exact(floats.value)) == ("duckdb", exact([(1, 0.5, 0.5)]))


# --- tables of the connection ----------------------------------------------------------------------------


def test_tables_and_views_have_their_names(ss: ss2sql.Session, own: Any) -> None:
    own.execute(
        "CREATE TABLE Pets(id INTEGER, name VARCHAR); INSERT INTO Pets VALUES (2, 'Rex'), (1, 'Tom'), (3, NULL)"
    )
    own.execute("CREATE SCHEMA farm; CREATE TABLE farm.cows AS SELECT 7::TINYINT AS age")
    own.execute("CREATE VIEW young AS SELECT id * 10 AS ten FROM Pets WHERE id < 3")
    results = [
        ss.run("SELECT id, name FROM Pets AS rows"),
        ss.run("SELECT age + 1 FROM farm.cows AS list"),
        ss.run("SELECT ten, p.id FROM young, p = Pets WHERE p.id * 10 == ten AS rows"),
    ]
    assert [result.engine for result in results] == ["duckdb"] * 3
    assert [result.value for result in results] == [[(2, "Rex"), (1, "Tom"), (3, None)], [8], [(20, 2), (10, 1)]]
    assert "FROM memory.main.Pets" in results[0].sql
    assert code_of(ss.run, "SELECT id FROM pets") == "R003"  # as it is written there
    assert ss.tables() == {"Pets": ("id", "name"), "young": ("ten",)}
    assert [line.split()[0] for line in ss.describe("Pets").splitlines()] == ["FROM", "id", "name"]


def test_a_variable_comes_before_a_table(ss: ss2sql.Session, own: Any) -> None:
    own.execute("CREATE TABLE t AS SELECT 1 AS a")
    assert ss.eval("SELECT a FROM t AS list") == [1]
    assert ss.eval("t = [5]; SELECT this FROM t AS list") == [5]
    assert ss.eval("SELECT this FROM t AS list", t=[6]) == [6]


def test_other_engines_read_the_same_tables(ss: ss2sql.Session, own: Any) -> None:
    own.execute("CREATE TABLE t AS SELECT i AS a, i % 3 AS b FROM range(7) AS r(i)")
    script = "SELECT b, count(*) FROM t WHERE a > 1 GROUP BY b AS rows"
    for engine in ("duckdb", "database", "native"):
        result = ss.run(script, engine=engine)  # type: ignore[arg-type]
        assert (result.engine, result.value) == (engine, [(2, 2), (0, 2), (1, 1)])


def test_searches_walk_tables(ss: ss2sql.Session, own: Any) -> None:
    own.execute(
        "CREATE TABLE roads(a INTEGER, b INTEGER); INSERT INTO roads VALUES (1, 2), (1, 3), (2, 4), (3, 4), (4, 5)"
    )
    script = "SELECT r.b FROM r = roads WHERE r.a == n AND r.b == 5 START WITH n = 1"
    script += " CONNECT BY {} n = r.b STOP WITH r.a != n AS list"
    assert ss.eval(script.format("UNIQUE")) == [[2, 4, 5]]
    every = script.format("BREADTH FIRST")
    assert ss.run(every).value == ss.run(every, engine="native").value == [[2, 4, 5], [3, 4, 5]]


def test_what_is_committed_counts(ss: ss2sql.Session, own: Any) -> None:
    own.execute("CREATE TABLE t AS SELECT 1 AS a")
    query = ss.compile("SELECT a + 1 FROM t AS list")
    assert query.run().value == [2]
    own.execute("BEGIN; INSERT INTO t VALUES (NULL)")
    assert query.run().value == [2]
    own.execute("COMMIT")
    assert code_of(query.run) == "X001"  # None + 1
    own.execute("DELETE FROM t WHERE a IS NULL; INSERT INTO t VALUES (41)")
    assert query.run().value == [2, 42]
    own.execute("ALTER TABLE t RENAME COLUMN a TO b")
    assert code_of(query.run) == "R001"


def test_a_run_sees_one_state(ss: ss2sql.Session, own: Any) -> None:
    own.execute("CREATE TABLE t AS SELECT 1 AS a")
    ss.function("more", lambda: own.execute("INSERT INTO t VALUES (2)").fetchall() and None, volatility="volatile")
    assert ss.eval("before = (SELECT a FROM t AS list); more(); SELECT a, before FROM t AS rows") == [(1, [1])]
    assert ss.eval("SELECT a FROM t AS list") == [1, 2]


def test_nothing_is_held_after_a_run(ss: ss2sql.Session, own: Any) -> None:
    own.execute("CREATE TABLE t AS SELECT 1 AS a")
    kept = [ss.run("SELECT a FROM t")]
    with pytest.raises(ss2sql.Error) as caught:
        ss.run("SELECT str(a) + 1 FROM t")
    assert own.execute("FROM duckdb_connection_count()").fetchall() == [(1,)]
    assert kept[0].value == [{"a": 1}]
    assert caught.value.code == "X001"


COLUMNS = (
    ("TINYINT", "-5", -5),
    ("UBIGINT", "5", 5),
    ("HUGEINT", "9223372036854775807", 2**63 - 1),
    ("DECIMAL(9, 2)", "1.25", 1.25),
    ("DECIMAL(38, 2)", "1.25", 1.25),
    ("DECIMAL(18, 0)", "7", 7),
    ("FLOAT", "1.5", 1.5),
    ("DOUBLE", "'NaN'", None),
    ("DOUBLE", "-0.5", -0.5),
    ("BOOLEAN", "true", True),
    ("VARCHAR", "'ä'", "ä"),
    ("ENUM('a', 'b')", "'b'", "b"),
    ("DATE", "'2024-02-29'", "2024-02-29"),
    ("TIMESTAMP", "'2024-02-29 12:00:00.5'", "2024-02-29T12:00:00.500000"),
    ("TIME", "'12:00:01'", "12:00:01"),
    ("INTEGER[]", "[1, 2]", [1, 2]),
    ("STRUCT(a INTEGER, b VARCHAR)", "{'a': 1, 'b': 'x'}", {"a": 1, "b": "x"}),
)


@pytest.mark.parametrize(("kind", "written", "value"), COLUMNS)
@pytest.mark.parametrize("others", ["", ", (NULL)"])
def test_columns_become_values_as_those_of_data_frames_do(
    ss: ss2sql.Session, own: Any, kind: str, written: str, value: Any, others: str
) -> None:
    own.execute(f"CREATE TABLE t(x {kind}); INSERT INTO t VALUES ({written}){others}")
    expected = [(value,), (None,)] if others else [(value,)]
    for engine in ("duckdb", "database", "native"):
        found = ss.run("SELECT x FROM t AS rows", engine=engine).value  # type: ignore[arg-type]
        assert exact(found) == exact(expected), engine
    ss.attach("frame", own.sql("FROM t").to_arrow_table())
    assert exact(ss.eval("SELECT x FROM frame AS rows")) == exact(expected)


@pytest.mark.parametrize("kind", sorted({kind for kind, _, _ in COLUMNS}))
def test_a_table_without_values(ss: ss2sql.Session, own: Any, kind: str) -> None:
    own.execute(f"CREATE TABLE t(x {kind})")
    assert ss.eval("SELECT x FROM t AS rows") == []
    own.execute("INSERT INTO t VALUES (NULL), (NULL)")
    assert ss.eval("SELECT x, x == None FROM t AS rows") == [(None, True)] * 2
    assert ss.eval("SELECT x, count(x) FROM t GROUP BY x AS rows") == [(None, 0)]


def test_times_are_texts(ss: ss2sql.Session, own: Any) -> None:
    own.execute("""
        CREATE TABLE t AS
        SELECT
          DATE '2024-01-30' + i::INTEGER AS d,
          TIMESTAMP '2024-12-31 23:59:59' + INTERVAL (i * 250) MILLISECOND AS at
        FROM range(8) AS r(i)
    """)
    result = ss.run("SELECT d[0:7], count(*), min(at) FROM t WHERE at > '2024-12-31T23:59:59' GROUP BY d[0:7] AS rows")
    assert result.engine == "duckdb"
    assert result.value == [("2024-01", 1, "2024-12-31T23:59:59.250000"), ("2024-02", 6, "2024-12-31T23:59:59.500000")]
    assert ss.eval("SELECT at FROM t WHERE d == '2024-02-03' AS list") == ["2025-01-01T00:00:00"]
    own.execute("INSERT INTO t VALUES ('10000-01-01', 'infinity'), ('0044-03-15 (BC)', NULL)")
    assert ss.run("SELECT d FROM t LIMIT 1 AS list").engine == "database"


@pytest.mark.parametrize(
    ("kind", "written"),
    [
        ("UBIGINT", "9223372036854775808"),
        ("HUGEINT", "-9223372036854775809"),
        ("DOUBLE", "'-inf'"),
        ("BIT", "'101'"),
        ("TIMETZ", "'12:00:00+02'"),
    ],
)
def test_what_is_no_value_is_named(ss: ss2sql.Session, own: Any, kind: str, written: str) -> None:
    own.execute(f"CREATE TABLE t(x {kind}); INSERT INTO t VALUES (NULL), ({written})")
    with pytest.raises(ss2sql.Error) as caught:
        ss.run("SELECT x FROM t")
    assert caught.value.code == "X004"
    assert "the column 'x' of 't'" in caught.value.message


def test_names_of_columns_are_names(ss: ss2sql.Session, own: Any) -> None:
    own.execute('CREATE TABLE "order"(rowid INTEGER, nth INTEGER, "qualify" INTEGER, "A""b" INTEGER)')
    own.execute('INSERT INTO "order" VALUES (9, 1, 2, 3), (8, 4, 5, 6)')
    own.execute('CREATE VIEW "all" AS FROM "order"')
    script = "SELECT t.rowid, t.nth, qualify, to(qualify + 1, x) FROM t = {} ORDER BY qualify % 1 AS rows"
    for name in ("order", "all"):
        result = ss.run(script.format(name).replace("to(qualify + 1, x)", "qualify + 1"))
        assert (result.engine, result.value) == ("duckdb", [(9, 1, 2, 3), (8, 4, 5, 6)])
        assert ss.eval(f"SELECT * FROM {name} LIMIT 1 AS rows") == [(9, 1, 2, 3)]


def test_what_a_script_calls_its_sources_changes_no_view(ss: ss2sql.Session, own: Any) -> None:
    own.execute("CREATE TABLE t AS SELECT 1 AS a; CREATE VIEW v AS SELECT a FROM t")
    result = ss.run("SELECT v.a, t.a FROM v, t = given AS rows", given=[{"a": 10}, {"a": 20}])
    assert (result.engine, result.value) == ("duckdb", [(1, 10), (1, 20)])
    assert "ss2sql_t AS t" in result.sql


def test_a_view_that_cannot_be_read_is_named(ss: ss2sql.Session, own: Any) -> None:
    own.execute("CREATE TABLE t AS SELECT 1 AS a; CREATE VIEW v AS FROM t; DROP TABLE t")
    with pytest.raises(ss2sql.Error) as caught:
        ss.run("SELECT a FROM v")
    assert (caught.value.code, caught.value.span.column) == ("X009", 15)
    assert "the table 'v' cannot be read" in caught.value.message


@pytest.mark.parametrize(
    "setting", ["SET default_collation = 'nocase'", "SET default_null_order = 'nulls_first'", "SET threads = 1"]
)
def test_settings_change_no_meaning(ss: ss2sql.Session, own: Any, setting: str) -> None:
    own.execute("CREATE TABLE t(s VARCHAR COLLATE nocase); INSERT INTO t VALUES ('B'), ('a'), ('A'), (NULL)")
    own.execute(setting)
    assert ss.eval("SELECT s FROM t ORDER BY s DESC AS list") == ["a", "B", "A", None]
    assert ss.eval("SELECT s FROM t WHERE s == 'a' AS list") == ["a"]
    assert ss.eval("SELECT s, count(*) FROM t WHERE s != None GROUP BY s AS rows") == [("B", 1), ("a", 1), ("A", 1)]


def test_insertion_order_may_be_off(ss: ss2sql.Session, own: Any) -> None:
    own.execute("SET threads = 2; SET preserve_insertion_order = false")
    own.execute("CREATE TABLE t AS SELECT (i * 7919) % 300000 AS a FROM range(300000) AS r(i) ORDER BY i")
    rows = [row for (row,) in own.execute("SELECT a FROM t ORDER BY rowid").fetchall()]
    for engine in ("duckdb", "native"):
        assert ss.run("SELECT a FROM t AS list", engine=engine).value == rows  # type: ignore[arg-type]


# --- files and frames ------------------------------------------------------------------------------------


@pytest.fixture
def parquet(tmp_path: Path, own: Any) -> Path:
    path = tmp_path / "it's.parquet"
    own.sql("SELECT i AS a, 'n' || i % 2 AS s FROM range(5) AS r(i)").write_parquet(str(path))
    return path


@pytest.mark.parametrize("engine", ["duckdb", "auto"])
def test_parquet_files(parquet: Path, engine: Any) -> None:
    with ss2sql.connect(engine=engine) as ss:
        ss.attach("t", parquet)
        result = ss.run("SELECT s, count(*), max(a) FROM t GROUP BY s AS rows")
        assert result.value == [("n0", 3, 4), ("n1", 2, 3)]
        assert result.engine == ("duckdb" if engine == "duckdb" else "database")
        ss.attach("u", str(parquet))
        assert ss.eval("SELECT t.a FROM t, u WHERE t.a == u.a AND u.s == 'n1' AS list") == [1, 3]
        ss.detach("t")
        assert code_of(ss.run, "SELECT a FROM t") == "R003"


def test_a_file_that_is_none(tmp_path: Path) -> None:
    wrong = tmp_path / "wrong.parquet"
    wrong.write_text("nothing")
    with ss2sql.connect(engine="duckdb") as ss:
        for path in (wrong, tmp_path / "missing.parquet", tmp_path / "*.parquet"):
            assert code_of(ss.attach, "t", path) == "S002"


def test_a_session_of_another_kind_is_refused() -> None:
    assert code_of(ss2sql.connect, engine="duckdb", session="memory") == "S002"


@pytest.mark.parametrize("library", ["pandas", "polars", "pyarrow"])
def test_data_frames(ss: ss2sql.Session, library: str) -> None:
    package = pytest.importorskip(library)
    columns = {"a": [3, 1, 2], "s": ["x", None, "y"], "x": [0.5, float("nan"), None]}
    ss.attach("t", package.table(columns) if library == "pyarrow" else package.DataFrame(columns))
    result = ss.run("SELECT a, s, x FROM t WHERE a > 1 ORDER BY a AS rows")
    assert (result.engine, exact(result.value)) == ("duckdb", exact([(2, "y", None), (3, "x", 0.5)]))


# --- what runs where -------------------------------------------------------------------------------------


def test_what_runs_elsewhere_is_explained(ss: ss2sql.Session) -> None:
    for script, engine, reason in (
        ("SELECT str(this) FROM [1] AS list", "database", "not in duckdb: str is not known to other databases"),
        ("SELECT this / (this - 1) FROM [2, 3, -1] AS list", "database", "not in duckdb: this may fail"),
        ("SELECT this FROM [1, 'a'] AS list", "database", "not in duckdb: the kind of this is not known"),
        (
            "SELECT this FROM [1, 2] WHERE (n = this) > 1 AS list",
            "native",
            "not in duckdb: this is not SQL that every database has; ",
        ),
    ):
        result = ss.run(script)
        assert result.engine == engine
        assert f"engine: {engine}: {reason}" in str(result.explain())


def test_what_runs_here_is_explained(ss: ss2sql.Session, own: Any) -> None:
    own.execute("CREATE TABLE t AS SELECT 1 AS a")
    result = ss.run("SELECT a FROM t, n = numbers WHERE a < n.this + least LIMIT most", numbers=[1, 2], least=3, most=5)
    assert result.engine == "duckdb"
    assert result.sql.parameters == {"least": 3, "most_rows": 5}
    assert "3" not in result.sql
    text = str(result.explain())
    for line in (
        "engine: duckdb: engine='duckdb' was asked for",
        "how DuckDB does it:",
        "finds the rows with one SELECT over",
        "t, which it reads itself",
        "the elements of numbers, which it is given in a table",
        "$least = 3",
        "$most_rows = 5, which is most",
    ):
        assert line in text, line
    assert "SELECT" in str(ss.compile("SELECT a FROM t").explain())


def test_large_texts_are_made_elsewhere() -> None:
    with ss2sql.connect(engine="duckdb", max_size=300_000) as ss:
        ss.set("t", ["x" * 200_000])
        assert ss.run("SELECT len(this) FROM t AS list").engine == "duckdb"
        assert code_of(ss.run, "SELECT len(this + this) FROM t AS list") == "X014"
        result = ss.run("SELECT len(this + 'y') FROM t AS list")
        assert (result.engine, result.value) == ("native", [200_001])
        assert "texts or lists may become larger than max_size" in str(result.explain())


def test_limits_of_a_run(ss: ss2sql.Session) -> None:
    script = "SELECT a.this FROM a = range(5), b = range(5) WHERE a.this < 4 AS list"
    assert code_of(ss.run, script, max_rows=19) == "X010"
    assert len(ss.run(script, max_rows=20).value) == 20
    assert code_of(ss.run, "SELECT this FROM [1, 2] LIMIT n", n=-1) == "X006"
    assert code_of(ss.run, "SELECT this FROM [1, 2] LIMIT 1 / 0") == "X002"
    sources = "a = range(30000), b = range(30000), c = range(30000)"
    long = f"SELECT count(*) FROM {sources} WHERE a.this * b.this < c.this GROUP BY 1"
    assert code_of(ss.run, long, timeout=0.3) == "T001"
    assert ss.eval("SELECT this FROM [1] AS list") == [1]


# --- hostile scripts -------------------------------------------------------------------------------------

SECRET = 42


@pytest.mark.parametrize(
    "source",
    [
        "SECRET",
        "secret",
        "duckdb_settings",
        "duckdb_tables",
        "sqlite_master",
        "pg_catalog.pg_tables",
        "information_schema.tables",
        "main.duckdb_settings",
        "system.duckdb_settings",
        "temp.hidden",
        "hidden",
        "duckdb_settings()",
        "read_csv('secret.csv')",
        "read_parquet('secret.parquet')",
        "read_text('secret.csv')",
        "glob('*')",
        "getenv('HOME')",
        "memory.main.t",
    ],
)
def test_a_name_means_a_table_or_view_alone(own: Any, tmp_path: Path, monkeypatch: Any, source: str) -> None:
    monkeypatch.chdir(tmp_path)
    secret = own.sql("SELECT 1 AS a")  # what DuckDB would find among the variables of Python
    secret.write_csv("secret.csv")
    secret.write_parquet("secret.parquet")
    own.execute("CREATE TEMP TABLE hidden AS SELECT 1 AS a")
    own.execute("CREATE TABLE t AS SELECT 1 AS a")
    with ss2sql.connect(engine="duckdb", session=own) as ss, pytest.raises(ss2sql.Error) as caught:
        ss.run(f"SELECT * FROM {source}")
    assert caught.value.code[0] in "RP"


@pytest.mark.parametrize("text", ["secret.csv", "secret.parquet", "x'; ATTACH 'y.db' AS y; --", "SELECT 1"])
def test_texts_are_elements(ss: ss2sql.Session, tmp_path: Path, monkeypatch: Any, text: str) -> None:
    monkeypatch.chdir(tmp_path)
    Path("secret.csv").write_text("a\n1\n")
    assert ss.eval(f"SELECT this FROM [{text!r}] AS list") == [text]
    assert ss.eval(f"SELECT this FROM {text!r} AS list") == [text]
    assert not Path("y.db").exists()


def test_a_name_of_a_table_may_look_like_sql(ss: ss2sql.Session, own: Any) -> None:
    own.execute('CREATE TABLE t AS SELECT 1 AS "a""; DROP TABLE t; --"')
    assert ss.eval("SELECT * FROM t AS rows") == [(1,)]
    assert own.execute("SELECT count(*) FROM t").fetchall() == [(1,)]


@pytest.mark.parametrize("name", ["getenv", "read_text", "current_setting", "version", "query", "nextval"])
def test_functions_of_duckdb_are_no_functions(ss: ss2sql.Session, name: str) -> None:
    assert code_of(ss.run, f"SELECT {name}('HOME') FROM [1]") == "R002"

"""What DuckDB answers, and queries for which it hands over rows to others: the reference's answers.

Its tables and views as sources, and Parquet files and data frames.
"""

from __future__ import annotations

import ast
import math
import re
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from itertools import count
from pathlib import Path
from typing import Any

import pytest
from agreement import Outcome, exact, is_allowed, outcome, reference_outcome, session_for
from golden import each_row
from hypothesis import given, seed
from hypothesis import strategies as st
from level_searches import agree
from programs import ProgramCase, programs
from programs.drawn import SEED, amount, drawn
from second_opinion import DECISIONS, TYPES, twin
from sessions import code_of

import ss2sql
from ss2sql.runtime.external import duckdb_query, duckdb_search, duckdb_sources

duckdb = pytest.importorskip("duckdb")

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
    assert {name: about.columns for name, about in ss.tables().items()} == {"Pets": ("id", "name"), "young": ("ten",)}
    assert [line.split()[0] for line in ss.describe("Pets").splitlines()] == ["FROM", "id", "name"]


def test_a_variable_comes_before_a_table(ss: ss2sql.Session, own: Any) -> None:
    own.execute("CREATE TABLE t AS SELECT 1 AS a")
    assert ss.eval("SELECT a FROM t AS list") == [1]
    assert ss.eval("t = [5]; SELECT this FROM t AS list") == [5]
    assert ss.eval("SELECT this FROM t AS list", t=[6]) == [6]


def test_searches_walk_tables(ss: ss2sql.Session, own: Any) -> None:
    own.execute("CREATE TABLE roads AS SELECT * FROM (VALUES (1, 2), (1, 3), (2, 4), (3, 4), (4, 5)) AS v(a, b)")
    script = "SELECT r.b FROM r = roads WHERE r.a == n AND r.b == 5 START WITH n = 1"
    script += " CONNECT BY {} n = r.b STOP WITH r.a != n AS list"
    assert agree(ss, script.format("UNIQUE")).value == [[2, 4, 5]]
    assert agree(ss, script.format("BREADTH FIRST")).value == [[2, 4, 5], [3, 4, 5]]


@each_row("search/steps-that-join", "walk", "told")
def test_steps_join_tables_where_they_are(
    ss: ss2sql.Session, own: Any, monkeypatch: pytest.MonkeyPatch, walk: str, told: str
) -> None:
    in_sql, paths = ast.literal_eval(told)
    own.execute("CREATE TABLE roads AS SELECT * FROM (VALUES (1, 2), (1, 3), (2, 4), (3, 4), (4, 5)) AS v(a, b)")
    own.execute("CREATE TABLE kinds AS SELECT * FROM (VALUES (3, TRUE), (4, TRUE), (2, FALSE)) AS v(of, open)")
    monkeypatch.setattr(duckdb_search, "TRIES", 0)  # so that the first levels are DuckDB's, too
    for name, value in {"off": 0, "word": "ab", "other": ""}.items():
        ss.set(name, value)
    script = "SELECT " + walk.format("START WITH n = 1 CONNECT BY {}")
    for order in ("UNIQUE", "BREADTH FIRST", "BREADTH FIRST NO CYCLE"):
        for more in ("", "GROUP BY n", "ORDER BY n DESC, b"):
            agree(ss, f"{script.format(order)} {more} AS list")
    found, native = (ss.run(f"{script.format('UNIQUE')} AS list", engine=engine) for engine in ("duckdb", "native"))
    assert found.value == paths
    assert (found.stats.generated, found.stats.expanded) == (native.stats.generated, native.stats.expanded)
    assert ("in SQL" in str(found.explain())) == in_sql
    if in_sql:  # no row of the tables becomes one of Python
        monkeypatch.delattr(duckdb_sources, "_fetch_columns")
        assert ss.eval(f"{script.format('UNIQUE')} AS list") == paths


def test_what_is_committed_counts(ss: ss2sql.Session, own: Any) -> None:
    own.execute("CREATE TABLE t AS SELECT 1 AS a")
    query = ss.compile("SELECT a + 1 FROM t AS list")
    assert query.run().value == [2]
    own.execute("BEGIN; INSERT INTO t VALUES (NULL)")
    assert query.run().value == [2]
    own.execute("COMMIT")
    assert code_of(query.run) == "U001"  # None + 1 fails
    own.execute("DELETE FROM t WHERE a IS NULL; INSERT INTO t VALUES (41)")
    assert query.run().value == [2, 42]
    own.execute("ALTER TABLE t RENAME COLUMN a TO b")
    assert code_of(query.run) == "R009"


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
    assert caught.value.code == "U001"


COLUMNS = (
    ("TINYINT", "-5", -5), ("UBIGINT", "5", 5), ("HUGEINT", "9223372036854775807", 2**63 - 1),
    ("DECIMAL(9, 2)", "1.25", 1.25), ("DECIMAL(38, 2)", "1.25", 1.25), ("DECIMAL(18, 0)", "7", 7),
    ("FLOAT", "1.5", 1.5), ("DOUBLE", "'NaN'", None), ("DOUBLE", "-0.5", -0.5), ("BOOLEAN", "true", True),
    ("VARCHAR", "'ä'", "ä"), ("ENUM('a', 'b')", "'b'", "b"), ("DATE", "'2024-02-29'", "2024-02-29"),
    ("TIMESTAMP", "'2024-02-29 12:00:00.5'", "2024-02-29T12:00:00.500000"), ("TIME", "'12:00:01'", "12:00:01"),
    ("INTEGER[]", "[1, 2]", [1, 2]), ("STRUCT(a INTEGER, b VARCHAR)", "{'a': 1, 'b': 'x'}", {"a": 1, "b": "x"}),
)  # fmt: skip


@pytest.mark.parametrize(("kind", "written", "value"), COLUMNS)
def test_columns_become_values_as_those_of_data_frames_do(
    ss: ss2sql.Session, own: Any, kind: str, written: str, value: Any
) -> None:
    """Whether there is no row, one without a value, one with a value, or both."""
    own.execute(f"CREATE TABLE t(x {kind})")
    expected: list[Any] = []
    for added, row in ((None, None), (written, value), ("NULL", None)):
        if added is not None:
            own.execute(f"INSERT INTO t VALUES ({added})")
            expected.append((row,))
        for engine in ("duckdb", "database", "native"):
            found, _ = outcome(ss, "SELECT x FROM t AS rows", engine=engine)
            unknown = expected in ([], [(None,)]) or kind[:4] in ("TIME", "INTE", "STRU", "DECI")
            assert found == Outcome(exact(expected)) or (found is None and unknown and engine == "duckdb"), engine
        ss.attach("frame", own.sql("FROM t").to_arrow_table())
        assert exact(ss.run("SELECT x FROM frame AS rows", engine="native").value) == exact(expected)
    own.execute("DELETE FROM t; INSERT INTO t VALUES (NULL), (NULL)")
    ss.engine = "native"
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
    assert code_of(ss.run, "SELECT d FROM t LIMIT 1 AS list") == "U001"


NO_VALUES = {"UBIGINT": "9223372036854775808", "HUGEINT": "-9223372036854775809", "DOUBLE": "'-inf'", "BIT": "'101'"}


@pytest.mark.parametrize(("kind", "written"), [*NO_VALUES.items(), ("TIMETZ", "'12:00:00+02'")])
def test_what_is_no_value_is_named(ss: ss2sql.Session, own: Any, kind: str, written: str) -> None:
    own.execute(f"CREATE TABLE t(x {kind}); INSERT INTO t VALUES (NULL), ({written})")
    with pytest.raises(ss2sql.Error, match=r"X004.*the column 'x' of 't'"):
        ss.run("SELECT x FROM t", engine="native")


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
    assert caught.value.message.startswith("duckdb: ")


@pytest.mark.parametrize(
    "setting", ["SET default_collation = 'nocase'", "SET default_null_order = 'nulls_first'", "SET threads = 1"]
)
def test_settings_change_no_meaning(ss: ss2sql.Session, own: Any, setting: str) -> None:
    own.execute("CREATE TABLE t(s VARCHAR COLLATE nocase); INSERT INTO t VALUES ('B'), ('a'), ('A'), (NULL)")
    own.execute(setting)
    if "default" in setting:
        with pytest.raises(ss2sql.UnsupportedError, match="RESET default_collation"):
            ss.eval("SELECT s FROM t")
        ss.engine = "auto"
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


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """The columns whose least values were asked for."""
    asked: list[str] = []
    fetch = duckdb_sources.DuckTransaction.fetch_rows

    def look(self: Any, text: str, values: Any = None) -> Any:
        asked.extend(sorted(set(re.findall(r"MIN\((\w+)\)", text))))
        return fetch(self, text, values)

    monkeypatch.setattr(duckdb_sources.DuckTransaction, "fetch_rows", look)
    return asked


@each_row("tables/facts-in-duckdb", "script", "told")
def test_facts_are_found_of_columns_that_are_read(
    ss: ss2sql.Session, own: Any, asked: list[str], script: str, told: str
) -> None:
    columns = ast.literal_eval(told)
    own.execute("CREATE TABLE t AS SELECT 1 AS a, 2 AS b, 3 AS c")
    ss.eval(script, engine="native") if "this" in script else ss.eval(script)
    assert asked == columns
    query = ss.compile("SELECT c FROM t AS list")
    assert query.run().value == [3]
    own.execute("INSERT INTO t VALUES (4, 5, NULL)")
    assert query.run().value == [3, None]
    assert {name: about.columns for name, about in ss.tables().items()} == {"t": ("a", "b", "c")}
    assert "b  int 2..8" in ss.describe("t")  # bounds are rounded up, so that types change less often


def test_facts_of_a_file_are_kept_while_it_is_the_same(parquet: Path, asked: list[str]) -> None:
    with ss2sql.connect() as ss:
        ss.attach("t", parquet)
        first = ss.eval("SELECT a FROM t AS list")
        assert asked == ["a"]
        assert ss.eval("SELECT a FROM t WHERE a > 1 AS list") == [one for one in first if one > 1]
        assert asked == ["a"]
        duckdb.sql("SELECT 70000 AS a").write_parquet(str(parquet))
        assert ss.eval("SELECT a FROM t AS list") == [70000]
        assert asked == ["a", "a"]


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


# --- random programs, and sums ---------------------------------------------------------------------------

COUNT = amount(1 / 5)
TWINS = st.binary(min_size=DECISIONS, max_size=DECISIONS).map(lambda bits: twin(bits).case)


@pytest.mark.drawn
def test_random_programs(own: Any) -> None:
    engines: Counter[str] = Counter()

    @seed(SEED)
    @drawn(COUNT, shrunk=False)
    @given(programs())
    def run(case: ProgramCase) -> None:
        with session_for(case, engine="duckdb", session=own) as ss:
            found, engine = outcome(ss, case.script)
        engines[engine] += 1
        # A list function on what is certainly no list is refused before the run; the reference notices it later.
        assert is_allowed(found, reference_outcome(case), "duckdb")

    run()
    assert engines["duckdb"] > COUNT // 10


def store(own: Any, case: ProgramCase, kept: str) -> None:
    """Makes the tables of a program those of a connection, or views of others there."""
    columns = ", ".join(f"{column} {kind}" for column, kind in TYPES.items())
    for name, rows in case.tables.items():
        table = f"stored_{name}" if kept == "views" else name
        own.execute(f"CREATE OR REPLACE TABLE {table}({columns})")
        values = [tuple(row[column] for column in TYPES) for row in rows]
        own.executemany(f"INSERT INTO {table} VALUES (?, ?, ?, ?)", values)
        if kept == "views":
            own.execute(f"CREATE OR REPLACE VIEW {name} AS FROM {table}")


@pytest.mark.drawn
@pytest.mark.parametrize(
    ("cases", "kept", "engine", "told", "least"),
    [
        (TWINS, "variables", "duckdb", "engine: duckdb", 4),
        (TWINS, "tables", "duckdb", "engine: duckdb", 4),
        pytest.param(TWINS, "views", "duckdb", "engine: duckdb", 4, marks=pytest.mark.slow),
        (TWINS, "tables", "database", "DuckDB hands over", 10),
        pytest.param(TWINS, "tables", "native", "DuckDB hands over", 10, marks=pytest.mark.slow),
    ],
    ids=["variables", "tables", "views", "narrowed-database", "narrowed-native"],
)
def test_random_queries(own: Any, cases: Any, kept: str, engine: Any, told: str, least: int) -> None:
    done = 0

    @seed(101)
    @drawn(COUNT, shrunk=False)
    @given(cases)
    def run(case: ProgramCase) -> None:
        nonlocal done
        variables = case.variables
        if kept == "variables":
            variables = {**variables, **case.tables}
        else:
            store(own, case, kept)
        with session_for(ProgramCase(case.script, variables, case.uses), engine="duckdb", session=own) as ss:
            found, _ = outcome(ss, case.script, engine=engine)
            if found is None:  # the engine alone cannot run it
                return
            done += told in str(ss.compile(case.script, engine=engine).explain())
        assert is_allowed(found, reference_outcome(case), "duckdb"), case

    run()
    assert done > COUNT // least


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
        for row, native in zip(found.value, ss.run(script, engine="native").value, strict=True):
            assert row == pytest.approx(native, rel=1e-12)
        assert "LIST(" not in (found.sql or "LIST(")  # no values are collected
        ours = "SELECT count(*) FROM duckdb_functions() WHERE function_name LIKE 'ss2sql%'"
        assert own.execute(ours).fetchall() == [(0,)]


def test_sessions_of_one_database_at_once(own: Any) -> None:
    own.execute("CREATE TABLE t AS SELECT i % 3 AS k, sin(i) AS x, 'ab' AS s FROM range(20000) AS r(i)")
    script = "SELECT k, sum(x), average(x), median(x), max(upper(s)) FROM t GROUP BY k AS rows"

    def ask(cursor: Any) -> list[Any]:
        with ss2sql.connect(engine="duckdb", session=cursor) as ss:
            return [ss.eval(script) for _ in range(5)]

    with ThreadPoolExecutor(3) as threads:
        found = list(threads.map(ask, [own.cursor() for _ in range(3)]))
    assert found == [[found[0][0]] * 5] * 3


def test_names_of_functions_do_not_meet(ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(duckdb_query, "_numbers", count(2))
    ss.set("t", [{"x": 2.5}])
    assert ss.eval("SELECT round(x), round(x / 4, 2) FROM t AS rows") == [(2, 0.62)]


FLOATS = st.floats(-1e300, 1e300) | st.sampled_from((-0.0, 5e-324, 2.0**62, -(2.0**63), 2.0**63, 2.0**-68, 1e16, 0.1))


@drawn(60)
@given(groups=st.lists(st.lists(FLOATS | st.none(), min_size=1, max_size=8), min_size=1, max_size=4))
def test_sums_of_any_floats(groups: list[list[float | None]]) -> None:
    rows = [{"k": k, "x": x} for k, group in enumerate(groups) for x in (*group, 0.25)]
    with ss2sql.connect(engine="duckdb") as ss:
        ss.set("t", rows)
        found = ss.eval("SELECT sum(x), average(x) FROM t GROUP BY k AS rows")
    kept = [[x for x in (*group, 0.25) if x is not None] for group in groups]
    for (total, mean), group in zip(found, kept, strict=True):
        error = 1e-12 * math.fsum(map(abs, group))
        assert total == pytest.approx(math.fsum(group), abs=error)
        assert mean == pytest.approx(math.fsum(group) / len(group), abs=error / len(group))


def test_facts_of_a_table_are_those_of_its_rows_now(ss: ss2sql.Session, own: Any) -> None:
    own.execute("CREATE TABLE t AS SELECT i AS a, i / 2::DOUBLE AS x FROM range(3) AS r(i)")
    query = ss.compile("SELECT a, x FROM t AS rows")
    assert query.run().value == [(0, 0.0), (1, 0.5), (2, 1.0)]
    own.execute("UPDATE t SET x = 'NaN' WHERE a = 1; UPDATE t SET a = 2 ** 62 WHERE a = 2")
    assert query.run().value == [(0, 0.0), (1, None), (2**62, 1.0)]
    assert ss.eval("SELECT max(a), sum(x) FROM t GROUP BY 1 AS rows") == [(2**62, 1.0)]
    own.execute("DELETE FROM t")
    assert query.run().value == []


def test_lists_of_floats_leave_none_out(ss: ss2sql.Session) -> None:
    ss.set("t", [{"k": k, "x": x} for k, x in [(1, 2.5), (1, None), (1, 0.5), (1, 4.0), (2, 1.0), (2, 2.0)]])
    found = ss.run("SELECT median(x), variance(x) FROM t GROUP BY k AS rows")
    assert (found.engine, found.value) == ("duckdb", [(2.5, pytest.approx(37 / 12)), (1.5, 0.5)])


@pytest.mark.parametrize("values", [[1.0, -0.0, 0.0], [0.0, -0.0, -1.0], [-0.0, 0.0], [1.0, 2.5, 1.0], [-2.0, -1.0]])
def test_the_first_of_equal_extremes(ss: ss2sql.Session, values: list[float]) -> None:
    ss.set("t", [{"x": x} for x in values])
    found = ss.run("SELECT min(x), max(x) FROM t GROUP BY 1 AS rows")
    assert (found.engine, exact(found.value)) == ("duckdb", exact([(min(values), max(values))]))


def test_a_sum_that_is_too_large_on_its_way(ss: ss2sql.Session) -> None:
    ss.set("t", [{"x": 1.5e308}, {"x": 1.5e308}, {"x": -1.5e308}])
    for rest in ("", "WHERE x > 0"):
        with pytest.raises(ss2sql.UnsupportedError, match="a sum of floats becomes too large on its way"):
            ss.run(f"SELECT sum(x) FROM t {rest} GROUP BY 1 AS list")


def test_a_sum_of_nothing_is_a_whole_number(ss: ss2sql.Session) -> None:
    ss.set("t", [{"k": 1, "x": 0.5}, {"k": 2, "x": None}, {"k": 1, "x": None}])
    with pytest.raises(ss2sql.UnsupportedError, match="a sum of nothing is a whole number"):
        ss.run("SELECT k, sum(x) FROM t GROUP BY k AS rows")
    floats = ss.run("SELECT k, sum(x), average(x) FROM t WHERE k == 1 GROUP BY k AS rows")
    assert (floats.engine, exact(floats.value)) == ("duckdb", exact([(1, 0.5, 0.5)]))

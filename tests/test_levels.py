"""Searches by levels in the tables of DuckDB find what the native search finds, in its order."""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from level_searches import BY_LENGTH, FORMS, ROADS, VARIANTS, agree, both_end_alike, compare, may_fail
from programs.drawn import amount
from sessions import code_of

import ss2sql
from ss2sql.runtime.levels import beginning, duck, tables
from ss2sql.runtime.levels.statements import Ask
from ss2sql.runtime.levels.watch import watched
from ss2sql.runtime.run import Run

duckdb = pytest.importorskip("duckdb")

COUNT = amount(1 / 10) // 2
OWN = duckdb.connect(config={"threads": 1})  # to connect takes 20 ms
GROWING = "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = this{};"


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The tables do all levels, also small ones."""
    monkeypatch.setattr(beginning, "STATES", 0)


@pytest.fixture
def ss() -> Iterator[ss2sql.Session]:
    with ss2sql.connect(engine="duckdb", session=OWN) as session:
        session.function("near", lambda n: ROADS[int(n)], volatility="immutable")
        yield session


@pytest.mark.parametrize(
    ("variants", "number", "states"),
    [
        *(("by length", 8, 0), ("by weight", 9, 0), ("by graph", 10, 0)),
        ("by length", 81, 2),  # the first levels are done in memory
        *(pytest.param("by length", 81 + states, states, marks=pytest.mark.slow) for states in (1, 3)),
    ],
)
def test_random_searches(monkeypatch: pytest.MonkeyPatch, variants: str, number: int, states: int) -> None:
    monkeypatch.setattr(beginning, "STATES", states)
    assert compare(VARIANTS[variants], "duckdb", OWN, number, COUNT) > COUNT // 8


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("strategy", ["BREADTH FIRST MAXIMUM 30", "UNIQUE", "BREADTH FIRST NO CYCLE MAXIMUM 40"])
def test_forms(ss: ss2sql.Session, form: str, strategy: str) -> None:
    agree(ss, form.format(strategy))


@pytest.mark.parametrize(
    ("step", "goal"), [("(2 * n + this) % 9999", 9000), ("min(n + this, 60)", 59)], ids=["wide", "thin"]
)
@pytest.mark.parametrize("limits", [(0, 1 << 26), (20, 1 << 26), (2000, 5000), (2000, 1 << 26)])
@pytest.mark.parametrize("is_sql", [True, False])
def test_what_is_done_in_memory_is_bounded(
    ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch, step: str, goal: int, limits: Any, is_sql: bool
) -> None:
    """By the states of a level and by what all take; then the tables have all that there is."""
    monkeypatch.setattr(beginning, "STATES", limits[0])
    monkeypatch.setattr(beginning, "BYTES", limits[1])
    loaded: list[int] = []
    load = duck.DuckTables.load

    def look(self: duck.DuckTables, table: str, columns: Any) -> None:
        if table == "steps":
            loaded.append(len(columns[0]))
        load(self, table, columns)

    monkeypatch.setattr(duck.DuckTables, "load", look)
    ss.function("same", lambda n: int(str(n)), volatility="immutable")
    result = agree(
        ss,
        f"SELECT {step} FROM [1, 2] WHERE {step} == {goal} START WITH n = 0 CONNECT BY UNIQUE n = {step}"
        f" STOP WITH {'n' if is_sql else 'same(n)'} > 7000 AS list",
    )
    assert result.value
    done = sum(loaded) - is_sql * bool(loaded)
    if limits[0] == 0:
        assert done == 0
    elif limits[1] == 5000:
        assert 5000 / 600 < done < 5000 / 500 + 200
    elif limits[0] == 20:
        assert (0 < done < 80) if "%" in step else loaded == []


# --- errors ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("strategy", BY_LENGTH)
@pytest.mark.parametrize("bad", range(7))
def test_a_step_that_fails_counts_where_it_would_have_been_taken(ss: ss2sql.Session, strategy: str, bad: int) -> None:
    """The step is the n-th of all that can be asked for their goal; what is found before it is the same."""
    both_end_alike(ss, f"{may_fail(ss, f'{strategy} MAXIMUM 5', bad)} AS list")


@pytest.mark.parametrize("strategy", BY_LENGTH)
@pytest.mark.parametrize("most", [1, 3, 4, 6, 9])
@pytest.mark.parametrize(("row", "far"), [("10 / (4 - x.this)", 7), ("x.this", 4)])
def test_rows_and_sources_that_fail(ss: ss2sql.Session, strategy: str, most: int, row: str, far: int) -> None:
    ss.set("roads", [[0], [2, 3], [3, 1, 5], [2, far], []])  # there are no roads from 5 and 7
    ss.set("most", most)
    search = f"START WITH n = 1 CONNECT BY {strategy} MAXIMUM (most) n = x.this"
    both_end_alike(ss, f"SELECT {row} FROM x = roads[n] {search} AS list;")


def test_a_function_that_fails_once_only(ss: ss2sql.Session) -> None:
    calls = []

    def moody(n: int) -> int:
        calls.append(n)
        if len(calls) == 1:
            raise ValueError
        return n

    ss.function("moody", moody, volatility="immutable")
    with pytest.raises(ss2sql.ExecutionError, match="did not fail again") as caught:
        ss.run("SELECT moody(n + this) FROM [1] START WITH n = 0 CONNECT BY UNIQUE n = n + this;")
    assert caught.value.code == "X009"


DEPTH_FIRST = "DEPTH FIRST goes on from the last step"


@pytest.mark.parametrize(
    ("options", "reason", "cure"),
    [
        ("", DEPTH_FIRST, "write BREADTH FIRST, or UNIQUE without DEPTH FIRST"),
        ("NO CYCLE", DEPTH_FIRST, "write BREADTH FIRST"),
        ("UNIQUE DEPTH FIRST", DEPTH_FIRST, "write BREADTH FIRST"),
        ("COST 1 HEURISTIC 1 MAXIMUM 9", "HEURISTIC goes on from one path", "leave HEURISTIC out, the costs are the"),
        ("COST 9007199254740992 MAXIMUM 9", "costs add up to more than 2^53", ""),
        ("UNIQUE COST dice(n)", "keeps the written order", ""),
    ],
)
def test_what_does_not_go_by_levels_is_refused_by_name(
    ss: ss2sql.Session, options: str, reason: str, cure: str
) -> None:
    ss.function("dice", lambda n: 4, volatility="volatile")
    with pytest.raises(ss2sql.UnsupportedError) as caught:
        ss.run(f"SELECT x.this FROM x = near(n) START WITH n = 1 CONNECT BY {options} n = x.this;")
    assert reason in caught.value.message
    assert cure in str(caught.value)


def test_aggregates_over_paths_and_objects_are_refused(ss: ss2sql.Session) -> None:
    search = "START WITH n = 1 CONNECT BY BREADTH FIRST MAXIMUM 9 n = x.this"
    with pytest.raises(ss2sql.UnsupportedError, match="aggregates count over whole paths"):
        ss.run(f"SELECT count(*) FROM x = near(n) {search} GROUP BY n;")
    ss.attach("things", [object()])
    assert code_of(ss.run, f"SELECT 1 FROM x = things {search};") == "U001"


@pytest.mark.parametrize(("engine", "package"), [("duckdb", "duckdb"), ("spark", "pyspark")])
def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch, engine: Any, package: str) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ss2sql.SessionError, match=rf"ss2sql\[{engine}\]") as caught:
        ss2sql.connect(engine=engine)
    assert caught.value.code == "S003"


@pytest.mark.filterwarnings("ignore:PySpark does not yet fully support pandas:FutureWarning")
def test_a_session_of_spark_that_cannot_be(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pytest.importorskip("pyspark")
    with pytest.raises(ss2sql.SessionError, match="is a SparkSession, not int"):
        ss2sql.connect(engine="spark", session=3)
    monkeypatch.setenv("JAVA_HOME", str(tmp_path))
    with pytest.raises(ss2sql.SessionError, match="needs Java 17 or newer") as caught:
        ss2sql.connect(engine="spark")
    assert caught.value.code == "S003"


# --- the session and its database ----------------------------------------------------------------------------


def test_the_engine_of_a_session(ss: ss2sql.Session) -> None:
    search = GROWING.format("")
    assert ss.run(search).engine == "duckdb"
    assert ss.run(search, engine="native").engine == "native"
    assert ss.compile(search).run().engine == "duckdb"
    assert ss.run("SELECT this FROM [1, 2] AS list;").engine == "duckdb"
    assert ss.run("SELECT str(this) FROM [1, 2] AS list;").engine == "database"
    with pytest.raises(ss2sql.SessionError, match="no engine 'duck'"):
        ss2sql.connect(engine="duck")  # type: ignore[arg-type]


def test_a_connection_of_the_user_is_left_as_it_was() -> None:
    """Also by a search that is late, and by one that fails while somebody keeps its error with the traceback."""
    own = duckdb.connect()
    own.execute("CREATE TABLE steps AS SELECT 1 AS a")

    def databases() -> list[Any]:
        return own.execute("FROM duckdb_databases() SELECT database_name").fetchall()

    before = databases()
    with ss2sql.connect(engine="duckdb", session=own) as ss:
        ss.function("near", lambda n: [n + 1], volatility="immutable")
        script = "SELECT x.this FROM x = near(n) START WITH n = 0 CONNECT BY UNIQUE MAXIMUM 9 n = x.this AS list;"
        assert ss.run(script).value[-1] == list(range(1, 10))
        with pytest.raises(ss2sql.Timeout):
            ss.run(script.replace("MAXIMUM 9", ""), timeout=0.3)
        with pytest.raises(ss2sql.ExecutionError) as caught:
            ss.run(GROWING.format(" ORDER BY 1 / (this - 2)"))
        assert caught.value.code == "X002"
        assert databases() == before
    assert databases() == before
    assert own.execute("FROM steps").fetchall() == [(1,)]


def test_what_does_not_fit_into_memory_goes_to_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """40,000 states of 2,000 characters are 80 MB, twice that with their rows, of which DuckDB may hold 64."""
    seen: list[int] = []
    load = duck.DuckTables.load

    def look(self: duck.DuckTables, table: str, columns: Any) -> None:
        load(self, table, columns)
        ((size,),) = self.rows(Ask("SELECT COALESCE(SUM(size), 0) FROM duckdb_temporary_files()"))
        seen.append(size)

    monkeypatch.setattr(duck.DuckTables, "load", look)
    own = duckdb.connect(config={"memory_limit": "64MB", "temp_directory": str(tmp_path), "threads": 1})
    with ss2sql.connect(engine="duckdb", session=own) as ss:
        ss.function("wide", lambda n, more: f"{2 * n + more:02000}", volatility="immutable")
        result = ss.run(
            "SELECT wide(int(s), this) FROM [0, 1] WHERE int(s) == 19999 START WITH s = '1'"
            " CONNECT BY UNIQUE s = wide(int(s), this) STOP WITH int(s) > 19999 AS list;"
        )
    assert [int(path[-1]) for path in result.value] == [39998, 39999]
    assert max(seen) > 10_000_000


def test_what_fits_nowhere_is_an_error_of_ours() -> None:
    own = duckdb.connect(config={"memory_limit": "4MB", "temp_directory": "", "threads": 1})
    with ss2sql.connect(engine="duckdb", session=own) as ss:
        ss.function("wide", lambda n: f"{n + 1:0100000}", volatility="immutable")
        with pytest.raises(ss2sql.ExecutionError, match="duckdb: Out of Memory") as caught:
            ss.run("SELECT wide(n) FROM [0] START WITH n = 0 CONNECT BY UNIQUE n = n + 1 STOP WITH n > 300;")
        assert caught.value.code == "X009"
        assert ss.run(GROWING.format(" AS list")).value == [[1], [2]]


def test_nothing_is_left_in_the_folder_for_temporary_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with ss2sql.connect() as ss:
        ss.run(GROWING.format(""), engine="duckdb")
        assert list(tmp_path.iterdir()) != []
    assert list(tmp_path.iterdir()) == []


def test_a_run_that_is_late_ends_the_statement_that_runs() -> None:
    ended = []

    class Slow:
        def interrupt(self) -> None:
            ended.append(True)

    run = Run(host=None)  # type: ignore[arg-type]

    def work() -> None:
        with watched(run, Slow()):  # type: ignore[arg-type]
            run.interrupted = True
            while not ended:
                time.sleep(0.001)
            raise RuntimeError("interrupted")  # as the database says it

    with pytest.raises(ss2sql.Cancelled):
        work()


def test_a_partial_result(ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "BLOCK", 10)
    called = []

    def again(n: int, more: int) -> int:
        called.append(n)
        if len(called) == 100:
            ss.interrupt()
        return 2 * n + more  # another number each time

    ss.function("again", again, volatility="immutable")
    with pytest.raises(ss2sql.Cancelled) as caught:
        ss.run("SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY BREADTH FIRST n = again(n, this) AS list;")
    partial = caught.value.partial
    assert partial is not None
    assert [list(path) for path in partial.paths[:3]] == [[(1,)], [(2,)], [(1,), (1,)]]


def test_explain_tells_of_levels(ss: ss2sql.Session) -> None:
    result = ss.run("SELECT x.this FROM x = near(n) START WITH n = 1 CONNECT BY UNIQUE n = x.this AS list;")
    text = str(result.explain())
    assert sorted(path[-1] for path in result.value) == [1, 2, 3, 4, 5]  # equal numbers are one row
    assert "engine: duckdb: engine='duckdb' was asked for" in text
    assert "keeps the first step to each row that no level before has reached" in text
    assert "GROUP BY\n    row_key" in result.sql
    assert text.splitlines()[-1].split() == ["all", "5", "10"]  # 15 steps from the 5 rows and the start

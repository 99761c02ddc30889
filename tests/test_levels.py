"""Searches by levels in the tables of DuckDB find what the native search finds, in its order."""

from __future__ import annotations

import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import golden
import pytest
from agreement import exact
from level_searches import FORMS, ROADS, by_length, compare_random
from programs.drawn import amount
from sessions import code_of

import ss2sql
from ss2sql.runtime.levels import beginning, duck, tables
from ss2sql.runtime.levels.statements import Ask
from ss2sql.runtime.levels.watch import watched
from ss2sql.runtime.run import Run

duckdb = pytest.importorskip("duckdb")

COUNT = amount(1 / 10)
OWN = duckdb.connect(config={"threads": 1})  # to connect takes 20 ms


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The tables do all levels, also small ones."""
    monkeypatch.setattr(beginning, "STATES", 0)


@pytest.fixture
def ss() -> Any:
    with ss2sql.connect() as session:
        session.function("near", lambda n: ROADS[int(n)], volatility="immutable")
        yield session


def test_random_searches() -> None:
    assert compare_random(by_length, "duckdb", OWN, 8, COUNT) > COUNT // 4


@pytest.mark.parametrize("states", [1, 2, 3])
def test_random_searches_whose_first_levels_are_done_in_memory(monkeypatch: pytest.MonkeyPatch, states: int) -> None:
    monkeypatch.setattr(beginning, "STATES", states)
    assert compare_random(by_length, "duckdb", OWN, 80 + states, COUNT // 2) > COUNT // 8


@pytest.mark.parametrize("case", golden.level_searches(), ids=lambda case: case.name)
def test_golden_cases(case: golden.Case) -> None:
    found = golden.run(case, "duckdb")
    if not isinstance(found.error, ss2sql.UnsupportedError):
        assert found.verdict == golden.run(case, "native").verdict


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("strategy", ["BREADTH FIRST MAXIMUM 30", "UNIQUE", "BREADTH FIRST NO CYCLE MAXIMUM 40"])
def test_forms(ss: ss2sql.Session, form: str, strategy: str) -> None:
    script = form.format(strategy)
    found = ss.run(script, engine="duckdb")
    assert found.engine == "duckdb"
    wanted = ss.run(script, engine="native")
    assert exact(found.value) == exact(wanted.value)
    assert (found.status, found.columns, list(found)) == (wanted.status, wanted.columns, list(wanted))


def test_equal_numbers_are_one_row(ss: ss2sql.Session) -> None:
    script = "SELECT x.this FROM x = near(n) START WITH n = 1 CONNECT BY UNIQUE n = x.this AS list"
    paths = ss.run(script, engine="duckdb").value
    assert sorted(path[-1] for path in paths) == [1, 2, 3, 4, 5]


@pytest.mark.parametrize(
    ("step", "goal"),
    [("(2 * n + this) % 9999", 9000), ("min(n + this, 500)", 499)],
    ids=["wide", "thin"],
)
@pytest.mark.parametrize("limits", [(0, 1 << 26), (20, 1 << 26), (2000, 5000), (2000, 1 << 26)])
@pytest.mark.parametrize("is_sql", [True, False])
def test_what_is_done_in_memory_is_bounded(
    monkeypatch: pytest.MonkeyPatch, step: str, goal: int, limits: tuple[int, int], is_sql: bool
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
    script = (
        f"SELECT {step} FROM [1, 2] WHERE {step} == {goal} START WITH n = 0 CONNECT BY UNIQUE n = {step}"
        " STOP WITH {} > 7000 AS list"
    ).format("n" if is_sql else "same(n)")
    with ss2sql.connect(engine="duckdb", session=OWN) as ss:
        ss.function("same", lambda n: int(str(n)), volatility="immutable")
        result = ss.run(script)
        wanted = ss.run(script, engine="native")
    assert result.value == wanted.value
    assert result.value
    done = sum(loaded) - is_sql * bool(loaded)
    if limits[0] == 0:
        assert done == 0
    elif limits[1] == 5000:
        assert 5000 / 600 < done < 5000 / 500 + 200
    elif limits[0] == 20:
        assert (0 < done < 80) if "%" in step else loaded == []


# --- errors ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("strategy", ["UNIQUE", "BREADTH FIRST NO CYCLE", "BREADTH FIRST"])
@pytest.mark.parametrize("bad", range(7))
def test_a_step_that_fails_counts_where_it_would_have_been_taken(strategy: str, bad: int) -> None:
    """The step is the n-th of all that can be asked for their goal; what is found before it is the same."""

    def fail(n: int, level: int) -> bool:
        if (n * 3 + level) % 7 == bad:
            raise ValueError(n)
        return n > 3

    def found(engine: Any) -> tuple[Any, ...]:
        with ss2sql.connect() as ss:
            ss.function("fail", fail, volatility="immutable")
            ss.set("roads", [[0], [2, 3], [1, 3, 4], [2, 4], [1, 2]])
            try:
                value = ss.run(
                    "SELECT x.this FROM x = roads[n] WHERE fail(x.this, level) START WITH n = 1, level = 0"
                    f" CONNECT BY {strategy} MAXIMUM 5 n = x.this, level = level + 1 AS list;",
                    engine=engine,
                ).value
            except ValueError as error:
                return ("ValueError", *error.args)
            return ("value", value)

    assert found("duckdb") == found("native")


@pytest.mark.parametrize("strategy", ["UNIQUE", "BREADTH FIRST NO CYCLE", "BREADTH FIRST"])
@pytest.mark.parametrize("most", [1, 3, 4, 6, 9])
@pytest.mark.parametrize("row", ["10 / (4 - x.this)", "x.this"])
def test_rows_and_sources_that_fail(strategy: str, most: int, row: str) -> None:
    def found(engine: Any) -> Any:
        with ss2sql.connect() as ss:
            ss.set(
                "roads", [[0], [2, 3], [3, 1, 5], [2, 7 if "/" in row else 4], []]
            )  # there are no roads from 5 and 7
            ss.set("most", most)
            script = (
                f"SELECT {row} FROM x = roads[n] START WITH n = 1"
                f" CONNECT BY {strategy} MAXIMUM (most) n = x.this AS list;"
            )
            try:
                return ss.run(script, engine=engine).value
            except ss2sql.Error as error:
                return error.code, error.span

    assert found("duckdb") == found("native")


def test_select_comes_after_stop_with_where_no_rows_are_compared() -> None:
    script = (
        "SELECT 10 / (4 - x.this) FROM x = [2, 4] START WITH n = 1"
        " CONNECT BY {} MAXIMUM 2 n = x.this STOP WITH x.this == 4 AS list;"
    )
    with ss2sql.connect(engine="duckdb", session=OWN) as ss:
        assert ss.run(script.format("BREADTH FIRST")).value == [[5.0], [5.0, 5.0]]
        assert code_of(ss.run, script.format("UNIQUE")) == "X002"


def test_a_function_that_fails_once_only(ss: ss2sql.Session) -> None:
    calls = []

    def moody(n: int) -> int:
        calls.append(n)
        if len(calls) == 1:
            raise ValueError
        return n

    ss.function("moody", moody, volatility="immutable")
    with pytest.raises(ss2sql.ExecutionError, match="did not fail again") as caught:
        ss.run("SELECT moody(n + this) FROM [1] START WITH n = 0 CONNECT BY UNIQUE n = n + this;", engine="duckdb")
    assert caught.value.code == "X009"


REFUSED = {
    "": ("DEPTH FIRST goes on from the last step", "write BREADTH FIRST, or UNIQUE without DEPTH FIRST"),
    "NO CYCLE": ("DEPTH FIRST goes on from the last step", "write BREADTH FIRST"),
    "UNIQUE DEPTH FIRST": ("DEPTH FIRST goes on from the last step", "write BREADTH FIRST"),
}


@pytest.mark.parametrize("options", REFUSED)
def test_what_does_not_go_by_levels_is_refused_by_name(ss: ss2sql.Session, options: str) -> None:
    reason, cure = REFUSED[options]
    script = f"SELECT x.this FROM x = near(n) START WITH n = 1 CONNECT BY {options} n = x.this;"
    with pytest.raises(ss2sql.UnsupportedError, match=reason) as caught:
        ss.run(script, engine="duckdb")
    assert cure in str(caught.value)


def test_aggregates_over_paths_are_refused(ss: ss2sql.Session) -> None:
    script = (
        "SELECT count(*) FROM x = near(n) START WITH n = 1 CONNECT BY BREADTH FIRST MAXIMUM 9 n = x.this GROUP BY n;"
    )
    with pytest.raises(ss2sql.UnsupportedError, match="aggregates count over whole paths"):
        ss.run(script, engine="duckdb")


def test_volatile_functions_are_refused(ss: ss2sql.Session) -> None:
    ss.function("dice", lambda n: 4, volatility="volatile")
    with pytest.raises(ss2sql.UnsupportedError, match="keeps the written order"):
        ss.run("SELECT dice(n) FROM [1] START WITH n = 1 CONNECT BY UNIQUE n = dice(n);", engine="duckdb")


def test_objects_are_refused(ss: ss2sql.Session) -> None:
    ss.attach("things", [object()])
    script = "SELECT 1 FROM x = things START WITH n = None CONNECT BY BREADTH FIRST MAXIMUM 3 n = x.this;"
    assert code_of(ss.run, script, engine="duckdb") == "U001"


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "duckdb", None)
    with pytest.raises(ss2sql.SessionError, match=r"ss2sql\[duckdb\]") as caught:
        ss2sql.connect(engine="duckdb")
    assert caught.value.code == "S003"


# --- the session and its database ----------------------------------------------------------------------------


def test_the_engine_of_a_session() -> None:
    with ss2sql.connect(engine="duckdb") as ss:
        search = "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = this AS list;"
        assert ss.run(search).engine == "duckdb"
        assert ss.run(search, engine="native").engine == "native"
        assert ss.compile(search).run().engine == "duckdb"
        assert ss.run("SELECT this FROM [1, 2] AS list;").engine == "duckdb"
        assert ss.run("SELECT str(this) FROM [1, 2] AS list;").engine == "database"
    with pytest.raises(ss2sql.SessionError, match="no engine 'duck'"):
        ss2sql.connect(engine="duck")  # type: ignore[arg-type]


def test_a_connection_of_the_user_is_left_as_it_was(ss: ss2sql.Session) -> None:
    own = duckdb.connect()
    own.execute("CREATE TABLE steps AS SELECT 1 AS a")
    before = own.execute("FROM duckdb_databases() SELECT database_name").fetchall()
    with ss2sql.connect(engine="duckdb", session=own) as mine:
        mine.function("near", lambda n: [n + 1], volatility="immutable")
        script = "SELECT x.this FROM x = near(n) START WITH n = 0 CONNECT BY UNIQUE MAXIMUM 9 n = x.this AS list;"
        assert mine.run(script).value[-1] == list(range(1, 10))
        with pytest.raises(ss2sql.Timeout):
            mine.run(script.replace("MAXIMUM 9", ""), timeout=0.3)
    assert own.execute("FROM duckdb_databases() SELECT database_name").fetchall() == before
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


def test_a_search_that_fails_lets_go_of_its_tables() -> None:
    """Also while somebody keeps the error, whose traceback holds what was under way."""
    own = duckdb.connect()
    before = own.execute("FROM duckdb_databases() SELECT database_name").fetchall()
    with ss2sql.connect(engine="duckdb", session=own) as session:
        with pytest.raises(ss2sql.ExecutionError) as caught:
            session.run("SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = this ORDER BY 1 / (this - 2)")
        assert caught.value.code == "X002"
        assert own.execute("FROM duckdb_databases() SELECT database_name").fetchall() == before


def test_what_fits_nowhere_is_an_error_of_ours() -> None:
    own = duckdb.connect(config={"memory_limit": "4MB", "temp_directory": "", "threads": 1})
    with ss2sql.connect(engine="duckdb", session=own) as ss:
        ss.function("wide", lambda n: f"{n + 1:0100000}", volatility="immutable")
        script = "SELECT wide(n) FROM [0] START WITH n = 0 CONNECT BY UNIQUE n = n + 1 STOP WITH n > 300;"
        with pytest.raises(ss2sql.ExecutionError, match="duckdb: Out of Memory") as caught:
            ss.run(script)
        assert caught.value.code == "X009"
        assert ss.run("SELECT this FROM [1] START WITH n = 0 CONNECT BY UNIQUE n = this AS list;").value == [[1]]


def test_nothing_is_left_in_the_folder_for_temporary_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with ss2sql.connect() as ss:
        ss.run("SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = this;", engine="duckdb")
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
        ss.run(
            "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY BREADTH FIRST n = again(n, this) AS list;",
            engine="duckdb",
        )
    partial = caught.value.partial
    assert partial is not None
    assert [list(path) for path in partial.paths[:3]] == [[(1,)], [(2,)], [(1,), (1,)]]


def test_explain_tells_of_levels(ss: ss2sql.Session) -> None:
    result = ss.run(
        "SELECT x.this FROM x = near(n) START WITH n = 1 CONNECT BY UNIQUE n = x.this AS list;", engine="duckdb"
    )
    text = str(result.explain())
    assert "engine: duckdb: engine='duckdb' was asked for" in text
    assert "keeps the first step to each row that no level before has reached" in text
    assert "GROUP BY\n    row_key" in result.sql
    assert text.splitlines()[-1].split() == ["all", "5", "10"]  # 15 steps from the 5 rows and the start

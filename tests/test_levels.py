"""Searches by levels in the tables of DuckDB find what the native search finds, in its order; and by weights."""

from __future__ import annotations

import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import level_searches
import pytest
from golden import each_row
from hypothesis import given, seed, settings
from hypothesis import strategies as st
from level_searches import BY_LENGTH, FORMS, MOVES, agree, by_sheet, fails_alike, may_fail
from programs.drawn import amount
from sessions import code_of

import ss2sql
from ss2sql.frontend.syntax.tokenizer import RESERVED
from ss2sql.lowering.portable import portable_flat
from ss2sql.runtime.external import duckdb_search, level_steps

duckdb = pytest.importorskip("duckdb")

COUNT = amount(1 / 10) // 2
TRIALS = amount(1 / 25)
OWN = duckdb.connect(config={"threads": 1})  # to connect takes 20 ms
GROWING = "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = this{};"


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The tables do all levels, also small ones."""
    monkeypatch.setattr(level_steps, "MAX_STATES", 0)


@pytest.fixture
def ss() -> Iterator[ss2sql.Session]:
    with ss2sql.connect(engine="duckdb", session=OWN) as session:
        session.function("near", lambda n: level_searches.ROADS[int(n)], volatility="immutable")
        session.set("moves", MOVES)
        yield session


# Of some the first levels are done in memory.
@pytest.mark.parametrize("states", [0, 2, *(pytest.param(states, marks=pytest.mark.slow) for states in (1, 3))])
def test_random_searches(monkeypatch: pytest.MonkeyPatch, states: int) -> None:
    monkeypatch.setattr(level_steps, "MAX_STATES", states)
    assert level_searches.compare(level_searches.by_length, "duckdb", OWN, 81 + states, COUNT) > COUNT // 8


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("strategy", ["BREADTH FIRST MAXIMUM 30", "UNIQUE", "BREADTH FIRST NO CYCLE MAXIMUM 40"])
def test_forms(ss: ss2sql.Session, form: str, strategy: str) -> None:
    agree(ss, form.format(strategy))


# --- errors ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("strategy", BY_LENGTH)
def test_a_step_that_fails(ss: ss2sql.Session, strategy: str) -> None:
    """Whichever step it is, and whichever clause: what is found is the same, and mostly what fails."""
    alike = [fails_alike(ss, f"{may_fail(ss, f'{strategy} MAXIMUM 5', bad)} AS list") for bad in range(7)]
    for row, far in (("10 / (4 - x.this)", 7), ("x.this", 4)):
        ss.set("roads", [[0], [2, 3], [3, 1, 5], [2, far], []])  # there are no roads from 5 and 7
        for most in (1, 3, 4, 6, 9):
            search = f"START WITH n = 1 CONNECT BY {strategy} MAXIMUM ({most}) n = x.this"
            alike.append(fails_alike(ss, f"SELECT {row} FROM x = roads[n] {search} AS list;"))
    assert sum(alike) > len(alike) // 2


def test_objects_are_refused(ss: ss2sql.Session) -> None:
    ss.attach("things", [object()])
    search = "START WITH n = 1 CONNECT BY BREADTH FIRST MAXIMUM 9 n = x.this"
    assert code_of(ss.run, f"SELECT 1 FROM x = things {search};") == "U001"


@pytest.mark.parametrize(("engine", "package"), [("duckdb", "duckdb"), ("spark", "pyspark")])
def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch, engine: Any, package: str) -> None:
    monkeypatch.setitem(sys.modules, package, None)
    with pytest.raises(ss2sql.SessionError, match=rf"S003[\s\S]*pip install {package}"):
        ss2sql.connect(engine=engine)


@pytest.mark.filterwarnings("ignore:PySpark does not yet fully support pandas:FutureWarning")
def test_a_session_of_spark_that_cannot_be(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    pytest.importorskip("pyspark")
    with pytest.raises(ss2sql.SessionError, match="is a SparkSession, not int"):
        ss2sql.connect(engine="spark", session=3)
    monkeypatch.setenv("JAVA_HOME", str(tmp_path))
    with pytest.raises(ss2sql.SessionError, match=r"S003.*needs Java 17 or newer"):
        ss2sql.connect(engine="spark")


# --- the session and its database ----------------------------------------------------------------------------


def test_the_engine_of_a_session(ss: ss2sql.Session) -> None:
    search = GROWING.format("")
    assert ss.run(search).engine == "duckdb"
    assert ss.run(search, engine="native").engine == "native"
    assert ss.compile(search).run().engine == "duckdb"
    assert ss.run("SELECT this FROM [1, 2] AS list;").engine == "duckdb"
    assert code_of(ss.run, "SELECT [this, 'a'] FROM [1, 2] AS list;") == "U001"
    with pytest.raises(ss2sql.SessionError, match="no engine 'duck'"):
        ss2sql.connect(engine="duck")  # type: ignore[arg-type]


def test_a_connection_of_the_user_is_left_as_it_was() -> None:
    """Also by searches that are late, interrupted, or fail while somebody keeps the error with its traceback."""
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
        threading.Timer(0.3, ss.interrupt).start()
        with pytest.raises(ss2sql.Cancelled):
            ss.run(script.replace("MAXIMUM 9", ""))
        with pytest.raises(ss2sql.ExecutionError, match="X002"):
            ss.run(GROWING.format(" ORDER BY 1 / (this - 2)"))
        assert databases() == before
    assert databases() == before
    assert own.execute("FROM steps").fetchall() == [(1,)]


def test_what_does_not_fit_into_memory_goes_to_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """40,000 states of 2,000 characters are 80 MB, twice that with their rows, of which DuckDB may hold 64."""
    seen: list[int] = []
    load = duckdb_search.DuckTables.load_rows

    def look(self: duckdb_search.DuckTables, *given: Any) -> None:
        load(self, *given)
        ((size,),) = self.read_rows("SELECT COALESCE(SUM(size), 0) FROM duckdb_temporary_files()")
        seen.append(size)

    monkeypatch.setattr(duckdb_search.DuckTables, "load_rows", look)
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
        with pytest.raises(ss2sql.ExecutionError, match=r"X009.*duckdb: Out of Memory"):
            ss.run("SELECT wide(n) FROM [0] START WITH n = 0 CONNECT BY UNIQUE n = n + 1 STOP WITH n > 300;")
        assert ss.run(GROWING.format(" AS list")).value == [[1], [2]]


def test_nothing_is_left_in_the_folder_for_temporary_files(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    with ss2sql.connect() as ss:
        ss.run(GROWING.format(""), engine="duckdb")
        assert list(tmp_path.iterdir()) != []
    assert list(tmp_path.iterdir()) == []


def test_a_partial_result(ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(duckdb_search, "BLOCK", 10)
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
    assert "engine: duckdb: engine='duckdb' was given" in text
    assert "tries.row_key" in result.sql
    assert text.splitlines()[-1].split() == ["all", "5", "10"]  # 15 steps from the 5 rows and the start


# --- steps as SQL: the same paths, and what is left to Python ------------------------------------------------


@pytest.mark.drawn
@seed(88)
@settings(max_examples=amount(1 / 8), deadline=None, database=None)
@given(
    level_searches.expressions(),
    st.sampled_from(BY_LENGTH),
    st.sets(st.sampled_from("ntbl"), min_size=1),
    st.booleans(),
    st.sampled_from((0, 0, 1, 4, 12)),
)
def test_random_steps(parts: dict[str, str], strategy: str, shown: set[str], grouped: bool, states: int) -> None:
    """Of some searches the first steps are tried in memory."""
    script = level_searches.script_of(parts, strategy, shown, grouped)
    with ss2sql.connect(engine="duckdb", session=OWN) as ss, pytest.MonkeyPatch.context() as patch:
        patch.setattr(level_steps, "MAX_STATES", states)
        ss.set("moves", MOVES)
        try:
            found = agree(ss, script)
        except ss2sql.UnsupportedError:
            assert grouped  # by what is constant: an aggregate
            return
        assert "in SQL" in str(found.explain()), script


def test_python_is_left_alone_where_steps_are_sql(ss: ss2sql.Session) -> None:
    search = "WHERE n + this == 5 START WITH n = 0 CONNECT BY UNIQUE n = n + this STOP WITH n + this > 5"
    result = ss.run(f"SELECT n + this FROM [1, 2] {search} AS list;")
    assert result.value == [[1, 3, 5]]
    assert result.stats.generated == 2 + 4 + 4 + 2  # from 0; from 1 and 2; from 3 and 4; from 5, as 6 stops
    assert "tries the steps of a level together, in SQL" in str(result.explain())
    assert "frontier.n + elements.this AS n" in result.sql


def test_steps_in_sql(ss: ss2sql.Session) -> None:
    for row, result in by_sheet(ss, "search/steps-in-sql"):
        assert "in SQL" in str(result.explain()), row


@each_row("search/left-to-python", "script", "reason")
def test_what_is_left_to_python(ss: ss2sql.Session, script: str, reason: str) -> None:
    added = {0: 1, 1: 2, 2: 3, 3: 4, 4: 5}
    ss.function("f", lambda n: added[n], volatility="immutable")
    assert f"tries the steps of a level together, in Python: {reason}" in str(agree(ss, script).explain())


@pytest.mark.parametrize("kinds", ["reserved", pytest.param("%", marks=pytest.mark.slow)])
def test_names_that_are_words_of_sql(ss: ss2sql.Session, kinds: str) -> None:
    """Every word that DuckDB knows can be a START WITH variable and a column of the elements."""
    known = f"SELECT keyword_name FROM duckdb_keywords() WHERE keyword_category LIKE '{kinds}'"
    words = [word for (word,) in duckdb.sql(known).fetchall()]
    for start in range(0, len(words), 40):
        some = dict.fromkeys(
            word for word in (*words[start : start + 40], *portable_flat.OWN_COLUMNS) if word.upper() not in RESERVED
        )
        first, *_ = some
        ss.set("moves", [dict.fromkeys(some, 1)])
        shown = ", ".join(f"{word} + m.{word}" for word in some)
        begun = ", ".join(f"{word} = {number}" for number, word in enumerate(some))
        assigned = ", ".join(f"{word} = {word} + m.{word}" for word in some)
        search = f"START WITH {begun} CONNECT BY UNIQUE {assigned} STOP WITH {first} > 2"
        assert "in SQL" in str(agree(ss, f"SELECT {shown} FROM m = moves {search} AS list").explain())


def test_a_table_of_the_session_is_read(ss: ss2sql.Session) -> None:
    ss.host.connection.execute("CREATE TABLE roads(a INTEGER NOT NULL, b INTEGER NOT NULL) STRICT")
    ss.host.connection.executemany("INSERT INTO roads VALUES (?, ?)", [(1, 2), (2, 3), (1, 4), (4, 3)])
    search = "START WITH n = 1 CONNECT BY UNIQUE n = r.b STOP WITH r.a != n"
    assert agree(ss, f"SELECT r.b FROM r = roads WHERE r.b == 3 AND r.a == n {search} AS list;").value == [[2, 3]]


def test_variables_are_bound_when_the_search_runs(ss: ss2sql.Session) -> None:
    search = "START WITH n = 0 CONNECT BY UNIQUE n = n + m.by STOP WITH n > most[0] OR n < -9"
    script = f"SELECT n + m.by FROM m = moves WHERE n + m.by == goal AND word == 'ab' {search} AS list"
    for goal, word, most in [(3, "ab", [5]), (4, "ab", [5]), (4, "b", [5]), (2, "ab", [0])]:
        for name, value in {"goal": goal, "word": word, "most": most}.items():
            ss.set(name, value)
        assert "in SQL" in str(agree(ss, script).explain())
    ss.set("goal", 4.0)  # of another kind: compiled anew
    agree(ss, script)


def test_a_variable_without_a_value_fails_where_it_is_read(ss: ss2sql.Session) -> None:
    script = "SELECT this FROM {} WHERE this == missing START WITH n = 0 CONNECT BY UNIQUE n = this AS list"
    assert ss.compile(script.format("[]")).parameters == ("missing",)
    for engine in ("duckdb", "native"):
        assert code_of(ss.run, script.format("[1]"), engine=engine) == "R001"


def test_more_elements_than_steps_can_be_numbered(ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(level_steps, "MAX_ELEMENTS", 2)
    script = "SELECT this FROM range({}) START WITH n = 0 CONNECT BY UNIQUE n = this AS list"
    assert len(ss.run(script.format(2)).value) == 2
    with pytest.raises(ss2sql.UnsupportedError, match=r"FROM has more than .* elements"):
        ss.run(script.format(3))

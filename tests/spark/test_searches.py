"""Searches by levels in tables of Spark find what the native search finds, in its order."""

from __future__ import annotations

import os
import threading
import time
from collections import Counter
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import golden
import level_searches
import pytest
from cases.shelf import Shelf
from hypothesis import given, seed
from level_searches import BY_LENGTH, FORMS, MOVES, SHORT, agree, by_sheet, fails_alike, may_fail
from programs.drawn import PROGRAMS, drawn

import ss2sql
from ss2sql.runtime.external import level_steps, spark_search
from ss2sql.runtime.external.spark_session import SparkStore

pytestmark = pytest.mark.slow

CASES = golden.level_searches()[:: 1 if os.environ.get("SS2SQL_SPARK") == "all" else 3]
TRIALS = max(4, PROGRAMS // 250)


def test_what_the_sheet_says(ss: ss2sql.Session) -> None:
    assert list(by_sheet(ss, "search/steps-in-sql"))


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_golden_cases(spark: Any, case: golden.Case) -> None:
    found = golden.run(case, "spark")  # in the session that is active
    if not isinstance(found.error, ss2sql.UnsupportedError):
        assert found.verdict == golden.run(case, "native").verdict


@pytest.mark.drawn
def test_random_searches(spark: Any) -> None:
    most = 2 * TRIALS
    assert level_searches.compare(level_searches.one_by_length, "spark", spark, 8, 30 * most, most=most) == most


@pytest.mark.parametrize("strategy", BY_LENGTH)
def test_a_step_that_fails(ss: ss2sql.Session, strategy: str) -> None:
    for bad in (1, 4):
        fails_alike(ss, f"{may_fail(ss, f'{strategy} MAXIMUM 5', bad)} AS list")


@pytest.mark.parametrize("script", [FORMS[1].format("UNIQUE"), SHORT], ids=["python", "sql"])
def test_large_levels_are_numbered_in_parts(ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    """And ways to many goals are looked up by joins, some goals at a time, and tables of rows become one."""
    for name, number in {
        "MAX_IN_ONE_PARTITION": 0,
        "MAX_COLLECTED_GOALS": 2,
        "STEPS_PER_QUERY": 0,
        "TABLES": 2,
    }.items():
        monkeypatch.setattr(spark_search, name, number)
    plans: list[str] = []
    persisted = SparkStore.persist_frame

    def look(self: SparkStore, frame: Any) -> Any:
        plans.append(frame._jdf.queryExecution().executedPlan().toString())
        return persisted(self, frame)

    monkeypatch.setattr(SparkStore, "persist_frame", look)
    agree(ss, script)
    large = [text for text in plans if "rangepartitioning(place" in text]
    assert large
    assert not any("SinglePartition" in text for text in large)  # no exchange brings all rows into one partition


def test_other_settings_of_spark(spark: Any, ss: ss2sql.Session) -> None:
    """Stages that are planned while they run, three partitions, small batches."""
    own = {"spark.sql.adaptive.enabled": "true", "spark.sql.shuffle.partitions": "3"}
    own["spark.sql.execution.arrow.maxRecordsPerBatch"] = "1"
    before = {name: spark.conf.get(name) for name in own}
    for name, value in own.items():
        spark.conf.set(name, value)
    agree(ss, FORMS[1].format("BREADTH FIRST NO CYCLE"))
    for name, value in before.items():
        spark.conf.set(name, value)


# --- steps in SQL: without a Python process ----------------------------------------------------------------


@pytest.fixture
def no_python(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(spark_search, "pickle_search", None)


@pytest.mark.drawn
@pytest.mark.usefixtures("no_python")
def test_random_steps(ss: ss2sql.Session) -> None:
    ss.set("moves", MOVES)

    @seed(89)
    @drawn(max(6, PROGRAMS // 160), shrunk=False)
    @given(level_searches.expressions())
    def run(parts: dict[str, str]) -> None:
        number = len(str(parts))
        agree(
            ss, level_searches.script_of(parts, BY_LENGTH[number % 3], set("ntbl"[number % 4 :]), grouped=False, ends=1)
        )

    run()


@pytest.mark.usefixtures("no_python")
@pytest.mark.parametrize(
    "script",
    [
        # Variables are bound, lists too; ORDER BY asks for the elements and the state of the last step.
        'SELECT n + m.by, t FROM m = moves WHERE n + m.by IN goals AND wanted == t START WITH n = 0, t = "it\'s"'
        " CONNECT BY UNIQUE MAXIMUM 9 n = n + m.by STOP WITH abs(n) > 4 ORDER BY m.by, n DESC;",
        # Places are steps times 2^24, so the 200th step has one that a small integer of Spark cannot hold.
        "SELECT n + this FROM range(300) START WITH n = 0 CONNECT BY UNIQUE n = n + this STOP WITH n > 0 AS list;",
    ],
    ids=["variables", "32 bits"],
)
def test_values_in_sql(ss: ss2sql.Session, script: str) -> None:
    for name, value in {"goals": [3, 5], "wanted": "it's", "moves": MOVES}.items():
        ss.set(name, value)
    agree(ss, script)


# --- what it takes -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("at_first", [False, True])
def test_each_step_is_tried_once(
    ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, at_first: bool
) -> None:
    """By a clock on which each look takes an hour the level of the start is done here, and no other."""
    calls = tmp_path / "calls"

    def noted(n: int, more: int) -> int:
        with calls.open("a") as file:
            file.write(f"{os.getpid()} {n} {more}\n")
        return min(n + more, 5)

    if at_first:
        monkeypatch.setattr(level_steps, "MAX_STATES", 2000)
        ticks = count(0, 3600)
        monkeypatch.setattr(level_steps, "time", SimpleNamespace(monotonic=lambda: next(ticks)))
    ss.function("noted", noted, volatility="immutable")
    script = "SELECT noted(n, this) FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = noted(n, this) AS list;"
    result = ss.run(script)
    made = [tuple(map(int, line.split())) for line in calls.read_text().splitlines()]
    assert Counter(call[1:] for call in made) == Counter((n, more) for n in range(6) for more in (1, 2))
    assert {n for process, n, _ in made if process == os.getpid()} == ({0} if at_first else set())
    assert result.stats.calls["noted"] == 12
    assert result.value == ss.run(script, engine="native").value


# --- what its processes are sent, how searches in them end, and what they leave behind ----------------------

LOCK = threading.Lock()
SEARCH = "SELECT f(n) FROM [1] START WITH n = 0 CONNECT BY UNIQUE n = n + 1;"
MANY = "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY BREADTH FIRST n = n + this AS list;"


def test_tables_variables_frames_and_nested_queries_are_sent(ss: ss2sql.Session) -> None:
    pandas = pytest.importorskip("pandas")
    ss.host.connection.execute("CREATE TABLE edges(src, dst); INSERT INTO edges VALUES (1, 2), (2, 3), (3, 4), (2, 1)")
    ss.set("closed", [4, {"a": 1}])
    ss.attach("weights", pandas.DataFrame({"node": [1, 2, 3], "more": [0.5, 1.5, 2.5]}))
    agree(
        ss,
        "SELECT e.dst, w.more FROM e = (SELECT dst FROM edges Where src == n), w = weights"
        " Where NOT (e.dst IN closed) START WITH n = 1 CONNECT BY UNIQUE n = e.dst STOP WITH w.node != n;",
    )


@pytest.mark.parametrize(
    ("function", "volatility", "script", "reason"),
    [
        (abs, "stable", SEARCH, "'f' is stable: it may depend on what only this process knows"),
        (lambda n, lock=LOCK: n + 1, "immutable", SEARCH, "'f' cannot be pickled"),
        (lambda n: object(), "immutable", SEARCH, "a row or state has an object"),
        (abs, "immutable", SEARCH.replace("[1]", "shelf"), "a world is in this process only"),
        (abs, "immutable", SEARCH.replace("[1]", "things"), "object"),
    ],
    ids=["stable", "lock", "object", "world", "objects"],
)
def test_what_cannot_be_sent_is_refused_by_name(
    ss: ss2sql.Session, function: Any, volatility: Any, script: str, reason: str
) -> None:
    ss.function("f", function, volatility=volatility)
    ss.attach("shelf", Shelf())
    ss.attach("things", [object()])
    with pytest.raises(ss2sql.UnsupportedError, match=reason) as caught:
        ss.run(script)
    assert caught.value.code == "U001"
    assert caught.value.hints or script != SEARCH


@pytest.mark.parametrize(
    ("wrong", "message"),
    [(lambda n: [][0], "did not fail again"), (lambda n: os._exit(3), "spark: ")],
    ids=["fails", "ends its process"],
)
def test_what_goes_wrong_on_executors_only(ss: ss2sql.Session, wrong: Any, message: str) -> None:
    here = os.getpid()
    ss.function("f", lambda n: n if os.getpid() == here else wrong(n), volatility="immutable")
    with pytest.raises(ss2sql.ExecutionError, match=message) as caught:
        ss.run(SEARCH)
    assert caught.value.code == "X009"
    assert ss.run(SHORT).value == [[1], [2], [1, 3], [2, 4]]


def test_a_run_that_is_late(ss: ss2sql.Session) -> None:
    with pytest.raises(ss2sql.Timeout) as caught:
        ss.run(MANY, timeout=6)
    partial = caught.value.partial
    assert partial is not None
    assert [list(path) for path in partial.paths[:3]] in ([], [[(1,)], [(2,)], [(1,), (1,)]], [[(1,)], [(2,)]])
    assert ss.run(SHORT).value == [[1], [2], [1, 3], [2, 4]]


def test_interrupt_ends_the_job_that_runs(ss: ss2sql.Session, tmp_path: Path) -> None:
    """The function sleeps on the executors for longer than anybody waits."""
    marker = tmp_path / "marker"

    def interrupt() -> None:
        while not marker.exists():
            time.sleep(0.01)
        ss.interrupt()

    ss.function("f", lambda n: (marker.touch(), time.sleep(30), n)[2], volatility="immutable")
    thread = threading.Thread(target=interrupt)
    thread.start()
    before = time.monotonic()
    with pytest.raises(ss2sql.Cancelled):
        ss.run(SEARCH)
    thread.join()
    assert time.monotonic() - before < 25


def test_explain_and_sql_and_views_of_the_user(spark: Any, ss: ss2sql.Session) -> None:
    spark.sql("SELECT 1 AS a").createOrReplaceTempView("steps")
    result = ss.run(SHORT)
    assert [tuple(row) for row in spark.table("steps").collect()] == [(1,)]
    spark.catalog.dropTempView("steps")
    assert "engine: spark: engine='spark' was given" in str(result.explain())
    assert "FROM frontier" in result.sql

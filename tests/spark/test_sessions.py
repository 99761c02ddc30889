"""Sessions of Spark: how searches in them end, and what they leave of them."""

from __future__ import annotations

import os
import sys
import threading
import time
from pathlib import Path
from typing import Any

import pytest

import ss2sql
from spark.same import SHORT

LONG = "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY BREADTH FIRST n = n + this AS list;"


def test_a_python_process_that_is_lost(ss: ss2sql.Session, tmp_path: Path) -> None:
    """The first process that meets 5 ends itself; Spark has another one begin the task anew."""
    marker = tmp_path / "marker"

    def deadly(n: int, more: int) -> int:
        if n == 5 and not marker.exists():
            marker.touch()
            os.kill(os.getpid(), 9)
        return min(n + more, 9)

    ss.function("deadly", deadly, volatility="immutable")
    script = "SELECT deadly(n, this) FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = deadly(n, this) AS list;"
    found = ss.run(script)
    assert marker.exists()
    wanted = ss.run(script, engine="native")
    assert found.value == wanted.value
    assert sum(level.steps + level.pruned for level in found.stats.levels) == 20


def test_a_function_that_ends_its_process(ss: ss2sql.Session) -> None:
    here = os.getpid()
    ss.function("deadly", lambda n: os._exit(3) if os.getpid() != here else n, volatility="immutable")
    with pytest.raises(ss2sql.ExecutionError, match="spark: ") as caught:
        ss.run("SELECT deadly(n) FROM [1] START WITH n = 0 CONNECT BY UNIQUE n = n + 1;")
    assert caught.value.code == "X009"
    assert ss.run(SHORT).value == [[1], [2], [1, 3], [2, 4]]


def test_a_run_that_is_late(ss: ss2sql.Session) -> None:
    with pytest.raises(ss2sql.Timeout) as caught:
        ss.run(LONG, timeout=6)
    partial = caught.value.partial
    assert partial is not None
    assert [list(path) for path in partial.paths[:3]] in ([], [[(1,)], [(2,)], [(1,), (1,)]], [[(1,)], [(2,)]])
    assert ss.run(SHORT).value == [[1], [2], [1, 3], [2, 4]]


def test_interrupt_ends_the_job_that_runs(ss: ss2sql.Session, tmp_path: Path) -> None:
    """The function sleeps on the executors for longer than anybody waits."""
    marker = tmp_path / "marker"

    def sleepy(n: int) -> int:
        marker.touch()
        time.sleep(30)
        return n

    def interrupt() -> None:
        while not marker.exists():
            time.sleep(0.01)
        ss.interrupt()

    ss.function("sleepy", sleepy, volatility="immutable")
    thread = threading.Thread(target=interrupt)
    thread.start()
    before = time.monotonic()
    with pytest.raises(ss2sql.Cancelled):
        ss.run("SELECT sleepy(n) FROM [1] START WITH n = 0 CONNECT BY UNIQUE n = n + 1;")
    thread.join()
    assert time.monotonic() - before < 25


# --- sessions ------------------------------------------------------------------------------------------------


def test_views_of_the_user_stay(spark: Any, ss: ss2sql.Session) -> None:
    spark.sql("SELECT 1 AS a").createOrReplaceTempView("steps")
    assert ss.run(SHORT).engine == "spark"
    assert [tuple(row) for row in spark.table("steps").collect()] == [(1,)]
    spark.catalog.dropTempView("steps")


def test_explain_and_sql(ss: ss2sql.Session) -> None:
    result = ss.run(SHORT)
    assert "engine: spark: engine='spark' was asked for" in str(result.explain())
    assert "in SQL" in str(result.explain())
    assert "CREATE TABLE kept AS" in result.sql
    assert "FROM frontier" in result.sql


def test_what_is_no_session_is_refused() -> None:
    with pytest.raises(ss2sql.SessionError, match="is a SparkSession, not int"):
        ss2sql.connect(engine="spark", session=3)


def test_missing_java_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("JAVA_HOME", str(tmp_path))
    with pytest.raises(ss2sql.SessionError, match="needs Java 17 or newer") as caught:
        ss2sql.connect(engine="spark")
    assert caught.value.code == "S003"


def test_a_missing_package_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pyspark", None)
    with pytest.raises(ss2sql.SessionError, match=r"ss2sql\[spark\]"):
        ss2sql.connect(engine="spark")

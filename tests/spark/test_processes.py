"""The processes of a session of Spark: what they are sent, how searches in them end, and what they leave behind."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from marshal import dumps
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from level_searches import SHORT, agree
from sessions import code_of

import ss2sql
from ss2sql.runtime.levels import executor, spark_steps
from ss2sql.runtime.levels.arrow import batch
from ss2sql.runtime.levels.level import TABLES
from ss2sql.runtime.levels.parcel import packed

pytestmark = pytest.mark.slow

LOCK = threading.Lock()


def of_f(ss: ss2sql.Session, f: Any, **options: Any) -> ss2sql.Result:
    """A search whose rows are of a function of the state."""
    ss.function("f", f, **{"volatility": "immutable", **options})
    return ss.run("SELECT f(n) FROM [1] START WITH n = 0 CONNECT BY UNIQUE n = n + 1;")


# --- what is sent ------------------------------------------------------------------------------------------


def test_a_task_that_is_broken_off_and_begun_anew(ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the same process, as Spark does it where others lost what the task needs: what was called is remembered."""
    sent: list[bytes] = []
    monkeypatch.setattr(spark_steps, "packed", lambda hunt, trial: sent.append(packed(hunt, trial)) or sent[-1])
    monkeypatch.setattr(executor, "ROWS", 1)
    ss.function("twice", lambda n, more: int(f"{n}{more}"), volatility="immutable")
    ss.run("SELECT twice(n, this) FROM [0, 1] START WITH n = 1 CONNECT BY UNIQUE n = twice(n, this) STOP WITH n > 9;")

    def task() -> Iterator[Any]:
        states = batch("step BIGINT, state BLOB", [(1, 2), (dumps((5,)), dumps((7,)))])
        return executor.tried([states], "a run", SimpleNamespace(value=sent[0]), TABLES["tries"])

    made = next(broken := task())
    broken.close()
    *rows, account = task()
    assert rows[0].equals(made)
    for told, called in ((account, {"twice": 2}), ([*task()][-1], {})):
        found = executor.account(told.column("state")[0].as_py())
        remembered = {"twice": 4 - sum(called.values())}
        assert (found["tried"], found["calls"], found["remembered"]) == (4, called, remembered)


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
    ("function", "options", "reason"),
    [
        (lambda n: n + 1, {"volatility": "stable"}, "'f' is stable: it may depend on what only this process knows"),
        (lambda n, lock=LOCK: n + 1, {}, "'f' cannot be pickled"),
        (lambda n: object(), {}, "a row or state has an object"),
    ],
    ids=["stable", "lock", "object"],
)
def test_functions_that_cannot_be_sent_are_refused_by_name(
    ss: ss2sql.Session, function: Any, options: Any, reason: str
) -> None:
    with pytest.raises(ss2sql.UnsupportedError, match=reason) as caught:
        of_f(ss, function, **options)
    assert caught.value.code == "U001"
    assert caught.value.hints


def test_worlds_and_objects_are_refused(ss: ss2sql.Session) -> None:
    from cases.shelf import Shelf

    ss.attach("shelf", Shelf())
    with pytest.raises(ss2sql.UnsupportedError, match="a world is in this process only"):
        ss.run("SELECT s.weight FROM s = shelf START WITH n = 1 CONNECT BY UNIQUE n = s.weight;")
    ss.attach("things", [object()])
    script = "SELECT 1 FROM x = things START WITH n = None CONNECT BY BREADTH FIRST MAXIMUM 3 n = x.this;"
    assert code_of(ss.run, script) == "U001"


@pytest.mark.parametrize("options", ["DEPTH FIRST", "HEURISTIC 0 COST 1"])
def test_other_orders_are_refused_by_name(ss: ss2sql.Session, options: str) -> None:
    with pytest.raises(ss2sql.UnsupportedError, match=f"{options.partition(' ')[0]}.*the tables of spark cannot do"):
        ss.run(f"SELECT x.this FROM x = near(n) START WITH n = 1 CONNECT BY {options} n = x.this;")


# --- how searches end --------------------------------------------------------------------------------------


def test_a_function_that_fails_on_executors_only(ss: ss2sql.Session) -> None:
    here = os.getpid()
    with pytest.raises(ss2sql.ExecutionError, match="did not fail again"):
        of_f(ss, lambda n: n if os.getpid() == here else [][0])


def test_a_function_that_ends_its_process(ss: ss2sql.Session) -> None:
    here = os.getpid()
    with pytest.raises(ss2sql.ExecutionError, match="spark: ") as caught:
        of_f(ss, lambda n: os._exit(3) if os.getpid() != here else n)
    assert caught.value.code == "X009"
    assert ss.run(SHORT).value == [[1], [2], [1, 3], [2, 4]]


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
    found = agree(ss, script)
    assert marker.exists()
    assert sum(level.steps + level.pruned for level in found.stats.levels) == 20


def test_a_run_that_is_late(ss: ss2sql.Session) -> None:
    with pytest.raises(ss2sql.Timeout) as caught:
        ss.run("SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY BREADTH FIRST n = n + this AS list;", timeout=6)
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

    thread = threading.Thread(target=interrupt)
    thread.start()
    before = time.monotonic()
    with pytest.raises(ss2sql.Cancelled):
        of_f(ss, sleepy)
    thread.join()
    assert time.monotonic() - before < 25


# --- what is left ------------------------------------------------------------------------------------------


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
    result = ss.run("SELECT x.this FROM x = near(n) START WITH n = 1 CONNECT BY UNIQUE n = x.this AS list;")
    assert "in Python: what stands in FROM depends on the state" in str(result.explain())

"""The processes of a session of Spark: what they are sent, how searches in them end, and what they leave behind."""

from __future__ import annotations

import os
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from cases.shelf import Shelf
from level_searches import SHORT, agree

import ss2sql

pytestmark = pytest.mark.slow

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
    assert "engine: spark: engine='spark' was asked for" in str(result.explain())
    assert "FROM frontier" in result.sql

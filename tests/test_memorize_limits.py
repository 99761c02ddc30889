"""What bounds the graph of MEMORIZE, what ends its making and the walk over it, and what is told of its levels."""

from __future__ import annotations

import threading
import time

import pytest

import ss2sql
from ss2sql.runtime.run.run_state import GraphLevel

TREE = (
    "SELECT 2 * n + this FROM [0, 1] WHERE 2 * n + this == 4 START WITH n = 1 CONNECT BY MEMORIZE 3 n = 2 * n + this;"
)
# Without an end: every step leads to a row of its own.
GROWING = """SELECT 2 * n + this FROM [0, 1] WHERE n < 0
START WITH n = 1 CONNECT BY MEMORIZE 99 n = (2 * n + this) % 999999937;"""
# A grid of 16 x 16 has more paths from corner to corner than anybody could list.
SIDE = 16
GRID = [
    [to for to in range(SIDE * SIDE) if abs(to % SIDE - at % SIDE) + abs(to // SIDE - at // SIDE) == 1]
    for at in range(SIDE * SIDE)
]
WALK = """SELECT next.this FROM next = grid[node] WHERE next.this == goal
START WITH node = 0 CONNECT BY MEMORIZE 200 node = next.this;"""
WEIGHTED = WALK.replace("MEMORIZE 200", "MEMORIZE 200 COST 1 + next.this / 1000.0")


# --- max_rows ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("workers", [1, 2])
@pytest.mark.parametrize("most", [0, 2, 13])
def test_a_graph_that_does_not_fit(ss: ss2sql.Session, most: int, workers: int) -> None:
    with pytest.raises(ss2sql.ExecutionError, match=f"graph of MEMORIZE has more than max_rows={most} rows") as caught:
        ss.run(TREE, max_rows=most, workers=workers)
    assert caught.value.code == "X010"
    assert caught.value.span is not None
    assert caught.value.hints == ("bound MEMORIZE, stop paths that lead nowhere with STOP WITH, or raise max_rows",)
    assert len(ss.run(TREE, max_rows=14).paths) == 1  # 2 + 4 + 8 rows


def test_a_graph_does_not_grow_beyond_its_limit(ss: ss2sql.Session) -> None:
    asked = []

    def onward(n: int) -> int:
        asked.append(n)
        return n + 1

    ss.function("onward", onward, volatility="volatile")
    script = "SELECT n FROM [1] WHERE n < 0 START WITH n = 1 CONNECT BY MEMORIZE 1000000 n = onward(n);"
    with pytest.raises(ss2sql.ExecutionError, match="max_rows=10"):
        ss.run(script, max_rows=10)
    assert len(asked) <= 12


def test_a_graph_of_keys_does_not_grow_beyond_its_limit(ss: ss2sql.Session) -> None:
    script = "SELECT n FROM [1, 2] WHERE n < 0 START WITH n = 1 CONNECT BY MEMORIZE 1000000 BY n n = 2 * n + this;"
    with pytest.raises(ss2sql.ExecutionError, match="graph of MEMORIZE has more than max_rows=10 rows"):
        ss.run(script, max_rows=10)
    assert len(ss.run(TREE, max_rows=14, trace=9).paths) == 1
    with pytest.raises(ss2sql.ExecutionError, match="max_rows=13"):
        ss.run(TREE, max_rows=13, trace=9)


def test_a_graph_inside_of_another_query(ss: ss2sql.Session) -> None:
    script = f"SELECT this FROM [1] WHERE len({TREE[:-1]} AS list) == 1;"
    assert ss.run(script, max_rows=14).value == ss.run(script).value
    with pytest.raises(ss2sql.ExecutionError, match="max_rows=13"):
        ss.run(script, max_rows=13)


# --- endings -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("way", ["timeout", "interrupt"])
@pytest.mark.parametrize("script", [GROWING, WALK, WEIGHTED], ids=["growing", "walk", "weighted"])
def test_it_ends_when_it_has_to(ss: ss2sql.Session, script: str, way: str) -> None:
    ss.set("grid", GRID)
    ss.set("goal", SIDE * SIDE - 1)
    query = ss.compile(script)
    timer = threading.Timer(0.3, ss.interrupt)
    if way == "interrupt":
        timer.start()
    started = time.process_time()
    with pytest.raises(ss2sql.Timeout if way == "timeout" else ss2sql.Cancelled) as caught:
        query.run(timeout=0.3 if way == "timeout" else 30)
    assert time.process_time() - started < 5
    partial = caught.value.partial
    assert partial.status == ("timeout" if way == "timeout" else "cancelled")
    lengths = [len(path) for path in partial.paths]
    assert lengths[:3] == ([] if script == GROWING else [2 * (SIDE - 1)] * 3)
    assert len(ss.run(TREE).paths) == 1


# --- levels --------------------------------------------------------------------------------------------


def test_levels_count_what_became_of_steps(ss: ss2sql.Session) -> None:
    # 0 -> 1, 2, 3; then 1 -> 2, 3, 4; 2 -> 3, 4, 5; 3 stops and is no goal, 5 stops as a goal, 4 goes on.
    script = """SELECT n + this FROM [1, 2, 3] WHERE n + this > 4 AND n + this < 6
        START WITH n = 0 CONNECT BY MEMORIZE 3 n = n + this STOP WITH n + this IN [3, 5, 6, 7];"""
    found = ss.run(script)
    # Each of the levels evaluates three steps for each of its states: 1; then 1 and 2; then 4.
    assert found.stats.levels == [GraphLevel(2, 2, 1), GraphLevel(2, 4, 2), GraphLevel(0, 1, 2)]
    assert [level.repeated for level in found.stats.levels] == [0, 2, 1]
    assert sum(level.steps + level.pruned for level in found.stats.levels) == found.stats.generated == 12
    lines = found.explain().splitlines()
    assert lines[lines.index("the graph of MEMORIZE:") + 1 :] == [
        "   level  rows  steps  repeated  pruned",
        "       1     2      2         0       1",
        "       2     2      4         2       2",
        "       3     0      1         1       2",
        "     all     4      7         3       5",
    ]


def test_impossible_steps_are_pruned(ss: ss2sql.Session) -> None:
    script = "SELECT this FROM [0, 1] START WITH n = 0 CONNECT BY MEMORIZE 2 PROBABILITY this / 2 n = n;"
    # The row 1 is found in the first level; in the second it leads to itself.
    assert ss.run(script).stats.levels == [GraphLevel(1, 1, 1), GraphLevel(0, 1, 1)]

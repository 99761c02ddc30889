"""Searches with conditions, keys behind BY, several starts, and what a step says: random ones, and what A* looks at."""

from __future__ import annotations

from typing import Any

import pytest
from agreement import trial
from hypothesis import given, seed
from programs import ProgramCase
from programs.drawn import SEED, amount, drawn
from programs.hierarchies import hierarchies

import ss2sql


def test_a_star_takes_the_smaller_estimate_first(engine: Any) -> None:
    moves = [{"dx": dx, "dy": dy} for dx, dy in ((1, 0), (0, 1), (-1, 0), (0, -1))]
    with ss2sql.connect() as ss:
        ss.set("moves", moves)
        result = ss.run(
            """SELECT x + dx, y + dy FROM moves WHERE x + dx == 39 AND y + dy == 39
               START WITH x = 0, y = 0
               CONNECT BY COST 1 HEURISTIC abs(39 - x - dx) + abs(39 - y - dy) UNIQUE BY (x, y) MAXIMUM 1,
                   x + dx >= 0 AND x + dx < 40 AND y + dy >= 0 AND y + dy < 40, x = x + dx, y = y + dy AS rows""",
            engine=engine,
        )
        assert len(result.paths[0]) == 78
        assert result.stats.expanded <= 100


# --- random searches -----------------------------------------------------------------------------------


@pytest.mark.drawn
def test_three_evaluators_agree_on_searches_of_edges() -> None:
    in_the_database = 0

    @seed(SEED)
    @drawn(amount())
    @given(hierarchies())
    def run(case: ProgramCase) -> None:
        nonlocal in_the_database
        tried = trial(case)
        in_the_database += tried.outcomes["database"] is not None
        assert tried.differences == []

    run()
    assert in_the_database > amount() / 4


def test_the_hint_for_an_aggregate_of_last_steps_is_typed(ss: ss2sql.Session) -> None:
    ss.set("emp", [{"id": n, "boss": n - 1 if n > 1 else None} for n in range(1, 5)])
    search = "FROM emp START WITH boss IS NULL CONNECT BY PRIOR id == boss"
    with pytest.raises(ss2sql.ResolveError) as caught:
        ss.run(f"SELECT LAST max(level()) {search} AS value;")
    assert caught.value.hints == (
        "write max(path(level())) for the steps of the path",
        "write SELECT LAST ... GROUP BY 1 for max of the last steps of all paths",
    )
    assert ss.eval(f"SELECT LAST max(level()) {search} GROUP BY 1 AS value;") == 4

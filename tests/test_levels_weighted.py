"""COST, PROBABILITY and MEMORIZE by levels in the tables of DuckDB find what the native search finds, in its order."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest
from level_searches import World, both_end_alike, by_sheet
from programs.drawn import amount
from sessions import code_of

import ss2sql

duckdb = pytest.importorskip("duckdb")

TRIALS = amount(1 / 25)
OWN = duckdb.connect(config={"threads": 1})  # to connect takes 20 ms


@pytest.fixture
def ss() -> Iterator[ss2sql.Session]:
    with ss2sql.connect(engine="duckdb", session=OWN) as session:
        yield session


@pytest.mark.parametrize("number", range(TRIALS))
@pytest.mark.parametrize("is_graph", [False, True], ids=["by weight", "by graph"])
def test_ties_totals_bounds_and_failing_steps(ss: ss2sql.Session, number: int, is_graph: bool) -> None:
    world = World(number)
    world.furnish(ss)
    if is_graph:
        both_end_alike(ss, world.by_graph(number % 3 > 0))
    else:
        both_end_alike(ss, world.by_weight(["", "MAXIMUM 2"], ["MAXIMUM 3", "MAXIMUM 20"]))


# --- what the language says ----------------------------------------------------------------------------------

ROADS = {1: [2, 3], 2: [1, 3, 4, 6], 3: [4, 2, 1], 4: [5, 2], 5: [4], 6: [7], 7: [6]}


def test_what_the_sheet_says(ss: ss2sql.Session) -> None:
    assert list(by_sheet(ss, "search/by-levels"))


@pytest.mark.parametrize("engine", ["native", "duckdb"])
def test_max_rows(ss: ss2sql.Session, engine: Any) -> None:
    script = "SELECT x.this FROM x = near(n) WHERE x.this == 7 START WITH n = 1 CONNECT BY MEMORIZE n = x.this AS list;"
    ss.function("near", lambda n: ROADS[n], volatility="immutable")
    assert ss.run(script, engine=engine, max_rows=7).value[0] == [2, 6, 7]
    for most in (6, 2):
        assert code_of(ss.run, script, engine=engine, max_rows=most) == "X010"


# --- what it takes ---------------------------------------------------------------------------------------------


def grid(ss: ss2sql.Session, cost: Callable[[int, int], float]) -> ss2sql.Result:
    """The cheapest way over a grid of 10 by 10 fields."""

    def near(field: int) -> list[int]:
        x, y = divmod(field, 10)
        steps = ((x - 1, y), (x + 1, y), (x, y - 1), (x, y + 1))
        return [10 * a + b for a, b in steps if 0 <= a < 10 and 0 <= b < 10]

    ss.function("near", near, volatility="immutable")
    ss.function("cost", cost, volatility="immutable")
    return ss.run(
        "SELECT x.this FROM x = near(n) WHERE x.this == 99 START WITH n = 0"
        " CONNECT BY UNIQUE COST cost(n, x.this) n = x.this AS list;"
    )


def test_equal_costs_make_a_level_of_each_total(ss: ss2sql.Session) -> None:
    result = grid(ss, lambda a, b: 1)
    assert len(result.value[0]) == 18
    assert len(result.stats.levels) <= 21  # the start is reached again at 2; the farthest rows lead nowhere
    assert result.stats.expanded == 100  # every field


def test_costs_that_all_differ_are_taken_many_at_a_time(ss: ss2sql.Session) -> None:
    result = grid(ss, lambda a, b: 1 + (a * 31 + b * 17) % 101 / 101)
    assert len(result.stats.levels) < 50  # for 100 rows
    assert result.stats.expanded < 140  # some are chosen too early and tried again


def test_the_bound_leaves_out_what_is_too_far(ss: ss2sql.Session) -> None:
    ss.function("near", lambda n: ROADS[n], volatility="immutable")
    script = "SELECT x.this FROM x = near(n) WHERE x.this == 4 START WITH n = 1 CONNECT BY MEMORIZE 2 n = x.this"
    # All rows but 5 and 7 are reached by two steps; the steps to 1 and between 2 and 3 are edges of the second level.
    assert [(level.rows, level.steps) for level in ss.run(script).stats.levels] == [(2, 2), (3, 7)]


# --- what is told ----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "told"),
    [
        ("UNIQUE COST n", "searches the cheapest steps first"),
        ("NO CYCLE PROBABILITY 0.5", "not met on the way back to the start"),
        ("MEMORIZE 3", "searched from the start only: its graph is in tables"),
    ],
)
def test_explain_tells_how(ss: ss2sql.Session, options: str, told: str) -> None:
    result = ss.run(f"SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY {options} n = this AS list;")
    text = str(result.explain())
    level = result.stats.levels[0]
    assert told in text
    if "MEMORIZE" not in options:
        assert ["1", str(level.steps), str(level.pruned)] in [line.split() for line in text.splitlines()]

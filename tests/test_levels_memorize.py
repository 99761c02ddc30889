"""MEMORIZE by levels in the tables of DuckDB finds what the native search finds, in its order."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from level_searches import compare_random, kept, options
from test_levels import COUNT, OWN
from test_levels_cost import TRIALS, World, either

import ss2sql
from ss2sql.frontend import ast
from ss2sql.runtime.memorize.graph import Graph

BOUNDS = ("1", "3", "5")
ROADS = {1: [2, 3], 2: [1, 3, 4, 6], 3: [4, 2, 1], 4: [5, 2], 5: [4], 6: [7], 7: [6]}


def variants(query: ast.Query) -> list[ast.Query]:
    """A search by MEMORIZE with its own bound or others, and its own weights."""
    own = kept(query, "MAXIMUM", "COST", "PROBABILITY", "MEMORIZE")
    bounds = [()] if kept(query, "MEMORIZE") else [options(f"MEMORIZE {bound}") for bound in BOUNDS]
    return [replace(query, options=(*own, *bound)) for bound in bounds]


def test_random_searches() -> None:
    assert compare_random(variants, "duckdb", OWN, 10, COUNT // 2) > COUNT // 16


@pytest.mark.parametrize("number", range(TRIALS))
def test_bounds_weights_and_failing_steps(number: int) -> None:
    world = World(number)
    weighs = f"{world.word} weigh(n, x.this)" if number % 3 else ""
    bound = world.some.choice(["MEMORIZE", "MEMORIZE 1", "MEMORIZE 2", "MEMORIZE 4"])
    wanted, found = either(world.script(f"{bound} {weighs}", world.some.choice(["", "MAXIMUM 2"])), world.functions())
    assert found == wanted


# --- what the language says ----------------------------------------------------------------------------------


def paths(options: str, clauses: str = "WHERE x.this == 4", end: str = "", **functions: Callable[..., Any]) -> Any:
    """The paths from 1 to a goal."""
    with ss2sql.connect(engine="duckdb", session=OWN) as ss:
        ss.function("near", lambda n: ROADS[n], volatility="immutable")
        for name, function in functions.items():
            ss.function(name, function, volatility="immutable")
        return ss.run(
            f"SELECT x.this FROM x = near(n) {clauses} START WITH n = 1 CONNECT BY {options} n = x.this {end} AS list;"
        ).value


def test_all_paths_without_a_repeated_row_shortest_first() -> None:
    # The start is no row, so a path may come back to 1, once.
    wanted = [[2, 4], [3, 4], [2, 3, 4], [3, 2, 4], [2, 1, 3, 4], [3, 1, 2, 4]]
    assert paths("MEMORIZE 3") == wanted[:4]
    assert paths("MEMORIZE") == wanted
    assert paths("MEMORIZE MAXIMUM 3") == wanted[:3]


def test_the_cheapest_come_first() -> None:
    found = paths("MEMORIZE 3 COST IF(x.this == 3; 0; 2)")
    # 3 costs nothing, other rows 2; among equals source order, in which from 2 the step to 3 comes before that to 4.
    assert found == [[3, 4], [2, 3, 4], [2, 4], [3, 2, 4]]


def test_a_step_to_a_known_row_is_an_edge_even_if_it_would_stop() -> None:
    # The step from 2 to 3 stops and is no goal; but 3 is known from the start, so STOP WITH is not asked again.
    assert paths("MEMORIZE 3", end="STOP WITH n == 2 and x.this == 3")[2] == [2, 3, 4]


def test_a_goal_at_once_and_none_at_all() -> None:
    assert paths("MEMORIZE 1", "WHERE x.this == 2") == [[2]]
    assert paths("MEMORIZE 1") == []
    assert paths("MEMORIZE", "WHERE x.this == 9") == []
    assert paths("MEMORIZE", "", "STOP WITH True") == []


def test_parts() -> None:
    assert paths("MEMORIZE 3", end="GROUP BY n") == {2: [[2, 4], [3, 2, 4]], 3: [[3, 4], [2, 3, 4]]}


@pytest.mark.parametrize("clause", ["stops", "weigh"])
def test_of_a_known_row_only_the_weight_is_asked_for(clause: str) -> None:
    """2 is known when the step from 3 is tried: what STOP WITH would raise there is no error, what COST raises is."""

    def fail(n: int, to: int) -> Any:
        if (n, to) == (3, 2):
            raise ValueError(clause)
        return 1

    def ask() -> Any:
        plain = {"stops": lambda n, to: 0, "weigh": lambda n, to: 1}
        options = "MEMORIZE 3 COST weigh(n, x.this)"
        return paths(options, end="STOP WITH stops(n, x.this) == 1 and n == 9", **{**plain, clause: fail})

    if clause == "weigh":
        with pytest.raises(ValueError, match="weigh"):
            ask()
    else:
        assert ask() == [[2, 4], [3, 4], [2, 3, 4], [3, 2, 4]]


@pytest.mark.parametrize("engine", ["native", "duckdb"])
@pytest.mark.parametrize(("most", "code"), [(6, "X010"), (7, None), (2, "X010")])
def test_max_rows(engine: Any, most: int, code: str | None) -> None:
    script = "SELECT x.this FROM x = near(n) WHERE x.this == 7 START WITH n = 1 CONNECT BY MEMORIZE n = x.this AS list;"
    with ss2sql.connect(session=OWN) as ss:
        ss.function("near", lambda n: ROADS[n], volatility="immutable")
        if code is None:
            assert ss.run(script, engine=engine, max_rows=most).value[0] == [2, 6, 7]
            return
        with pytest.raises(ss2sql.ExecutionError) as caught:
            ss.run(script, engine=engine, max_rows=most)
        assert caught.value.code == code


# --- what it takes ---------------------------------------------------------------------------------------------


def test_only_what_lies_on_ways_to_goals_is_loaded(monkeypatch: pytest.MonkeyPatch) -> None:
    """From 1000 numbers in a binary tree with ways back, 4 are on the only way to the goal."""
    loaded: list[Graph] = []
    known = Graph.first_path

    def seen(self: Graph) -> Any:
        loaded.append(self)
        return known(self)

    monkeypatch.setattr(Graph, "first_path", seen)
    with ss2sql.connect(engine="duckdb", session=OWN) as ss:
        result = ss.run(
            "SELECT 2 * n + this FROM [0, 1] WHERE 2 * n + this == 22 START WITH n = 1"
            " CONNECT BY MEMORIZE n = 2 * n + this STOP WITH 2 * n + this > 1000 AS list;"
        )
    assert result.value == [[2, 5, 11, 22]]
    (graph,) = loaded
    assert len(graph.rows) == 1 + 4
    assert len(graph.targets) == 4
    assert sum(level.rows for level in result.stats.levels) == 999


def test_the_bound_leaves_out_what_is_too_far() -> None:
    with ss2sql.connect(engine="duckdb", session=OWN) as ss:
        ss.function("near", lambda n: ROADS[n], volatility="immutable")
        result = ss.run(
            "SELECT x.this FROM x = near(n) WHERE x.this == 4"
            " START WITH n = 1 CONNECT BY MEMORIZE 2 n = x.this AS list;"
        )
    assert result.value == [[2, 4], [3, 4]]
    # All rows but 5 and 7 are reached by two steps; the steps to 1 and between 2 and 3 are edges of the second level.
    assert [(level.rows, level.steps) for level in result.stats.levels] == [(2, 2), (3, 7)]


def test_explain_tells_how() -> None:
    with ss2sql.connect(engine="duckdb", session=OWN) as ss:
        ss.function("near", lambda n: ROADS[n], volatility="immutable")
        result = ss.run(
            "SELECT x.this FROM x = near(n) WHERE x.this == 4"
            " START WITH n = 1 CONNECT BY MEMORIZE 3 n = x.this AS list;"
        )
    text = str(result.explain())
    assert "keeps every step to a row that is reached by then as an edge" in text
    assert "gives the paths of that, the shortest first" in text
    assert "searched from the start only: its graph is in tables" in text
    assert "INSERT INTO edges" in result.sql

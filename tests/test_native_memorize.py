"""MEMORIZE natively, against a search that tries everything, on random graphs with repeated edges."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

import pytest
from native_host import FakeHost
from path_problems import CHANCES, COSTS, Edge, Problem, by_length, by_total, problem

SEEDS = range(120)


@pytest.mark.parametrize("seed", SEEDS)
def test_by_length(seed: int) -> None:
    graph = problem(seed, [1])
    expected = by_length(graph)
    assert graph.host().run(graph.script()) == expected
    assert graph.host().run(graph.script("MAXIMUM 2")) == expected[:2]


@pytest.mark.parametrize("seed", SEEDS)
def test_by_cost(seed: int) -> None:
    graph = problem(seed, COSTS[seed % len(COSTS)])
    expected = by_total(graph, False)
    assert graph.host().run(graph.script("COST e.this[1]")) == expected
    assert graph.host().run(graph.script("COST e.this[1] MAXIMUM 3")) == expected[:3]


@pytest.mark.parametrize("seed", SEEDS)
def test_by_probability(seed: int) -> None:
    graph = problem(seed, CHANCES[seed % len(CHANCES)])
    assert graph.host().run(graph.script("PROBABILITY e.this[1]")) == by_total(graph, True)


def test_equal_totals_of_different_sums() -> None:
    # 0.1 + 0.2 is more than 0.3 by rounding, so the second path comes first; 0.2 + 0.1 is the same number.
    edges = [[(1, 0.1), (2, 0.3), (3, 0.2)], [(4, 0.2)], [(4, 0)], [(4, 0.1)], []]
    graph = Problem(edges, {4}, set(), None)
    assert graph.host().run(graph.script("COST e.this[1]")) == [[2, 4], [1, 4], [3, 4]]


@pytest.mark.parametrize("options", ["", "COST 1", "COST 0", "COST e.this[1]", "PROBABILITY 0.9", "PROBABILITY 1"])
def test_the_first_paths_of_very_many(options: str) -> None:
    # A grid of 30 x 30 has 30,067,266,499,541,040 shortest paths from corner to corner.
    side = 30
    edges: list[list[Edge]] = [
        [
            (node + step, weight)
            for step, weight, inside in ((side, 1, node // side < side - 1), (1, 1, node % side < side - 1))
            if inside
        ]
        for node in range(side * side)
    ]
    graph = Problem(edges, {side * side - 1}, set(), None)
    paths = graph.host().run(graph.script(f"{options} MAXIMUM 500"))
    assert len(paths) == len(set(map(tuple, paths))) == 500
    assert {len(path) for path in paths} == {2 * (side - 1)}
    # In source order, which here is down before right.
    assert paths == sorted(paths, reverse=True)


def test_the_first_of_very_many_paths_whose_totals_differ_by_rounding() -> None:
    side, costs = 20, {1: 0.1, 20: 0.3}
    edges: list[list[Edge]] = [
        [(node + step, costs[step]) for step in (1, side) if (node % side if step == 1 else node // side) < side - 1]
        for node in range(side * side)
    ]
    graph = Problem(edges, {side * side - 1}, set(), None)
    paths = graph.host().run(graph.script("COST e.this[1] MAXIMUM 300"))
    sums = [sum(costs[after - before] for before, after in pairwise([0, *path])) for path in paths]
    assert len(sums) == 300
    assert sums == sorted(sums)
    assert sums[-1] - sums[0] < 1e-9
    # Among equal totals right comes before down, which is source order.
    assert all(a < b for a, b in pairwise(zip(sums, paths, strict=True)))


def test_work_is_bounded_where_most_ways_lead_nowhere() -> None:
    # A long corridor, and at its start a room of which every node leads to every other one, and nowhere else.
    room, corridor = list(range(1, 13)), list(range(13, 113))
    edges: list[list[Edge]] = [[(node, 1) for node in (*room, 13)]]
    edges += [[(other, 1) for other in room if other != node] for node in room]
    edges += [[(node + 1, 1)] for node in corridor[:-1]] + [[]]
    graph = Problem(edges, {112}, set(), None)
    assert graph.host().run(graph.script()) == [corridor]
    assert graph.host().run(graph.script("COST e.this[1]")) == [corridor]


def test_each_row_is_expanded_once() -> None:
    side = 20
    edges: list[list[Edge]] = [
        [(node + step, 1) for step in (-side, side, -1, 1) if 0 <= node + step < side * side]
        for node in range(side * side)
    ]
    graph = Problem(edges, {side + 3}, set(), None)
    host = graph.host()
    run = host.start()
    host.run(graph.script("MAXIMUM 10"), run)
    # Every node is a row, the start's own one too; the start is expanded besides.
    assert run.stats.calls["near"] == run.stats.expanded + 1 == side * side + 1


def test_the_graph_ends_at_the_bound() -> None:
    edges: list[list[Edge]] = [[(node + 1, 1)] for node in range(50)] + [[]]
    graph = Problem(edges, {3, 40}, set(), 5)
    host = graph.host()
    run = host.start()
    assert host.run(graph.script(), run) == [[1, 2, 3]]
    assert run.stats.generated == 5


def test_a_row_is_shown_as_it_was_first_met() -> None:
    # 1.0 is a second way to the row 1.
    script = "SELECT this FROM [1, 1.0, 2.0] START WITH n = 0 CONNECT BY MEMORIZE 1 n = this AS list"
    assert [repr(path) for path in FakeHost().run(script)] == ["[1]", "[1]", "[2.0]"]


def test_functions_are_asked_once_for_a_row() -> None:
    asked: list[Any] = []

    def ask(value: Any) -> Any:
        asked.append(value)
        return True

    graph = [[1, 2], [2], []]
    host = FakeHost({"near": lambda node: graph[node], "ask": ask}, {"ask": "volatile"})
    script = "SELECT n.this FROM n = near(node) WHERE ask(n.this) START WITH node = 0 CONNECT BY MEMORIZE node = n.this"
    assert len(host.run(script)) == 3
    # The second step to 2 is an edge to a known row.
    assert asked == [1, 2]

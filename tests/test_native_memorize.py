"""MEMORIZE natively, against a search that tries everything, on random graphs with repeated edges."""

from __future__ import annotations

import random
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import pytest
from native_host import FakeHost

Edge = tuple[int, Any]  # the node that it leads to, and its weight


@dataclass(frozen=True)
class Problem:
    """Node 0 is the start. `edges[node]` are the edges out of a node in source order."""

    edges: list[list[Edge]]
    goals: set[int]
    stops: set[int]
    bound: int | None

    def host(self) -> FakeHost:
        near = [[list(edge) for edge in edges] for edges in self.edges]
        return FakeHost({"near": lambda node: near[node]}, goals=sorted(self.goals), stops=sorted(self.stops))

    def script(self, options: str = "") -> str:
        bound = "" if self.bound is None else str(self.bound)
        return f"""SELECT e.this[0] FROM e = near(node) WHERE e.this[0] IN goals
        START WITH node = 0 CONNECT BY MEMORIZE {bound} {options} node = e.this[0]
        STOP WITH e.this[0] IN stops AS list"""

    def paths(self) -> list[tuple[list[int], list[int], list[Any]]]:
        """All paths in source order: the positions of the edges, the nodes, the weights."""
        found = []
        longest = len(self.edges) + 1 if self.bound is None else self.bound

        def walk(node: int, positions: list[int], nodes: list[int], weights: list[Any]) -> None:
            if len(nodes) == longest:
                return
            for position, (target, weight) in enumerate(self.edges[node]):
                if target in nodes:
                    continue
                longer = ([*positions, position], [*nodes, target], [*weights, weight])
                if target in self.goals:
                    found.append(longer)
                if target not in self.stops:
                    walk(target, *longer)

        walk(0, [], [], [])
        return found


def problem(seed: int, weights: list[Any], largest: int = 6) -> Problem:
    dice = random.Random(seed)
    number = dice.randint(2, largest)
    edges = [[(dice.randrange(number), dice.choice(weights)) for _ in range(dice.randint(0, 4))] for _ in range(number)]
    goals = {node for node in range(number) if dice.random() < 0.4}
    stops = {node for node in range(number) if dice.random() < 0.2}
    return Problem(edges, goals, stops, dice.choice([None, 1, 2, 3, 4, 5]))


SEEDS = range(120)


@pytest.mark.parametrize("seed", SEEDS)
def test_by_length(seed: int) -> None:
    graph = problem(seed, [1])
    expected = [nodes for _, nodes, _ in sorted(graph.paths(), key=lambda path: (len(path[0]), path[0]))]
    assert graph.host().run(graph.script()) == expected
    assert graph.host().run(graph.script("MAXIMUM 2")) == expected[:2]


def totals(graph: Problem, likeliest: bool) -> list[list[int]]:
    """The paths by their total, ties in source order, a path before its continuations."""

    def rank(path: tuple[list[int], list[int], list[Any]]) -> Any:
        total: Any = 1 if likeliest else 0
        for weight in path[2]:
            total = total * weight if likeliest else total + weight
        return (-total if likeliest else total, path[0])

    return [path[1] for path in sorted(graph.paths(), key=rank)]


COSTS: list[list[Any]] = [
    [1],
    [0],
    [0, 1, 2],
    [3, 5, 7],
    [0.5, 1, 1.25],
    [0.1, 0.2, 0.3, 0.7],
    [0.1, 1.1, 0],
    [2**60, 1],
]
CHANCES: list[list[Any]] = [[0.9], [1], [0.5, 1, 0.25], [0.1, 0.3, 0.9], [1 / 3, 2 / 3, 1], [1e-200, 0.5]]


@pytest.mark.parametrize("seed", SEEDS)
def test_by_cost(seed: int) -> None:
    graph = problem(seed, COSTS[seed % len(COSTS)])
    expected = totals(graph, False)
    assert graph.host().run(graph.script("COST e.this[1]")) == expected
    assert graph.host().run(graph.script("COST e.this[1] MAXIMUM 3")) == expected[:3]


@pytest.mark.parametrize("seed", SEEDS)
def test_by_probability(seed: int) -> None:
    graph = problem(seed, CHANCES[seed % len(CHANCES)])
    assert graph.host().run(graph.script("PROBABILITY e.this[1]")) == totals(graph, True)


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

"""The paths of MEMORIZE against brute force, and how many steps they take where most ways lead nowhere."""

from __future__ import annotations

import random
from functools import reduce
from itertools import islice, pairwise
from operator import add, mul
from typing import Any

import pytest
from native_host import FakeHost
from path_problems import CHANCES, COSTS, HARMLESS, MISLEADING, Edge, Problem, by_length, by_total, graph_of, problem
from programs.drawn import amount

import ss2sql
from ss2sql.runtime.search import paths_by_length as lengths_module
from ss2sql.runtime.search.paths_by_length import PATIENCE_FACTOR, PathsByLength
from ss2sql.runtime.search.paths_by_weight import PathsByWeight
from ss2sql.runtime.search.search_run import RowGraph

COUNT = amount(1 / 5)

# --- against brute force ------------------------------------------------------------------------------------------

SCRIPT = """SELECT e.this[0] FROM e = near(node) WHERE is_goal(e.this[0])
    START WITH node = 0 CONNECT BY MEMORIZE (most) {} node = e.this[0]
    STOP WITH is_stop(e.this[0]) AS list"""
WEIGHTS = {"length": "", "cost": "COST e.this[1]", "chance": "PROBABILITY e.this[1]"}
RANKED: dict[str, Any] = {
    "length": ([[1]], by_length),
    "cost": (COSTS, lambda graph: by_total(graph, False)),
    "chance": (CHANCES, lambda graph: by_total(graph, True)),
}
WORK: dict[str, Any] = {
    "length": PathsByLength,
    "cost": lambda graph: PathsByWeight(graph, graph.weights, False),
    "chance": lambda graph: PathsByWeight(graph, graph.weights, True),
}


# The engine, and when quick walks give up; None as it is.
CARE = [("auto", None), ("native", None), ("native", 0), ("native", 0.05), ("native", 0.3)]


@pytest.mark.drawn
@pytest.mark.parametrize("order", RANKED)
@pytest.mark.parametrize(("engine", "patience"), CARE)
def test_the_paths_are_those_of_brute_force_whenever_care_begins(
    ss: ss2sql.Session, order: str, engine: Any, patience: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    if patience is not None:
        monkeypatch.setattr(lengths_module, "PATIENCE_FACTOR", patience)
    graph = Problem([], set(), set(), None)
    ss.function("near", lambda node: [list(edge) for edge in graph.edges[node]], volatility="stable")
    ss.function("is_goal", lambda node: node in graph.goals, volatility="stable")
    ss.function("is_stop", lambda node: node in graph.stops, volatility="stable")
    ss.set("most", 1)
    scripts = [SCRIPT.format(options) for options in (WEIGHTS[order], f"{WEIGHTS[order]} MAXIMUM 3")]
    scripts += [script.replace("(most)", "") for script in scripts]
    queries = [ss.compile(script, engine=engine) for script in scripts]
    weights, ranked = RANKED[order]
    found = 0
    for seed in range(COUNT):
        graph = problem(seed, weights[seed % len(weights)], 7)
        expected = ranked(graph)
        found += len(expected)
        ss.set("most", graph.bound or 1)
        every, first = queries[2:] if graph.bound is None else queries[:2]
        assert every.run().value == expected, seed
        assert first.run().value == expected[:3], seed
    assert found > COUNT


def grid(side: int, steps: dict[int, Any]) -> list[list[Edge]]:
    """The edges of a grid whose nodes are numbered row by row: steps of 1 lead right, those of its side lead down."""

    def outward(node: int) -> list[Edge]:
        inside = {1: node % side < side - 1, side: node // side < side - 1}
        return [(node + step, weight) for step, weight in steps.items() if inside[step]]

    return [outward(node) for node in range(side * side)]


@pytest.mark.parametrize("options", ["", "COST 1", "COST 0", "COST e.this[1]", "PROBABILITY 0.9", "PROBABILITY 1"])
def test_the_first_paths_of_very_many(options: str) -> None:
    # A grid of 30 x 30 has 30,067,266,499,541,040 shortest paths from corner to corner.
    graph = Problem(grid(30, {30: 1, 1: 1}), {30 * 30 - 1}, set(), None)
    paths = graph.host().run(graph.script(f"{options} MAXIMUM 500"))
    assert len(paths) == len(set(map(tuple, paths))) == 500
    assert {len(path) for path in paths} == {2 * 29}
    # In source order, which here is down before right.
    assert paths == sorted(paths, reverse=True)


def test_the_first_of_very_many_paths_whose_totals_differ_by_rounding() -> None:
    costs = {1: 0.1, 20: 0.3}
    graph = Problem(grid(20, costs), {20 * 20 - 1}, set(), None)
    paths = graph.host().run(graph.script("COST e.this[1] MAXIMUM 300"))
    sums = [sum(costs[after - before] for before, after in pairwise([0, *path])) for path in paths]
    assert len(sums) == 300
    assert sums == sorted(sums)
    assert sums[-1] - sums[0] < 1e-9
    # Among equal totals right comes before down, which is source order.
    assert all(a < b for a, b in pairwise(zip(sums, paths, strict=True)))


def test_each_row_is_expanded_once() -> None:
    side = 20
    nodes = range(side * side)
    edges = [[(node + step, 1) for step in (-side, side, -1, 1) if node + step in nodes] for node in nodes]
    graph = Problem(edges, {side + 3}, set(), None)
    stats = graph.host().result(graph.script("MAXIMUM 10")).stats
    # Every node is a row, the start's own one too; the start is expanded besides.
    assert stats.calls["near"] == stats.expanded + 1 == side * side + 1


def test_the_graph_ends_at_the_bound() -> None:
    edges: list[list[Edge]] = [[(node + 1, 1)] for node in range(50)] + [[]]
    graph = Problem(edges, {3, 40}, set(), 5)
    result = graph.host().result(graph.script())
    assert result.value == [[1, 2, 3]]
    assert result.stats.generated == 5


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


# --- how much work it is -----------------------------------------------------------------------------------------


def most_steps(graph: RowGraph, paths: int) -> int:
    """For each path, and for the end, what patience allows and a search of the whole graph for each of its nodes."""
    size = len(graph.rows) + len(graph.targets)
    return (paths + 1) * (PATIENCE_FACTOR + len(graph.rows)) * size


def weigh(graph: RowGraph, order: str) -> None:
    dice = random.Random(1)
    graph.weights = [dice.choice({"cost": [0.1, 0.2, 0.7], "chance": [0.1, 0.5, 0.9]}[order]) for _ in graph.weights]


def check_order(graph: RowGraph, order: str, found: list[tuple[int, ...]]) -> None:
    if order == "length":
        assert found == sorted(found, key=lambda path: (len(path), path))
    else:
        combine, start = (add, 0) if order == "cost" else (mul, -1)
        ranked = [(reduce(combine, (graph.weights[edge] for edge in path), start), path) for path in found]
        assert ranked == sorted(ranked)
    for path in found:
        nodes = [graph.targets[edge] for edge in path]
        assert len(set(nodes)) == len(nodes)
        assert graph.goals[nodes[-1]]


@pytest.mark.parametrize("order", WORK)
@pytest.mark.parametrize("name", [*MISLEADING, *HARMLESS])
def test_steps_are_bounded(name: str, order: str) -> None:
    graph = (MISLEADING | HARMLESS)[name]()
    if order != "length":
        weigh(graph, order)
    work = WORK[order](graph)
    found = [tuple(path) for path in islice(work.find_paths(), 200)]
    assert work.steps <= most_steps(graph, len(found))
    assert len(found) == len(set(found)) > 0
    check_order(graph, order, found)


def test_ways_that_are_cheap_but_too_long() -> None:
    # Every place can be passed at no cost in two steps or dearly in one. Only `limit` steps are left for 40 places.
    places, limit = 40, 44
    edges: list[list[int]] = []
    for place in range(places):
        edges += [[2 * place + 2, 2 * place + 1], [2 * place + 2]]
    graph = graph_of([*edges, []], {2 * places}, limit)
    graph.weights = [5 if node % 2 == 0 and target == node + 2 else 0 for node in range(2 * places)
                     for target in edges[node]]  # fmt: skip
    search = PathsByWeight(graph, graph.weights, False)
    found = [tuple(path) for path in islice(search.find_paths(), 100)]
    # Four of the places are passed at no cost.
    assert {sum(graph.weights[edge] for edge in path) for path in found} == {36 * 5}
    assert len(found) == 100
    assert search.steps <= most_steps(graph, 100)


# --- only what is asked for -----------------------------------------------------------------------------------------


def test_steps_to_the_first_paths_do_not_depend_on_how_many_there_are() -> None:
    side = 40
    edges = [[1], *([target + 1 for target, _ in outward] for outward in grid(side, {1: 1, side: 1}))]
    walk = PathsByLength(graph_of(edges, {side * side}))
    steps = [walk.steps for _ in islice(walk.find_paths(), 50)]
    # The first path is walked straight; each of the others leaves the one before it somewhere.
    assert steps[0] == 0
    assert all(after - before <= 4 * side for before, after in pairwise(steps))

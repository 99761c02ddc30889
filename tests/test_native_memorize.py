"""The paths of MEMORIZE against brute force, and how many steps they take where most ways lead nowhere."""

from __future__ import annotations

import random
from dataclasses import dataclass
from functools import reduce
from itertools import islice, pairwise
from operator import add, mul
from typing import Any

import pytest
from native_host import FakeHost
from programs.drawn import amount

import ss2sql
from ss2sql.runtime.search import paths_by_length as lengths_module
from ss2sql.runtime.search.paths_by_length import PATIENCE_FACTOR, PathsByLength
from ss2sql.runtime.search.paths_by_weight import PathsByWeight
from ss2sql.runtime.search.search_run import RowGraph

COUNT = amount(1 / 5)
Edge = tuple[int, Any]  # the node that it leads to, and its weight
Path = tuple[list[int], list[int], list[Any]]  # the positions of its edges, its nodes, its weights

# --- against brute force ------------------------------------------------------------------------------------------


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

    def paths(self) -> list[Path]:
        """All paths in source order."""
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


def by_length(graph: Problem) -> list[list[int]]:
    """The paths by their length, ties in source order."""
    return [nodes for _, nodes, _ in sorted(graph.paths(), key=lambda path: (len(path[0]), path[0]))]


def by_total(graph: Problem, likeliest: bool) -> list[list[int]]:
    """The paths by their total, ties in source order, a path before its continuations."""

    def rank(path: Path) -> Any:
        return (-reduce(mul, path[2], 1) if likeliest else reduce(add, path[2], 0), path[0])

    return [path[1] for path in sorted(graph.paths(), key=rank)]


COSTS: list[list[Any]] = [
    *([1], [0], [0, 1, 2], [3, 5, 7], [0.5, 1, 1.25]),
    *([0.1, 0.2, 0.3, 0.7], [0.1, 1.1, 0], [2**60, 1]),
]
CHANCES: list[list[Any]] = [[0.9], [1], [0.5, 1, 0.25], [0.1, 0.3, 0.9], [1 / 3, 2 / 3, 1], [1e-200, 0.5]]


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


def test_the_graph_ends_at_the_bound() -> None:
    edges: list[list[Edge]] = [[(node + 1, 1)] for node in range(50)] + [[]]
    graph = Problem(edges, {3, 40}, set(), 5)
    result = graph.host().result(graph.script())
    assert result.value == [[1, 2, 3]]
    assert result.stats.generated == 5


# --- graphs in which most ways lead nowhere ---------------------------------------------------------------------


def graph_of(edges: list[list[int]], goals: set[int], bound: int | None = None) -> RowGraph:
    """The graph of these edges, all of weight 1; node 0 is the start, which has no row."""
    graph = RowGraph(lambda: None, bound)
    graph.rows += [(node,) for node in range(1, len(edges))]
    graph.goals += [node in goals for node in range(1, len(edges))]
    graph.targets = [target for targets in edges for target in targets]
    graph.weights, graph.lasts = [1] * len(graph.targets), [None] * len(graph.targets)
    graph.edges, first = [], 0
    for targets in edges:
        graph.edges.append(range(first, first + len(targets)))
        first += len(targets)
    return graph


def both_ways(pairs: list[tuple[int, int]]) -> list[list[int]]:
    """The edges of pairs of nodes, which can be taken both ways; nothing leads back to the start."""
    edges: list[list[int]] = [[] for _ in range(1 + max(map(max, pairs)))]
    for one, other in pairs:
        edges[one].append(other)
        if one:
            edges[other].append(one)
    return edges


def lollipop(size: int, stick: int = 10) -> RowGraph:
    """A stick, and at its middle a room in which every node leads to every other one. The room comes first."""
    room = range(stick + 1, stick + 1 + size)
    pairs = [(one, other) for one in room for other in room if one < other]
    pairs += [(stick // 2, node) for node in room]
    pairs += [(node, node + 1) for node in range(stick)]
    return graph_of(both_ways(pairs), {stick})


def doubling(places: int) -> RowGraph:
    """From place to place a step or a detour, each detour twice as long as the one before: every length occurs once."""
    edges: list[list[int]] = [[]]
    place = 0
    for number in range(places):
        following, detour = len(edges), range(len(edges) + 1, len(edges) + 1 + 2**number)
        edges += [[] for _ in range(1 + len(detour))]
        edges[place] += [following, detour[0]]
        for node in detour:
            edges[node].append(following if node == detour[-1] else node + 1)
        place = following
    return graph_of(edges, {place})


MISLEADING = {
    "lollipop": lambda: lollipop(20),
    "long lollipop": lambda: lollipop(16, 120),
    "doubling": lambda: doubling(9),
}


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
@pytest.mark.parametrize("name", MISLEADING)
def test_steps_are_bounded(name: str, order: str) -> None:
    graph = MISLEADING[name]()
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

"""The paths of MEMORIZE against networkx and brute force, and how many steps they take where most ways lead nowhere."""

from __future__ import annotations

import random
from collections.abc import Iterator, Sequence
from functools import reduce
from itertools import islice, pairwise
from operator import add, mul
from typing import Any

import networkx as nx
import pytest
from path_problems import CHANCES, COSTS, HARMLESS, MISLEADING, Problem, by_length, by_total, graph_of, problem

import ss2sql
from ss2sql.runtime.memorize import by_length as lengths_module
from ss2sql.runtime.memorize import by_weight as weights_module
from ss2sql.runtime.memorize import careful as careful_module
from ss2sql.runtime.memorize import growing
from ss2sql.runtime.memorize.by_length import PATIENCE, ByLength
from ss2sql.runtime.memorize.by_weight import ByWeight
from ss2sql.runtime.memorize.graph import Graph

# --- against networkx ---------------------------------------------------------------------------------------------

SCRIPT = """SELECT e.this[0] FROM e = near(node) WHERE is_goal(e.this[0])
    START WITH node = 0 CONNECT BY MEMORIZE (most) {} node = e.this[0]
    STOP WITH is_stop(e.this[0]) AS list"""
ROUNDS = range(10)


def random_graph(dice: random.Random, largest: int, repeated: bool) -> Problem:
    """Nothing leads to the start, which networkx would take for a node of the path."""
    number = dice.randint(2, largest)
    edges = []
    for _ in range(number):
        targets = [dice.randrange(1, number) for _ in range(dice.randint(0, 4))]
        edges.append([(target, dice.randint(0, 9)) for target in (targets if repeated else dict.fromkeys(targets))])
    goals = {node for node in range(1, number) if dice.random() < 0.3}
    stops = {node for node in range(1, number) if dice.random() < 0.2}
    return Problem(edges, goals, stops, dice.randint(1, number))


def networkx_of(graph: Problem) -> Any:
    """The graph without the steps that leave no trace, and without those behind a stop. Keys are positions."""
    made = nx.MultiDiGraph()
    made.add_nodes_from(range(len(graph.edges)))
    for node, edges in enumerate(graph.edges):
        for position, (target, weight) in enumerate(edges):
            if node not in graph.stops and (target in graph.goals or target not in graph.stops):
                made.add_edge(node, target, position, weight=weight)
    return made


class Runs:
    """One script, run for one graph after the other by the engine that `auto` takes and by the native one."""

    def __init__(self, options: str = "") -> None:
        self.graph = Problem([], set(), set(), None)
        session = self.session = ss2sql.connect()
        session.function("near", lambda node: [list(edge) for edge in self.graph.edges[node]], volatility="stable")
        session.function("is_goal", lambda node: node in self.graph.goals, volatility="stable")
        session.function("is_stop", lambda node: node in self.graph.stops, volatility="stable")
        session.set("most", 1)
        self.queries = [session.compile(SCRIPT.format(options), engine=engine) for engine in ("auto", "native")]

    def both(self, graph: Problem) -> list[Any]:
        self.graph = graph
        self.session.set("most", graph.bound)
        found: list[list[Any]] = [query.run().value for query in self.queries]
        assert found[0] == found[1]
        return found[0]


@pytest.mark.parametrize("number", ROUNDS)
def test_the_paths_that_networkx_finds(number: int) -> None:
    dice, runs = random.Random(number), Runs()
    for _ in range(100):
        graph = random_graph(dice, 7, repeated=True)
        found = nx.all_simple_edge_paths(networkx_of(graph), 0, graph.goals, cutoff=graph.bound)
        ranked = sorted((len(path), [position for _, _, position in path], path) for path in found)
        assert runs.both(graph) == [[target for _, target, _ in path] for _, _, path in ranked]


@pytest.mark.parametrize("number", ROUNDS)
def test_the_cheapest_paths_that_networkx_finds(number: int) -> None:
    dice, runs = random.Random(number), Runs("COST e.this[1] MAXIMUM 20")
    compared = 0
    while compared < 50:
        graph = random_graph(dice, 12, repeated=False)
        goal = dice.randrange(1, len(graph.edges))
        graph = Problem(graph.edges, {goal}, {goal}, len(graph.edges))
        plain = nx.DiGraph(networkx_of(graph))
        if not nx.has_path(plain, 0, goal):
            continue
        compared += 1
        expected = [nx.path_weight(plain, path, "weight") for path in simple_paths(plain, goal)]
        assert [nx.path_weight(plain, [0, *path], "weight") for path in runs.both(graph)] == expected


def simple_paths(graph: Any, goal: int) -> Iterator[list[int]]:
    return islice(nx.shortest_simple_paths(graph, 0, goal, "weight"), 20)


# --- whenever care begins, order and paths are the same ---------------------------------------------------------------


def numbered(graph: Problem) -> Graph:
    """The graph with its nodes as they are; a row of the start, which steps may lead to, is a node of its own."""
    start, made = len(graph.edges), Graph(lambda: None, graph.bound)
    for node in [*range(1, start), 0]:
        made.add_node((node,), node in graph.goals)
    for node in [0, *range(1, start), start]:
        if node % start in graph.stops and node:
            continue
        for target, weight in graph.edges[node % start]:
            if target in graph.goals or target not in graph.stops:
                made.add_edge(node, target or start, weight, None)
    return made


def rows(graph: Graph, paths: Iterator[Sequence[int]]) -> list[list[int]]:
    return [[graph.rows[graph.targets[edge]][0] for edge in path] for path in paths]


@pytest.fixture(params=[0, 0.05, 0.3, 1])
def impatient(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Quick walks give up here and there."""
    monkeypatch.setattr(lengths_module, "PATIENCE", request.param)
    monkeypatch.setattr(weights_module, "PATIENCE", request.param)


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize("kept", [0, 3, 1000])
def test_careful_walks_by_length(kept: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(careful_module, "KEPT", kept)
    careful = 0
    for seed in range(300):
        graph = problem(seed, [1], 7)
        made = numbered(graph)
        walk = ByLength(made)
        assert rows(made, walk.paths()) == by_length(graph)
        careful += walk.careful is not None
        assert walk.careful is None or walk.careful.kept == 0
    assert careful > 5


@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize("likeliest", [False, True])
def test_careful_searches_by_weight(likeliest: bool) -> None:
    careful = 0
    for seed in range(400):
        choices = CHANCES if likeliest else COSTS
        graph = problem(seed, choices[seed % len(choices)], 7)
        made = numbered(graph)
        search = ByWeight(made, likeliest)
        assert rows(made, search.paths()) == by_total(graph, likeliest)
        careful += search.lost
    assert careful > 5


# --- how much work it is -----------------------------------------------------------------------------------------

WORK: dict[str, Any] = {
    "length": ByLength,
    "cost": lambda graph: ByWeight(graph, False),
    "chance": lambda graph: ByWeight(graph, True),
}


def most_steps(graph: Graph, paths: int) -> int:
    """For each path, and for the end, what patience allows and a search of the whole graph for each of its nodes."""
    size = len(graph.rows) + len(graph.targets)
    return (paths + 1) * (PATIENCE + len(graph.rows)) * size


def weigh(graph: Graph, order: str) -> None:
    dice = random.Random(1)
    graph.weights = [dice.choice({"cost": [0.1, 0.2, 0.7], "chance": [0.1, 0.5, 0.9]}[order]) for _ in graph.weights]


def check_order(graph: Graph, order: str, found: list[tuple[int, ...]]) -> None:
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
    found = [tuple(path) for path in islice(work.paths(), 200)]
    assert work.steps <= most_steps(graph, len(found))
    assert len(found) == len(set(found)) > 0
    check_order(graph, order, found)


@pytest.mark.parametrize("name", MISLEADING)
def test_a_quick_walk_loses_its_way(name: str) -> None:
    walk = ByLength(MISLEADING[name]())
    # That makes these the bad cases; in the last two a walk finds paths, but begins anew for each length.
    for _ in islice(walk.paths(), 1000):
        pass
    assert walk.careful is not None


@pytest.mark.parametrize("name", HARMLESS)
def test_a_quick_walk_finds_its_way(name: str) -> None:
    walk = ByLength(HARMLESS[name]())
    assert sum(1 for _ in islice(walk.paths(), 1000)) == 1000
    assert walk.careful is None


def test_ways_that_are_cheap_but_too_long() -> None:
    # Every place can be passed at no cost in two steps or dearly in one. Only `limit` steps are left for 40 places.
    places, limit = 40, 44
    edges: list[list[int]] = []
    for place in range(places):
        edges += [[2 * place + 2, 2 * place + 1], [2 * place + 2]]
    graph = graph_of([*edges, []], {2 * places}, limit)
    graph.weights = [5 if node % 2 == 0 and target == node + 2 else 0 for node in range(2 * places)
                     for target in edges[node]]  # fmt: skip
    search = ByWeight(graph, False)
    found = [tuple(path) for path in islice(search.paths(), 100)]
    # Four of the places are passed at no cost.
    assert {sum(graph.weights[edge] for edge in path) for path in found} == {36 * 5}
    assert len(found) == 100
    assert search.lost
    assert search.steps <= most_steps(graph, 100)


# --- only what is asked for -----------------------------------------------------------------------------------------


def test_maximum_takes_no_step_beyond_the_last_path(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def counted(graph: Graph, marks: Sequence[Any] | None) -> Iterator[list[Any]]:
        for number, path in enumerate(ByLength(graph, marks).paths(), 1):
            asked.append(number)
            yield path

    monkeypatch.setattr(growing, "paths_by_length", counted)
    with ss2sql.connect() as ss:
        paths = ss.eval("SELECT this FROM range(9) START WITH n = 0 CONNECT BY MEMORIZE MAXIMUM 7 n = this AS list")
    assert paths == [[0], [1], [2], [3], [4], [5], [6]]
    assert asked == [1, 2, 3, 4, 5, 6, 7]


def test_steps_to_the_first_paths_do_not_depend_on_how_many_there_are() -> None:
    side = 40
    edges: list[list[int]] = [[]] + [
        [node + step for step in (1, side) if ((node - 1) % side if step == 1 else (node - 1) // side) < side - 1]
        for node in range(1, side * side + 1)
    ]
    edges[0] = [1]
    walk = ByLength(graph_of(edges, {side * side}))
    steps = []
    for _ in islice(walk.paths(), 50):
        steps.append(walk.steps)
    # The first path is walked straight; each of the others leaves the one before it somewhere.
    assert steps[0] == 0
    assert all(after - before <= 4 * side for before, after in pairwise(steps))


class EndedError(Exception):
    pass


@pytest.mark.parametrize("order", WORK)
@pytest.mark.parametrize("name", MISLEADING)
def test_a_run_that_has_to_end_ends(name: str, order: str) -> None:
    graph = MISLEADING[name]()
    if order != "length":
        weigh(graph, order)
    work = WORK[order](graph)

    def check() -> None:
        raise EndedError

    graph.check = check
    with pytest.raises(EndedError):
        list(islice(work.paths(), 5000))

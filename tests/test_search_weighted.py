"""COST and HEURISTIC against networkx and a textbook search, on random graphs."""

from __future__ import annotations

import heapq
import itertools
import random
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import networkx
import pytest
from programs.drawn import amount
from sessions import both

import ss2sql

Edge = tuple[int, int, Any]
Estimate = Callable[[int], Any]

# Each reads the edges of a node in another way: a query over them, a condition on their product, a function's list.
FORMS = {
    "query": """SELECT dst FROM (SELECT * FROM {edges} WHERE src == node) WHERE dst == goal
        START WITH node = 0 CONNECT BY {options} node = dst;""",
    "stop": """SELECT dst FROM {edges} WHERE src == node AND dst == goal
        START WITH node = 0 CONNECT BY {options} node = dst STOP WITH src != node;""",
    "no trace": """SELECT dst FROM {edges} WHERE dst == goal AND node == src AND True
        START WITH node = 0 CONNECT BY {options} node = dst STOP WITH NOT src == node;""",
}
SOURCES = ("listed", "stored", "indexed")
COUNT = 2 * amount(1 / 4)
TWICE = (282, 392, 404)  # graphs of which a node is expanded twice


@dataclass
class Graph:
    """A random graph whose node 0 is the start."""

    size: int
    edges: list[Edge]
    goal: int
    random: random.Random

    def distances(self) -> dict[int, Any]:
        """What the cheapest way to the goal costs from each node that has one."""
        return dict(networkx.single_source_dijkstra_path_length(self.network().reverse(), self.goal))

    def network(self) -> networkx.DiGraph:
        network = networkx.DiGraph()
        network.add_nodes_from(range(self.size))
        for src, dst, weight in self.edges:
            known = network.get_edge_data(src, dst)
            if known is None or weight < known["weight"]:
                network.add_edge(src, dst, weight=weight)
        return network


def graph(seed: int) -> Graph:
    """Up to 12 nodes; weights are whole numbers, quarters (whose sums are exact), both, or any, zero among them."""
    rng = random.Random(seed)
    size, any_floats = rng.randint(2, 12), [0, *(rng.random() for _ in range(8))]
    weights: Sequence[Any] = [range(6), [n / 4 for n in range(6)], [0, 1, 2, 0.0, 0.25, 1.0, 3.5], any_floats][seed % 4]
    count = rng.randint(1, 3 * size)
    edges = [(rng.randrange(size), rng.randrange(size), rng.choice(weights)) for _ in range(count)]
    return Graph(size, edges, rng.randrange(1, size), rng)


def textbook(edges: Sequence[Edge], goal: int, estimate: Estimate) -> tuple[list[int] | None, int]:
    """The first path that A* takes from the queue and ends in the goal, and how many nodes it expanded before.

    Of equals the one with the smaller estimate comes first, then the first generated. The start is no row, so it may be
    reached again.
    """
    numbers = itertools.count()
    queue: list[tuple[Any, Any, int, Any, list[int]]] = [(0, 0, next(numbers), 0, [])]
    best: dict[int, Any] = {}
    expanded = -1  # the start is no step
    while queue:
        _, _, _, cost, path = heapq.heappop(queue)
        if path and best[path[-1]] < cost:
            continue
        if path and path[-1] == goal:
            return path, expanded
        expanded += 1
        node = path[-1] if path else 0
        for src, dst, weight in edges:
            if src == node and (dst not in best or cost + weight < best[dst]):
                best[dst] = total = cost + weight
                heapq.heappush(queue, (total + estimate(dst), estimate(dst), next(numbers), total, [*path, dst]))
    return None, expanded


class Searches:
    """The same searches over the edges as a list of dicts and as tables, compiled once and run on many graphs."""

    def __init__(self) -> None:
        self.session = ss2sql.connect()
        connection = self.session.host.connection
        connection.execute("CREATE TABLE stored(src, dst, w); CREATE TABLE indexed(src, dst, w)")
        connection.execute("CREATE INDEX by_src ON indexed(src)")
        self.queries: dict[str, Any] = {}
        self.bounds: list[Any] = []
        # A function, for a variable whose values get other types makes a query be compiled again.
        self.session.function("bound", lambda node: self.bounds[node], volatility="stable")

    def load(self, given: Graph) -> None:
        connection = self.session.host.connection
        self.session.set("listed", [dict(zip(("src", "dst", "w"), edge, strict=True)) for edge in given.edges])
        for name in ("stored", "indexed"):
            connection.execute(f"DELETE FROM {name}")
            connection.executemany(f"INSERT INTO {name} VALUES (?, ?, ?)", given.edges)
        self.session.set("goal", given.goal)

    def run(self, form: str, source: str, options: str, engine: Any) -> ss2sql.Result:
        text = FORMS[form].format(edges=source, options=options)
        if text not in self.queries:
            self.queries[text] = self.session.compile(text)
        result = self.queries[text].run(engine=engine)
        assert result.engine == engine
        return result


def path_of(result: ss2sql.Result) -> list[int] | None:
    """The nodes of the one path that there may be."""
    paths = result.paths
    assert len(paths) <= 1
    return [row[0] for row in paths[0]] if paths else None


def estimates(given: Graph) -> dict[str, list[Any]]:
    """Lower bounds for each node; of one without a way to the goal every number is one."""
    exact = given.distances()
    far = [exact.get(node, given.random.choice([0, 1000])) for node in range(given.size)]
    rng = given.random
    return {
        "zero": [0] * given.size,
        "exact": far,
        "half": [distance / 2 for distance in far],
        "inconsistent": [distance * rng.choice([0, 0.25, rng.random(), 1]) for distance in far],
    }


@pytest.mark.drawn
@both
def test_the_cheapest_path_is_that_of_dijkstra_whatever_the_heuristic(engine: Any) -> None:
    searches, found, again = Searches(), 0, 0
    for seed in (*TWICE, *range(COUNT)):
        given = graph(seed)
        searches.load(given)
        costs, kinds = given.distances(), estimates(given)
        form, source = list(FORMS)[seed % 3], SOURCES[seed // 3 % 3]
        for kind in ("", "inconsistent", ("zero", "exact", "half")[seed % 3]):
            searches.bounds = kinds[kind or "zero"]
            heuristic = "HEURISTIC bound(dst)" if kind else ""
            result = searches.run(form, source, f"COST w {heuristic} UNIQUE MAXIMUM 1", engine)
            path = path_of(result)
            assert (path is None) == (0 not in costs), (seed, kind)
            if path is not None and seed % 4 != 3:  # floats would have to be added in the same order
                found += 1
                edges = given.network().edges
                assert path[-1] == given.goal
                assert sum(edges[pair]["weight"] for pair in itertools.pairwise([0, *path])) == costs[0], (seed, kind)
            expected = textbook(given.edges, given.goal, searches.bounds.__getitem__)
            assert (path, result.stats.expanded) == expected, (seed, kind)
            assert result.status == ("complete" if path is None else "maximum")
            again += result.stats.expanded > len(networkx.descendants(given.network(), 0)) + 1
    assert found > COUNT * 3 / 4
    assert again >= len(TWICE)

"""Random graphs with repeated edges, and all their paths without a repeated node, for the tests of MEMORIZE."""

from __future__ import annotations

import random
from dataclasses import dataclass
from functools import reduce
from itertools import pairwise
from operator import add, mul
from typing import Any

from native_host import FakeHost

from ss2sql.runtime.search.search_run import RowGraph

Edge = tuple[int, Any]  # the node that it leads to, and its weight
Path = tuple[list[int], list[int], list[Any]]  # the positions of its edges, its nodes, its weights


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


def floor_of(width: int, height: int, first: int) -> list[tuple[int, int]]:
    """The pairs of neighbours on a floor of cells, which are numbered row by row."""
    along = [(cell, cell + 1) for cell in range(first, first + width * height) if (cell - first + 1) % width]
    return along + [(cell, cell + width) for cell in range(first, first + width * (height - 1))]


def lollipop(size: int, stick: int = 10) -> RowGraph:
    """A stick, and at its middle a room in which every node leads to every other one. The room comes first."""
    room = range(stick + 1, stick + 1 + size)
    pairs = [(one, other) for one in room for other in room if one < other]
    pairs += [(stick // 2, node) for node in room]
    pairs += [(node, node + 1) for node in range(stick)]
    return graph_of(both_ways(pairs), {stick})


def side_room(side: int, detour: int) -> RowGraph:
    """A short way of three steps, a floor beside it, and a detour to the goal."""
    first = 4 + side * side
    chain = [1, *range(first, first + detour), 3]
    pairs = [(2, 4), *floor_of(side, side, 4), (0, 1), (1, 2), (2, 3), *pairwise(chain)]
    return graph_of(both_ways(pairs), {3})


def trap(side: int, detour: int) -> RowGraph:
    """A floor whose far corner has a door back to where one came from, and a long corridor to the goal."""
    first = 3 + side * side
    edges = both_ways(floor_of(side, side, 3)) + [[] for _ in range(detour)]
    edges[0], edges[1] = [1], [3, 2]
    edges[first - 1].append(1)
    for node, after in zip([first - 1, *range(first, first + detour)], [*range(first, first + detour), 2], strict=True):
        edges[node].append(after)
    return graph_of(edges, {2})


def ladder(rungs: int, first: int = 1) -> RowGraph:
    """Two corridors with a rung from each place to the other; the goal is at one end."""
    pairs = [(0, first)]
    for left in range(1, 2 * rungs, 2):
        pairs.append((left, left + 1))
        if left + 2 < 2 * rungs:
            pairs += [(left, left + 2), (left + 1, left + 3)]
    return graph_of(both_ways(pairs), {2 * rungs - 1})


def corridors(number: int, shortest: int, rungs: bool) -> RowGraph:
    """Corridors side by side, each a step longer than the one before, with or without ways across."""
    pairs: list[tuple[int, int]] = []
    nodes, rows = 2, []
    for extra in range(number):
        row = [0, *range(nodes, nodes + shortest + extra), 1]
        nodes += shortest + extra
        pairs += pairwise(row)
        rows.append(row)
    if rungs:
        for row, beside in pairwise(rows):
            pairs += list(zip(row[1:-1:3], beside[1:-1:3], strict=False))
    return graph_of(both_ways(pairs), {1})


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


def crowd(side: int) -> RowGraph:
    """A floor on which the goal is beside the start, and all paths are wanted."""
    return graph_of(both_ways([(0, 1), *floor_of(side, side, 1)]), {2})


MISLEADING = {
    "lollipop": lambda: lollipop(20), "long lollipop": lambda: lollipop(16, 120),
    "side room": lambda: side_room(8, 200), "trap": lambda: trap(6, 60), "crowd": lambda: crowd(8),
    "corridors": lambda: corridors(20, 30, rungs=False), "doubling": lambda: doubling(9),
}  # fmt: skip
HARMLESS = {
    "ladder": lambda: ladder(40),
    "ladder from its middle": lambda: ladder(40, 41),
    "corridors with rungs": lambda: corridors(8, 30, rungs=True),
}

"""The least total that a path can still get, known from the goals backwards.

A Dijkstra search from the goals gives for each node the least cost, or greatest probability, of the way on.
Where no sum or product of weights is rounded that is the whole answer: it is combined with the total so far.

Elsewhere the parts of a total depend on the order of their making, by a rounding. A bound that is wrong by as
much would bring paths of equal total out of their order, and one that is lowered by as much would make the
queue find all paths of almost the same total before the first comes out. So the total of the best way on is
made exactly as the path would make it, by an A* search forwards from the total so far; what is lowered is
only its estimate. Rounding never swaps two numbers, so of several ways to a node the best total stays best.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from heapq import heappop, heappush
from math import frexp, inf
from operator import add, mul
from typing import Any

from ss2sql.runtime.memorize.by_length import FAR
from ss2sql.runtime.memorize.graph import Graph


class Bounds:
    """Bounds of totals: costs are added up from 0, probabilities multiplied from -1, so less is better."""

    def __init__(self, graph: Graph, likeliest: bool) -> None:
        self.graph = graph
        self.start: Any = -1 if likeliest else 0
        self.combine: Callable[[Any, Any], Any] = mul if likeliest else add
        self._best = _ways_on(graph, likeliest)
        self._exact = (_exact_products if likeliest else _exact_sums)(graph.weights, graph.longest)
        # Each operation is off by a part in 2^53; a bound and a total take at most so many operations each.
        margin = 4 * (graph.longest + 2) * 2.0**-53
        self._slack = 1 + margin if likeliest else 1 - margin
        self._known: dict[tuple[int, Any], Any] = {}

    def onward(self, node: int, total: Any) -> Any:
        """The least total of a path that is at `node` with this total and takes at least one more step to a goal.

        The caller guarantees that there is a way on. Steps to nodes that the path has visited are not excluded.
        """
        if self._exact:
            return self.combine(total, self._best[node])
        key = (node, total)
        if key not in self._known:
            self._known[key] = self._searched(node, total)
        return self._known[key]

    def _searched(self, node: int, total: Any) -> Any:
        graph, combine, best = self.graph, self.combine, self._best
        reached: dict[int, Any] = {}
        queue: list[tuple[Any, bool, int, Any]] = [(total, True, node, total)]
        while True:
            _, goes_on, node, total = heappop(queue)
            if not goes_on:
                return total
            for edge in graph.edges[node]:
                target = graph.targets[edge]
                further = combine(total, graph.weights[edge])
                if target in reached and reached[target] <= further:
                    continue
                reached[target] = further
                if graph.goals[target]:
                    heappush(queue, (further, False, target, further))
                if best[target] is not None:
                    estimate = combine(further, best[target]) * self._slack
                    heappush(queue, (estimate, True, target, further))


def _exact_sums(weights: Iterable[Any], longest: int) -> bool:
    """Whether no sum of so many weights is rounded."""
    weights = set(weights)
    if all(isinstance(weight, int) for weight in weights):
        return True
    scale = max(weight.as_integer_ratio()[1] for weight in weights)
    return all(weight * scale * longest < 2**53 for weight in weights)


def _exact_products(weights: Iterable[Any], longest: int) -> bool:
    """Whether no product of so many weights is rounded: they are powers of two, and not too small."""
    parts = [frexp(weight) for weight in set(weights)]
    return all(fraction == 0.5 and exponent * longest > -1000 for fraction, exponent in parts)


def _ways_on(graph: Graph, likeliest: bool) -> list[Any]:
    """For each node the least cost, or greatest probability, of at least one step to a goal; None: there is no way."""
    combine: Callable[[Any, Any], Any] = mul if likeliest else add
    sign = -1 if likeliest else 1  # less is better in the queue
    into: list[list[tuple[int, Any]]] = [[] for _ in graph.rows]
    for node, edges in enumerate(graph.edges):
        for edge in edges:
            into[graph.targets[edge]].append((node, graph.weights[edge]))
    ranks: list[Any] = [inf] * len(graph.rows)
    start: Any = sign if likeliest else 0
    queue: list[tuple[Any, int]] = [(start, node) for node, goal in enumerate(graph.goals) if goal]
    settled = bytearray(len(graph.rows))
    while queue:
        rank, node = heappop(queue)
        if settled[node]:
            continue
        settled[node] = 1
        for source, weight in into[node]:
            further = combine(rank, weight)
            if further < ranks[source]:
                ranks[source] = further
                heappush(queue, (further, source))
    return [None if rank == inf else sign * rank for rank in ranks]


def hops_to_goals(graph: Graph) -> list[int]:
    """For each node the number of steps, at least one, to the nearest goal; FAR where there is no way."""
    hops = [FAR] * len(graph.rows)
    sources = graph.into()
    level = [node for node, goal in enumerate(graph.goals) if goal]
    steps = 0
    while level:
        steps += 1
        found = []
        for node in level:
            for source in sources[node]:
                if hops[source] == FAR:
                    hops[source] = steps
                    found.append(source)
        level = found
    return hops

"""The paths of a graph without a repeated node by their total, ties in source order, a path before its continuations.

Best-first over paths: the queue holds results at their totals and paths that go on at the least total that
they can still get, which a Dijkstra search backwards from the goals knows. Totals are costs added up from 0,
or probabilities multiplied from -1, so less is better.

Where sums and products are not exact, a bound may lie above a total by rounding; it is lowered by more than
that. Then all paths of almost the same total are found before the first of them comes out. This cannot be
helped where totals differ by rounding only, but for the common case of equal weights the order by length,
which is the same, is better.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from heapq import heappop, heappush
from itertools import count
from math import frexp, inf
from operator import add, mul
from typing import Any

from ss2sql.runtime.native.searches.by_length import FAR, paths_by_length
from ss2sql.runtime.native.searches.graph import Graph
from ss2sql.runtime.native.searches.step import Place, Trail

CHECK_EVERY = 255


def paths_by_weight(graph: Graph, likeliest: bool) -> Iterator[Sequence[int]]:
    """The paths from the start to a goal as lists of edges, the cheapest or likeliest first."""
    return paths_by_length(graph) if _by_length(graph, likeliest) else _paths(graph, likeliest)


def _by_length(graph: Graph, likeliest: bool) -> bool:
    """Whether all weights are the same and each step makes a path worse, so that its length decides."""
    weights = set(graph.weights)
    if len(weights) != 1:
        return False
    weight = weights.pop()
    # Beyond 1e-300 products lose precision, and different powers may become one number.
    return weight < 1 and weight**graph.longest > 1e-300 if likeliest else bool(weight > 0)


def _paths(graph: Graph, likeliest: bool) -> Iterator[Sequence[int]]:
    total, combine = (-1, mul) if likeliest else (0, add)
    bounds, hops = _onward(graph, likeliest), _hops(graph)
    slack = _slack(graph, likeliest)
    trail, ticks = Trail(), count(1)
    # Bound, path as edges, whether the path goes on; then its total, its last node and place.
    queue: list[tuple[Any, tuple[int, ...], bool, Any, int, Place | None]] = []
    if hops[0] <= graph.longest:
        queue.append((combine(total, bounds[0]), (), True, total, 0, None))
    while queue:
        _, path, goes_on, total, node, place = heappop(queue)
        if not next(ticks) & CHECK_EVERY:
            graph.check()
        if not goes_on:
            yield path
            continue
        trail.move_to(place)
        depth = len(path) + 1
        for edge in graph.edges[node]:
            target = graph.targets[edge]
            if target in trail.keys:
                continue
            reached, longer = combine(total, graph.weights[edge]), (*path, edge)
            if graph.goals[target]:
                heappush(queue, (reached, longer, False, reached, target, None))
            if depth + hops[target] <= graph.longest:
                bound = combine(reached, bounds[target]) * slack
                heappush(queue, (bound, longer, True, reached, target, (place, (), target, depth)))


def _slack(graph: Graph, likeliest: bool) -> float:
    """What bounds are multiplied with, so that none lies above a total that it bounds."""
    if (_exact_products if likeliest else _exact_sums)(graph.weights, graph.longest):
        return 1
    # Each operation is off by a part in 2^53; a bound and a total take at most that many operations each.
    margin = 4 * (graph.longest + 2) * 2.0**-53
    return 1 + margin if likeliest else 1 - margin


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


def _onward(graph: Graph, likeliest: bool) -> list[Any]:
    """For each node the least cost, or greatest probability, of going on from it by at least one step to a goal."""
    into: list[list[tuple[int, Any]]] = [[] for _ in graph.rows]
    for node, edges in enumerate(graph.edges):
        for edge in edges:
            into[graph.targets[edge]].append((node, graph.weights[edge]))
    worst: Any = 0 if likeliest else inf
    combine: Callable[[Any, Any], Any] = mul if likeliest else add
    onward = [worst] * len(graph.rows)
    # Probabilities are negative in the queue, so that the greatest comes first.
    sign = -1 if likeliest else 1
    start: Any = 1 if likeliest else 0
    queue: list[tuple[Any, int]] = [(sign * start, node) for node, goal in enumerate(graph.goals) if goal]
    settled = bytearray(len(graph.rows))
    while queue:
        rank, node = heappop(queue)
        if settled[node]:
            continue
        settled[node] = 1
        for source, weight in into[node]:
            value = combine(sign * rank, weight)
            if sign * value < sign * onward[source]:
                onward[source] = value
                heappush(queue, (sign * value, source))
    return onward


def _hops(graph: Graph) -> list[int]:
    """For each node the number of steps, at least one, to the nearest goal."""
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

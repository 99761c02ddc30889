"""The paths of a graph without a repeated node by their total, ties in source order, a path before its continuations.

Best-first over paths: the queue holds results at their totals and paths that go on at the least total that
they can still get. Totals are costs added up from 0, or probabilities multiplied from -1, so less is better.
Among equals source order decides, so a path whose bound is its total leads straight on, even where there are
millions of its kind. That is why bounds have to be exact, see bounds.py.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from heapq import heappop, heappush
from itertools import count
from typing import Any

from ss2sql.runtime.memorize.bounds import Bounds, hops_to_goals
from ss2sql.runtime.memorize.by_length import paths_by_length
from ss2sql.runtime.memorize.graph import Graph
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
    bounds, hops = Bounds(graph, likeliest), hops_to_goals(graph)
    combine = bounds.combine
    trail, ticks = Trail(), count(1)
    # Bound, path as edges, whether the path goes on; then its total, its last node and place.
    queue: list[tuple[Any, tuple[int, ...], bool, Any, int, Place | None]] = []
    if hops[0] <= graph.longest:
        queue.append((bounds.start, (), True, bounds.start, 0, None))
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
                bound = bounds.onward(target, reached)
                heappush(queue, (bound, longer, True, reached, target, (place, (), target, depth)))

"""The paths of a graph without a repeated node by their total, ties in source order, a path before its continuations.

Best-first over paths: the queue holds results at their totals and paths that go on at the least total that
they can still get. Totals are costs added up from 0, or probabilities multiplied from -1, so less is better.
Among equals source order decides, so a path whose bound is its total leads straight on, even where there are
millions of its kind. That is why bounds have to be exact, see path_bounds.py.

Bounds do not know that the path itself is in the way, nor how many steps are left. Where that has cost many steps
without a result, a search around the nodes of each path finds its exact bound before it goes on. From then on each
path that goes on leads to a result.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from heapq import heappop, heappush
from itertools import islice
from typing import Any, TypeAlias

from ss2sql.runtime.run.backpointers import KeyedBackpointer, PathKeys
from ss2sql.runtime.search.graph import RowGraph
from ss2sql.runtime.search.path_bounds import PathBounds, RemainingPath
from ss2sql.runtime.search.paths_by_length import PATIENCE_FACTOR, enumerate_by_length

# Bound, path as edges, whether the path goes on; then its total, its last node, its place, and the way that is known to
# give the bound. The first three differ always.
QueueEntry: TypeAlias = tuple[Any, tuple[int, ...], bool, Any, int, KeyedBackpointer | None, RemainingPath | None]


def enumerate_by_weight(graph: RowGraph, likeliest: bool) -> Iterator[Sequence[int]]:
    """The paths from the start to a goal as lists of edges, the cheapest or likeliest first."""
    return (
        enumerate_by_length(graph)
        if _is_ordered_by_length(graph, likeliest)
        else PathsByWeight(graph, likeliest).find_paths()
    )


def _is_ordered_by_length(graph: RowGraph, likeliest: bool) -> bool:
    """Whether all weights are equal and each step makes a path worse, so that shorter paths are better."""
    weights = set(graph.weights)
    if len(weights) != 1:
        return False
    weight = weights.pop()
    # Beyond 1e-300 products lose precision, and different powers may become one number.
    return weight < 1 and weight**graph.longest > 1e-300 if likeliest else bool(weight > 0)


class PathsByWeight:
    def __init__(self, graph: RowGraph, likeliest: bool) -> None:
        self.graph = graph
        self.bounds = PathBounds(graph, likeliest)
        self.patience = PATIENCE_FACTOR * (len(graph.rows) + len(graph.targets))
        self.lost = False

    @property
    def steps(self) -> int:
        """How many edges were looked at."""
        return self.bounds.steps

    def find_paths(self) -> Iterator[Sequence[int]]:
        """The paths from the start to a goal as lists of edges."""
        found_count = 0
        for path in self._iterate_paths(by_search=False):
            yield path
            found_count += 1
        if self.lost:
            # What waits in the queue are mostly ways that lead nowhere.
            yield from islice(self._iterate_paths(by_search=True), found_count, None)

    def _iterate_paths(self, by_search: bool) -> Iterator[Sequence[int]]:
        """The paths; without `by_search` it sets `lost` and ends after too many dead ends."""
        bounds, trail = self.bounds, PathKeys()
        trusted = bounds.steps + self.patience
        queue: list[QueueEntry] = []
        if bounds._edge_distances[0] <= self.graph.longest:
            queue.append((bounds.start, (), True, bounds.start, 0, None, None))
        while queue:
            entry = heappop(queue)
            _, path, goes_on, total, node, place, remaining_path = entry
            if not goes_on:
                trusted = bounds.steps + self.patience
                yield path
                continue
            trail.move_to(place)
            if by_search and remaining_path is None:
                known = bounds.bound_around(node, total, len(path), trail.keys)
                if known is not None:
                    heappush(queue, (known[0], path, True, total, node, place, known[1]))
                continue
            self._extend_path(queue, trail, entry)
            if not by_search and bounds.steps > trusted:
                self.lost = True
                return

    def _extend_path(self, queue: list[QueueEntry], trail: PathKeys, entry: QueueEntry) -> None:
        graph, bounds = self.graph, self.bounds
        bound, path, _, total, node, place, remaining_path = entry
        bounds.count_edges(node)
        depth = len(path) + 1
        for edge in graph.edges[node]:
            target = graph.targets[edge]
            if target in trail.keys:
                continue
            reached, longer = bounds.combine(total, graph.weights[edge]), (*path, edge)
            if graph.goals[target]:
                heappush(queue, (reached, longer, False, reached, target, None, None))
            if depth + bounds._edge_distances[target] <= graph.longest:
                there = (place, (), target, depth)
                known = remaining_path[1] if remaining_path is not None and remaining_path[0] == edge else None
                least = bounds.bound_onward(target, reached) if known is None else bound
                heappush(queue, (least, longer, True, reached, target, there, known))

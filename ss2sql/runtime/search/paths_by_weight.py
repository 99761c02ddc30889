"""The paths of a graph without a repeated node by their total, ties in source order, a path before its continuations.

Best-first over paths: the queue holds results at their totals, and paths that go on at a bound of the least total that
they can still get. Totals are costs added up from 0, or probabilities multiplied from -1, so less is better. Among
equals source order decides, so a path whose bound is its total leads straight on, even where there are millions of its
kind.

A bound comes first from a Dijkstra search from the goals, which gives for each node the least cost, or greatest
probability, of the rest of a path. It knows neither that the path is in its own way nor how many steps are left, and
where weights are rounded it is lowered by as much. So before a path goes on, an A* search around its nodes makes the
total of its best rest exactly as the path would make it, which is the exact bound. Along this rest no other search is
needed, and each path that goes on leads to a result.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Hashable, Iterator, Sequence
from heapq import heappop, heappush
from math import inf
from operator import add, mul
from typing import Any, TypeAlias

from ss2sql.runtime.run.search_paths import KeyedBackpointer, PathKeys
from ss2sql.runtime.search.search_run import UNREACHABLE, RowGraph

CHECK_EVERY = 4096  # edges

RemainingPath: TypeAlias = tuple[int, Any]  # an edge, and the path after it; None: it leads to a goal

# Bound, path as edges, whether the path goes on; then its total, its last node, its place, and the rest that is known
# to give the bound. The first three differ always.
QueueEntry: TypeAlias = tuple[Any, tuple[int, ...], bool, Any, int, KeyedBackpointer | None, RemainingPath | None]


class PathsByWeight:
    """The paths of one graph by the `weights` of its edges. `steps` counts the edges that were looked at."""

    def __init__(self, graph: RowGraph, weights: Sequence[Any], likeliest: bool) -> None:
        self.graph = graph
        self.weights = weights
        self._start: Any = -1 if likeliest else 0
        self._combine: Callable[[Any, Any], Any] = mul if likeliest else add
        self._best = _compute_goal_distances(graph, weights, likeliest)
        self._edge_distances = graph.fill_goal_distances(
            [UNREACHABLE] * len(graph.rows)
        )  # at least one, also from a goal
        # Each operation on floats is off by a part in 2^53; a bound and a total take at most so many operations each.
        margin = 4 * (graph.longest + 2) * 2.0**-53
        exact = all(isinstance(weight, int) for weight in set(weights))
        self._rounding_slack: float = 1 if exact else 1 + margin if likeliest else 1 - margin
        self.steps = 0
        self._due = CHECK_EVERY

    def find_paths(self) -> Iterator[Sequence[int]]:
        """The paths from the start to a goal as lists of edges."""
        trail = PathKeys()
        queue: list[QueueEntry] = []
        if self._edge_distances[0] <= self.graph.longest:
            queue.append((self._start, (), True, self._start, 0, None, None))
        while queue:
            entry = heappop(queue)
            _, path, goes_on, total, node, place, remaining_path = entry
            if not goes_on:
                yield path
                continue
            trail.move_to(place)
            if remaining_path is not None:
                self._extend_path(queue, trail.keys, entry)
            elif (known := self._search_around(node, total, len(path), trail.keys)) is not None:
                heappush(queue, (known[0], path, True, total, node, place, known[1]))

    def _extend_path(self, queue: list[QueueEntry], visited: Container[Hashable], entry: QueueEntry) -> None:
        graph = self.graph
        bound, path, _, total, node, place, remaining_path = entry
        self._count_edges(node)
        depth = len(path) + 1
        for edge in graph.edges[node]:
            target = graph.targets[edge]
            if target in visited:
                continue
            reached, longer = self._combine(total, self.weights[edge]), (*path, edge)
            if graph.goals[target]:
                heappush(queue, (reached, longer, False, reached, target, None, None))
            if depth + self._edge_distances[target] <= graph.longest:
                there = (place, (), graph.twins.get(target, target), depth)
                known = remaining_path[1] if remaining_path is not None and remaining_path[0] == edge else None
                least = self._bound_onward(target, reached) if known is None else bound
                heappush(queue, (least, longer, True, reached, target, there, known))

    def _bound_onward(self, node: int, total: Any) -> Any:
        """No path that is at `node` with this total, and takes at least one more step to a goal, has a lesser total."""
        return self._combine(total, self._best[node]) * self._rounding_slack

    def _search_around(
        self, node: int, total: Any, taken: int, visited: Container[Hashable]
    ) -> tuple[Any, RemainingPath] | None:
        """The least total of a path that goes on from `node` around the nodes visited, and the rest of this path.

        The path has `taken` steps at `node`. An A* search. Where the length of paths is bounded, a more expensive path
        to a node counts if it has fewer steps.
        """
        graph, limited = self.graph, self.graph.bound is not None
        done: dict[int, list[tuple[Any, int]]] = {}
        number = 0  # keeps paths from being compared
        queue: list[tuple[Any, bool, int, Any, int, int, Any]] = [(total, True, node, total, taken, 0, None)]
        while queue:
            _, goes_on, node, total, taken, _, remaining_path = heappop(queue)
            if not goes_on:
                return total, _reverse_path(remaining_path)
            if any(other <= total and steps <= taken for other, steps in done.get(node, ())):
                continue
            done.setdefault(node, []).append((total, taken))
            self._count_edges(node)
            steps = taken + limited
            for edge in graph.edges[node]:
                target = graph.targets[edge]
                if target in visited:
                    continue
                further, longer, number = self._combine(total, self.weights[edge]), (edge, remaining_path), number + 1
                if graph.goals[target]:
                    heappush(queue, (further, False, target, further, steps, number, longer))
                if steps + self._edge_distances[target] <= graph.longest:
                    bound = self._bound_onward(target, further)
                    heappush(queue, (bound, True, target, further, steps, number, longer))
        return None

    def _count_edges(self, node: int) -> None:
        self.steps += 1 + len(self.graph.edges[node])
        if self.steps > self._due:
            self._due = self.steps + CHECK_EVERY
            self.graph.check()


def _reverse_path(remaining_path: RemainingPath) -> RemainingPath:
    after: Any = None
    back: Any = remaining_path
    while back is not None:
        after = (back[0], after)
        back = back[1]
    return after  # type: ignore[no-any-return]


def _compute_goal_distances(graph: RowGraph, weights: Sequence[Any], likeliest: bool) -> list[Any]:
    """For each node the least cost, or greatest probability, of at least one step to a goal; None: no path."""
    combine: Callable[[Any, Any], Any] = mul if likeliest else add
    sign = -1 if likeliest else 1  # less is better in the queue
    into: list[list[tuple[int, Any]]] = [[] for _ in graph.rows]
    for node, edges in enumerate(graph.edges):
        for edge in edges:
            into[graph.targets[edge]].append((node, weights[edge]))
    ranks: list[Any] = [inf] * len(graph.rows)
    start: Any = sign if likeliest else 0
    queue: list[tuple[Any, int]] = [(start, node) for node, goal in enumerate(graph.goals) if goal]
    settled = bytearray(len(graph.rows))
    turns = 0
    while queue:
        rank, node = heappop(queue)
        if settled[node]:
            continue
        settled[node] = 1
        turns += 1
        if not turns % CHECK_EVERY:
            graph.check()
        for source, weight in into[node]:
            further = combine(rank, weight)
            if further < ranks[source]:
                ranks[source] = further
                heappush(queue, (further, source))
    return [None if rank == inf else sign * rank for rank in ranks]


def can_search_by_length(graph: RowGraph, likeliest: bool) -> bool:
    """Whether all weights are equal and each step makes a path worse, so that shorter paths are better."""
    weights = set(graph.weights)
    if len(weights) != 1:
        return False
    weight = weights.pop()
    # Beyond 1e-300 products lose precision, and different powers may become one number.
    return weight < 1 and weight**graph.longest > 1e-300 if likeliest else bool(weight > 0)

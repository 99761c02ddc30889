"""The paths of a graph without a repeated node by their total, and the least total that a path can still get.

A Dijkstra search from the goals gives for each node the least cost, or greatest probability, of the rest of a path.
Where no sum or product of weights is rounded that is the whole answer: it is combined with the total so far.

Elsewhere the parts of a total depend on the order of their making, by a rounding. A bound that is wrong by as
much would bring paths of equal total out of their order, and one that is lowered by as much would make the
queue find all paths of almost the same total before the first comes out. So the total of the best rest is
made exactly as the path would make it, by an A* search forwards from the total so far; what is lowered is
only its estimate. Rounding never swaps two numbers, so of several ways to a node the best total stays best.

None of this knows that the nodes of a path are in its own way, nor how many steps it may still take. `bound_around`
does, by a search for each path: dear, but less so than a great many paths that lead nowhere.

Best-first over paths: the queue holds results at their totals and paths that go on at the least total that
they can still get. Totals are costs added up from 0, or probabilities multiplied from -1, so less is better.
Among equals source order decides, so a path whose bound is its total leads straight on, even where there are
millions of its kind. That is why bounds have to be exact, see paths_by_weight.py.

Bounds do not know that the path itself is in the way, nor how many steps are left. Where that has cost many steps
without a result, a search around the nodes of each path finds its exact bound before it goes on. From then on each
path that goes on leads to a result.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Hashable, Iterable, Iterator, Sequence
from heapq import heappop, heappush
from itertools import islice
from math import frexp, inf
from operator import add, mul
from typing import Any, TypeAlias

from ss2sql.runtime.run.search_paths import KeyedBackpointer, PathKeys
from ss2sql.runtime.search.paths_by_length import PATIENCE_FACTOR, enumerate_by_length
from ss2sql.runtime.search.search_run import UNREACHABLE, RowGraph

CHECK_EVERY = 4096  # edges
MAX_KNOWN = 500_000  # totals that are remembered

RemainingPath: TypeAlias = tuple[int, Any]  # an edge, and the way after it; None: it leads to a goal


class PathBounds:
    """Bounds of totals: costs are added up from 0, probabilities multiplied from -1, so less is better."""

    def __init__(self, graph: RowGraph, likeliest: bool) -> None:
        self.graph = graph
        self.start: Any = -1 if likeliest else 0
        self.combine: Callable[[Any, Any], Any] = mul if likeliest else add
        self._best = _compute_goal_distances(graph, likeliest)
        self._exact = (_are_path_products_exact if likeliest else _are_path_sums_exact)(graph.weights, graph.longest)
        # Each operation is off by a part in 2^53; a bound and a total take at most so many operations each.
        margin = 4 * (graph.longest + 2) * 2.0**-53
        self._rounding_slack: float = 1 if self._exact else 1 + margin if likeliest else 1 - margin
        self._known: dict[tuple[int, Any], Any] = {}
        self._edge_distances = graph.fill_goal_distances(
            [UNREACHABLE] * len(graph.rows)
        )  # at least one, also from a goal
        self.steps = 0  # edges that were looked at
        self._due = CHECK_EVERY

    def bound_onward(self, node: int, total: Any) -> Any:
        """The least total of a path that is at `node` with this total and takes at least one more step to a goal.

        The goal must be reachable. Nodes that the path has visited are not excluded.
        """
        if self._exact:
            return self.combine(total, self._best[node])
        if (node, total) not in self._known:
            self._search_onward(node, total)
        return self._known[node, total]

    def _search_onward(self, node: int, total: Any) -> None:
        """Finds the best path to a goal, which gives the least total from each of its nodes."""
        found = self._search_around(node, total, 0, (), limited=False)
        assert found is not None
        least, remaining_path = found
        if len(self._known) > MAX_KNOWN:
            self._known.clear()
        while remaining_path is not None:
            self._known[node, total] = least
            edge, remaining_path = remaining_path
            node, total = self.graph.targets[edge], self.combine(total, self.graph.weights[edge])

    def bound_around(
        self, node: int, total: Any, taken: int, visited: Container[Hashable]
    ) -> tuple[Any, RemainingPath] | None:
        """The least total of a path that goes on from `node` around the nodes visited, and the rest of this path.

        The path has `taken` steps at `node`.
        """
        return self._search_around(node, total, taken, visited, limited=self.graph.bound is not None)

    def _search_around(
        self, node: int, total: Any, taken: int, visited: Container[Hashable], limited: bool
    ) -> tuple[Any, RemainingPath] | None:
        """An A* search. With `limited`, a more expensive path to a node counts if it has fewer steps."""
        graph, combine, best, slack = self.graph, self.combine, self._best, self._rounding_slack
        done: dict[int, list[tuple[Any, int]]] = {}
        number = 0  # keeps ways from being compared
        queue: list[tuple[Any, bool, int, Any, int, int, Any]] = [(total, True, node, total, taken, 0, None)]
        while queue:
            _, goes_on, node, total, taken, _, remaining_path = heappop(queue)
            if not goes_on:
                return total, _reverse_path(remaining_path)
            if any(other <= total and steps <= taken for other, steps in done.get(node, ())):
                continue
            done.setdefault(node, []).append((total, taken))
            self.count_edges(node)
            steps = taken + limited
            for edge in graph.edges[node]:
                target = graph.targets[edge]
                if target in visited:
                    continue
                further, longer, number = combine(total, graph.weights[edge]), (edge, remaining_path), number + 1
                if graph.goals[target]:
                    heappush(queue, (further, False, target, further, steps, number, longer))
                if best[target] is not None and steps + self._edge_distances[target] <= graph.longest:
                    estimate = combine(further, best[target]) * slack
                    heappush(queue, (estimate, True, target, further, steps, number, longer))
        return None

    def count_edges(self, node: int) -> None:
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


def _are_path_sums_exact(weights: Iterable[Any], longest: int) -> bool:
    """Whether no sum of so many weights is rounded."""
    weights = set(weights)
    if all(isinstance(weight, int) for weight in weights):
        return True
    scale = max(weight.as_integer_ratio()[1] for weight in weights)
    return all(weight * scale * longest < 2**53 for weight in weights)


def _are_path_products_exact(weights: Iterable[Any], longest: int) -> bool:
    """Whether no product of so many weights is rounded: they are powers of two, and not too small."""
    parts = [frexp(weight) for weight in set(weights)]
    return all(fraction == 0.5 and exponent * longest > -1000 for fraction, exponent in parts)


def _compute_goal_distances(graph: RowGraph, likeliest: bool) -> list[Any]:
    """For each node the least cost, or greatest probability, of at least one step to a goal; None: no path."""
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


# --- the paths of a graph without a repeated node by their total, ties in source order, a path before its continuatio
# Bound, path as edges, whether the path goes on; then its total, its last node, its place, and the way that is known to
# give the bound. The first three differ always.
QueueEntry: TypeAlias = tuple[Any, tuple[int, ...], bool, Any, int, KeyedBackpointer | None, RemainingPath | None]


def enumerate_by_weight(graph: RowGraph, likeliest: bool) -> Iterator[Sequence[int]]:
    """The paths from the start to a goal as lists of edges, the cheapest or likeliest first."""
    return (
        enumerate_by_length(graph)
        if _can_search_by_length(graph, likeliest)
        else PathsByWeight(graph, likeliest).find_paths()
    )


def _can_search_by_length(graph: RowGraph, likeliest: bool) -> bool:
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

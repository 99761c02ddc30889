"""The paths of a graph without a repeated node, shortest first, those of one length in source order.

One depth-first walk for each length that occurs. A walk enters a node only if a goal is as many steps away as
are left; that is known from distances, found backwards from the goals. As a walk of a given length may go to
and fro, the distances are kept apart for even and odd lengths. Where a walk turns back it notes for which
greater length it would have gone on: the least of them is the next length; without one no longer path exists.

Distances do not know that the path itself is in the way. Where the rest leads back over the path, or into a room whose
only door the path has closed, a walk may try every path to the obstacle, which are exponentially many. In most graphs
that does not matter. Where `PATIENCE_FACTOR` times as many edges as the graph has were looked at without another path,
the search of paths_by_weight.py takes over, for which each step costs 1. It takes two to seven times as long where all
is well.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Any

from ss2sql.runtime.search.paths_by_weight import PathsByWeight
from ss2sql.runtime.search.search_run import UNREACHABLE, RowGraph

CHECK_EVERY = 1023
PATIENCE_FACTOR = 10  # 14,000 paths of Hanoi with 4 disks need 1.5, a crowded grid of 7 x 7 nodes 0.7


class PathsByLength:
    """The paths of one graph: by the quick walk, after too many dead ends by a search around each path.

    They are lists of edges, or of what `marks` has in place of each edge. `steps` counts the edges that were looked at.
    """

    def __init__(self, graph: RowGraph, marks: Sequence[Any] | None = None) -> None:
        self.graph = graph
        self.marks: Sequence[Any] = range(len(graph.targets)) if marks is None else marks
        self.walks = DistanceWalks(graph, self.marks)
        self.search: PathsByWeight | None = None

    @property
    def steps(self) -> int:
        return self.walks.steps + (self.search.steps if self.search else 0)

    def find_paths(self) -> Iterator[list[Any]]:
        """The paths from the start to a goal as lists of marks."""
        length = self.walks.get_shortest()
        while length <= self.graph.longest:
            yield from self.walks.find_paths(length)
            if self.walks.lost:
                self.search = PathsByWeight(self.graph, [1] * len(self.graph.targets), likeliest=False)
                for path in islice(self.search.find_paths(), self.walks.found_count, None):
                    yield [self.marks[edge] for edge in path]
                return
            length = self.walks.longer


class DistanceWalks:
    """The walks over one graph. `even` and `odd` are the distances to a goal in an even and odd number of steps."""

    def __init__(self, graph: RowGraph, marks: Sequence[Any]) -> None:
        self.graph = graph
        self.marks = marks
        self.even, self.odd = _search_walk_lengths(graph)
        # Of the nodes that were entered, the edges that lead somewhere: their marks, and the nodes that they lead to.
        self.edges: list[list[tuple[Any, int]] | None] = [None] * len(graph.rows)
        self.longer = UNREACHABLE
        self.steps = 0  # edges of the nodes that were left again
        self.patience = PATIENCE_FACTOR * (len(graph.rows) + len(graph.targets))
        self.trusted = self.patience  # how many steps may be taken before the next path
        self.lost = False
        self.found_count = 0  # paths of all lengths

    def get_shortest(self) -> int:
        return min(self.even[0], self.odd[0])

    def find_paths(self, length: int) -> Iterator[list[Any]]:
        """The paths of this length as lists of marks; `longer` is then the next possible length.

        Sets `lost` and ends after too many edges without a path.
        """
        self.graph.check()
        self.longer = UNREACHABLE
        turns = 0
        goals, edges = self.graph.goals, self.edges
        distances = (self.even, self.odd)
        visited = bytearray(len(goals))
        path: list[Any] = []
        nodes: list[int] = []
        stack = [self._iterate_starts(visited)]
        while stack:
            left = length - len(stack)  # steps that are left after the next one
            distance = distances[left & 1]
            for mark, node in stack[-1]:
                if visited[node]:
                    continue
                if not left:
                    if goals[node]:
                        self.trusted = self.steps + self.patience
                        self.found_count += 1
                        yield [*path, mark]
                    if self.longer > length + 1:
                        self._note_longer_walk(node, length)
                elif distance[node] <= left:
                    path.append(mark)
                    nodes.append(node)
                    visited[node] = 1
                    stack.append(iter(edges[node] or self._list_edges(node)))
                    break
                elif self.longer > length + 1:
                    self._note_bound(node, length - left, left)
            else:
                stack.pop()
                if nodes:
                    path.pop()
                    node = nodes.pop()
                    visited[node] = 0
                    self.steps += len(edges[node] or ())
                turns += 1  # counted here: a method that does it takes a twentieth of the walk
                if not turns & CHECK_EVERY:
                    self.graph.check()
                if self.steps > self.trusted:
                    self.lost = True
                    return

    def _iterate_starts(self, visited: bytearray) -> Iterator[tuple[Any, int]]:
        """The edges out of the start; the twin of a node counts as visited while the paths by this edge are found."""
        for mark, node in self._list_edges(0):
            twin = self.graph.twins.get(node, 0)
            visited[twin] = 1
            yield mark, node
            visited[twin] = 0

    def _list_edges(self, node: int) -> list[tuple[Any, int]]:
        """The edges out of a node that lead to a goal."""
        even, odd, targets, marks = self.even, self.odd, self.graph.targets, self.marks
        pairs = [(marks[edge], targets[edge]) for edge in self.graph.edges[node]]
        known = self.edges[node] = [pair for pair in pairs if even[pair[1]] < UNREACHABLE or odd[pair[1]] < UNREACHABLE]
        return known

    def _note_longer_walk(self, node: int, depth: int) -> None:
        """Notes the length of the shortest walk that goes on from the last node."""
        for _, following in self.edges[node] or self._list_edges(node):
            self._note_bound(following, depth + 1, -1)

    def _note_bound(self, node: int, depth: int, left: int) -> None:
        """Notes the least length of a walk with more than `left` steps after the `depth` ones to the node."""
        for parity, distances in enumerate((self.even, self.odd)):
            further = distances[node]
            if further < UNREACHABLE:
                least = left + 1 if (left + 1) & 1 == parity else left + 2
                self.longer = min(self.longer, depth + max(further, least))


def _search_walk_lengths(graph: RowGraph) -> tuple[list[int], list[int]]:
    """For each node the steps to the nearest goal by walks of even and of odd length; FAR beyond the longest path."""
    sources = graph.list_predecessors()
    far = [UNREACHABLE] * len(graph.rows)
    distances = (far, far.copy())
    level = [node for node, goal in enumerate(graph.goals) if goal]
    for node in level:
        far[node] = 0
    for steps in range(1, graph.longest + 1):
        known = distances[steps & 1]
        found = []
        for node in level:
            for source in sources[node]:
                if known[source] == UNREACHABLE:
                    known[source] = steps
                    found.append(source)
        graph.check()
        if not found:
            break
        level = found
    return distances

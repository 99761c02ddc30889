"""The paths of a graph without a repeated node, shortest first, those of one length in source order.

One depth-first walk for each length that occurs. A walk enters a node only if a goal is as many steps away as
are left; that is known from distances, found backwards from the goals. As a walk of a given length may go to
and fro, the distances are kept apart for even and odd lengths. Where a walk turns back it notes for which
greater length it would have gone on: the least of them is the next length, and when there is none, no longer
path exists.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence

from ss2sql.runtime.memorize.graph import Graph

FAR = 2**62  # no goal can be reached
CHECK_EVERY = 1023


def paths_by_length(graph: Graph) -> Iterator[Sequence[int]]:
    """The paths from the start to a goal as lists of edges. Each is read before the next one is asked for."""
    walk = _Walk(graph)
    length = walk.first()
    while length <= graph.longest:
        yield from walk.paths(length)
        length = walk.longer


class _Walk:
    """The walks over one graph. `even` and `odd` are the distances to a goal in an even and odd number of steps."""

    def __init__(self, graph: Graph) -> None:
        self.graph = graph
        self.even, self.odd = _distances(graph)
        even, odd, targets = self.even, self.odd, graph.targets
        # Edges that lead nowhere are left out once and for all.
        self.edges = [
            [(edge, targets[edge]) for edge in edges if min(even[targets[edge]], odd[targets[edge]]) < FAR]
            for edges in graph.edges
        ]
        self.longer = FAR
        self.turns = 0

    def first(self) -> int:
        """The length of the shortest paths."""
        return min(self.even[0], self.odd[0])

    def paths(self, length: int) -> Iterator[Sequence[int]]:
        """The paths of this length; `longer` is then the next length that is worth a walk."""
        self.longer = FAR
        goals, edges = self.graph.goals, self.edges
        distances = (self.even, self.odd)
        visited = bytearray(len(goals))
        path: list[int] = []
        nodes: list[int] = []
        stack = [iter(edges[0])]
        while stack:
            left = length - len(stack)  # steps that are left after the next one
            distance = distances[left & 1]
            for edge, node in stack[-1]:
                if visited[node]:
                    continue
                if not left:
                    if goals[node]:
                        yield [*path, edge]
                    if self.longer > length + 1:
                        self._note_beyond(node, length)
                elif distance[node] <= left:
                    path.append(edge)
                    nodes.append(node)
                    visited[node] = 1
                    stack.append(iter(edges[node]))
                    break
                elif self.longer > length + 1:
                    self._note(node, length - left, left)
            else:
                stack.pop()
                if nodes:
                    path.pop()
                    visited[nodes.pop()] = 0
                self._tick()

    def _tick(self) -> None:
        self.turns += 1
        if not self.turns & CHECK_EVERY:
            self.graph.check()

    def _note_beyond(self, node: int, depth: int) -> None:
        """Notes the length of the shortest walk that goes on from a node which is the last one now."""
        for _, following in self.edges[node]:
            self._note(following, depth + 1, -1)

    def _note(self, node: int, depth: int, left: int) -> None:
        """Notes the least length of a walk that takes more than `left` steps after the `depth` ones to the node."""
        for parity, distances in enumerate((self.even, self.odd)):
            further = distances[node]
            if further < FAR:
                least = left + 1 if (left + 1) & 1 == parity else left + 2
                self.longer = min(self.longer, depth + max(further, least))


def _distances(graph: Graph) -> tuple[list[int], list[int]]:
    """For each node the steps to the nearest goal, by walks of even and of odd length."""
    sources = graph.into()
    far = [FAR] * len(graph.rows)
    distances = (far, far.copy())
    queue: deque[tuple[int, int]] = deque()
    for node, goal in enumerate(graph.goals):
        if goal:
            distances[0][node] = 0
            queue.append((node, 0))
    while queue:
        node, parity = queue.popleft()
        further = distances[parity][node] + 1
        other = distances[1 - parity]
        for source in sources[node]:
            if other[source] == FAR:
                other[source] = further
                queue.append((source, 1 - parity))
    return distances

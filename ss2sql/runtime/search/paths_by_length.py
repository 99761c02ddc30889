"""The paths of a graph without a repeated node, shortest first, those of one length in source order.

Where the rest leads back over the path, or into a room whose only door the path has closed, a walk that knows
distances alone may try every path to the obstacle, which are exponentially many. This one enters a branch only
when a search around the nodes of the path has found a goal in reach. Along the path that it found no other search
is needed, so a path costs one for each place where it leaves such a path, and one for each branch that stays out.

Where lengths are many, walking anew for each of them costs a multiple. So the branches that were entered are kept,
each with a bound: what is still to come from it is not shorter. A walk goes only where the bound is its length,
and the least bound of all is the next length.

One depth-first walk for each length that occurs. A walk enters a node only if a goal is as many steps away as
are left; that is known from distances, found backwards from the goals. As a walk of a given length may go to
and fro, the distances are kept apart for even and odd lengths. Where a walk turns back it notes for which
greater length it would have gone on: the least of them is the next length; without one no longer path exists.

Distances do not know that the path itself is in the way, and a walk knows nothing of the walks before it. In
most graphs neither matters. Where `PATIENCE_FACTOR` times as many edges as the graph has were looked at without another
path, the walk of paths_by_length.py takes over. It takes three to ten times as long where all is well.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import field
from heapq import heappop, heappush
from itertools import islice
from typing import Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.runtime.search.search_run import UNREACHABLE, RowGraph

CHECK_EDGES_EVERY = 4096  # edges
MAX_KEPT = 500_000  # branches that are kept; one takes some 300 bytes, and what is not kept is walked again


@dataclass(slots=True)
class PathBranch:
    """What goes on from one path, which ends at `node`.

    `bounds` has for each edge the least length of a path that goes on by it and is still to come. `child_branches` are
    the branches after the edges, by position, where they have been entered.
    """

    node: int
    bounds: list[int]
    child_branches: dict[int, PathBranch] = field(default_factory=dict)


class SimplePathWalks:
    """The walks over one graph. `steps` counts edges."""

    def __init__(self, graph: RowGraph, marks: Sequence[Any]) -> None:
        self.graph = graph
        self.longest = graph.longest
        self.near = graph.fill_goal_distances([0 if goal else UNREACHABLE for goal in graph.goals])
        near, targets = self.near, graph.targets
        # Edges that lead nowhere are left out once and for all.
        kept = [[edge for edge in edges if near[targets[edge]] < UNREACHABLE] for edges in graph.edges]
        self.marks = [[marks[edge] for edge in edges] for edges in kept]
        self.targets = [[targets[edge] for edge in edges] for edges in kept]
        self.visited = bytearray(len(near))
        self.kept = 0
        self.steps = 0
        self._due = CHECK_EDGES_EVERY
        self._known: list[int] = []  # a path to a goal from the last node of the path, backwards
        self._known_bounds: PathBranch | None = None

    def find_paths(self, length: int) -> Iterator[list[Any]]:
        """The paths of at least this length as lists of the marks of their edges."""
        root = self._make_branch(0, 1)
        while length < UNREACHABLE:
            yield from self._iterate_paths(root, length)
            length = min(root.bounds, default=UNREACHABLE)

    def _iterate_paths(self, branch: PathBranch, length: int) -> Iterator[list[Any]]:
        marks, visited = self.marks, self.visited
        path: list[Any] = []
        above: list[tuple[PathBranch, Iterator[tuple[int, int]], int]] = []
        rest: Iterator[tuple[int, int]] = enumerate(branch.bounds)
        while True:
            for at, bound in rest:
                if bound > length:
                    continue
                if len(path) + 1 == length:
                    yield [*path, marks[branch.node][at]]
                    branch.bounds[at] = self._bound_extensions(self.targets[branch.node][at], length)
                    continue
                kid = branch.child_branches.get(at) or self._enter_branch(branch, at, len(path) + 1, length)
                if kid is None:
                    continue
                self._count_edges(kid.node)
                visited[kid.node] = 1
                path.append(marks[branch.node][at])
                above.append((branch, rest, at))
                branch, rest = kid, enumerate(kid.bounds)
                break
            else:
                if not above:
                    return
                visited[branch.node] = 0
                bound = min(branch.bounds, default=UNREACHABLE)
                branch, rest, at = above.pop()
                path.pop()
                branch.bounds[at] = bound
                if bound == UNREACHABLE and at in branch.child_branches:
                    del branch.child_branches[at]
                    self.kept -= 1

    def _make_branch(self, node: int, depth: int) -> PathBranch:
        """A branch whose next step is followed by `depth` others."""
        near, longest, visited = self.near, self.longest, self.visited
        bounds = [
            UNREACHABLE if visited[target] or target == node or (bound := depth + near[target]) > longest else bound
            for target in self.targets[node]
        ]
        return PathBranch(node, bounds)

    def _bound_extensions(self, node: int, length: int) -> int:
        """A bound of paths that go on from the end of a path of this length."""
        bound = length + 1 + min([self.near[target] for target in self.targets[node]], default=UNREACHABLE)
        return bound if bound <= self.longest else UNREACHABLE

    def _enter_branch(self, branch: PathBranch, at: int, depth: int, length: int) -> PathBranch | None:
        """The branch after an edge, which is step `depth`; None if it has no path of this length."""
        node = self.targets[branch.node][at]
        if self._known_bounds is branch and self._known[-1:] == [node]:
            self._known.pop()
        else:
            reached, remaining_path = self._find_path_around(node, depth)
            if reached > length:
                branch.bounds[at] = reached
                return None
            self._known = remaining_path
        self._known_bounds = kid = self._make_branch(node, depth + 1)
        if self.kept < MAX_KEPT:
            branch.child_branches[at] = kid
            self.kept += 1
        return kid

    def _find_path_around(self, start: int, depth: int) -> tuple[int, list[int]]:
        """The length of the shortest path that goes on from `start`, its node after `depth` steps, and its other nodes.

        The nodes are in reverse order. An A* search whose estimate is the distance.
        """
        near, targets, visited, longest = self.near, self.targets, self.visited, self.longest
        queue: list[tuple[int, int, int, int]] = [(0, -depth, start, start)]
        before: dict[int, int] = {}
        while queue:
            _, taken, node, last = heappop(queue)
            if node in before:
                continue
            if not near[node] and node != start:
                remaining_path = [node]
                while last != start:
                    remaining_path.append(last)
                    last = before[last]
                return -taken, remaining_path
            before[node] = last
            self._count_edges(node)
            for target in targets[node]:
                if not visited[target] and target not in before:
                    bound = 1 - taken + near[target]
                    if bound <= longest:
                        heappush(queue, (bound, taken - 1, target, node))
        return UNREACHABLE, []

    def _count_edges(self, node: int) -> None:
        self.steps += 1 + len(self.targets[node])
        if self.steps > self._due:
            self._due = self.steps + CHECK_EDGES_EVERY
            self.graph.check()


# --- the paths of a graph without a repeated node, shortest first, those of one length in source order
CHECK_EVERY = 1023
PATIENCE_FACTOR = 10  # 14,000 paths of Hanoi with 4 disks need 1.5, a crowded grid of 7 x 7 nodes 0.7


def enumerate_by_length(graph: RowGraph, marks: Sequence[Any] | None = None) -> Iterator[list[Any]]:
    """The paths from the start to a goal as lists of edges, or of what `marks` has in place of each edge."""
    return PathsByLength(graph, marks).find_paths()


class PathsByLength:
    """The paths of one graph: by the quick walk, after too many dead ends by that of paths_by_length.py."""

    def __init__(self, graph: RowGraph, marks: Sequence[Any] | None = None) -> None:
        self.graph = graph
        self.marks: Sequence[Any] = range(len(graph.targets)) if marks is None else marks
        self.distance_walks = DistanceWalks(graph, self.marks)
        self.simple_walks: SimplePathWalks | None = None

    @property
    def steps(self) -> int:
        """How many edges were looked at."""
        return self.distance_walks.steps + (self.simple_walks.steps if self.simple_walks else 0)

    def find_paths(self) -> Iterator[list[Any]]:
        """The paths from the start to a goal as lists of marks."""
        quick = self.distance_walks
        length = quick.get_shortest()
        while length <= self.graph.longest:
            yield from quick.find_paths(length)
            if quick.lost:
                self.simple_walks = SimplePathWalks(self.graph, self.marks)
                yield from islice(self.simple_walks.find_paths(length), quick.found_count, None)
                return
            length = quick.longer


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
        self.found_count = 0  # paths of this length

    def get_shortest(self) -> int:
        return min(self.even[0], self.odd[0])

    def find_paths(self, length: int) -> Iterator[list[Any]]:
        """The paths of this length as lists of marks; `longer` is then the next possible length.

        Sets `lost` and ends after `found_count` edges without a path.
        """
        self.graph.check()
        self.longer = UNREACHABLE
        self.found_count = turns = 0
        goals, edges = self.graph.goals, self.edges
        distances = (self.even, self.odd)
        visited = bytearray(len(goals))
        path: list[Any] = []
        nodes: list[int] = []
        stack = [iter(self._list_edges(0))]
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

"""The same paths in the same order as paths_by_length.py, for graphs where most ways lead nowhere.

Where the rest leads back over the path, or into a room whose only door the path has closed, a walk that knows
distances alone may try every way to the obstacle, which are exponentially many. This one enters a branch only
when a search around the nodes of the path has found a goal in reach. Along the way that it found no other search
is needed, so a path costs one for each place where it leaves such a way, and one for each branch that stays out.

Where lengths are many, walking anew for each of them costs a multiple. So the branches that were entered are kept,
each with a bound: what is still to come from it is not shorter. A walk goes only where the bound is its length,
and the least bound of all is the next length.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import field
from heapq import heappop, heappush
from typing import Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.runtime.search.graph import UNREACHABLE, RowGraph

CHECK_EVERY = 4096  # edges
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
        self._due = CHECK_EVERY
        self._known: list[int] = []  # a way to a goal from the last node of the path, backwards
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
            self._due = self.steps + CHECK_EVERY
            self.graph.check()

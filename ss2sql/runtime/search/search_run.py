"""One run of a search with MEMORIZE, its graph, and what its parts hand to each other."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import field
from typing import Any, TypeAlias

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.rows import Row
from ss2sql.language.values import FrozenShapes, State
from ss2sql.runtime.run.run_state import Run, Stats
from ss2sql.runtime.search.step_contract import NotedSearch, Notes, Problem

# `grow(graph, level, seen, most, choose)` adds the steps from the nodes of a level to the graph, each evaluated in
# source order, and gives the nodes that go on: each a number, then the values of its frozen state. `seen` has the
# numbers of rows by their keys. It ends early when the graph has more than `most` rows and the start.
# `choose(elements, state)`, where it is given, says which elements of a single list are tried; with notes it is Notes.
Node: TypeAlias = tuple[Any, ...]
Nodes: TypeAlias = Iterable[Node]
ChooseElements: TypeAlias = Callable[[list[Any], State], list[Any]] | Notes

# A result: the rows of its path, and the last part of its last step.
Found: TypeAlias = tuple[Sequence[Row], Any]


# What finds the results of a search.
FindPaths: TypeAlias = Callable[["SearchRun"], Iterator[Found]]


@dataclass(frozen=True, slots=True)
class SearchRun:
    """One run of a search."""

    start: State  # as values; the states of `problem` are frozen
    problem: Problem
    shapes: FrozenShapes  # how states are frozen
    grow: Callable[..., list[Node]] | None  # makes a level of the graph, with the step function inlined
    order: plan.Order
    bound: int | None  # MEMORIZE's greatest length
    stats: Stats
    check: Callable[[], None]  # ends the run if it has to end
    query: plan.Query
    run: Run
    noted: NotedSearch | None = None  # the search with notes of its steps, where it can have some
    chooses: bool = False  # `grow` takes a choice of elements
    flush: Callable[[], None] = lambda: None  # brings `stats` up to date
    keyed: bool = True  # GROUP BY or ORDER BY need the last part of a result


# --- the graph that MEMORIZE searches: rows as nodes, steps as edges
UNREACHABLE = 2**62  # no goal can be reached


@dataclass(slots=True)
class RowGraph:
    """Nodes are numbers; 0 is the start, which has no row. Edges are numbers, in the order of their making."""

    check: Callable[[], None]
    bound: int | None  # the greatest length of a path
    rows: list[Row] = field(default_factory=lambda: [()])
    goals: list[bool] = field(default_factory=lambda: [False])
    edges: list[Sequence[int]] = field(default_factory=lambda: [()])  # out of a node, in source order
    targets: list[int] = field(default_factory=list)  # the node to which an edge leads
    weights: list[Any] = field(default_factory=list)  # cost or probability of an edge; empty where they are not needed
    lasts: list[Any] = field(default_factory=list)  # what GROUP BY and ORDER BY see of its step; likewise
    twins: dict[int, int] = field(default_factory=dict)  # for nodes at which paths start: the one where none comes back

    @property
    def longest(self) -> int:
        """No path without a repeated row has more steps than this."""
        nodes = len(self.rows) - 1
        return nodes if self.bound is None else min(nodes, self.bound)

    def make_result(self, path: Sequence[int]) -> Found:
        return [self.rows[self.targets[edge]] for edge in path], self.lasts[path[-1]] if self.lasts else None

    def list_marks(self) -> list[Row] | None:
        """For each edge the row that it leads to, where a result is nothing but its rows."""
        return None if self.lasts else list(map(self.rows.__getitem__, self.targets))

    def find_first_path(self) -> list[int] | None:
        """The first of the shortest paths in source order, as edges; None where no goal was reached.

        It goes by the steps that made its nodes, for the graph has grown breadth-first, which is said here and nowhere
        else. All other paths want the distances to the goals first, a tenth of the time that the graph has taken.
        """
        node = next((node for node, goal in enumerate(self.goals) if goal), None)
        if node is None:
            return None
        numbers = range(len(self.targets) - 1, -1, -1)
        made_by = dict(zip(reversed(self.targets), numbers, strict=True))  # the first edge to a node stays
        starts = [(edges[0], source) for source, edges in enumerate(self.edges) if edges]
        path = []
        while node:
            path.append(made_by[node])
            node = starts[bisect_right(starts, (path[-1], len(self.rows))) - 1][1]
        return path[::-1]

    def list_predecessors(self) -> list[list[int]]:
        """For each node the nodes with an edge to it, once per edge."""
        sources: list[list[int]] = [[] for _ in self.rows]
        for node, edges in enumerate(self.edges):
            for edge in edges:
                sources[self.targets[edge]].append(node)
        return sources

    def fill_goal_distances(self, steps: list[int]) -> list[int]:
        """Sets the steps to the nearest goal for each node that is UNREACHABLE in `steps`, and gives the list."""
        sources = self.list_predecessors()
        level = [node for node, goal in enumerate(self.goals) if goal]
        depth = 0
        while level:
            self.check()
            depth += 1
            found = []
            for node in level:
                for source in sources[node]:
                    if steps[source] == UNREACHABLE:
                        steps[source] = depth
                        found.append(source)
            level = found
        return steps

"""MEMORIZE: first the graph of rows, built breadth-first, then its paths without a repeated row, best first.

Each row is a node; its first visit by a step that leaves a trace makes it and fixes the state behind it, and
it is expanded once. Every step to a row is an edge, so two elements that lead to the same row are two edges.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable, Iterator

from ss2sql.runtime.memorize.by_length import paths_by_length
from ss2sql.runtime.memorize.by_weight import paths_by_weight
from ss2sql.runtime.memorize.graph import Graph
from ss2sql.runtime.native.searches.step import Found, Hunt, State


def memorize(hunt: Hunt) -> Iterator[Found]:
    """The paths of at most `hunt.bound` steps, shortest first."""
    graph = built(hunt)
    for edges in paths_by_length(graph):
        yield graph.found(edges)


def memorize_weighted(hunt: Hunt) -> Iterator[Found]:
    """The paths of at most `hunt.bound` steps, cheapest or likeliest first."""
    graph = built(hunt)
    for edges in paths_by_weight(graph, hunt.order == "probability"):
        yield graph.found(edges)


def built(hunt: Hunt) -> Graph:
    """The graph of the rows that are reached by at most `hunt.bound` steps."""
    graph = Graph(hunt.check, hunt.bound)
    numbers: dict[Hashable, int] = {}
    queue: deque[tuple[int, State, int]] = deque([(0, hunt.start, 0)])
    while queue:
        node, state, depth = queue.popleft()
        for row, goal, following, key, weight, _, last in hunt.steps(state, numbers):
            if goal is None:
                graph.add_edge(node, numbers[key], weight, last)
                continue
            number = numbers[key] = graph.add_node(row, goal)
            graph.add_edge(node, number, weight, last)
            if following is not None and (hunt.bound is None or depth + 1 < hunt.bound):
                queue.append((number, following, depth + 1))
    return graph

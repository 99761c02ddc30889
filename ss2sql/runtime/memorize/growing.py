"""MEMORIZE: first the graph of rows, built breadth-first, then its paths without a repeated row, best first.

Each row is a node; its first visit by a step that leaves a trace makes it and fixes the state behind it, and
it is expanded once. Every step to a row is an edge, so two elements that lead to the same row are two edges.
The graph grows by levels: a level are the rows that were first reached by so many steps.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterator

from ss2sql.runtime.memorize.by_length import paths_by_length
from ss2sql.runtime.memorize.by_weight import paths_by_weight
from ss2sql.runtime.memorize.graph import Graph
from ss2sql.runtime.native.searches.step import Found, Hunt, State, Steps
from ss2sql.runtime.run import Level


def memorize(hunt: Hunt) -> Iterator[Found]:
    """The paths of at most `hunt.bound` steps, shortest first."""
    graph = grown(hunt)
    for edges in paths_by_length(graph):
        yield graph.found(edges)


def memorize_weighted(hunt: Hunt) -> Iterator[Found]:
    """The paths of at most `hunt.bound` steps, cheapest or likeliest first."""
    graph = grown(hunt)
    for edges in paths_by_weight(graph, hunt.order == "probability"):
        yield graph.found(edges)


def grown(hunt: Hunt) -> Graph:
    """The graph of the rows that are reached by at most `hunt.bound` steps."""
    graph = Graph(hunt.check, hunt.bound)
    numbers: dict[Hashable, int] = {}
    steps = steps_from(hunt)
    level, levels = [(0, hunt.start)], list[Level]()
    hunt.stats.levels = levels
    while level and (hunt.bound is None or len(levels) < hunt.bound):
        rows, edges = len(graph.rows), len(graph.targets)
        level = _next_level(steps, graph, numbers, level)
        levels.append(Level(len(graph.rows) - rows, len(graph.targets) - edges))
    return graph


def steps_from(hunt: Hunt) -> Steps:
    """What gives the steps from a state."""
    return hunt.steps


def _next_level(
    steps: Steps, graph: Graph, numbers: dict[Hashable, int], level: list[tuple[int, State]]
) -> list[tuple[int, State]]:
    """Adds the steps from the nodes of a level to the graph, and gives the nodes of the next level that go on."""
    following_level = []
    for node, state in level:
        for row, goal, following, key, weight, _, last in steps(state, numbers):
            if goal is None:
                graph.add_edge(node, numbers[key], weight, last)
                continue
            number = numbers[key] = graph.add_node(row, goal)
            graph.add_edge(node, number, weight, last)
            if following is not None:
                following_level.append((number, following))
    return following_level

"""MEMORIZE: first the graph of rows, built breadth-first, then its paths without a repeated row, best first.

Each row is a node; its first visit by a step that leaves a trace makes it and fixes the state behind it, and
it is expanded once. Every step to a row is an edge, so two elements that lead to the same row are two edges.
The graph grows by levels: a level are the rows that were first reached by so many steps.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Container, Hashable, Iterable, Iterator
from functools import partial
from itertools import islice, repeat
from typing import TypeAlias

from ss2sql import plan
from ss2sql.errors import ExecutionError
from ss2sql.runtime.memorize.both_ends import WayBack, balanced, way_back
from ss2sql.runtime.memorize.by_length import paths_by_length
from ss2sql.runtime.memorize.by_weight import paths_by_weight
from ss2sql.runtime.memorize.graph import Graph
from ss2sql.runtime.memorize.hunt import Choose, Found, Grow, Hunt, Node, Nodes, State, Steps
from ss2sql.runtime.memorize.pieces import Last
from ss2sql.runtime.remembered.steps import Remembering
from ss2sql.runtime.run import Level

Elements: TypeAlias = Callable[[State], Iterable[Last]]


def memorize(hunt: Hunt) -> Iterator[Found]:
    """The paths of at most `hunt.bound` steps: shortest, cheapest or likeliest first."""
    yield from results_of(hunt, grown(hunt))


def results_of(hunt: Hunt, graph: Graph) -> Iterator[Found]:
    """The same for the graph that has grown."""
    if hunt.order in ("cost", "probability"):
        yield from map(graph.found, paths_by_weight(graph, hunt.order == "probability"))
        return
    first = graph.first_path()
    if first is not None:
        yield graph.found(first)
        marks = graph.marks()
        others = islice(paths_by_length(graph, marks), 1, None)
        yield from map(graph.found, others) if marks is None else zip(others, repeat(None))


def grown(hunt: Hunt) -> Graph:
    """The graph of the rows that are reached by at most `hunt.bound` steps."""
    keeper = hunt.run.host.graphs
    memory = None if keeper is None else keeper.remembering(hunt)
    if memory is None:
        return _grown(hunt, hunt.grow, way_back(hunt), None)
    with memory:
        return _grown(hunt, growth(memory.steps), None, memory)


def _grown(hunt: Hunt, grow: Grow, way: WayBack | None, memory: Remembering | None) -> Graph:
    graph = hunt.run.graph = Graph(hunt.check, hunt.bound)
    hunt.flush()
    numbers: dict[Hashable, int] = {}
    level, levels = [(0, hunt.start)], list[Level]()
    hunt.stats.levels, hunt.stats.backward = levels, []
    most = hunt.run.max_rows
    while level and (hunt.bound is None or len(levels) < hunt.bound):
        depth = len(levels)
        if memory is not None:
            memory.level([state for _, state in level])
        way = way and balanced(way, depth, [state for _, state in level])
        rows, edges, steps_before = len(graph.rows), len(graph.targets), hunt.stats.generated
        leading = way if way and way.leads(depth) else None
        states = _prepared(hunt, level, numbers, None if leading is None else partial(leading.lasts, depth))
        onward, choose = grow, None
        if leading is not None and leading.pieces.chooses:
            choose = partial(leading.chosen, depth)
        elif leading is not None:
            onward = growth(leading.steps(depth))
        level = onward(graph, states, numbers, sys.maxsize if most is None else most + 1, choose)
        if most is not None and len(graph.rows) - 1 > most:
            raise too_many(hunt.query, most)
        hunt.flush()
        edges = len(graph.targets) - edges
        levels.append(Level(len(graph.rows) - rows, edges, hunt.stats.generated - steps_before - edges))
    return graph


def _prepared(
    hunt: Hunt, level: list[tuple[int, State]], numbers: Container[Hashable], elements: Elements | None
) -> Iterable[tuple[int, State]]:
    """The level, whose calls other processes make before they are asked for, where that is wanted."""
    foreteller = hunt.run.foreteller
    return level if foreteller is None else foreteller.blocks(hunt, level, numbers, elements)


def growth(steps: Steps) -> Grow:
    """The growth of a graph by steps that are given one by one, each evaluated when it is asked for."""

    def grow(graph: Graph, level: Nodes, seen: dict[Hashable, int], most: int, _: Choose | None) -> list[Node]:
        following_level = []
        for node, state in level:
            for row, goal, following, key, weight, _, last in steps(state, seen):
                if goal is not None:
                    seen[key] = graph.add_node(row, goal)
                    if following is not None:
                        following_level.append((seen[key], following))
                graph.add_edge(node, seen[key], weight, last)
            if len(graph.rows) > most:
                break
        return following_level

    return grow


def too_many(query: plan.Query, most: int) -> ExecutionError:
    """The error for a graph that does not fit."""
    hints = ("bound MEMORIZE, stop paths that lead nowhere with STOP WITH, or raise max_rows",)
    return ExecutionError("X010", f"the graph of MEMORIZE has more than max_rows={most} rows", query.span, hints)

"""MEMORIZE: first the graph of rows, built breadth-first, then its paths without a repeated row, best first.

Each row is a node; its first visit by a step that leaves a trace makes it and fixes the state behind it, and
it is expanded once. Every step to a row is an edge, so two elements that lead to the same row are two edges.
The graph grows by levels: a level are the rows that were first reached by so many steps.
"""

from __future__ import annotations

import sys
from collections.abc import Hashable, Iterator
from dataclasses import replace
from functools import partial
from itertools import islice, repeat

from ss2sql import plan
from ss2sql.errors import ExecutionError
from ss2sql.runtime.memorize.both_ends import WayBack, balanced, way_back
from ss2sql.runtime.memorize.by_length import paths_by_length
from ss2sql.runtime.memorize.by_weight import paths_by_weight
from ss2sql.runtime.memorize.graph import Graph
from ss2sql.runtime.memorize.hunt import Choose, Found, Hunt, Node, Nodes
from ss2sql.runtime.memorize.notes import Notes
from ss2sql.runtime.run import Level
from ss2sql.runtime.search.contract import Problem


def memorize(hunt: Hunt) -> Iterator[Found]:
    """The paths of at most `hunt.bound` steps: shortest, cheapest or likeliest first."""
    yield from results_of(hunt, grown(hunt))


def results_of(hunt: Hunt, graph: Graph) -> Iterator[Found]:
    """The same for the graph that has grown."""
    thaw = hunt.shapes.thawing()
    by_weight = hunt.order in ("cost", "probability")
    first = None if by_weight else graph.first_path()
    if not by_weight and first is None:
        return
    if first is not None:  # often the only one
        rows, last = graph.found(first)
        yield rows if thaw is None else thaw(rows), last
    if thaw is not None:
        graph.rows[1:] = thaw(graph.rows[1:])
    if by_weight:
        yield from map(graph.found, paths_by_weight(graph, hunt.order == "probability"))
        return
    marks = graph.marks()
    others = islice(paths_by_length(graph, marks), 1, None)
    yield from map(graph.found, others) if marks is None else zip(others, repeat(None))


def grown(hunt: Hunt) -> Graph:
    """The graph of the rows that are reached by at most `hunt.bound` steps."""
    if hunt.run.foreteller is not None:
        hunt.run.foreteller.begin(hunt)
    keeper = hunt.run.host.graphs
    memory = None if keeper is None else keeper.remembering(hunt)
    if memory is not None:
        with memory:
            return _grown(hunt, memory, None)
    way = way_back(hunt)
    if hunt.noted is None or (hunt.run.foreteller is None and (way is None or hunt.chooses)):
        return _grown(hunt, None, way)
    return _grown(hunt, Notes(hunt.noted), way)


def _grown(hunt: Hunt, notes: Notes | None, way: WayBack | None) -> Graph:
    """The same, with notes where there are some."""
    graph = hunt.run.graph = Graph(hunt.check, hunt.bound)
    hunt.flush()
    numbers: dict[Hashable, int] = {}
    level: list[Node] = [(0, *hunt.problem.starts[0])]
    levels = list[Level]()
    hunt.stats.levels, hunt.stats.backward = levels, []
    most = hunt.run.max_rows
    onward = partial(hunt.grow or grow, hunt.problem)
    if notes is not None:
        onward = partial(grow, replace(hunt.problem, expand=notes.noted.expand))
    while level and (hunt.bound is None or len(levels) < hunt.bound):
        depth, states = len(levels), [node[1:] for node in level]
        if way is not None:
            way = balanced(way, depth, states)
        rows, edges, steps_before = len(graph.rows), len(graph.targets), hunt.stats.generated
        leading = way if way and way.leads(depth) else None
        nodes: Nodes = level
        choose: Choose | None = None if leading is None else partial(leading.chosen, depth)
        if notes is not None:
            chosen = None if leading is None else [leading.chosen(depth, leading.items, state) for state in states]
            notes.begin_level(states, chosen)
            choose = notes
            if hunt.run.foreteller is not None:
                blocks = hunt.run.foreteller.blocks(states, notes, numbers)
                nodes = (node for _, node in zip(blocks, level, strict=True))
        level = onward(graph, nodes, numbers, sys.maxsize if most is None else most + 1, choose)
        if most is not None and len(graph.rows) - 1 > most:
            raise too_many(hunt.query, most)
        hunt.flush()
        edges = len(graph.targets) - edges
        levels.append(Level(len(graph.rows) - rows, edges, hunt.stats.generated - steps_before - edges))
    return graph


def grow(
    problem: Problem, graph: Graph, level: Nodes, seen: dict[Hashable, int], most: int, choose: Choose | None
) -> list[Node]:
    """One level of the graph: every step to a row is an edge, the first that leaves a trace makes it a node.

    Gives the nodes of the next level that go on. Ends early beyond `most` rows.
    """
    expand = problem.expand
    rows, goals, edges = graph.rows, graph.goals, graph.edges
    targets, weights, lasts = graph.targets, graph.weights, graph.lasts
    following = []
    for node, *state in level:
        first = len(targets)
        for row, key, goal, goes_on, after, weight, _, last in expand(state, seen, choose):
            if goal is not None:
                seen[key] = len(rows)
                rows.append(row)
                goals.append(goal)
                edges.append(())
                if goes_on:
                    following.append((seen[key], *after))
            targets.append(seen[key])
            if problem.weighed:
                weights.append(weight)
            if problem.keyed:
                lasts.append(last)
        edges[node] = range(first, len(targets))
        if len(rows) > most:
            break
    return following


def too_many(query: plan.Query, most: int) -> ExecutionError:
    """The error for a graph that does not fit."""
    hints = ("bound MEMORIZE, stop paths that lead nowhere with STOP WITH, or raise max_rows",)
    return ExecutionError("X010", f"the graph of MEMORIZE has more than max_rows={most} rows", query.span, hints)

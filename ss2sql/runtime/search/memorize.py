"""MEMORIZE: first the graph of rows, built breadth-first, then its paths without a repeated row, best first.

Each row is a node; its first visit by a step that leaves a trace makes it and fixes the state after it, and
it is expanded once. Every step to a row is an edge, so two elements that lead to the same row are two edges.
The graph grows by levels: a level are the rows that were first reached by so many steps.
"""

from __future__ import annotations

import sys
from collections.abc import Hashable, Iterator
from dataclasses import replace
from functools import partial
from itertools import islice, repeat

from ss2sql.errors import ExecutionError
from ss2sql.language import plan
from ss2sql.runtime.run.run_state import GraphLevel
from ss2sql.runtime.search.bidirectional import BackwardSearch, balance_backward_search, start_backward_search
from ss2sql.runtime.search.paths_by_length import PathsByLength
from ss2sql.runtime.search.paths_by_weight import PathsByWeight, can_search_by_length
from ss2sql.runtime.search.search_run import ChooseElements, Found, Node, Nodes, RowGraph, SearchRun
from ss2sql.runtime.search.step_contract import Notes, Problem


def run_memorize(search_run: SearchRun) -> Iterator[Found]:
    """The paths of at most `search_run.bound` steps: shortest, cheapest or likeliest first."""
    yield from iterate_graph_results(search_run, memorize_graph(search_run))


def iterate_graph_results(search_run: SearchRun, graph: RowGraph) -> Iterator[Found]:
    """The same paths, of a graph that was built before."""
    thaw = search_run.shapes.make_row_thaw()
    by_weight = search_run.order in ("cost", "probability")
    first = None if by_weight else graph.find_first_path()
    if not by_weight and first is None:
        return
    if first is not None:  # often the only one
        rows, last = graph.make_result(first)
        yield rows if thaw is None else thaw(rows), last
    if thaw is not None:
        graph.rows[1:] = thaw(graph.rows[1:])
    if by_weight:
        likeliest = search_run.order == "probability"
        alike = can_search_by_length(graph, likeliest)
        every = PathsByLength(graph) if alike else PathsByWeight(graph, graph.weights, likeliest)
        yield from map(graph.make_result, every.find_paths())
        return
    marks = graph.list_marks()
    others = islice(PathsByLength(graph, marks).find_paths(), 1, None)
    yield from map(graph.make_result, others) if marks is None else zip(others, repeat(None))


def memorize_graph(search_run: SearchRun) -> RowGraph:
    """The graph of the rows within `search_run.bound` steps."""
    if search_run.run.foreteller is not None:
        search_run.run.foreteller.begin_search(search_run)
    cache_policy = search_run.run.host.graphs
    memory = None if cache_policy is None else cache_policy.open_cached_graph(search_run)
    if memory is not None:
        with memory:
            return _memorize_graph(search_run, memory, None)
    backward = start_backward_search(search_run)
    if search_run.noted is None or (search_run.run.foreteller is None and (backward is None or search_run.chooses)):
        return _memorize_graph(search_run, None, backward)
    return _memorize_graph(search_run, Notes(search_run.noted), backward)


def _memorize_graph(search_run: SearchRun, notes: Notes | None, backward: BackwardSearch | None) -> RowGraph:
    graph = search_run.run.graph = RowGraph(search_run.check, search_run.bound)
    search_run.flush()
    numbers: dict[Hashable, int] = {}
    level: list[Node] = [(0, *search_run.problem.starts[0])]
    levels = list[GraphLevel]()
    search_run.stats.levels, search_run.stats.backward = levels, []
    most = search_run.run.max_rows
    onward = partial(search_run.grow or add_graph_level, search_run.problem)
    if notes is not None:
        onward = partial(add_graph_level, replace(search_run.problem, expand=notes.noted.expand))
    while level and (search_run.bound is None or len(levels) < search_run.bound):
        depth, states = len(levels), [node[1:] for node in level]
        if backward is not None:
            backward = balance_backward_search(backward, depth, states)
        rows, edges, steps_before = len(graph.rows), len(graph.targets), search_run.stats.generated
        leading = backward if backward and backward.has_all_states(depth) else None
        nodes: Nodes = level
        choose: ChooseElements | None = None if leading is None else partial(leading.choose_elements, depth)
        if notes is not None:
            chosen = None if leading is None else [leading.choose_elements(depth, leading.items, s) for s in states]
            notes.begin_level(states, chosen)
            choose = notes
            if search_run.run.foreteller is not None:
                blocks = search_run.run.foreteller.prefetch_blocks(states, notes, numbers)
                nodes = (node for _, node in zip(blocks, level, strict=True))
        level = onward(graph, nodes, numbers, sys.maxsize if most is None else most + 1, choose)
        if most is not None and len(graph.rows) - 1 > most:
            raise build_graph_limit_error(search_run.query, most)
        search_run.flush()
        edges = len(graph.targets) - edges
        levels.append(GraphLevel(len(graph.rows) - rows, edges, search_run.stats.generated - steps_before - edges))
    return graph


def add_graph_level(
    problem: Problem, graph: RowGraph, level: Nodes, seen: dict[Hashable, int], most: int, choose: ChooseElements | None
) -> list[Node]:
    """Adds one level to the graph: every step to a row is an edge, the first one that leaves a trace makes it a node.

    Gives the nodes of the next level that go on; ends early beyond `most` rows.
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


def build_graph_limit_error(query: plan.Query, most: int) -> ExecutionError:
    hints = ("bound MEMORIZE, stop paths that lead nowhere with STOP WITH, or raise max_rows",)
    return ExecutionError("X010", f"the graph of MEMORIZE has more than max_rows={most} rows", query.span, hints)

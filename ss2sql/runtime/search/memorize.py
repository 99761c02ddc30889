"""MEMORIZE: first the graph, built breadth-first, then its paths without a repeat.

Each row is a node; its first visit by a step that leaves a trace makes it and fixes the state after it, and
it is expanded once. Every step to a row is an edge, so two elements that lead to the same row are two edges.
The graph grows by levels: a level are the rows that were first reached by so many steps.

A node is a key, with the state of the first step to it that goes on. By rows the first step to a row decides whether it
stops and is a goal; after BY each step has a row, stop and goal of its own.
"""

from __future__ import annotations

import sys
from collections.abc import Hashable, Iterator
from dataclasses import field, replace
from functools import partial
from itertools import islice, repeat
from typing import Any

from ss2sql.errors import ExecutionError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.rows import Row
from ss2sql.language.values import State
from ss2sql.runtime.run.run_state import GraphLevel
from ss2sql.runtime.search.bidirectional import BackwardSearch, balance_backward_search, start_backward_search
from ss2sql.runtime.search.paths_by_length import PathsByLength
from ss2sql.runtime.search.paths_by_weight import PathsByWeight, can_search_by_length
from ss2sql.runtime.search.search_run import ChooseElements, Found, Node, Nodes, RowGraph, SearchRun
from ss2sql.runtime.search.step_contract import Notes, Problem


# --- MEMORIZE: first the graph of rows, built breadth-first, then its paths without a repeated row, best first
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
        yield from map(graph.make_result, _choose_graph_paths(graph, search_run.order).find_paths())
        return
    marks = graph.list_marks()
    others = islice(PathsByLength(graph, marks).find_paths(), 1, None)
    yield from map(graph.make_result, others) if marks is None else zip(others, repeat(None))


def _choose_graph_paths(graph: RowGraph, order: plan.Order) -> PathsByLength | PathsByWeight:
    likeliest = order == "probability"
    if order not in ("cost", "probability") or can_search_by_length(graph, likeliest):
        return PathsByLength(graph)
    return PathsByWeight(graph, graph.weights, likeliest)


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


# --- MEMORIZE where a step is more than an edge between rows: after BY, with several starts, or with what a path tells
@dataclass(slots=True)
class KeyedGraph(RowGraph):
    """A graph whose steps have rows and goals of their own.

    Node 0 leads to the starts. Every start is a node of its own, for its steps are first steps; every other node is a
    key. A step that is a goal leads to a node of its own that goes nowhere, and one that goes on to its key besides.
    `keys` are those to which edges lead, `shown` the rows of steps.
    """

    keys: list[Hashable] = field(default_factory=list)
    shown: list[Row] = field(default_factory=list)

    def add_node(self, goal: bool) -> int:
        self.rows.append(())
        self.goals.append(goal)
        self.edges.append(())
        return len(self.rows) - 1

    def add_edge(self, target: int, key: Hashable, row: Row, weight: Any, last: Any) -> None:
        self.targets.append(target)
        self.keys.append(key)
        self.shown.append(row)
        self.weights.append(weight)
        self.lasts.append(last)


def run_keyed_memorize(search_run: SearchRun) -> Iterator[Found]:
    """The same paths of such a search, without a repeated key."""
    assert search_run.query.search is not None
    if search_run.run.foreteller is not None:
        search_run.run.foreteller.refuse_search(search_run)
    graph, thaw = _build_keyed_graph(search_run), search_run.shapes.make_row_thaw() or tuple
    reader = None if search_run.noted is None or search_run.query.search.plain else PathRows(search_run)
    for path in _choose_graph_paths(graph, search_run.order).find_paths():
        *before, end = [graph.keys[edge] for edge in path]
        if end in before:  # a goal that repeats a key
            continue
        rows, lasts = list(thaw([graph.shown[edge] for edge in path[1:]])), [graph.lasts[edge] for edge in path[1:]]
        yield (rows, lasts[-1]) if reader is None else reader.read_rows(rows, lasts)


def _build_keyed_graph(search_run: SearchRun) -> KeyedGraph:
    """The graph, built level by level."""
    problem, query, bound = search_run.problem, search_run.query, search_run.bound
    assert query.search is not None
    by_row, most = query.search.by == "row", search_run.run.max_rows
    graph = KeyedGraph(search_run.check, None if bound is None else bound + 1)
    keys = [problem.key_of(start) if problem.visits else object() for start in problem.starts]
    # No path comes back to a key that all starts have, so it needs no node.
    nodes: dict[Hashable, int] = dict.fromkeys(keys, 0) if len(set(keys)) == 1 else {}
    level = []
    for start, key in zip(problem.starts, keys, strict=True):
        level.append((graph.add_node(False), start))
        graph.add_edge(level[-1][0], key, (), 1 if problem.likeliest else 0, None)
    graph.edges[0] = range(len(level))
    first_steps: dict[Hashable, tuple[Row, bool, bool]] = {}  # to rows: these, whether they are goals and go on
    reached, depth = set[Hashable](), 0
    while level and depth != bound:
        following: list[tuple[int, State]] = []
        for node, state in level:
            first = len(graph.targets)
            for row, key, goal, goes_on, after, weight, _, last in problem.expand(state, first_steps, None):
                reached.add(key)
                if most is not None and len(reached) > most:
                    raise build_graph_limit_error(query, most)
                if goal is None:
                    row, goal, goes_on = first_steps[key]
                    search_run.stats.pruned += 1
                elif key in nodes:
                    if problem.outdated:
                        problem.outdated(after, None)
                elif goes_on:
                    nodes[key] = graph.add_node(False)
                    following.append((nodes[key], after))
                if by_row:
                    first_steps[key] = row, goal, goes_on
                if goal:
                    graph.add_edge(graph.add_node(True), key, row, weight, last)
                if goes_on:
                    graph.add_edge(nodes[key], key, row, weight, last)
            graph.edges[node] = range(first, len(graph.targets))
        level, depth = following, depth + 1
    graph.twins = {node: nodes[key] for node, key in enumerate(keys, 1) if key in nodes}
    return graph


class PathRows:
    """Makes the rows of a path where they depend on it: a step belongs to many paths."""

    def __init__(self, search_run: SearchRun) -> None:
        search = search_run.query.search
        assert search is not None
        assert search_run.noted is not None
        self.noted, self.shapes, self.start = search_run.noted, search_run.shapes, search_run.problem.starts[0]
        self.carried = [place for place, (name, _) in enumerate(search.start) if _is_path_value(name)]
        # A column that was not compared is that of the step, the others are those of the first step to the row.
        compared = search.key if search.by == "row" else ()
        self.kept = [place for place, output in enumerate(search_run.query.columns) if output.expr in compared]

    def read_rows(self, rows: list[Row], lasts: list[Any]) -> Found:
        """The result for the rows of its steps, and their last parts."""
        sources, last = self.noted.sources, lasts[-1]
        carried = {place: self.start[place] for place in self.carried}
        for number, known in enumerate(lasts):
            state = list(known[sources:])
            for place, value in carried.items():
                state[place] = value
            last = (*known[:sources], *state)
            row, after = self._read_row(last)
            for place in self.kept:
                row[place] = rows[number][place]
            rows[number] = tuple(row)
            carried = {place: after[place] for place in carried}
        return rows, last

    def _read_row(self, last: tuple[Any, ...]) -> tuple[list[Any], State]:
        sources = self.noted.sources
        before, notes = self.shapes.freeze_state(last[sources:]), Notes(self.noted)
        before += self.start[len(before) :]  # whether it is a start, where first steps have a condition
        notes.begin_level([before], [[last[:sources] if sources > 1 else last[0]]])
        for _ in self.noted.expand(before, (), notes):
            pass
        (pairs,) = notes.pairs
        assert pairs is not None
        note = pairs[0][0]
        after = self.noted.after(note, last[sources:])
        assert after is not None
        return list(self.noted.row(note)), after


def has_path_rows(search: plan.Search) -> bool:
    """Whether the rows that are shown are those of one path."""
    return any(_is_path_value(name) for name, _ in search.start) or (search.by == "row" and bool(search.key))


def _is_path_value(variable: str) -> bool:
    """Whether a variable is carried for what a step says of its path."""
    return not variable.isidentifier()

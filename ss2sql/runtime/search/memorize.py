"""MEMORIZE: first the graph, built breadth-first, then its paths without a repeat.

Each row is a node; its first visit by a step that leaves a trace makes it and fixes the state after it, and
it is expanded once. Every step to a row is an edge, so two elements that lead to the same row are two edges.
The graph grows by levels: a level are the rows that were first reached by so many steps.

A node is a key, with the state of the first step to it that goes on. By rows the first step to a row decides whether it
stops and is a goal; after BY each step has a row, stop and goal of its own.
"""

from __future__ import annotations

import sys
from collections import deque
from collections.abc import Callable, Hashable, Iterator
from dataclasses import replace
from functools import partial
from heapq import heappop, heappush
from itertools import islice, repeat
from typing import Any, NamedTuple

from ss2sql.errors import ExecutionError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.rows import Row
from ss2sql.language.values import FrozenShapes, State, Thaw
from ss2sql.runtime.run.run_state import GraphLevel
from ss2sql.runtime.search.bidirectional import BackwardSearch, balance_backward_search, start_backward_search
from ss2sql.runtime.search.paths_by_length import PathsByLength
from ss2sql.runtime.search.paths_by_weight import PathsByWeight, can_search_by_length
from ss2sql.runtime.search.search_run import ChooseElements, Found, Node, Nodes, RowGraph, SearchRun
from ss2sql.runtime.search.step_contract import NotedSearch, Notes, Problem


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


# --- MEMORIZE where a step is more than an edge between rows: after BY, with several starts, or with what a path tell
ByNode = dict[Hashable, list["KeyedEdge"]]


class KeyedEdge(NamedTuple):
    """A step that leaves a trace, see runtime/search/step_contract.py."""

    row: Row
    key: Hashable
    goal: bool
    goes_on: bool
    weight: Any
    last: Any


@dataclass(frozen=True, slots=True)
class KeyedMemorize:
    """One run of such a search. `shown` makes rows, and the states after them, if rows depend on the path."""

    query: plan.Query
    problem: Problem
    bound: int | None
    check: Callable[[], None]
    most: int | None
    shapes: FrozenShapes
    shown: NotedSearch | None

    def find_paths(self) -> Iterator[Found]:
        """The paths without a repeated key: shortest, cheapest or likeliest first, ties in source order.

        Only steps from which a goal is still reachable within the bound extend a path.
        """
        problem, bound = self.problem, self.bound
        nodes, roots = self._build_graph()
        left = _search_goal_distances(nodes)
        thaw = self.shapes.make_row_thaw() or tuple
        # rank, place in source order, path, its keys, whether it is a result
        queue: list[tuple[Any, tuple[int, ...], list[KeyedEdge], tuple[Hashable, ...], bool]] = []
        for place, key in enumerate(roots):
            heappush(queue, (-1 if problem.likeliest else 0, (place,), [], (key,), False))
        while queue:
            self.check()
            rank, places, path, keys, result = heappop(queue)
            if result:
                yield self._make_result(path, thaw)
                continue
            if bound is not None and len(path) == bound:
                continue
            for place, edge in enumerate(nodes.get(keys[-1], ())):
                if edge.key in keys:
                    continue
                new = rank * edge.weight if problem.likeliest else rank + (edge.weight if problem.weighed else 1)
                longer, at = [*path, edge], (*places, place)
                if edge.goal:
                    heappush(queue, (new, at, longer, keys, True))
                far = left.get(edge.key)
                if edge.goes_on and far is not None and (bound is None or len(longer) + far <= bound):
                    heappush(queue, (new, (*at, 0), longer, (*keys, edge.key), False))

    def _build_graph(self) -> tuple[ByNode, list[Hashable]]:
        """The steps from each node, built level by level, and the nodes of the starts."""
        problem = self.problem
        by_row = self.query.search is not None and self.query.search.by == "row"
        nodes: ByNode = {}
        firsts: dict[Hashable, KeyedEdge] = {}  # by rows
        level = {problem.key_of(start) if problem.visits else object(): start for start in problem.starts}
        roots, seen, depth = list(level), set(level), 0
        reached: set[Hashable] = set()
        while level and depth != self.bound:
            following: dict[Hashable, Any] = {}
            for node, state in level.items():
                edges = nodes[node] = []
                for row, key, goal, goes_on, after, weight, _, last in problem.expand(state, firsts, None):
                    reached.add(key)
                    if self.most is not None and len(reached) > self.most:
                        raise build_graph_limit_error(self.query, self.most)
                    if goal is None:
                        edges.append(firsts[key]._replace(weight=weight, last=last))
                        continue
                    edge = KeyedEdge(row, key, goal, goes_on, weight, last)
                    edges.append(edge)
                    if by_row:
                        firsts[key] = edge
                    if key in seen:
                        if problem.outdated:
                            problem.outdated(after, None)
                    elif goes_on:
                        seen.add(key)
                        following[key] = after
            level, depth = following, depth + 1
        return nodes, roots

    def _make_result(self, path: list[KeyedEdge], thaw: Thaw) -> Found:
        """The result, with the rows of this path; a step belongs to many paths."""
        rows = list(thaw([edge.row for edge in path]))
        last = path[-1].last
        if self.shown is None:
            return rows, last
        search, sources = self.query.search, len(self.query.sources)
        assert search is not None
        carried = {
            place: self.problem.starts[0][place] for place, (name, _) in enumerate(search.start) if _is_path_value(name)
        }
        # A column that was not compared is that of the step, the others are those of the first step to the row.
        compared = search.key if search.by == "row" else ()
        kept = [place for place, output in enumerate(self.query.columns) if output.expr in compared]
        for number, edge in enumerate(path):
            state = list(edge.last[sources:])
            for place, value in carried.items():
                state[place] = value
            last = (*edge.last[:sources], *state)
            row, after = self._read_row(last)
            for place in kept:
                row[place] = rows[number][place]
            rows[number] = tuple(row)
            carried = {place: after[place] for place in carried}
        return rows, last

    def _read_row(self, last: tuple[Any, ...]) -> tuple[list[Any], State]:
        assert self.shown is not None
        sources = self.shown.sources
        before, notes = self.shapes.freeze_state(last[sources:]), Notes(self.shown)
        before += self.problem.starts[0][len(before) :]  # whether it is a start, where first steps have a condition
        notes.begin_level([before], [[last[:sources] if sources > 1 else last[0]]])
        for _ in self.shown.expand(before, (), notes):
            pass
        (pairs,) = notes.pairs
        assert pairs is not None
        note = pairs[0][0]
        after = self.shown.after(note, last[sources:])
        assert after is not None
        return list(self.shown.row(note)), after


def has_path_rows(search: plan.Search) -> bool:
    """Whether the rows that are shown are those of one path."""
    return any(_is_path_value(name) for name, _ in search.start) or (search.by == "row" and bool(search.key))


def _is_path_value(variable: str) -> bool:
    """Whether a variable is carried for what a step says of its path."""
    return not variable.isidentifier()


def _search_goal_distances(nodes: ByNode) -> dict[Hashable, int]:
    """The least number of steps from each node to a goal."""
    before: dict[Hashable, list[Hashable]] = {}
    found: dict[Hashable, int] = {}
    for node, edges in nodes.items():
        for edge in edges:
            if edge.goal:
                found[node] = 1
            if edge.goes_on:
                before.setdefault(edge.key, []).append(node)
    queue = deque(found)
    while queue:
        key = queue.popleft()
        for other in before.get(key, ()):
            if other not in found:
                found[other] = found[key] + 1
                queue.append(other)
    return found

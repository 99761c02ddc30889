"""MEMORIZE where a step is more than an edge between rows: after BY, with several starts, or with what a path tells.

A node is a key, with the state of the first step to it that goes on. By rows the first step to a row decides whether it
stops and is a goal; after BY each step has a row, stop and goal of its own.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Hashable, Iterator
from heapq import heappop, heappush
from typing import Any, NamedTuple

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.rows import Row
from ss2sql.language.values import FrozenShapes, State, Thaw
from ss2sql.runtime.search.memorize import build_graph_limit_error
from ss2sql.runtime.search.search_run import Found
from ss2sql.runtime.search.step_contract import NotedSearch, Notes, Problem

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

"""Hierarchical queries: section 6 of the language page, one method per order of search."""

from __future__ import annotations

import heapq
import itertools
from collections import deque
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ss2sql.frontend import ast

from . import groups, queries
from .sight import Frame
from .values import Failure, Row, arithmetic, frozen

if TYPE_CHECKING:
    from .evaluator import Reference

State = dict[str, Any]


@dataclass(frozen=True)
class Step:
    """A step that was not dropped: its row, the element and state before it (`frame`), and what follows."""

    row: Row
    frame: Frame
    stop: bool
    goal: bool
    weight: Any  # of COST or PROBABILITY, else None
    heuristic: Any
    after: State  # the state after CONNECT BY; of a step that stops: none
    key: Hashable  # the row as something that can be looked for


Path = tuple[Step, ...]
Seen = Callable[[Hashable], bool]


def check_bounds(ref: Reference, query: ast.Query, outer: Frame | None) -> None:
    """MAXIMUM and MEMORIZE are whole numbers, also where nothing is searched for."""
    for option in query.options:
        if option.keyword in ("MAXIMUM", "MEMORIZE") and option.argument is not None:
            queries.at_least(1, ref.evaluate(option.argument, outer))


def check(query: ast.Query) -> None:
    """The options of CONNECT BY that contradict each other, and clauses that need CONNECT BY."""
    if not query.connect and (query.start or query.stop is not None):
        raise Failure("R012")
    words = [option.keyword for option in query.options]
    queries.no_repeats(words)
    queries.no_repeats([assign.name for assign in query.start])
    orders = {"DEPTH FIRST", "BREADTH FIRST", "COST", "PROBABILITY"}.intersection(words)
    guards = {"NO CYCLE", "UNIQUE", "MEMORIZE"}.intersection(words)
    if len(orders) > 1 or (len(guards) > 1 and guards != {"NO CYCLE", "UNIQUE"}):
        raise Failure("R010")
    if "MEMORIZE" in guards and orders & {"DEPTH FIRST", "BREADTH FIRST"}:
        raise Failure("R010")
    if "HEURISTIC" in words and "COST" not in words:
        raise Failure("R010")


class Search:
    """One run of a query with CONNECT BY."""

    def __init__(self, ref: Reference, query: ast.Query, outer: Frame | None) -> None:
        self.ref, self.query, self.outer = ref, query, outer
        self.options = {option.keyword: option.argument for option in query.options}
        self.unique = "UNIQUE" in self.options
        self.no_cycle = "NO CYCLE" in self.options and not self.unique
        self.memorize = "MEMORIZE" in self.options
        self.maximum = self.number("MAXIMUM")
        self.depth = self.number("MEMORIZE")
        self.start = self.assigned(query.start, {}, outer)
        self.sources = queries.Sources(ref, query, outer, self.start)
        self.per_group = self.sources.per_group()
        self.compares = self.unique or self.no_cycle or self.memorize
        if self.compares and any(groups.calls_in(ref, query.columns)) and query.group:
            raise Failure("R008", "an aggregate in a row that the search compares")

    def number(self, keyword: str) -> int | None:
        argument = self.options.get(keyword)
        return None if argument is None else queries.at_least(1, self.ref.evaluate(argument, self.outer))

    def assigned(self, assigns: tuple[ast.Assign, ...], state: State, outer: Frame | None, bound: Any = ()) -> State:
        """The state after assignments in their order, a later one seeing an earlier one."""
        state = dict(state)
        for assign in assigns:
            state[assign.name] = self.ref.evaluate(assign.value, Frame(outer, state, bound))
        return state

    def paths(self) -> Iterator[tuple[list[Row], Frame]]:
        """The results in their order: the rows of each path with the frame of its last step."""
        found = itertools.islice(self.method()(), self.maximum)
        return ((self.rows_of(path), path[-1].frame) for path in found)

    @staticmethod
    def rows_of(path: Path) -> list[Row]:
        return [step.row for step in path]

    def method(self) -> Callable[[], Iterator[Path]]:
        if self.memorize:
            return self.memorized
        if "COST" in self.options or "PROBABILITY" in self.options:
            return self.best_first
        if "BREADTH FIRST" in self.options or (self.unique and "DEPTH FIRST" not in self.options):
            return self.breadth_first
        return lambda: self.depth_first((), self.start, set())

    # One step

    def elements(self, state: State) -> Iterator[Frame]:
        """The product of the sources in a state; every element is a step that is generated."""
        for frame in self.sources.product(Frame(self.outer, state)):
            self.ref.steps += 1
            yield frame

    def step(self, frame: Frame, seen: Seen) -> Step | None:
        """One step, its clauses in the order of section 7; None when it is dropped.

        `seen` says of a row whether it repeats one that must not occur again.
        """
        row: Row | None = None
        if self.compares:
            row = queries.select(self.ref, self.query, frame)
            if seen(row_key(row)):
                return None
        return self.judged(frame, row)

    def judged(self, frame: Frame, row: Row | None) -> Step | None:
        """The rest of a step whose row, where one is compared, is new."""
        query, ref = self.query, self.ref
        stop = query.stop is not None and bool(ref.evaluate(query.stop, frame))
        goal = bool(ref.evaluate(query.where, frame)) if query.where is not None else not stop
        if stop and not goal:
            return None  # it leaves no trace
        if row is None:
            row = [] if self.per_group else queries.select(ref, query, frame)
        weight = self.weight(frame)
        if "PROBABILITY" in self.options and weight == 0:
            return None
        heuristic = 0 if stop else self.heuristic(frame)
        after = {} if stop else self.connected(frame)
        return Step(row, frame, stop, goal, weight, heuristic, after, row_key(row))

    def connected(self, frame: Frame) -> State:
        """CONNECT BY: assignments to START WITH variables."""
        for assign in self.query.connect:
            if assign.name not in self.start:
                raise Failure("R001", assign.name)
        return self.assigned(self.query.connect, frame.state, frame.outer, frame.bound)

    def weight(self, frame: Frame) -> Any:
        """COST, at least 0, or PROBABILITY, 0 to 1."""
        if "COST" in self.options:
            return self.positive("COST", frame)
        if "PROBABILITY" not in self.options:
            return None
        probability = self.positive("PROBABILITY", frame)
        if probability > 1:
            raise Failure("X006", "a probability above 1")
        return probability

    def heuristic(self, frame: Frame) -> Any:
        return self.positive("HEURISTIC", frame) if "HEURISTIC" in self.options else 0

    def positive(self, keyword: str, frame: Frame) -> Any:
        argument = self.options[keyword]
        assert argument is not None
        value = self.ref.evaluate(argument, frame)
        if not isinstance(value, (int, float)) or value < 0:
            raise Failure("X006", f"{keyword} {value!r}")
        return value

    # Orders

    def depth_first(self, path: Path, state: State, reached: set[Hashable]) -> Iterator[Path]:
        """Default and DEPTH FIRST: a step is given out, then followed, before its next sibling is evaluated."""
        for frame in self.elements(state):
            step = self.step(frame, self.seen(path, reached))
            if step is None:
                continue
            reached.add(step.key)
            if step.goal:
                yield (*path, step)
            if not step.stop:
                yield from self.depth_first((*path, step), step.after, reached)

    def breadth_first(self) -> Iterator[Path]:
        """BREADTH FIRST, and UNIQUE without an order: the oldest path is extended first."""
        reached: set[Hashable] = set()
        queue: deque[tuple[Path, State]] = deque([((), self.start)])
        while queue:
            path, state = queue.popleft()
            for frame in self.elements(state):
                step = self.step(frame, self.seen(path, reached))
                if step is None:
                    continue
                reached.add(step.key)
                if step.goal:
                    yield (*path, step)
                if not step.stop:
                    queue.append(((*path, step), step.after))

    def seen(self, path: Path, reached: set[Hashable]) -> Seen:
        """UNIQUE: whether a row was reached at all; NO CYCLE: whether it is on the path."""
        if self.unique:
            return lambda key: key in reached
        return lambda key: any(key == step.key for step in path)

    def best_first(self) -> Iterator[Path]:
        """COST and PROBABILITY: the cheapest, respectively likeliest, entry of the queue is taken first.

        A step has two entries: its result at its total cost, and its expansion at its total cost plus the
        heuristic. Among equals the step that was generated first comes first, its result before its expansion. Of
        UNIQUE a row belongs to the cheapest path to it, of several to that whose last step was generated first, even
        if the estimate of another one is lower.
        """
        likeliest = "PROBABILITY" in self.options
        generation = itertools.count(1)
        given: set[Hashable] = set()
        taken: dict[Hashable, tuple[Any, int]] = {}  # rows given out or expanded: best rank, and by which step
        known: dict[Hashable, tuple[Any, int]] = {}  # the same of all paths that have been found
        queue: list[tuple[Any, int, int, Any, Path, State]] = []  # rank, step, 0 result or 1 expansion, total, path
        heapq.heappush(queue, (0, 0, 1, 1 if likeliest else 0, (), self.start))
        while queue:
            _, number, expansion, total, path, state = heapq.heappop(queue)
            if self.unique and path:
                key, rank = path[-1].key, -total if likeliest else total
                if known[key] < (rank, number):
                    continue  # though its estimate may hide by how little it is worse
                best, by = taken.get(key, (rank, number))
                if by != number and best <= rank:
                    continue  # another path to this row was as good
                taken[key] = (rank, number)
                if not expansion and key in given:
                    continue
            if not expansion:
                given.add(path[-1].key)
                yield path
                continue
            here = -total if likeliest else total
            for frame in self.elements(state):
                # With a heuristic a row may come again, more cheaply; without one what was taken is final.
                closed = {key for key, (best, _) in taken.items() if best <= here}
                step = self.step(frame, self.seen(path, closed))
                if step is None:
                    continue
                number, longer = next(generation), (*path, step)
                reached = self.combined(total, step.weight)
                rank = -reached if likeliest else reached
                known[step.key] = min((rank, number), known.get(step.key, (rank, number)))
                if step.goal:
                    heapq.heappush(queue, (rank, number, 0, reached, longer, step.after))
                if not step.stop:
                    rank = arithmetic(lambda a, b: a + b, rank, step.heuristic)
                    heapq.heappush(queue, (rank, number, 1, reached, longer, step.after))

    def combined(self, total: Any, weight: Any) -> Any:
        """The sum of costs, or the product of probabilities, from left to right."""
        if "PROBABILITY" in self.options:
            return arithmetic(lambda a, b: a * b, total, weight)
        return arithmetic(lambda a, b: a + b, total, weight)

    # MEMORIZE

    def memorized(self) -> Iterator[Path]:
        """MEMORIZE: the graph first, then its simple paths by length (or cost, or probability) and source order."""
        found = list(self.walks((), self.graph(), ()))  # in source order, a path before its continuations
        if "COST" in self.options or "PROBABILITY" in self.options:
            sign = -1 if "PROBABILITY" in self.options else 1
            found.sort(key=lambda path: sign * self.total(path))
        else:
            found.sort(key=len)
        return iter(found)

    def graph(self) -> Node:
        """The graph of rows, built breadth-first: each node above the last level is expanded once."""
        root = Node(None, self.start, 0, [])
        nodes: dict[Hashable, Node] = {}
        queue = deque([root])
        while queue:
            node = queue.popleft()
            if node.level == self.depth:
                continue
            for frame in self.elements(node.after):
                row = queries.select(self.ref, self.query, frame)
                known = nodes.get(row_key(row))
                if known is not None:
                    weight = self.weight(frame)
                    if "PROBABILITY" not in self.options or weight > 0:
                        node.edges.append(Edge(frame, weight, known))
                    continue
                step = self.judged(frame, row)
                if step is None:
                    continue
                new = Node(step, step.after, node.level + 1, [])
                nodes[step.key] = new
                node.edges.append(Edge(frame, step.weight, new))
                if not step.stop:
                    queue.append(new)
        return root

    def walks(self, path: Path, node: Node, visited: tuple[Node, ...]) -> Iterator[Path]:
        """All paths without a repeated row that go on from a node and end in a goal."""
        if len(path) == self.depth:
            return
        for edge in node.edges:
            first = edge.target.step
            assert first is not None
            if any(edge.target is other for other in visited):
                continue
            longer = (*path, replace(first, frame=edge.frame, weight=edge.weight))
            if first.goal:
                yield longer
            yield from self.walks(longer, edge.target, (*visited, edge.target))

    def total(self, path: Path) -> Any:
        total: Any = 1 if "PROBABILITY" in self.options else 0
        for step in path:
            total = self.combined(total, step.weight)
        return total


@dataclass(frozen=True)
class Node:
    """A row of MEMORIZE's graph: the step that met it first (the root has none), its state, level and edges."""

    step: Step | None
    after: State
    level: int
    edges: list[Edge]


@dataclass(frozen=True)
class Edge:
    """A step to a row, made in the state of the row that it comes from."""

    frame: Frame
    weight: Any
    target: Node


def row_key(row: Row) -> Hashable:
    return tuple(frozen(value) for _, value in row)

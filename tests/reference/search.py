"""Hierarchical queries: section 6 of the language page, one method per order of search."""

from __future__ import annotations

import heapq
import itertools
from collections import deque
from collections.abc import Callable, Hashable, Iterator
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

from ss2sql.frontend.syntax import ast

from . import groups, paths, queries
from .sight import Frame, elements_of, mentions
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
    after: State  # the state after CONNECT BY; of a step that stops without a goal: none
    key: Hashable  # what is compared, as something that can be looked for


Path = tuple[Step, ...]
Seen = Callable[[Hashable], bool]


@dataclass(frozen=True)
class Way:
    """A path with the state that it started in."""

    start: State
    steps: Path = ()

    def longer(self, step: Step) -> Way:
        return Way(self.start, (*self.steps, step))


def check_bounds(ref: Reference, query: ast.Query, outer: Frame | None) -> None:
    """MAXIMUM and MEMORIZE are whole numbers, also where nothing is searched for."""
    for option in query.options:
        if option.keyword in ("MAXIMUM", "MEMORIZE") and option.argument is not None:
            queries.at_least(1, ref.operand(option.argument, outer))


def check(query: ast.Query) -> None:
    """The options of CONNECT BY that contradict each other, and clauses that need CONNECT BY."""
    hierarchical = query.start or query.first is not None or query.stop is not None or query.siblings or query.last
    if not query.searches and hierarchical:
        raise Failure("R012")
    words = [option.keyword for option in query.options]
    queries.no_repeats(words)
    queries.no_repeats([item.name for item in query.start])
    orders = {"DEPTH FIRST", "BREADTH FIRST", "COST", "PROBABILITY"}.intersection(words)
    guards = {"NO CYCLE", "UNIQUE", "MEMORIZE"}.intersection(words)
    if len(orders) > 1 or (len(guards) > 1 and guards != {"NO CYCLE", "UNIQUE"}):
        raise Failure("R010")
    if "MEMORIZE" in guards and orders & {"DEPTH FIRST", "BREADTH FIRST"}:
        raise Failure("R010")
    if "HEURISTIC" in words and "COST" not in words and (orders or "MEMORIZE" in guards):
        raise Failure("R010")


class Search:
    """One run of a query with CONNECT BY."""

    def __init__(self, ref: Reference, query: ast.Query, outer: Frame | None) -> None:
        self.ref, self.query, self.outer = ref, query, outer
        self.options = {option.keyword: option.argument for option in query.options}
        self.unique = "UNIQUE" in self.options
        self.no_cycle = "NO CYCLE" in self.options and not self.unique
        self.memorize = "MEMORIZE" in self.options
        self.compares = self.unique or self.no_cycle or self.memorize
        guard = "UNIQUE" if self.unique else "NO CYCLE" if self.no_cycle else "MEMORIZE"
        self.by = next((option.by for option in query.options if option.keyword == guard), ())
        self.maximum = self.number("MAXIMUM")
        self.depth = self.number("MEMORIZE")
        self.starts = list(self.first_states(0, {}))
        self.start = self.starts[0] if self.starts else {}
        self.variables = [item.name for item in query.start]
        self.sources = queries.Sources(ref, query, outer, dict.fromkeys(self.variables))
        for assign in query.connect:
            if assign.name not in self.variables:
                raise Failure("R001", assign.name)
        self.per_group = self.sources.per_group()
        self.reads_state = bool(self.by) and not self.reads_elements(self.by)
        if self.compares and not self.by and any(groups.calls_in(ref, query.columns)) and query.group:
            raise Failure("R008", "an aggregate in a row that the search compares")
        if self.compares and not self.by and all(paths.asks(ref, column) for column in query.columns):
            raise Failure("R010", "every column asks for the path")

    def reads_elements(self, node: Any) -> bool:
        """Whether an expression mentions the elements of the sources."""
        own = self.sources.own(len(self.query.sources))

        def elsewhere(name: str) -> bool:
            return name in self.variables or own.elsewhere(name)

        return mentions(node, replace(own, states=frozenset(), elsewhere=elsewhere))

    def number(self, keyword: str) -> int | None:
        argument = self.options.get(keyword)
        return None if argument is None else queries.at_least(1, self.ref.operand(argument, self.outer))

    def first_states(self, number: int, state: State) -> Iterator[State]:
        """The START WITH states: one for each combination of what EACH walks, the last one varying fastest."""
        if number == len(self.query.start):
            yield state
            return
        item = self.query.start[number]
        frame = Frame(self.outer, state)
        if isinstance(item, ast.Each):
            found = elements_of(self.ref.values_of(item.values, frame))
        else:
            found = [self.ref.evaluate(item.value, frame)]
        for value in found:
            yield from self.first_states(number + 1, {**state, item.name: value})

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
        if "COST" in self.options or "PROBABILITY" in self.options or "HEURISTIC" in self.options:
            return self.best_first
        if "BREADTH FIRST" in self.options or (self.unique and "DEPTH FIRST" not in self.options):
            return self.breadth_first
        return self.all_depth_first

    # One step

    def elements(self, state: State, path: Path = (), first: bool | None = None) -> Iterator[Frame]:
        """The elements of the sources in a state for which a step is made; every element is generated."""
        made = self.made(state, tuple(step.frame for step in path), not path if first is None else first)
        return iter(self.in_order(list(made))) if self.query.siblings else made

    def made(self, state: State, before: tuple[Frame, ...], first: bool) -> Iterator[Frame]:
        """Those that meet the condition of CONNECT BY, of first steps that of START WITH."""
        condition = self.query.first if first and self.query.first is not None else self.query.made
        for frame in self.sources.product(Frame(self.outer, state, search=self, before=before)):
            self.ref.steps += 1
            if condition is None or self.ref.evaluate(condition, frame):
                yield frame

    def in_order(self, made: list[Frame]) -> list[Frame]:
        """ORDER SIBLINGS BY."""
        found = []
        for frame in made:
            keys = [queries.Key(self.ref.alone(key.expr, frame), key) for key in self.query.siblings]
            found.append(queries.Found([], frame, [], [], keys))
        return [one.frame for one in queries.in_order(found)]

    def step(self, frame: Frame, seen: Seen) -> Step | None:
        """One step, its clauses in the order of section 7; None when it is dropped.

        `seen` says of a row or key whether it repeats one that must not occur again.
        """
        row: Row | None = None
        if self.compares and not self.by:
            row = queries.select(self.ref, self.query, frame)
            if seen(self.row_key(row)):
                return None
        step = self.judged(frame, row)
        return None if step is not None and self.by and seen(step.key) else step

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
        after = self.connected(frame) if not stop or self.reads_state else {}
        return Step(row, frame, stop, goal, weight, heuristic, after, self.key(frame, after, row))

    def key(self, frame: Frame, after: State, row: Row) -> Hashable:
        """What is compared: the row without what asks for the path, or what BY names."""
        if not self.by:
            return self.row_key(row)
        return self.key_of_state(after) if self.reads_state else self.values_of_key(frame)

    def key_of_state(self, state: State) -> Hashable:
        return self.values_of_key(Frame(self.outer, state))

    def values_of_key(self, frame: Frame) -> Hashable:
        return tuple(frozen(self.ref.evaluate(part, frame)) for part in self.by)

    def row_key(self, row: Row) -> Hashable:
        asks = [paths.asks(self.ref, column) for column in self.query.columns]
        asks = asks if len(asks) == len(row) else [False] * len(row)  # a star stands alone
        return tuple(frozen(value) for (_, value), says in zip(row, asks, strict=True) if not says)

    def connected(self, frame: Frame) -> State:
        """CONNECT BY: assignments to START WITH variables, in their order, a later one seeing an earlier one."""
        state = dict(frame.state)
        for assign in self.query.connect:
            state[assign.name] = self.ref.evaluate(assign.value, replace(frame, state=dict(state)))
        return state

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
        value = self.ref.operand(argument, frame)
        if not isinstance(value, (int, float)) or value < 0:
            raise Failure("X006", f"{keyword} {value!r}")
        return value

    # Orders

    def all_depth_first(self) -> Iterator[Path]:
        """Default and DEPTH FIRST, from one start after the other."""
        reached: set[Hashable] = set()
        for start in self.starts:
            if self.is_new(start, reached):
                yield from self.depth_first(Way(start), start, reached)

    def is_new(self, start: State, reached: set[Hashable]) -> bool:
        """Whether a search with UNIQUE BY starts in this state, which then counts as visited."""
        if not (self.unique and self.reads_state):
            return True
        key = self.key_of_state(start)
        if key in reached:
            return False
        reached.add(key)
        return True

    def depth_first(self, way: Way, state: State, reached: set[Hashable]) -> Iterator[Path]:
        """A step is given out, then followed, before its next sibling is evaluated."""
        for frame in self.elements(state, way.steps):
            step = self.step(frame, self.seen(way, reached))
            if step is None:
                continue
            reached.add(step.key)
            longer = way.longer(step)
            if step.goal:
                yield longer.steps
            if not step.stop:
                yield from self.depth_first(longer, step.after, reached)

    def breadth_first(self) -> Iterator[Path]:
        """BREADTH FIRST, and UNIQUE without an order: the oldest path is extended first."""
        reached: set[Hashable] = set()
        queue: deque[tuple[Way, State]] = deque(
            (Way(start), start) for start in self.starts if self.is_new(start, reached)
        )
        while queue:
            way, state = queue.popleft()
            for frame in self.elements(state, way.steps):
                step = self.step(frame, self.seen(way, reached))
                if step is None:
                    continue
                reached.add(step.key)
                longer = way.longer(step)
                if step.goal:
                    yield longer.steps
                if not step.stop:
                    queue.append((longer, step.after))

    def seen(self, way: Way, reached: set[Hashable]) -> Seen:
        """UNIQUE: whether a row or key was reached at all; NO CYCLE: whether it is on the path."""
        if self.unique:
            return lambda key: key in reached
        if not self.no_cycle:
            return lambda key: False
        before = [step.key for step in way.steps]
        if self.reads_state:
            before.append(self.key_of_state(way.start))
        return lambda key: any(key == other for other in before)

    def best_first(self) -> Iterator[Path]:
        """COST and PROBABILITY: the cheapest, respectively likeliest, entry of the queue is taken first.

        A step has two entries: its result at its total cost, and its expansion at its total cost plus the
        heuristic. Among equals the one with the smaller estimate comes first, then the step that was generated first,
        its result before its expansion. Of UNIQUE a row belongs to the cheapest path to it, of several to that whose
        last step was generated first, even if the estimate of another one is lower.

        HEURISTIC alone: the smallest estimate is expanded first, and a result is given out when it is generated.
        """
        likeliest, greedy = "PROBABILITY" in self.options, not {"PROBABILITY", "COST"} & self.options.keys()
        generation = itertools.count(1)
        given: set[Hashable] = set()
        taken: dict[Hashable, tuple[Any, int]] = {}  # rows given out or expanded: best rank, and by which step
        known: dict[Hashable, tuple[Any, int]] = {}  # the same of all paths that have been found
        # rank, estimate, step, 0 result or 1 expansion, total, path, state
        queue: list[tuple[Any, Any, int, int, Any, Way, State]] = []
        for number, start in enumerate(self.starts, -len(self.starts)):
            rank = -1 if likeliest else 0
            if self.unique and self.reads_state:
                key = self.key_of_state(start)
                if key in known:
                    continue
                known[key] = taken[key] = rank, number
            heapq.heappush(queue, (rank, 0, number, 1, 1 if likeliest else 0, Way(start), start))
        while queue:
            _, _, number, expansion, total, way, state = heapq.heappop(queue)
            if self.unique and way.steps and not greedy:
                key, rank = way.steps[-1].key, -total if likeliest else total
                if known[key] < (rank, number):
                    continue  # though its estimate may hide by how little it is worse
                best, by = taken.get(key, (rank, number))
                if by != number and best <= rank:
                    continue  # another path to this row was as good
                taken[key] = (rank, number)
                if not expansion and key in given:
                    continue
            if not expansion:
                given.add(way.steps[-1].key)
                yield way.steps
                continue
            here = -total if likeliest else total
            for frame in self.elements(state, way.steps):
                # With a heuristic a row may come again, more cheaply; without one what was taken is final.
                closed = set(known) if greedy else {key for key, (best, _) in taken.items() if best <= here}
                step = self.step(frame, self.seen(way, closed))
                if step is None:
                    continue
                number, longer = next(generation), way.longer(step)
                reached = 0 if greedy else self.combined(total, step.weight)
                rank = -reached if likeliest else reached
                known[step.key] = min((rank, number), known.get(step.key, (rank, number)))
                if step.goal and greedy:
                    yield longer.steps
                elif step.goal:
                    heapq.heappush(queue, (rank, 0, number, 0, reached, longer, step.after))
                if not step.stop:
                    estimate = step.heuristic
                    rank = arithmetic(lambda a, b: a + b, rank, estimate)
                    heapq.heappush(queue, (rank, estimate, number, 1, reached, longer, step.after))

    def combined(self, total: Any, weight: Any) -> Any:
        """The sum of costs, or the product of probabilities, from left to right."""
        if "PROBABILITY" in self.options:
            return arithmetic(lambda a, b: a * b, total, weight)
        return arithmetic(lambda a, b: a + b, total, weight)

    # MEMORIZE

    def memorized(self) -> Iterator[Path]:
        """MEMORIZE: the graph first, then its simple paths by length (or cost, or probability) and source order."""
        nodes, roots = self.graph()
        found = [
            path for root, key in roots for path in self.walks((), root, nodes, (key,))
        ]  # a path before what continues it
        if "COST" in self.options or "PROBABILITY" in self.options:
            sign = -1 if "PROBABILITY" in self.options else 1
            found.sort(key=lambda path: sign * self.total(path))
        else:
            found.sort(key=len)
        return iter([self.shown(path) for path in found])

    def graph(self) -> tuple[dict[Hashable, list[Step]], list[tuple[Hashable, Hashable]]]:
        """The steps from each node, built breadth-first, and the nodes of the starts with their keys.

        A start is a node of its own. Any other node is a row, or a key, whose state is that of the first step to it
        that goes on. By rows the first step to a row decides whether it stops and is a goal; with BY each step has a
        row, stop and goal of its own.
        """
        nodes: dict[Hashable, list[Step]] = {}
        firsts: dict[Hashable, Step] = {}
        level: list[tuple[Hashable, State]] = [(("start", number), start) for number, start in enumerate(self.starts)]
        roots = [(node, self.key_of_state(start) if self.reads_state else node) for node, start in level]
        seen, depth = {key for _, key in roots}, 0
        if len(seen) > 1:  # a path from one start may come to another
            seen.clear()
        while level and depth != self.depth:
            following: list[tuple[Hashable, State]] = []
            for key, state in level:
                nodes[key] = []
                for frame in self.elements(state, first=depth == 0):
                    row = None if self.by else queries.select(self.ref, self.query, frame)
                    first = None if row is None else firsts.get(self.row_key(row))
                    if first is not None:
                        weight = self.weight(frame)
                        if "PROBABILITY" not in self.options or weight > 0:
                            nodes[key].append(replace(first, frame=frame, weight=weight))
                        continue
                    step = self.judged(frame, row)
                    if step is None:
                        continue
                    nodes[key].append(step)
                    firsts[step.key] = step
                    if not step.stop and step.key not in seen:
                        seen.add(step.key)
                        following.append((step.key, step.after))
            level, depth = following, depth + 1
        return nodes, roots

    def walks(
        self, path: Path, key: Hashable, nodes: dict[Hashable, list[Step]], visited: tuple[Hashable, ...]
    ) -> Iterator[Path]:
        """All paths without a repeated row or key that go on from a node and end in a goal."""
        if len(path) == self.depth:
            return
        for step in nodes.get(key, ()):
            if any(step.key == other for other in visited):
                continue
            longer = (*path, step)
            if step.goal:
                yield longer
            if not step.stop:
                yield from self.walks(longer, step.key, nodes, (*visited, step.key))

    def shown(self, path: Path) -> Path:
        """The path with columns that ask for it."""
        asks = [not self.per_group and paths.asks(self.ref, column) for column in self.query.columns]
        frames: list[Frame] = []
        steps = []
        for step in path:
            frames.append(replace(step.frame, before=tuple(frames)))
            row = step.row
            if any(asks):
                new = queries.select(self.ref, self.query, frames[-1])
                row = [pair if says else old for pair, old, says in zip(new, row, asks, strict=True)]
            steps.append(replace(step, row=row, frame=frames[-1]))
        return tuple(steps)

    def total(self, path: Path) -> Any:
        total: Any = 1 if "PROBABILITY" in self.options else 0
        for step in path:
            total = self.combined(total, step.weight)
        return total

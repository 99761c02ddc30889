"""Searches as plain loops over the steps from a state: those of native/step_functions.py.

A step that leaves a trace is a `Step`. What was met is known by keys: rows, or what BY names. Where BY names the state
reached, the start counts as visited.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Container, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from heapq import heappop, heappush
from itertools import count
from typing import Any, NamedTuple, TypeAlias

from ss2sql import plan
from ss2sql.runtime.ordering import sort_rows
from ss2sql.runtime.rows import Row
from ss2sql.runtime.run import Run
from ss2sql.runtime.search.contract import exceeds

State: TypeAlias = tuple[Any, ...]
Last: TypeAlias = tuple[Any, ...]  # the elements of a step and the state before it
Keys: TypeAlias = Callable[[Last], Row] | None
Seen: TypeAlias = Container[Hashable]


class Step(NamedTuple):
    """A step that leaves a trace: `state` is the one after it, `weight` its cost, its probability or 1."""

    row: Row
    key: Hashable
    stop: bool
    goal: bool
    weight: Any
    estimate: Any
    state: State
    last: Last


class Way:
    """A path, by its last step and the way to the step before it; `start` is the state where it begins."""

    __slots__ = ("before", "length", "start", "step")

    def __init__(self, start: State, before: Way | None = None, step: Step | None = None) -> None:
        self.start = start
        self.before = before
        self.step = step
        self.length: int = 0 if before is None else before.length + 1

    def longer(self, step: Step) -> Way:
        return Way(self.start, self, step)

    def steps(self) -> list[Step]:
        """The steps from the first to the last."""
        found: list[Step] = []
        way: Way | None = self
        while way is not None and way.step is not None:
            found.append(way.step)
            way = way.before
        return found[::-1]


@dataclass(frozen=True, slots=True)
class Steps:
    """The steps of one search, by functions that are generated.

    `elements(state)` gives the elements that meet the condition of CONNECT BY, as what the others take; `first` those
    of first steps, where START WITH has a condition. `key` takes a step and its row, or the state reached. The others
    see `Pieces` in memorize/pieces.py. `tells`: the row of any step can be made, and nobody could notice.
    """

    run: Run
    query: plan.Query
    elements: Callable[[State], Iterator[Last]]
    first: Callable[[State], Iterator[Last]] | None
    row: Callable[[Last], Row]
    key: Callable[..., Hashable] | None
    ends: Callable[[Last, Row | None, State | None], bool] | None
    is_goal: Callable[[Last, Row | None, State | None], bool] | None
    weigh: Callable[[Last, Row], Any] | None
    estimate: Callable[[Last, Row], Any] | None
    follow: Callable[[Last, Row], State]
    siblings: Callable[[Last], Row] | None
    tells: bool = False

    @property
    def search(self) -> plan.Search:
        assert self.query.search is not None
        return self.query.search

    @property
    def visits_start(self) -> bool:
        return self.search.by == "state" and self.search.repeats != "allowed"

    def key_of_start(self, state: State) -> Hashable:
        """The key of a start, which a start has where BY names the state reached."""
        assert self.key is not None
        return self.key(state)

    def expand(self, way: Way, state: State, seen: Seen, firsts: dict[Hashable, Step] | None = None) -> Iterator[Step]:
        """The steps from a state, but for those whose keys were seen; `firsts` see `edge`."""
        for last in self.lasts(way, state):
            step = self.step(last, seen) if firsts is None else self.edge(last, firsts)
            if step is not None:
                yield step

    def lasts(self, way: Way, state: State) -> Iterable[Last]:
        """The elements that make a step from a state, in their order."""
        elements = self.elements if self.first is None or way.step is not None else self.first
        return self.in_order(elements(state))

    def in_order(self, lasts: Iterator[Last]) -> Iterable[Last]:
        """The elements of a state as ORDER SIBLINGS BY has them."""
        if self.siblings is None:
            return lasts
        every = list(lasts)
        keys = self.search.siblings
        return sort_rows(every, list(map(self.siblings, every)), tuple(key.descending for key in keys))

    def step(self, last: Last, seen: Seen, row: Row | None = None) -> Step | None:
        """The step to an element, with its row where that is known; None where it leaves no trace, or was seen."""
        by = self.search.by
        key: Hashable = None
        if self.key is not None and by == "row":
            row = self.row(last) if row is None else row
            key = self.key(last, row)
            if key in seen:
                self.dropped()
                return None
        stop = self.ends is not None and self.ends(last, row, None)
        goal = not stop if self.is_goal is None else self.is_goal(last, row, None)
        if stop and not goal:
            return None
        row = self.row(last) if row is None else row
        weight = 1 if self.weigh is None else self.weigh(last, row)
        if not weight and self.search.order == "probability":
            return None
        estimate = 0 if stop or self.estimate is None else self.estimate(last, row)
        state = () if stop and by != "state" else self.follow(last, row)
        if self.key is not None and by != "row":
            key = self.key(state) if by == "state" else self.key(last, row)
            if key in seen:
                self.dropped()
                return None
        return Step(row, key, stop, goal, weight, estimate, state, last)

    def edge(self, last: Last, firsts: dict[Hashable, Step]) -> Step | None:
        """The same where a step to a row is what the first step to that row was."""
        assert self.key is not None
        row = self.row(last)
        key = self.key(last, row)
        first = firsts.get(key)
        if first is None:
            step = self.step(last, (), row)
            if step is not None:
                firsts[key] = step
            return step
        weight = 1 if self.weigh is None else self.weigh(last, row)
        if not weight and self.search.order == "probability":
            return None
        return first._replace(weight=weight, last=last)

    def dropped(self) -> None:
        self.run.stats.pruned += 1

    # --- what watched.py hears of the loops ----

    def outdated(self, step: Step) -> None:
        """A step that leads to what another one has reached as well."""

    def found(self, step: Step) -> None:
        """A step whose path is a result."""


def searched(steps: Steps, starts: list[State], keys: Keys, bound: int | None) -> Iterator[Any]:
    """The results as the task of the query takes them: paths or rows, or pairs of such a result and its keys."""
    search = steps.search
    order = _ORDERS.get(search.order, best_first)
    every = memorized(steps, starts, bound) if search.repeats == "memorize" else order(steps, starts)
    aggregated, only_last = steps.query.aggregated, steps.query.last
    for found in every:
        path = None if aggregated or only_last else tuple([step.row for step in found.steps()])
        assert found.step is not None
        steps.found(found.step)
        result = found.step.row if only_last and not aggregated else path
        yield result if keys is None else (result, keys(found.step.last))


def new_starts(steps: Steps, starts: list[State], seen: set[Hashable]) -> Iterator[State]:
    """The starts in their order; with UNIQUE BY one that was reached is left out, and any other counts as visited."""
    for start in starts:
        if steps.visits_start and steps.search.repeats == "unique":
            key = steps.key_of_start(start)
            if key in seen:
                continue
            seen.add(key)
        yield start


def on_path(steps: Steps, way: Way) -> set[Hashable]:
    """The keys on a path, that of its start included."""
    keys = {step.key for step in way.steps()}
    if steps.visits_start:
        keys.add(steps.key_of_start(way.start))
    return keys


def depth_first(steps: Steps, starts: list[State]) -> Iterator[Way]:
    """A step is given out, then followed, before its next sibling is evaluated."""
    unique, no_cycle = steps.search.repeats == "unique", steps.search.repeats == "no cycle"
    seen: set[Hashable] = set()  # the keys on the path, or with UNIQUE all keys so far
    for start in new_starts(steps, starts, seen):
        way = Way(start)
        if no_cycle:
            seen = on_path(steps, way)
        stack = [(way, steps.expand(way, start, seen))]
        while stack:
            way, rest = stack[-1]
            step = next(rest, None)
            if step is None:
                stack.pop()
                if no_cycle and way.step is not None:
                    seen.discard(way.step.key)
                continue
            longer = way.longer(step)
            if unique:
                seen.add(step.key)
            if step.goal:
                yield longer
            if not step.stop:
                if no_cycle:
                    seen.add(step.key)
                stack.append((longer, steps.expand(longer, step.state, seen)))


def by_estimate(steps: Steps, starts: list[State]) -> Iterator[Way]:
    """The step with the smallest estimate is extended first, of equal ones the oldest.

    Without HEURISTIC all are equal: breadth first. A result is given out when it is generated.
    """
    unique, no_cycle = steps.search.repeats == "unique", steps.search.repeats == "no cycle"
    seen: set[Hashable] = set()
    number = count()
    queue = [(0, next(number), Way(start), start) for start in list(new_starts(steps, starts, seen))]
    while queue:
        _, _, way, state = heappop(queue)
        if no_cycle:
            seen = on_path(steps, way)
        for step in steps.expand(way, state, seen):
            longer = way.longer(step)
            if unique:
                seen.add(step.key)
            if step.goal:
                yield longer
            if not step.stop:
                heappush(queue, (step.estimate, next(number), longer, step.state))


def best_first(steps: Steps, starts: list[State]) -> Iterator[Way]:
    """The cheapest or likeliest path is extended first, with HEURISTIC that of the least total and estimate.

    Totals are made so that less is better: costs are added up from 0, probabilities multiplied from -1. Of equal ranks
    the smaller estimate comes first, then the step that was generated first, its result before its expansion.
    """
    unique, no_cycle = steps.search.repeats == "unique", steps.search.repeats == "no cycle"
    likeliest = steps.search.order == "probability"
    nothing = -1 if likeliest else 0
    best: dict[Hashable, Any] = {}  # the least total of a path to each key so far
    taken: dict[Hashable, Any] = {}  # those at which keys came out of the queue
    given: set[Hashable] = set()
    visited: set[Hashable] = set()
    number = count()
    queue: list[tuple[Any, Any, int, bool, Any, Way]] = []
    for start in list(new_starts(steps, starts, visited)):
        heappush(queue, (nothing, 0, next(number), True, nothing, Way(start)))
    best.update(dict.fromkeys(visited, nothing))
    taken.update(best)
    highest = nothing
    while queue:
        guess, *_, expands, total, way = heappop(queue)
        if unique and way.step is not None:
            key = way.step.key
            if best[key] < total:
                steps.outdated(way.step)
                continue
            taken[key] = total
        if not expands:
            assert way.step is not None
            if not unique or way.step.key not in given:
                given.add(way.step.key)
                steps.run.overestimated |= exceeds(highest, guess)
                yield way
            continue
        highest = max(highest, guess)
        seen: Seen = on_path(steps, way) if no_cycle else _Closed(taken, total) if unique else ()
        for step in steps.expand(way, way.start if way.step is None else way.step.state, seen):
            reached = total * step.weight if likeliest else total + step.weight
            if unique:
                known = best.get(step.key)
                if known is not None and known <= reached:
                    steps.dropped()
                    steps.outdated(step)
                    continue
                best[step.key] = reached
            longer, place = way.longer(step), next(number)
            if step.goal:
                heappush(queue, (reached, 0, place, False, reached, longer))
            if not step.stop:
                heappush(queue, (reached + step.estimate, step.estimate, place, True, reached, longer))


class _Closed:
    """The keys that were taken at a total that no path through a step of this one can improve."""

    def __init__(self, taken: dict[Hashable, Any], total: Any) -> None:
        self.taken = taken
        self.total = total

    def __contains__(self, key: object) -> bool:
        known = self.taken.get(key)
        return known is not None and bool(known <= self.total)


_ORDERS = {"depth first": depth_first, "breadth first": by_estimate, "greedy": by_estimate}


# --- MEMORIZE ------------------------------------------------------------------------------------------


def memorized(steps: Steps, starts: list[State], bound: int | None) -> Iterator[Way]:
    """The paths of the graph without a repeated key: shortest, cheapest or likeliest first, ties in source order.

    A path is extended only by steps from which a goal can be reached in the steps that are left.
    """
    nodes, roots = graph(steps, starts, bound)
    left = distances(nodes)
    likeliest, weighed = steps.search.order == "probability", steps.weigh is not None
    start = (-1 if likeliest else 1) if weighed and likeliest else 0
    # rank, place in source order, path, its keys
    queue: list[tuple[Any, tuple[int, ...], list[Step], tuple[Hashable, ...], bool]] = []
    for place, key in enumerate(roots):
        heappush(queue, (start, (place,), [], (key,), False))
    shown = _Shown(steps, starts[0] if starts else ())
    while queue:
        steps.run.check()
        rank, places, path, keys, result = heappop(queue)
        if result:
            yield shown.path(path)
            continue
        if bound is not None and len(path) == bound:
            continue
        for place, step in enumerate(nodes.get(keys[-1], ())):
            if step.key in keys:
                continue
            new = rank * step.weight if weighed and likeliest else rank + (step.weight if weighed else 1)
            longer, at = [*path, step], (*places, place)
            if step.goal:
                heappush(queue, (new, at, longer, keys, True))
            far = left.get(step.key)
            if not step.stop and far is not None and (bound is None or len(longer) + far <= bound):
                heappush(queue, (new, (*at, 0), longer, (*keys, step.key), False))


def graph(steps: Steps, starts: list[State], bound: int | None) -> tuple[dict[Hashable, list[Step]], list[Hashable]]:
    """The steps from each node, built level by level, and the nodes of the starts.

    A node is a key, with the state of the first step to it that goes on. By rows the first step to a row decides
    whether it stops and is a goal; with BY each step has a row, stop and goal of its own.
    """
    nodes: dict[Hashable, list[Step]] = {}
    firsts: dict[Hashable, Step] = {}
    level: dict[Hashable, Way] = {}
    for number, start in enumerate(starts):
        level.setdefault(steps.key_of_start(start) if steps.visits_start else _Start(number), Way(start))
    roots, seen, depth = list(level), set(level), 0
    while level and depth != bound:
        following: dict[Hashable, Way] = {}
        for key, way in level.items():
            own = nodes[key] = []
            state = way.start if way.step is None else way.step.state
            for step in steps.expand(way, state, (), firsts if steps.search.by == "row" else None):
                own.append(step)
                if step.key in seen:
                    steps.outdated(step)
                elif not step.stop:
                    seen.add(step.key)
                    following[step.key] = Way((), None, step)
        level, depth = following, depth + 1
    return nodes, roots


class _Start:
    """The key of a start that has none."""

    def __init__(self, number: int) -> None:
        self.number = number


def distances(nodes: dict[Hashable, list[Step]]) -> dict[Hashable, int]:
    """How many steps it takes at least from each node to a goal."""
    before: dict[Hashable, list[Hashable]] = {}
    found: dict[Hashable, int] = {}
    for key, own in nodes.items():
        for step in own:
            if step.goal:
                found[key] = 1
            if not step.stop:
                before.setdefault(step.key, []).append(key)
    queue = deque(found)
    while queue:
        key = queue.popleft()
        for other in before.get(key, ()):
            if other not in found:
                found[other] = found[key] + 1
                queue.append(other)
    return found


class _Shown:
    """Makes rows that ask for the path: a step belongs to many paths, and what it carries is that of one."""

    def __init__(self, steps: Steps, start: State) -> None:
        search = steps.search
        self.steps = steps
        self.start = start  # what is carried begins alike in all starts
        self.sources = len(steps.query.sources)
        self.carried = [place for place, (name, _) in enumerate(search.start) if not name.isidentifier()]
        columns = [output.expr for output in steps.query.columns]
        # A column that was not compared is that of the step, the others are those of the first step to the row.
        self.own_rows = bool(self.carried) or (search.by == "row" and bool(search.key))
        self.kept = [place for place, expr in enumerate(columns) if search.by == "row" and expr in search.key]

    def path(self, path: Sequence[Step]) -> Way:
        """The steps of a path, with rows and carried variables that are those of this path."""
        way = Way(())
        carried = [self.start[place] for place in self.carried]
        for step in path:
            if not self.own_rows:
                way = way.longer(step)
                continue
            state = list(step.last[self.sources :])
            for place, value in zip(self.carried, carried, strict=True):
                state[place] = value
            last = (*step.last[: self.sources], *state)
            row = list(self.steps.row(last))
            for place in self.kept:
                row[place] = step.row[place]
            way = way.longer(step._replace(last=last, row=tuple(row)))
            after = self.steps.follow(last, tuple(row))
            carried = [after[place] for place in self.carried]
        return way

"""Watching a search: what its loop does, noted event by event.

The loops of stepwise.py ask `Steps` for every step, so `WatchedSteps` sees all of them; the loops know nothing of it.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator
from typing import Any, NamedTuple

from ss2sql import plan
from ss2sql.runtime.rows import Row
from ss2sql.runtime.run import Run
from ss2sql.runtime.search.stepwise import Last, Seen, State, Step, Steps, Way
from ss2sql.runtime.values import kept
from ss2sql.told import as_written


class Event(NamedTuple):
    """What happened to step `n`, the start included, whose path is that of `parent` and one step more.

    `event` is "generated" (it enters the frontier), "expanded" (it leaves it, its own steps come next), "repeated" (its
    row or key was reached already), "stopped" (the path ends with it) or "goal" (its path is a result). `state` is the
    one reached and `row` what SELECT shows, each None where the search has not made it. `g` is the total of COST or
    PROBABILITY, `h` the estimate.
    """

    n: int
    parent: int | None
    depth: int
    event: str
    state: dict[str, Any] | None
    row: dict[str, Any] | None
    g: Any
    h: Any


class Trace:
    """The first `most` events of a search; `total` counts all.

    `here` is the step whose own steps are made, `row` that of the latest of these, where it is made, and `lost`
    what happened to it where it leaves no trace.
    """

    def __init__(self, most: int) -> None:
        self.most, self.total = most, 0
        self.events: list[Event] = []
        self.here: Event | None = None
        self.row: Row | None = None
        self.lost = "stopped"
        self._steps: dict[int, tuple[Step | None, Event]] = {}  # by their identity, which they keep while they are here
        self._count = 0
        self._latest: Step | None = None  # which was generated just now

    def add(self, word: str, step: Step | None, state: Any, row: Any, g: Any = None, h: Any = None) -> None:
        """The first event of a step; without one it is that of a start, or of what leaves no trace in the search."""
        parent, depth = (None, 0) if self.here is None else (self.here.n, self.here.depth + 1)
        event = Event(self._count, parent, depth, word, state, row, g, h)
        self._count += 1
        self._latest = step
        if self._note(event):
            self._steps[id(step)] = step, event

    def again(self, word: str, step: Step | None) -> Event | None:
        """One more event of a step, or of the latest start; gives its first one.

        A step that repeats another and was generated just now has not entered the frontier: this is its first event.
        """
        known = self._steps.get(id(step), (None, None))[1]
        if word == "repeated" and step is self._latest:
            if known is not None:
                self.events[-1] = known._replace(event=word)
            return known
        self._latest = None
        self._note(None if known is None else known._replace(event=word))
        return known

    def _note(self, event: Event | None) -> bool:
        self.total += 1
        if event is None or len(self.events) == self.most:
            return False
        self.events.append(event)
        return True

    def keep(self) -> None:
        """Makes the events independent of values that somebody else may change."""
        self.events = [event._replace(state=kept(event.state), row=kept(event.row)) for event in self.events]
        self._steps.clear()


class WatchedSteps(Steps):
    """The steps of a search, which `run.trace` hears of."""

    __slots__ = ()

    @property
    def trace(self) -> Trace:
        trace: Trace = self.run.trace
        return trace

    def expand(self, way: Way, state: State, seen: Seen, firsts: dict[Hashable, Step] | None = None) -> Iterator[Step]:
        trace = self.trace
        if way.step is None:
            trace.here = None
            nothing = None if self.weigh is None else 1 if self._likeliest else 0
            trace.add("generated", None, self._state(state), None, nothing)
        here = trace.again("expanded", way.step)
        for last in self.lasts(way, state):
            trace.here, trace.row, trace.lost = here, None, "stopped"
            step = self.step(last, seen) if firsts is None else self.edge(last, firsts)
            if step is None:
                row = self.row(last) if trace.row is None and self.tells else trace.row
                trace.add(trace.lost, None, None, self._row(row))
                continue
            self._generated(step)
            yield step

    def _generated(self, step: Step) -> None:
        trace, g = self.trace, None
        if self.weigh is not None and trace.here is not None:
            g = trace.here.g * step.weight if self._likeliest else trace.here.g + step.weight
        h = None if self.estimate is None or step.stop else step.estimate
        trace.add("generated", step, self._state(step.state), self._row(step.row), g, h)
        if self.search.repeats == "memorize":  # the paths come when the graph is there
            self._reached(step)

    def dropped(self) -> None:
        super().dropped()
        self.trace.lost = "repeated"

    def outdated(self, step: Step) -> None:
        self.trace.again("repeated", step)

    def found(self, step: Step) -> None:
        if self.search.repeats != "memorize":
            self._reached(step)

    def _reached(self, step: Step) -> None:
        if step.goal:
            self.trace.again("goal", step)
            if step.stop:
                self.trace.again("stopped", step)

    @property
    def _likeliest(self) -> bool:
        return self.search.order == "probability"

    def _state(self, state: State) -> dict[str, Any] | None:
        """The START WITH variables by name; what the search carries beside them has no name."""
        names = [name for name, _ in self.search.start]
        return {name: value for name, value in zip(names, state, strict=True) if name.isidentifier()} if state else None

    def _row(self, row: Row | None) -> dict[str, Any] | None:
        return dict(zip(row_names(self.query), row, strict=False)) if row else None


def noted(run: Run, row: Callable[[Last], Row]) -> Callable[[Last], Row]:
    """The function that makes rows, of which the trace of the run hears."""

    def noting(last: Last) -> Row:
        made = run.trace.row = row(last)
        return made

    return noting


def row_names(query: plan.Query) -> list[str]:
    """What the values of the rows of a search are called."""
    if query.aggregated:
        return list(map(as_written, query.rows))
    return [output.name for output in query.columns[: len(query.columns) - query.representation.hidden]]

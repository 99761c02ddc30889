"""Watching a search: what its loop does, noted event by event.

`TracedSearch` stands around the step function, so it sees each step that a loop takes. Of what becomes of it tells what
the loop hands on unseen: the state after a step, its last part. The step function tells of steps without a trace.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any, NamedTuple

from ss2sql.language import plan
from ss2sql.language.plan_traversal import write_in_script
from ss2sql.language.values import FrozenRow, State, copy_deep, thaw_value
from ss2sql.runtime.search.step_contract import Found, Problem, Step


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
    """The first `most` events of a search; `total` counts all. `here` is the step whose own steps are made."""

    def __init__(self, most: int) -> None:
        self.most, self.total = most, 0
        self.events: list[Event] = []
        self.here: Event | None = None
        self.names: list[str] = []  # of the values of rows
        self._count = 0
        self._latest: Event | None = None  # of the step that was generated just now

    def add_event(self, word: str, state: Any, row: FrozenRow | None, g: Any = None, h: Any = None) -> Event:
        """The first event of a step, or of a start where there is no step `here`."""
        parent, depth = (None, 0) if self.here is None else (self.here.n, self.here.depth + 1)
        shown = dict(zip(self.names, map(thaw_value, row), strict=False)) if row else None
        event = self._latest = Event(self._count, parent, depth, word, state, shown, g, h)
        self._count += 1
        self._append_event(event)
        return event

    def note_dropped(self, word: str, row: FrozenRow | None) -> None:
        """A step leaves no trace in the search; the step function says so."""
        self.add_event(word, None, row)

    def repeat_event(self, word: str, event: Event) -> None:
        """One more event of a step.

        A step that repeats another and was generated just now has not entered the frontier: this is its first event.
        """
        if word == "repeated" and event is self._latest:
            if self.total <= self.most:
                self.events[-1] = event._replace(event=word)
            return
        self._latest = None
        self._append_event(event._replace(event=word))

    def note_result(self, event: Event, stops: bool) -> None:
        """The path of a step is a result."""
        self.repeat_event("goal", event)
        if stops:
            self.repeat_event("stopped", event)

    def _append_event(self, event: Event) -> None:
        self.total += 1
        if len(self.events) < self.most:
            self.events.append(event)

    def copy_values(self) -> None:
        """Makes the events independent of values that somebody else may change."""
        self.events = [event._replace(state=copy_deep(event.state), row=copy_deep(event.row)) for event in self.events]


class TracedState(tuple[Any, ...]):
    """A state with the first event of the step to it, None for a start."""

    event: Event | None = None


class TraceToken(NamedTuple):
    """What travels with a step in place of its last part."""

    event: Event
    stops: bool
    last: Any


class TracedSearch:
    """A search of which its trace hears."""

    def __init__(self, trace: Trace, query: plan.Query, problem: Problem) -> None:
        assert query.search is not None
        self.trace, self.search = trace, query.search
        self.is_memorize = query.search.repeats == "memorize"
        self.totals = problem.weighed and problem.repeats == "unique"  # the step function adds weights up
        self._expand, self._likeliest = problem.expand, problem.likeliest
        trace.names = name_traced_values(query)
        starts = list(map(TracedState, problem.starts))
        self.problem = replace(problem, starts=starts, expand=self.expand_state, outdated=self.note_outdated)

    def expand_state(self, state: Any, *more: Any) -> Iterator[Step]:
        trace, here = self.trace, state.event
        if here is None:
            trace.here = None
            nothing = None if self.search.weight is None else -1 if self._likeliest else 0
            here = trace.add_event("generated", self._name_variables(state), None, self._show_total(nothing))
        trace.repeat_event("expanded", here)
        steps = self._expand(state, *more)
        while True:
            trace.here = here
            step = next(steps, None)
            if step is None:
                return
            row, key, goal, goes_on, after, weight, estimate, last = step
            if goal is None:  # an edge to a row that is known
                trace.add_event("repeated", None, row)
                yield step
                continue
            g = self._show_total(weight) if self.totals or weight is None else here.g + weight
            if self._likeliest and not self.totals:
                g = here.g * weight
            reached = TracedState(after or ())
            event = reached.event = trace.add_event("generated", self._name_variables(after), row, g, estimate)
            if not self.is_memorize:
                last = TraceToken(event, not goes_on, last)
            elif goal:  # the paths come when the graph is there
                trace.note_result(event, not goes_on)
            yield row, key, goal, goes_on, reached, weight, estimate, last

    def note_outdated(self, state: Any, token: TraceToken | None) -> None:
        """A step leads to what another one has reached as well."""
        self.trace.repeat_event("repeated", state.event if token is None else token.event)

    def strip_traces(self, results: Iterator[Found]) -> Iterator[Found]:
        """The results as they are without a trace."""
        for path, token in results:
            if self.is_memorize:
                yield path, token
            else:
                self.trace.note_result(token.event, token.stops)
                yield path, token.last

    def _show_total(self, total: Any) -> Any:
        """A total as the script has it; likelihoods are multiplied from -1."""
        return -total if self._likeliest and total is not None else total

    def _name_variables(self, state: State | None) -> dict[str, Any] | None:
        """The START WITH variables by name; what the search carries beside them has no name."""
        if not state:
            return None
        names = [name for name, _ in self.search.start]
        return {name: thaw_value(value) for name, value in zip(names, state, strict=False) if name.isidentifier()}


def name_traced_values(query: plan.Query) -> list[str]:
    """What the values of the rows of a search are called."""
    if query.aggregated:
        return list(map(write_in_script, query.rows))
    return [output.name for output in query.columns[: len(query.columns) - query.representation.hidden]]

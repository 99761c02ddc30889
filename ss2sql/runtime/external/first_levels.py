"""The first levels of a search, in memory: where another database plans a level for longer than its steps take."""

from __future__ import annotations

import math
import time
from collections.abc import Container, Hashable, Iterator
from typing import Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.frozen_values import FrozenRow, State
from ss2sql.lowering.portable.search_steps import MAX_ELEMENTS
from ss2sql.runtime.run.run_state import GraphLevel
from ss2sql.runtime.search.search_run import Found, SearchRun

MAX_STATES = 2_000  # of a level that is done here
MOST = 100_000  # steps that are kept here


@dataclass(frozen=True, slots=True)
class FirstStep:
    """A step that was kept, as the step function gives it; `state` is the one to go on from, if there is one.

    `trail` has the keys of the rows of its path, for NO CYCLE.
    """

    place: int
    row: FrozenRow
    last: Any
    goal: bool
    state: State | None
    trail: tuple[Hashable, ...]


class FirstLevels:
    """Goes on step by step, as the native search does, until a level has more than STATES or `states`, takes longer
    than `seconds`, as the one before tells, or all have more than MOST steps.

    The n-th step that a level has kept has the number n; `levels` are those that are done. `frontier` has the steps to
    go on from, with their numbers. `met` are the keys of all rows, for UNIQUE.
    """

    def __init__(self, search_run: SearchRun, states: float = math.inf, seconds: float = math.inf) -> None:
        self.search_run, self.repeats = search_run, search_run.problem.repeats
        self.states, self.seconds = min(states, MAX_STATES), seconds
        self.levels: list[list[FirstStep]] = []
        self.frontier = [(0, FirstStep(0, (), None, False, search_run.problem.starts[0], ()))]
        self.met: set[Hashable] = set()

    def find_goals(self) -> Iterator[FirstStep]:
        """The goals in their order."""
        search_run, seconds, kept = self.search_run, 0.0, 0
        search_run.flush()
        while 0 < len(self.frontier) <= self.states and seconds * len(self.frontier) <= self.seconds and kept <= MOST:
            search_run.check()
            begin, before = time.monotonic(), search_run.stats.generated
            level: list[FirstStep] = []
            for step, begun in self.frontier:
                for found in self._expand_step(step, begun):
                    level.append(found)
                    if found.goal:
                        yield found
            seconds = (time.monotonic() - begin) / len(self.frontier)
            kept += len(level)
            self.levels.append(level)
            search_run.flush()
            search_run.stats.levels.append(
                GraphLevel(len(level), len(level), search_run.stats.generated - before - len(level))
            )
            self.frontier = [(step, begun) for step, begun in enumerate(level, 1) if begun.state is not None]

    def _expand_step(self, step: int, before: FirstStep) -> Iterator[FirstStep]:
        """The steps from a state that are kept."""
        unique, free = self.repeats == "unique", self.repeats == "no cycle"
        closed: Container[Hashable] = self.met if unique else before.trail
        expanded = self.search_run.problem.expand(before.state, closed)
        for nth, (row, key, goal, goes_on, after, _, _, last) in enumerate(expanded):
            if unique:
                self.met.add(key)
            trail = (*before.trail, key) if free else ()
            yield FirstStep(step * MAX_ELEMENTS + nth, row, last, bool(goal), after if goes_on else None, trail)

    def trace_path(self, step: FirstStep, depth: int) -> list[FirstStep]:
        """The steps of the path to a step of a level."""
        way = [step]
        for level in reversed(self.levels[: depth - 1]):
            way.append(level[way[-1].place // MAX_ELEMENTS - 1])
        return way[::-1]

    def make_result(self, goal: FirstStep) -> Found:
        """The path to a goal that was just found, and the last part of its last step."""
        return [
            self.search_run.shapes.thaw_state(step.row) for step in self.trace_path(goal, len(self.levels) + 1)
        ], goal.last

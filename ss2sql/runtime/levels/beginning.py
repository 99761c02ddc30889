"""The first levels of a search, in memory: where another database plans a level for longer than its steps take."""

from __future__ import annotations

import math
import time
from collections.abc import Container, Hashable, Iterator
from typing import Any

from ss2sql.lowering.portable.steps import ELEMENTS
from ss2sql.records import dataclass
from ss2sql.runtime.frozen import FrozenRow, State
from ss2sql.runtime.memorize.hunt import Found, Hunt
from ss2sql.runtime.run import Level

STATES = 2_000  # of a level that is done here
MOST = 100_000  # steps that are kept here


@dataclass(frozen=True, slots=True)
class Begun:
    """A step that was kept, as the step function gives it; `state` is the one to go on from, if there is one.

    `trail` has the keys of the rows of its path, for NO CYCLE.
    """

    place: int
    row: FrozenRow
    last: Any
    goal: bool
    state: State | None
    trail: tuple[Hashable, ...]


class Beginning:
    """Goes on step by step, as the native search does, until a level has more than STATES or `states`, takes longer
    than `seconds`, as the one before tells, or all have more than MOST steps.

    The n-th step that a level has kept has the number n; `levels` are those that are done. `frontier` has the steps to
    go on from, with their numbers. `met` are the keys of all rows, for UNIQUE.
    """

    def __init__(self, hunt: Hunt, states: float = math.inf, seconds: float = math.inf) -> None:
        self.hunt, self.repeats = hunt, hunt.problem.repeats
        self.states, self.seconds = min(states, STATES), seconds
        self.levels: list[list[Begun]] = []
        self.frontier = [(0, Begun(0, (), None, False, hunt.problem.starts[0], ()))]
        self.met: set[Hashable] = set()

    def goals(self) -> Iterator[Begun]:
        """The goals in their order."""
        hunt, seconds, kept = self.hunt, 0.0, 0
        hunt.flush()
        while 0 < len(self.frontier) <= self.states and seconds * len(self.frontier) <= self.seconds and kept <= MOST:
            hunt.check()
            begin, before = time.monotonic(), hunt.stats.generated
            level: list[Begun] = []
            for step, begun in self.frontier:
                for found in self._steps(step, begun):
                    level.append(found)
                    if found.goal:
                        yield found
            seconds = (time.monotonic() - begin) / len(self.frontier)
            kept += len(level)
            self.levels.append(level)
            hunt.flush()
            hunt.stats.levels.append(Level(len(level), len(level), hunt.stats.generated - before - len(level)))
            self.frontier = [(step, begun) for step, begun in enumerate(level, 1) if begun.state is not None]

    def _steps(self, step: int, before: Begun) -> Iterator[Begun]:
        """The steps from a state that are kept."""
        unique, free = self.repeats == "unique", self.repeats == "no cycle"
        closed: Container[Hashable] = self.met if unique else before.trail
        expanded = self.hunt.problem.expand(before.state, closed)
        for nth, (row, key, goal, goes_on, after, _, _, last) in enumerate(expanded):
            if unique:
                self.met.add(key)
            trail = (*before.trail, key) if free else ()
            yield Begun(step * ELEMENTS + nth, row, last, bool(goal), after if goes_on else None, trail)

    def way(self, step: Begun, depth: int) -> list[Begun]:
        """The steps of the path to a step of a level."""
        way = [step]
        for level in reversed(self.levels[: depth - 1]):
            way.append(level[way[-1].place // ELEMENTS - 1])
        return way[::-1]

    def found(self, goal: Begun) -> Found:
        """The path to a goal that was just found, and the last part of its last step."""
        return [self.hunt.shapes.thaw(step.row) for step in self.way(goal, len(self.levels) + 1)], goal.last

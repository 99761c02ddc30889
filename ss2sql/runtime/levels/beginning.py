"""The first levels of a search, in memory: where another database plans a level for longer than its steps take."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from itertools import count
from marshal import loads
from typing import Any

from ss2sql import plan
from ss2sql.lowering.portable.steps import ELEMENTS
from ss2sql.records import dataclass
from ss2sql.runtime.levels.trial import Trial, encoded
from ss2sql.runtime.memorize.hunt import Found, Hunt
from ss2sql.runtime.run import Level

STATES = 2_000  # of a level that is done here
BYTES = 1 << 26  # of all that is kept here
STEP = 500  # bytes that a step takes beside its row and state


@dataclass(frozen=True, slots=True)
class Begun:
    """A step that was kept, see `level.TABLES`. `trail` has the keys of the rows of its path, for NO CYCLE."""

    place: int
    key: bytes
    row: bytes
    last: bytes | None
    goal: bool
    goes_on: bool
    state: bytes | None
    trail: tuple[bytes, ...]

    @property
    def values(self) -> Any:
        """The state to go on from; None where there is none."""
        return None if self.state is None else loads(self.state)


class Beginning:
    """Goes on step by step, as the native search does, until a level has more than STATES or `states`, takes longer
    than `seconds`, as the one before tells, or all have more than BYTES.

    The n-th step that a level has kept has the number n; `levels` are those that are done. `frontier` has the steps to
    go on from, with their numbers. `met` are the keys of all rows, for UNIQUE.
    """

    def __init__(
        self,
        hunt: Hunt,
        trial: Trial,
        repeats: plan.Repeats,
        pause: Callable[[], None],
        states: float = math.inf,
        seconds: float = math.inf,
    ) -> None:
        self.hunt, self.trial, self.repeats, self.pause = hunt, trial, repeats, pause
        self.states, self.seconds = min(states, STATES), seconds
        self.levels: list[list[Begun]] = []
        self.frontier = [(0, Begun(0, b"", b"", None, False, True, encoded(hunt.start), ()))]
        self.met: set[bytes] = set()
        self.bytes = 0

    def goals(self) -> Iterator[Begun]:
        """The goals in their order."""
        seconds = 0.0  # for each state
        while 0 < len(self.frontier) <= self.states:
            if seconds * len(self.frontier) > self.seconds or self.bytes > BYTES:
                break
            self.pause()
            begin, tried = time.monotonic(), count()
            level: list[Begun] = []
            for step, before in self.frontier:
                for found in self._kept(step, before, tried):
                    level.append(found)
                    if found.goal:
                        yield found
            seconds = (time.monotonic() - begin) / len(self.frontier)
            self.levels.append(level)
            self.hunt.stats.levels.append(Level(len(level), len(level), next(tried) - len(level)))
            self.frontier = [(step, begun) for step, begun in enumerate(level, 1) if begun.goes_on]
        self.pause()

    def _kept(self, step: int, before: Begun, tried: Iterator[int]) -> Iterator[Begun]:
        """The steps from a state that are kept. Raises what one raises that failed."""
        assert before.state is not None
        for made in self.trial.steps(step, before.state):
            if next(tried) % 1000 == 999:
                self.pause()
            if made is None:
                continue
            place, _, key, row, last, goal, goes_on, state, failed = made
            if key in self.met or key in before.trail:
                continue
            if failed:
                self.trial.fail(place, before.state)
            if self.repeats == "unique":
                self.met.add(key)
            self.bytes += STEP + len(row) + len(state or b"")
            trail = (*before.trail, key) if self.repeats == "no cycle" else ()
            yield Begun(place, key, row, last, goal, goes_on, state, trail)

    def way(self, step: Begun, depth: int) -> list[Begun]:
        """The steps of the path to a step of a level."""
        way = [step]
        for level in reversed(self.levels[: depth - 1]):
            way.append(level[way[-1].place // ELEMENTS - 1])
        return way[::-1]

    def waiting(self) -> Iterator[tuple[int, Begun]]:
        """The steps to go on from, with their numbers throughout all levels."""
        first = sum(map(len, self.levels[:-1]))
        return ((first + step, begun) for step, begun in self.frontier)

    def found(self, goal: Begun) -> Found:
        """The path to a goal that was just found, and the last part of its last step."""
        way = self.way(goal, len(self.levels) + 1)
        return [loads(step.row) for step in way], None if goal.last is None else loads(goal.last)

    def steps(self) -> Iterator[tuple[int, int, int, Begun]]:
        """All steps that were kept, with their numbers through all levels, those of the steps before, and depths."""
        step = before = 0
        for depth, level in enumerate(self.levels, 1):
            first = step
            for step, begun in enumerate(level, first + 1):
                yield step, before + begun.place // ELEMENTS, depth, begun
            before = first

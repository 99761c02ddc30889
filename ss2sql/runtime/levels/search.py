"""Going from level to level: every step from the states of one level is tried, then tables say which are kept.

It finds the results of the breadth-first search that takes one step after the other, in its order, and raises what that
would raise. Only what nobody can notice is different: the clauses of all steps of a level are evaluated, also of those
behind the last result that is asked for, and behind the first step to their row.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from itertools import groupby
from marshal import loads
from operator import itemgetter
from typing import Any

from ss2sql.lowering.portable.steps import ELEMENTS
from ss2sql.runtime.levels import level
from ss2sql.runtime.levels.beginning import Beginning
from ss2sql.runtime.levels.level import LevelStatements
from ss2sql.runtime.levels.statements import Statement, Value
from ss2sql.runtime.levels.tables import Tables
from ss2sql.runtime.levels.trial import Trial
from ss2sql.runtime.memorize.hunt import Found, Hunt
from ss2sql.runtime.memorize.pieces import Pieces
from ss2sql.runtime.run import Level


class TableSearch:
    """One search in some tables: what is the same for all orders."""

    def __init__(self, hunt: Hunt, tables: Tables) -> None:
        self.hunt, self.tables = hunt, tables

    @property
    def pieces(self) -> Pieces:
        assert self.hunt.pieces is not None
        return self.hunt.pieces

    def run(self, statements: Iterable[Statement], **values: Value) -> None:
        for statement in statements:
            self.tables.run(statement, **values)

    def pause(self) -> None:
        self.hunt.flush()
        self.hunt.check()

    def fail(self, trial: Trial, place: int, known: bool = False) -> None:
        """Raises the error of the step that failed, see `Trial.fail`."""
        trial.fail(place, self.state_of(place // ELEMENTS), known)

    def state_of(self, step: int) -> bytes:
        """The state to go on from that a step led to."""
        ((state,),) = self.tables.rows(level.STATE_OF, step=step)
        return state  # type: ignore[no-any-return]

    def paths(self) -> Iterator[tuple[int, Found]]:
        """The paths to the goals in `kept`, each with the number of its last step."""
        for goal, rows in groupby(self.tables.ways(), itemgetter(0)):
            path = list(rows)
            last = path[-1][2]
            yield goal, ([loads(row) for _, row, _ in path], None if last is None else loads(last))


class BreadthFirstSearch(TableSearch, ABC):
    """A breadth-first search: the first levels in memory, the others in tables."""

    def __init__(self, hunt: Hunt, tables: Tables, written: Any, states: float = math.inf) -> None:
        super().__init__(hunt, tables)
        self.written = written
        self.trial = Trial(self.pieces, hunt.keyed, compared=written.search.repeats != "allowed")
        self.states = states  # of a level in memory, at the most

    def results(self) -> Iterator[Found]:
        """The paths and the last parts of their last steps."""
        beginning = Beginning(self.hunt, self.trial, self.written.search.repeats, self.pause, self.states)
        yield from map(beginning.found, beginning.goals())
        if beginning.frontier:
            self.run(self.written.made)
            reached = len(beginning.levels), self.load(beginning), len(beginning.frontier)
            del beginning  # the tables have it all
            yield from self.go_on(*reached)

    @abstractmethod
    def load(self, beginning: Beginning) -> int:
        """Hands over what the first levels have come to; gives the number of the last step."""

    @abstractmethod
    def go_on(self, depth: int, steps: int, going: int) -> Iterator[Found]:
        """The results behind that level and step, where so many states of the level are to be expanded."""


class LevelSearch(BreadthFirstSearch):
    """A breadth-first search whose steps are tried in Python."""

    written: LevelStatements

    def go_on(self, depth: int, steps: int, going: int) -> Iterator[Found]:
        written, tables = self.written, self.tables
        while going:
            depth += 1
            tally = tables.try_all(self.trial, self.pause)
            self.run(written.kept, before=steps)
            failed = None
            if tally.failed:
                ((failed,),) = tables.rows(written.failed)
            tables.run(level.KEEP, depth=depth)
            ((kept, goals, going, last),) = tables.rows(level.COUNTS)
            steps = last or steps
            if goals:
                yield from self._before(failed)
            if failed is not None:
                self.fail(self.trial, failed)
            self.hunt.stats.levels.append(Level(kept, kept, tally.tried - kept))
            self.run(written.go_on)

    def load(self, beginning: Beginning) -> int:
        steps = list(beginning.steps())
        if steps:
            rows = [(step, parent, depth, one.key, one.row, one.last, one.goal) for step, parent, depth, one in steps]
            self.tables.load("steps", list(zip(*rows, strict=True)))
        numbers, states = zip(*beginning.waiting(), strict=True)
        self.tables.load("frontier", [numbers, [begun.state for begun in states]])
        return len(steps)

    def _before(self, failed: int | None) -> Iterator[Found]:
        """The results of a level before the step that failed."""
        last = None
        if failed is not None:
            ((last,),) = self.tables.rows(level.LAST_BEFORE, place=failed)
        for goal, found in self.paths():
            if failed is not None and (last is None or goal > last):
                break
            yield found

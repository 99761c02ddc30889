"""Searches by COST or PROBABILITY, many waiting steps at a time.

They find the results of the search that takes the step with the least total each time, in its order, and raise what
that would raise: cost_level.py says why. How many steps are chosen at a time is a guess, which decides about the time
alone: what is chosen too early is tried again later, or its tries are kept until then. The guess is as far as the
level before has reached, from its first step to the least total of a new one. Where every step costs the same, that is
all steps with the least total.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import isfinite

from ss2sql.lowering.portable.steps import ELEMENTS
from ss2sql.runtime.levels.cost_level import NOTE, REMEMBER, STATE_OF, CostStatements
from ss2sql.runtime.levels.search import TableSearch
from ss2sql.runtime.levels.tables import Tables
from ss2sql.runtime.levels.trial import WeighingTrial, encoded
from ss2sql.runtime.memorize.hunt import Found, Hunt
from ss2sql.runtime.run import Level

BEFORE_ALL = -2.0  # less than every total


class CostSearch(TableSearch):
    """One search by totals; less is better."""

    def __init__(self, hunt: Hunt, tables: Tables, written: CostStatements) -> None:
        super().__init__(hunt, tables)
        self.written = written
        self.trial = WeighingTrial(self.pieces, hunt.keyed, compared=written.search.repeats != "allowed")

    def results(self) -> Iterator[Found]:
        """The paths and the last parts of their last steps."""
        written, tables = self.written, self.tables
        self.run(written.made)
        tables.load("frontier", [[0], [encoded((-1 if self.pieces.probable else 0, self.hunt.start))]])
        reach = 1.0 if self.pieces.probable else 0.0
        total, last, rounds, waiting = BEFORE_ALL, 0, 0, 0
        early = False
        while True:
            rounds += 1
            tried = tables.try_all(self.trial, self.pause).tried
            if early:
                tables.run(REMEMBER)
            self.run(written.keep, depth=rounds)
            ((kept, goals, step, least, greatest, new, chosen),) = tables.rows(written.counts)
            if not kept and rounds > 1:
                return
            earlier, last = last, step or last
            self.run(written.enter, last=last)
            before = waiting
            ((waiting, failed),) = tables.rows(written.entered, last=last)
            if goals:
                yield from self._until(failed)
            if failed is not None:
                self.fail(self.trial, failed)
            if written.keeps and (early or chosen > kept):
                early = True
                self.run(NOTE, last=last)
            # Of those that enter some may have been tried, and counted as pruned, when it was too early for them.
            entered = waiting - before
            self.hunt.stats.levels.append(Level(entered, entered, max(0, tried - entered)))
            if kept:
                total, reach = greatest, self._further(reach, least, new)
            self.run(written.go_on)
            self.run(written.choose, total=total, earlier=earlier, before=last, reach=reach)

    def state_of(self, step: int) -> bytes:
        for (state,) in self.tables.rows(STATE_OF, step=step):
            return state  # type: ignore[no-any-return]
        return super().state_of(step)  # the start

    def _until(self, failed: int | None) -> Iterator[Found]:
        """The results of a level up to the step after which one failed: a step is a result before it goes on."""
        for goal, found in self.paths():
            if failed is not None and goal > failed // ELEMENTS:
                break
            yield found

    def _further(self, reach: float, least: float, new: float | None) -> float:
        """How far the next level may reach, from its first step.

        The mean of the guess before and of how far it would have been right. On a grid with random costs the last
        alone makes one level in ten more, and a quarter more tries.
        """
        if new is None or not (isfinite(least) and isfinite(new)):
            return reach
        if self.pieces.probable:
            return (reach + (new / least if least else 1.0)) / 2
        return (reach + new - least) / 2

"""Going from level to level: every step from the states of one level is tried, then tables say which are kept.

It finds the results of the breadth-first search that takes one step after the other, in its order, and raises what that
would raise. Only what nobody can notice is different: the clauses of all steps of a level are evaluated, also of those
behind the last result that is asked for, and behind the first step to their row.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from itertools import groupby
from marshal import loads
from operator import itemgetter

from ss2sql.runtime.levels import level
from ss2sql.runtime.levels.level import LevelStatements
from ss2sql.runtime.levels.statements import Drop, Statement
from ss2sql.runtime.levels.tables import Tables
from ss2sql.runtime.levels.trial import ELEMENTS, Trial, encoded
from ss2sql.runtime.memorize.hunt import Found, Hunt
from ss2sql.runtime.run import Level


class LevelSearch:
    """One search in some tables."""

    def __init__(self, hunt: Hunt, tables: Tables, written: LevelStatements) -> None:
        assert hunt.pieces is not None
        self.hunt, self.tables, self.written = hunt, tables, written
        self.trial = Trial(hunt.pieces, hunt.keyed)

    def results(self) -> Iterator[Found]:
        """The paths and the last parts of their last steps."""
        written, tables = self.written, self.tables
        self._run(written.made)
        tables.load(level.FRONTIER, [[0], [encoded(self.hunt.start)]])
        going, depth, steps = 1, 0, 0
        while going:
            depth += 1
            tried = tables.try_all(self.trial, self._pause)
            self._run(written.kept, before=steps)
            ((failed,),) = tables.rows(written.failed)
            tables.run(level.KEEP, depth=depth)
            ((kept, goals, going, last),) = tables.rows(level.COUNTS)
            steps = last or steps
            if goals:
                yield from self._paths(failed)
            if failed is not None:
                ((state,),) = tables.rows(level.STATE_OF, step=failed // ELEMENTS)
                self.trial.fail(failed, state)
            self.hunt.stats.levels.append(Level(kept, kept, tried - kept))
            self._run(written.go_on)

    def _run(self, statements: Iterable[Statement], **values: int) -> None:
        for statement in statements:
            self.tables.run(statement, **values)

    def _pause(self) -> None:
        self.hunt.flush()
        self.hunt.check()

    def _paths(self, failed: int | None) -> Iterator[Found]:
        """The paths to the goals of a level, those before the step that failed."""
        self.tables.run(level.WAYS)
        for goal, rows in groupby(self.tables.rows(level.PATHS), itemgetter(0)):
            if failed is not None:
                ((place,),) = self.tables.rows(level.PLACE_OF, step=goal)
                if place > failed:
                    break
            path = list(rows)
            last = path[-1][2]
            yield [loads(row) for _, row, _ in path], None if last is None else loads(last)
        self.tables.run(Drop(level.WAYS.table))

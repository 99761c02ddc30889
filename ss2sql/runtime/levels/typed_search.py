"""Going from level to level where the steps are SQL: nothing but results passes through Python."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from itertools import groupby
from marshal import loads
from operator import itemgetter

from ss2sql.lowering.portable.steps import ELEMENTS, too_many_elements
from ss2sql.runtime.levels.beginning import Beginning
from ss2sql.runtime.levels.search import BreadthFirstSearch
from ss2sql.runtime.levels.tables import NumberingTables, walked_ways
from ss2sql.runtime.levels.typed import COUNTS, WAYS, TypedStatements
from ss2sql.runtime.memorize.hunt import Found, Hunt
from ss2sql.runtime.memorize.pieces import Last
from ss2sql.runtime.run import Level

TRIES = 2_000  # steps of a level that are tried here: DuckDB takes 5 ms for the smallest one


class TypedSearch(BreadthFirstSearch):
    """A breadth-first search whose steps are SQL."""

    tables: NumberingTables
    written: TypedStatements

    def __init__(self, hunt: Hunt, tables: NumberingTables, written: TypedStatements) -> None:
        self.elements = written.elements_of(hunt.run)
        if len(self.elements) > ELEMENTS:
            raise too_many_elements("FROM")
        super().__init__(hunt, tables, written, TRIES // max(len(self.elements), 1))

    def go_on(self, depth: int, steps: int, going: int) -> Iterator[Found]:
        written, tables = self.written, self.tables
        values = {label: self.hunt.run.source(name) for label, name in written.steps.parameters.items()}
        while going:
            depth += 1
            self.run(written.tried, depth=depth, **values)
            kept = tables.add(written.kept, before=steps, depth=depth, **values)
            self.run(written.done)
            self._count(going, kept)
            goals, going = self._goals_and_going(depth, kept)
            if goals:
                yield from self._found(depth)
            steps += kept

    def _goals_and_going(self, depth: int, kept: int) -> tuple[int, int]:
        """How many of the steps that a level has kept are goals, and from how many the search goes on."""
        goal, goes_on = self.written.steps.goal, self.written.steps.goes_on
        if goal is not None and goes_on is not None:  # DuckDB takes 1 ms to count nothing
            return kept * goal, kept * goes_on
        ((goals, going),) = self.tables.rows(COUNTS, depth=depth)
        return goals, going

    def load(self, beginning: Beginning) -> int:
        steps = self.written.steps
        start = steps.after(self.hunt.start)
        rows = [(0, None, None, 0, *(start.get(column) for column in (*steps.rows, *steps.own)), False, True)]
        for step, parent, depth, begun in beginning.steps():
            after = steps.after(begun.values)
            values = *loads(begun.row), *(after.get(column) for column in steps.own)
            rows.append((step, parent, begun.place % ELEMENTS, depth, *values, begun.goal, begun.goes_on))
        self.tables.load(self.written.start.table, list(zip(*rows, strict=True)))
        columns = list(zip(*self.elements, strict=True))[: len(steps.reads)]
        self.tables.load(self.written.elements.table, [range(len(self.elements)), *columns])
        return len(rows) - 1

    def _count(self, expanded: int, kept: int) -> None:
        stats, tried = self.hunt.stats, expanded * len(self.elements)
        stats.generated += tried
        stats.expanded += expanded
        stats.levels.append(Level(kept, kept, tried - kept))
        self.hunt.check()

    def _found(self, depth: int) -> Iterator[Found]:
        """The paths to the goals of a level."""
        tables, written = self.tables, self.written
        lasts = self._lasts(depth) if self.hunt.keyed else None
        for _, rows in groupby(walked_ways(tables, WAYS, written.paths, depth=depth), itemgetter(0)):
            path = [row[1:] for row in rows]
            yield path, None if lasts is None else next(lasts)

    def _lasts(self, depth: int) -> Iterator[Last]:
        """The elements and the state before, of the last steps of the paths."""
        for nth, *state in self.tables.rows(self.written.lasts, depth=depth):
            yield (*self._combinations[nth], *state)

    @cached_property
    def _combinations(self) -> list[Last]:
        return combinations(self.hunt)


def combinations(hunt: Hunt) -> list[Last]:
    """The elements of the sources in their order, which are the same for all states."""
    assert hunt.pieces is not None
    hunt.flush()
    stats, sources = hunt.stats, len(hunt.query.sources)
    expanded = stats.expanded
    made = [last[:sources] for last in hunt.pieces.elements(hunt.start)]
    hunt.flush()
    stats.expanded = expanded  # no state was, for this
    return made

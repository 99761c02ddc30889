"""Going from level to level where the steps are SQL: nothing but results passes through Python."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from itertools import groupby
from operator import itemgetter

from ss2sql.lowering.portable.steps import ELEMENTS, too_many_elements
from ss2sql.runtime.levels.search import TableSearch
from ss2sql.runtime.levels.tables import Tables, walked_ways
from ss2sql.runtime.levels.typed import COUNTS, WAYS, TypedStatements
from ss2sql.runtime.memorize.hunt import Found, Hunt
from ss2sql.runtime.memorize.pieces import Last
from ss2sql.runtime.run import Level


class TypedSearch(TableSearch):
    """One search in some tables."""

    def __init__(self, hunt: Hunt, tables: Tables, written: TypedStatements) -> None:
        super().__init__(hunt, tables)
        self.written = written
        self.elements = written.elements_of(hunt.run)
        if len(self.elements) > ELEMENTS:
            raise too_many_elements("FROM")

    def results(self) -> Iterator[Found]:
        """The paths and the last parts of their last steps."""
        written, tables = self.written, self.tables
        self.run(written.made)
        self._load()
        values = {label: self.hunt.run.source(name) for label, name in written.steps.parameters.items()}
        expanded, depth, steps = 1, 0, 0
        while expanded and self.elements:
            depth += 1
            self.run((*written.kept, *written.done), before=steps, depth=depth, **values)
            ((kept, goals, going, last),) = tables.rows(COUNTS, depth=depth)
            self._count(expanded, kept)
            if goals:
                yield from self._found(depth)
            expanded, steps = going, last

    def _load(self) -> None:
        """The state at the start, and what is read of the elements."""
        steps = self.written.steps
        start = dict(zip(steps.states, self.hunt.start, strict=True))
        values = [start.get(column) for column in (*steps.rows, *steps.own)]
        self.tables.load(self.written.start.table, [[value] for value in (0, None, None, 0, *values, False, True)])
        columns = list(zip(*self.elements, strict=True))[: len(steps.reads)]
        self.tables.load(self.written.elements.table, [range(len(self.elements)), *columns])

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

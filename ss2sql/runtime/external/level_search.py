"""Going from level to level in DuckDB: steps from the states of a level are tried, then a statement says which stay.

It finds the results of the breadth-first search that takes one step after the other, in its order. Only what nobody can
notice is different: the clauses of all steps of a level are evaluated, also of those behind the last result that is
wanted, and behind the first step to their row; so one of these may fail.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import groupby
from operator import itemgetter
from typing import Any

from ss2sql.lowering.portable.search_steps import MAX_ELEMENTS
from ss2sql.runtime.external.duckdb_store import DuckTables
from ss2sql.runtime.external.first_levels import FirstLevels
from ss2sql.runtime.external.level_statements import DuckLevelStatements
from ss2sql.runtime.external.level_steps import PythonSteps, SqlSteps, make_level_steps
from ss2sql.runtime.run.run_state import GraphLevel
from ss2sql.runtime.search.search_run import Found, SearchRun

TRIES = 2_000  # steps of a level that are SQL but tried in memory: DuckDB takes 5 ms for the smallest one
BLOCK = 5_000  # steps that are added to their table at once


class DuckSearch:
    """One search in the tables of a run."""

    def __init__(self, search_run: SearchRun, tables: DuckTables, written: DuckLevelStatements) -> None:
        self.search_run, self.tables, self.written = search_run, tables, written
        self.steps: PythonSteps = make_level_steps(search_run, written)

    def find_results(self) -> Iterator[Found]:
        """The paths and the last parts of their last steps."""
        tries = TRIES // max(len(self.steps.elements), 1) if isinstance(self.steps, SqlSteps) else math.inf
        beginning = FirstLevels(self.search_run, tries)
        yield from map(beginning.make_result, beginning.find_goals())
        depth, going = len(beginning.levels), len(beginning.frontier)
        if going:
            steps = self._load_first_levels(beginning)
            del beginning  # the tables have it all
            yield from self._search_levels(depth, steps, going)

    def _load_first_levels(self, beginning: FirstLevels) -> int:
        """Hands over what the first levels have come to; gives the number of the last step."""
        steps, free = self.steps, bool(self.written.trails)
        rows: list[Sequence[Any]] = [(0, None, None, 0, *steps.make_start_row(), *([[]] if free else ()))]
        first = before = 0  # how many steps were kept before a level, and before the one above
        for depth, level in enumerate(beginning.levels, 1):
            for step, begun in enumerate(level, first + 1):
                parent, nth = divmod(begun.place, MAX_ELEMENTS)
                parent += before if parent else 0
                trail = [steps.collect_trail(beginning.trace_path(begun, depth))] if free else ()
                rows.append((step, parent, nth, depth, *steps.make_table_row(begun), *trail))
            first, before = first + len(level), first
        self.tables.create_table("steps", self.written.columns, rows)
        if isinstance(steps, SqlSteps):
            self.tables.create_table("elements", self.written.elements, steps.elements)
        return first

    def _search_levels(self, depth: int, steps: int, going: int) -> Iterator[Found]:
        """The results behind that level and step, where so many states of the level are to be expanded."""
        search_run, tables, written = self.search_run, self.tables, self.written
        while going:
            depth += 1
            generated = search_run.stats.generated
            if isinstance(self.steps, SqlSteps):
                self.steps.count_tries(going)
            else:
                self._expand_level(depth)
            kept = tables.add_rows(written.kept, steps, depth=depth, **self.steps.values)
            steps += kept
            search_run.stats.levels.append(GraphLevel(kept, kept, search_run.stats.generated - generated - kept))
            search_run.check()
            goals, going = self._count_goals_and_continuing(depth, kept)
            if goals:
                yield from self._read_goals(depth)

    def _expand_level(self, depth: int) -> None:
        """Adds the steps from all states of a level to `tries`."""
        tables, written, after = self.tables, self.written, -1
        tables.create_table("tries", written.tries)
        block: list[Any] = []
        while page := list(tables.read_rows(written.page, depth=depth, after=after)):
            for after, state in page:
                block += self.steps.trial.evaluate_steps(after, state)
                if len(block) >= BLOCK:
                    tables.load_rows("tries", written.tries, block)
                    block.clear()
        tables.load_rows("tries", written.tries, block)
        self.search_run.flush()

    def _count_goals_and_continuing(self, depth: int, kept: int) -> tuple[int, int]:
        """How many of the steps that a level has kept are goals, and from how many the search goes on."""
        goal, goes_on = self.written.steps.goal, self.written.steps.goes_on
        if goal is not None and goes_on is not None:  # DuckDB takes 1 ms to count nothing
            return kept * goal, kept * goes_on
        ((goals, going),) = self.tables.read_rows(self.written.counts, kept=True, depth=depth)
        return goals, going

    def _read_goals(self, depth: int) -> Iterator[Found]:
        self.tables.run_statement(self.written.ways, depth=depth)
        for _, rows in groupby(self.tables.read_rows(self.written.paths), itemgetter(0)):
            path = [row[1:] for row in rows]
            (nth, *shown), before = path[-1], path[-2][1:] if len(path) > 1 else None
            yield [self.steps.read_row(values) for _, *values in path], self.steps.read_last_part(nth, shown, before)

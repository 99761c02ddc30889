"""One level of a search whose steps are SQL, as statements.

`steps` has all steps that were kept, numbered in their order from 1, with typed columns for their row and the state
after them; the start is step 0. `elements` has what is read of the sources, `nth` counts them. No step can fail.
"""

from __future__ import annotations

from collections.abc import Iterator

from ss2sql import plan
from ss2sql.lowering.portable.steps import ELEMENTS, Typed, WrittenSteps
from ss2sql.runtime.levels.level import GOALS_AND_GOING, back_to_start, ways_back
from ss2sql.runtime.levels.statements import AddNumbered, Ask, Create, Drop, Make, Statement, listed
from ss2sql.runtime.native.compiled import NativeQuery
from ss2sql.runtime.rows import Row
from ss2sql.runtime.run import Run

MET = "AND steps.depth > 0"  # the start is no row
COUNTS = Ask(f"SELECT {GOALS_AND_GOING} FROM steps WHERE depth = :depth", simple=True)
WAYS = ways_back("steps WHERE depth = :depth AND goal", MET)


class TypedStatements:
    """The statements of a search."""

    def __init__(self, steps: WrittenSteps, search: plan.Search) -> None:
        self.steps, self.search = steps, search
        self._elements = NativeQuery(steps.elements)
        self.elements = Create("elements", listed("nth BIGINT", *steps.reads))
        rows, own = _names(steps.rows), _names(steps.own)
        self.columns = listed(*rows, *own)
        numbers = ("step BIGINT", "parent BIGINT", "nth BIGINT", "depth BIGINT")
        self.start = Create("steps", listed(*numbers, *steps.rows, *steps.own, "goal BOOLEAN", "goes_on BOOLEAN"))
        self.made: list[Statement] = [self.elements, self.start]
        self.tried: list[Statement] = []
        self.done: list[Statement] = []
        if search.repeats == "unique":
            self.kept = self._added(self._first(rows, own))
        elif search.repeats == "no cycle":
            self.tried = [
                Make("tries", steps.tries),
                back_to_start(parent=f"place // {ELEMENTS}", row=rows, more=MET),
            ]
            self.kept = self._added(_FREE)
            self.done = [Drop("tries"), Drop("back")]
        else:
            self.kept = self._added(steps.tries)
        self.paths = Ask(f"""
            SELECT ways.goal, {listed(*(f"steps.{name}" for name in rows))}
            FROM ways
            JOIN steps ON steps.step = ways.step
            ORDER BY ways.goal, ways.distance DESC
        """)
        self.lasts = Ask(f"""
            SELECT steps.nth, {listed(*(f"before.{name}" for name in _names(steps.states)))}
            FROM steps
            JOIN steps AS before ON before.step = steps.parent
            WHERE steps.depth = :depth AND steps.goal
            ORDER BY steps.step
        """)

    def elements_of(self, run: Run) -> list[Row]:
        """What is read of the elements in a run."""
        rows = self._elements.rows(run).rows
        assert rows is not None
        return rows

    def level(self) -> Iterator[Statement]:
        """All of one level, in order."""
        yield from (*self.tried, self.kept, *self.done)
        if None in (self.steps.goal, self.steps.goes_on):
            yield COUNTS
        if self.steps.goal is not False:
            yield from (WAYS, self.paths, Drop(WAYS.table))

    def _added(self, select: str) -> AddNumbered:
        numbers = f"step, place // {ELEMENTS}, place % {ELEMENTS}, :depth"
        return AddNumbered("steps", f"{numbers}, {self.columns}, goal, goes_on", select)

    def _first(self, rows: list[str], own: list[str]) -> str:
        """The first step to each row, if none of a level before has led there."""
        shown = listed(*(f"tries.{name}" for name in rows))
        others = [f"MIN_BY(tries.{name}, tries.place) AS {name}" for name in own]
        goal, goes_on = self.steps.goal, self.steps.goes_on
        if goal is None or goes_on is None:  # one value for both takes 4 % less time
            flags = "CASE WHEN NOT tries.goal THEN 1 WHEN tries.goes_on THEN 3 ELSE 2 END"
            others.append(f"MIN_BY({flags}, tries.place) AS flags")
        chosen = (
            f"{'flags > 1' if goal is None else goal} AS goal",
            f"{'flags <> 2' if goes_on is None else goes_on} AS goes_on",
        )
        met = " AND ".join(f"steps.{name} = tries.{name}" for name in rows)
        # NOT EXISTS takes 1.3 times as long in DuckDB, which looks for other ways to ask it.
        return f"""
            SELECT *, {listed(*chosen)}
            FROM (
              SELECT {listed(shown, "MIN(tries.place) AS place", *others)}
              FROM ({self.steps.tries}) AS tries
              ANTI JOIN steps ON {met} {MET}
              GROUP BY {shown}
            ) AS firsts
        """


_FREE = "SELECT * FROM tries WHERE place IN (SELECT place FROM back WHERE previous = 0)"


def _names(columns: tuple[Typed, ...]) -> list[str]:
    return [column.name for column in columns]

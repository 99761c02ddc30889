"""The paths of a search as a DataFrame of Spark: nothing of them passes through this process.

Ways lead back from the goals of all levels together, by a join with each level. Where steps are tried in Python rows
are bytes until then, of which the executors make columns; these have the types that frames of other libraries have.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from ss2sql.errors import RepresentationError
from ss2sql.lowering.portable.steps import ELEMENTS, Typed
from ss2sql.results.kinds import holds_any, promised_shape
from ss2sql.runtime.levels.beginning import Beginning, Begun
from ss2sql.runtime.levels.row_columns import NOTHING, Told, tell_columns, told_of, types_of, with_columns
from ss2sql.runtime.levels.sending import sent
from ss2sql.runtime.levels.spark_search import FEW, Reached, SparkSearch
from ss2sql.runtime.levels.steps import TypedSteps

if TYPE_CHECKING:
    from pyspark.sql import DataFrame

JOINS = 16  # of ways that are computed at once


class FramedSearch(SparkSearch):
    """One search whose results stay in Spark."""

    def frame(self, most: int | None) -> DataFrame:
        """The rows of the first `most` paths: path, step, and the columns of SELECT; steps of Spark's own session."""
        with self._begun() as beginning:
            parts = [] if most == 0 else list(self._parts(beginning, most))
            rows = parts[0] if parts else self._loaded("path", [])
            for part in parts[1:]:
                rows = rows.unionAll(part)
            return self.store.handed_over(self._columns(rows))

    @property
    def _kept(self) -> tuple[Typed, ...]:
        """What is kept of a row."""
        return self.written.steps.rows if self._typed else (Typed("row", "BLOB"),)

    @property
    def _typed(self) -> bool:
        return isinstance(self.steps.made, TypedSteps)

    def _loaded(self, first: str, rows: list[Any]) -> DataFrame:
        numbers = Typed(first, "BIGINT"), Typed("place" if first == "step" else "step", "BIGINT")
        return self.store.loaded((*numbers, *self._kept), rows)

    def _parts(self, beginning: Beginning, most: int | None) -> Iterator[DataFrame]:
        """The rows of the paths, part by part."""
        ways = []
        for goal in beginning.goals():
            ways.append(beginning.way(goal, len(beginning.levels) + 1))
            if len(ways) == most:
                break
        if ways:
            yield self._rows_of(ways)
        if len(ways) != most:
            yield from self._ways_back(self._goals(beginning, len(ways), most))

    def _rows_of(self, ways: list[list[Begun]]) -> DataFrame:
        """The rows of paths that this process knows."""
        rows = [
            (path, step, *self._kept_of(begun)) for path, way in enumerate(ways, 1) for step, begun in enumerate(way, 1)
        ]
        return self._loaded("path", rows)

    def _kept_of(self, begun: Begun) -> Any:
        return self.steps.made.shown_of(begun)[: len(self._kept)]

    # --- goals and ways ----------------------------------------------------------------------------------

    def _goals(self, beginning: Beginning, before: int, most: int | None) -> dict[int, DataFrame]:
        """The goals of each level, with the numbers of their paths, which follow those of the paths before."""
        goals: dict[int, DataFrame] = {}
        for reached in self._levels(beginning):
            found = reached.counts.goals
            if found:
                goals[reached.depth] = self._counted(reached, found, before, most)
                before += found
            if most is not None and before >= most:
                break
        for depth, level in enumerate(beginning.levels, 1) if goals else ():
            rows = [(step, begun.place, *self._kept_of(begun)) for step, begun in enumerate(level, 1)]
            self.levels[depth] = self._loaded("step", rows)
        return goals

    def _counted(self, reached: Reached, found: int, before: int, most: int | None) -> DataFrame:
        goals = reached.goals.select("step")
        if found > FEW:
            numbered = self._numbered(goals, "step", "nth")
        else:
            numbered = goals.selectExpr("CAST(ROW_NUMBER() OVER (ORDER BY step) AS BIGINT) AS nth", "step")
        numbered = numbered.selectExpr(f"nth + {before} AS path", "step")
        return numbered if most is None else numbered.where(f"path <= {most}")

    def _ways_back(self, goals: dict[int, DataFrame]) -> Iterator[DataFrame]:
        """The rows of the ways to goals, from the last level to the first."""
        ways: DataFrame | None = None
        columns = [column.name for column in self._kept]
        for depth in range(max(goals, default=0), 0, -1):
            self._pause()
            own = goals.get(depth)
            if own is not None:
                ways = own if ways is None else ways.unionAll(own)
            assert ways is not None
            met = self.store.persisted(ways.join(self.levels[depth].select("step", "place", *columns), "step"))
            if depth % JOINS == 0:
                met.count()
            yield met.selectExpr("path", f"CAST({depth} AS BIGINT) AS step", *columns)
            ways = met.selectExpr("path", f"place DIV {ELEMENTS} AS step")

    # --- columns -----------------------------------------------------------------------------------------

    def _columns(self, rows: DataFrame) -> DataFrame:
        """The rows with the columns of SELECT, numbered."""
        outputs = self.hunt.query.columns
        if self._typed:
            return rows.toDF("path", "step", *(f"c{number}" for number in range(len(outputs))))
        rows = self.store.persisted(rows)  # it is read twice
        told = [NOTHING] * len(outputs)
        asked = rows.select("row").mapInArrow(sent(tell_columns, len(outputs)), "told BINARY")
        for (part,) in asked.collect():
            told = [one.merged(other) for one, other in zip(told, told_of(bytes(part)), strict=True)]
        shapes = []
        for output, column in zip(outputs, told, strict=True):
            if holds_any(column.shape):
                raise _refused(output.name, column)
            shapes.append(promised_shape(column.shape, output.expr.type))
        return rows.mapInArrow(sent(with_columns, pickle.dumps(shapes)), types_of(shapes))


def _refused(name: str, told: Told) -> RepresentationError:
    if told.other is None:
        message = f"Spark has no type for {told.first} in the column '{name}'"
    else:
        kinds = f"values of several kinds, such as {told.first} and {told.other}"
        message = f"the column '{name}' has {kinds}; a column of Spark has one"
    return RepresentationError("V001", message, hints=("make them alike in SELECT, with str(...) or float(...)",))

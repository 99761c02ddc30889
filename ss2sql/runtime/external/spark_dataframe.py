"""The paths of a search as a DataFrame of Spark: nothing of them passes through this process.

Ways lead back from the goals of all levels together, by a join with each level. Where steps are tried in Python rows
are bytes until then, of which the executors make columns; these have the types that frames of other libraries have.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterator, Sequence
from marshal import loads
from typing import TYPE_CHECKING, Any

from ss2sql.language.column_shapes import (
    ColumnShape,
    Shape,
    build_type_error,
    convert_value_to_shape,
    infer_missing_shape,
    infer_shape,
    is_untyped,
    make_arrow_type,
)
from ss2sql.lowering.portable.search_steps import MAX_ELEMENTS, TypedColumn
from ss2sql.runtime.external.level_steps import FirstLevels, FirstStep, SqlSteps
from ss2sql.runtime.external.spark_search import MAX_IN_ONE_PARTITION, ComputedLevel, SparkSearch
from ss2sql.runtime.external.task_pickle import make_task

if TYPE_CHECKING:
    import pyarrow as pa  # type: ignore[import-untyped]
    from pyspark.sql import DataFrame
    from pyspark.sql.types import StructType


def read_spark_shapes(part: bytes) -> list[ColumnShape]:
    told: list[ColumnShape] = pickle.loads(part)
    return told


def describe_row_shapes(batches: Iterator[pa.RecordBatch], width: int) -> Iterator[pa.RecordBatch]:
    """What a task tells of the rows in so many columns, as one answer."""
    import pyarrow as pa

    told = [ColumnShape()] * width
    for block in batches:
        columns = _transpose_spark_rows(block.column(0), width)
        told = [before.merge_shapes(infer_shape(values)) for before, values in zip(told, columns, strict=True)]
    yield pa.record_batch([pa.array([pickle.dumps(told)], pa.binary())], names=["told"])


def unpickle_rows_in_spark(batches: Iterator[pa.RecordBatch], pickled: bytes) -> Iterator[pa.RecordBatch]:
    """Path, step and row, with the row as columns of these shapes."""
    import pyarrow as pa

    shapes: list[Shape] = pickle.loads(pickled)
    for block in batches:
        columns = _transpose_spark_rows(block.column(2), len(shapes))
        arrays = [
            pa.array([convert_value_to_shape(value, shape) for value in values], make_arrow_type(pa, shape))
            for values, shape in zip(columns, shapes, strict=True)
        ]
        yield pa.record_batch([block.column(0), block.column(1), *arrays], schema=_build_schema(shapes))


def _transpose_spark_rows(rows: pa.Array, width: int) -> list[tuple[Any, ...]]:
    """Rows by columns, also where there are none."""
    return list(zip(*map(loads, rows.to_pylist()), strict=True)) or [()] * width


def _build_schema(shapes: Sequence[Shape]) -> pa.Schema:
    import pyarrow as pa

    own = [(f"c{number}", make_arrow_type(pa, shape)) for number, shape in enumerate(shapes)]
    return pa.schema([("path", pa.int64()), ("step", pa.int64()), *own])


def build_spark_types(shapes: Sequence[Shape]) -> StructType:
    """The types of Spark for path, step and columns of these shapes."""
    from pyspark.sql.pandas.types import from_arrow_schema

    return from_arrow_schema(_build_schema(shapes))


MAX_JOINS = 16  # of ways that are computed at once


class DataFrameSearch(SparkSearch):
    """One search whose results stay in Spark."""

    def make_dataframe(self, most: int | None) -> DataFrame:
        """The rows of the first `most` paths: path, step, and the columns of SELECT; steps of Spark's own session."""
        with self._begin_first_levels() as beginning:
            parts = [] if most == 0 else list(self._iterate_parts(beginning, most))
            rows = parts[0] if parts else self._load_graph("path", [])
            for part in parts[1:]:
                rows = rows.unionAll(part)
            return self.store.hand_over_frame(self._select_columns(rows))

    @property
    def _kept(self) -> tuple[TypedColumn, ...]:
        """What is kept of a row."""
        return self.written.steps.rows if self._typed else (TypedColumn("row", "BLOB"),)

    @property
    def _typed(self) -> bool:
        return isinstance(self.steps.made, SqlSteps)

    def _load_graph(self, first: str, rows: list[Any]) -> DataFrame:
        numbers = TypedColumn(first, "BIGINT"), TypedColumn("place" if first == "step" else "step", "BIGINT")
        return self.store.load_rows((*numbers, *self._kept), rows)

    def _iterate_parts(self, beginning: FirstLevels, most: int | None) -> Iterator[DataFrame]:
        begun_paths = []
        for goal in beginning.find_goals():
            begun_paths.append(beginning.trace_path(goal, len(beginning.levels) + 1))
            if len(begun_paths) == most:
                break
        if begun_paths:
            yield self._load_paths(begun_paths)
        if len(begun_paths) != most:
            yield from self._join_paths_back(self._find_level_goals(beginning, len(begun_paths), most))

    def _load_paths(self, begun_paths: list[list[FirstStep]]) -> DataFrame:
        """The rows of paths that this process knows."""
        rows = [
            (path, step, *self._select_kept_columns(begun))
            for path, path_steps in enumerate(begun_paths, 1)
            for step, begun in enumerate(path_steps, 1)
        ]
        return self._load_graph("path", rows)

    def _select_kept_columns(self, begun: FirstStep) -> Any:
        return self.steps.made.make_shown(begun)[: len(self._kept)]

    # --- goals and ways ----------------------------------------------------------------------------------

    def _find_level_goals(self, beginning: FirstLevels, before: int, most: int | None) -> dict[int, DataFrame]:
        """The goals of each level, with the numbers of their paths, which follow those of the paths before."""
        goals: dict[int, DataFrame] = {}
        for reached in self._compute_levels(beginning):
            found = reached.counts.goals
            if found:
                goals[reached.depth] = self._number_goals(reached, found, before, most)
                before += found
            if most is not None and before >= most:
                break
        for depth, level in enumerate(beginning.levels, 1) if goals else ():
            rows = [(step, begun.place, *self._select_kept_columns(begun)) for step, begun in enumerate(level, 1)]
            self.levels[depth] = self._load_graph("step", rows)
        return goals

    def _number_goals(self, reached: ComputedLevel, found: int, before: int, most: int | None) -> DataFrame:
        goals = reached.goals.select("step")
        if found > MAX_IN_ONE_PARTITION:
            numbered = self._number_spark_rows(goals, "step", "nth")
        else:
            numbered = goals.selectExpr("CAST(ROW_NUMBER() OVER (ORDER BY step) AS BIGINT) AS nth", "step")
        numbered = numbered.selectExpr(f"nth + {before} AS path", "step")
        return numbered if most is None else numbered.where(f"path <= {most}")

    def _join_paths_back(self, goals: dict[int, DataFrame]) -> Iterator[DataFrame]:
        """The rows of the ways to goals, from the last level to the first."""
        begun_paths: DataFrame | None = None
        columns = [column.name for column in self._kept]
        for depth in range(max(goals, default=0), 0, -1):
            self._flush_and_check()
            own = goals.get(depth)
            if own is not None:
                begun_paths = own if begun_paths is None else begun_paths.unionAll(own)
            assert begun_paths is not None
            met = self.store.persist_frame(
                begun_paths.join(self.levels[depth].select("step", "place", *columns), "step")
            )
            if depth % MAX_JOINS == 0:
                met.count()
            yield met.selectExpr("path", f"CAST({depth} AS BIGINT) AS step", *columns)
            begun_paths = met.selectExpr("path", f"place DIV {MAX_ELEMENTS} AS step")

    # --- columns -----------------------------------------------------------------------------------------

    def _select_columns(self, rows: DataFrame) -> DataFrame:
        """The rows with the columns of SELECT, numbered."""
        outputs = self.search_run.query.columns
        if self._typed:
            return rows.toDF("path", "step", *(f"c{number}" for number in range(len(outputs))))
        rows = self.store.persist_frame(rows)  # it is read twice
        told = [ColumnShape()] * len(outputs)
        described = rows.select("row").mapInArrow(make_task(describe_row_shapes, len(outputs)), "told BINARY")
        for (part,) in described.collect():
            told = [one.merge_shapes(other) for one, other in zip(told, read_spark_shapes(bytes(part)), strict=True)]
        shapes = []
        for output, column in zip(outputs, told, strict=True):
            if is_untyped(column.shape):
                hint = "select what can be told of it, such as its name"
                raise build_type_error("Spark", output.name, column, hint)
            shapes.append(infer_missing_shape(column.shape, output.expr.type))
        return rows.mapInArrow(make_task(unpickle_rows_in_spark, pickle.dumps(shapes)), build_spark_types(shapes))

"""Going from level to level in Spark: steps by Python processes of the executors, or by SQL.

Each level is one query, whose rows the executors keep, and one job, which counts them. A plan takes as long as the job
of a level with some thousand steps. The levels that are smaller than that this process does itself, see level_steps.py.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import accumulate
from marshal import loads
from operator import itemgetter
from typing import TYPE_CHECKING, Any

from ss2sql.errors import ExecutionError
from ss2sql.lowering.portable.search_steps import MAX_ELEMENTS, TypedColumn
from ss2sql.runtime.external.level_query import SparkLevelStatements
from ss2sql.runtime.external.level_steps import FirstLevels, SqlSteps, make_level_steps
from ss2sql.runtime.external.spark_session import SparkStore
from ss2sql.runtime.external.table_statements import join_column_names, list_duckdb_columns, make_schema
from ss2sql.runtime.external.task_pickle import (
    add_executor_counts,
    expand_spark_batches,
    make_task,
    pickle_search,
)
from ss2sql.runtime.run.run_state import GraphLevel
from ss2sql.runtime.search.search_run import Found, SearchRun

if TYPE_CHECKING:
    from pyspark import Broadcast
    from pyspark.sql import DataFrame


TASKS_PER_CORE = 2  # of each level for each core where Python tries the steps, because some take longer than others
TABLES = 16  # of rows, before they become one; to plan with each takes some milliseconds
MAX_IN_ONE_PARTITION = 100_000  # steps of a level that are numbered in one partition, which takes a job less
MAX_COLLECTED_GOALS = 10_000  # whose paths are looked up at once
SECONDS = 0.1  # that a level may take here, where Spark takes about 0.3
STEPS_PER_QUERY = 1_000  # steps that are looked up by naming them in a query


class SparkSearch:
    """One search in a store of Spark."""

    def __init__(self, search_run: SearchRun, store: SparkStore, written: SparkLevelStatements) -> None:
        self.search_run, self.store, self.written = search_run, store, written
        self.made = make_level_steps(search_run, written)
        self.broadcast: Broadcast[bytes] | None = None  # the search, where executors try its steps in Python
        self.levels: dict[int, DataFrame] = {}
        self.met: DataFrame | None = None  # the rows of all levels, for UNIQUE
        self.tables = 0  # of which they are put together
        # Steps on paths to goals, by level and number: their place, and what is shown of them.
        self.known: dict[tuple[int, int], tuple[int, Sequence[Any]]] = {}

    def find_results(self) -> Iterator[Found]:
        """The paths and the last parts of their last steps."""
        try:
            packed = None if isinstance(self.made, SqlSteps) else pickle_search(self.search_run)
            beginning = FirstLevels(self.search_run, seconds=SECONDS)
            yield from map(beginning.make_result, beginning.find_goals())
            if beginning.frontier:
                yield from self._search_levels(beginning, packed)
        finally:
            if self.broadcast is not None:
                self.broadcast.destroy()

    # --- from level to level -----------------------------------------------------------------------------

    def _search_levels(self, beginning: FirstLevels, packed: bytes | None) -> Iterator[Found]:
        """The results after the first levels. The executors get the `packed` search, or the values of elements."""
        if isinstance(self.made, SqlSteps):
            elements = self.store.session.createDataFrame(self.made.elements)
            elements.coalesce(1).createOrReplaceTempView("elements")
        else:
            assert packed is not None
            self.broadcast = self.store.context.broadcast(packed)
        self._load_first_levels(beginning)
        stats, depth, expanded = self.search_run.stats, len(beginning.levels), len(beginning.frontier)
        frontier, few = self._make_frontier(beginning), True
        while expanded:
            depth += 1
            self.search_run.flush()
            self.search_run.check()
            kept = self.levels[depth] = self._plan_level(frontier, few)
            generated = stats.generated
            ((number, goals, going, accounts, matched),) = self.store.query_rows(
                self.written.counts, self.made.values
            ).collect()
            if isinstance(self.made, SqlSteps):
                self.made.count_tries(expanded, None if matched is None else int(matched))
            self._read_accounts(accounts, frontier)
            if goals:
                yield from self._read_goals(depth, kept.where("goal"), goals)
            stats.levels.append(GraphLevel(number, number, stats.generated - generated - number))
            few = going * number <= MAX_IN_ONE_PARTITION * expanded  # kept, if as many for each state
            expanded, frontier = going, kept.where("goes_on")
            if self.written.search.repeats == "unique":
                self._add_to_closed_list(kept.where("place >= 0"))

    def _plan_level(self, frontier: DataFrame, few: bool) -> DataFrame:
        """The steps that a level keeps, not computed yet."""
        from pyspark.sql.pandas.types import from_arrow_schema

        cores = self.store.context.defaultParallelism
        if self.broadcast is None:
            frontier = frontier.repartition(cores, "step")
        frontier.createOrReplaceTempView("frontier")
        if self.broadcast is not None:
            spread = frontier.select("step", "state").repartition(cores * TASKS_PER_CORE, "step")
            columns = [(column.name, column.type) for column in self.written.tries]
            steps = make_task(expand_spark_batches, self.store.name, self.broadcast, columns)
            schema = from_arrow_schema(make_schema(self.written.tries))
            spread.mapInArrow(steps, schema).createOrReplaceTempView("tries")
        if self.met is not None:
            self.met.createOrReplaceTempView("steps")
        if few:
            kept = self.store.persist_frame(self.store.query_rows(self.written.kept, self.made.values))
        else:
            kept = self._select_kept_in_partitions()
        kept.createOrReplaceTempView("kept")
        return kept

    def _read_accounts(self, accounts: list[bytes], frontier: DataFrame) -> None:
        """Counts what tasks have told. Raises what has kept one from its work, or has failed there."""
        told: list[dict[str, Any]] = [loads(bytes(state)) for state in accounts]
        for one in told:
            if one["trouble"]:
                hint = "what functions import has to be installed there, or sent with spark.sparkContext.addPyFile"
                raise ExecutionError(
                    "X009", f"an executor cannot make the search ready: {one['trouble']}", hints=(hint,)
                )
            add_executor_counts(self.search_run.stats, one)
        refused = [one["refused"] for one in told if one["refused"] is not None]
        if refused:
            step = min(refused)
            ((state,),) = frontier.where(f"step = {step}").select("state").collect()
            for _ in self.made.evaluation.evaluate_steps(step, bytes(state)):  # raises here what it raised there
                pass
            hint = "see whether a function is declared immutable that is not"
            raise ExecutionError("X009", "a step that failed did not fail again", hints=(hint,))

    def _select_kept_in_partitions(self) -> DataFrame:
        """The same without bringing all rows into one partition: sorted parts, and where each begins follows from the
        counts of those before.
        """
        chosen = self.store.query_rows(self.written.chosen, self.made.values)
        rows = self.store.persist_frame(chosen)  # read twice to be sorted
        numbers = ("spark_partition_id() AS part", f"monotonically_increasing_id() & {(1 << 33) - 1} AS nth_of_part")
        ranged = rows.repartitionByRange("place").sortWithinPartitions("place").selectExpr(*numbers, "*")
        in_order = self.store.persist_frame(ranged)
        found = dict(map(tuple, in_order.groupBy("part").count().collect()))
        starts = accumulate((found.get(number, 0) for number in range(max(found, default=0))), initial=0)
        offsets = join_column_names(*(f"{start}L" for start in starts))
        return in_order.selectExpr(f"array({offsets})[part] + nth_of_part + 1 AS step", *rows.columns)

    def _add_to_closed_list(self, rows: DataFrame) -> None:
        rows = rows.select(*list_duckdb_columns(self.written.steps.rows))
        self.met = rows if self.met is None else self.met.unionAll(rows)
        self.tables += 1
        if self.tables == TABLES:
            self.met, self.tables = self.store.persist_frame(self.met), 1

    # --- from this process to Spark ----------------------------------------------------------------------

    def _load_first_levels(self, beginning: FirstLevels) -> None:
        """Hands over what the first levels have come to."""
        made = self.made
        for depth, level in enumerate(beginning.levels, 1):
            for step, begun in enumerate(level, 1):
                self.known[depth, step] = begun.place, made.make_shown(begun)
        if self.written.search.repeats == "unique":
            keys = [made.make_key(begun) for level in beginning.levels for begun in level]
            self._add_to_closed_list(self.store.load_rows(self.written.steps.rows, keys))

    def _make_frontier(self, beginning: FirstLevels) -> DataFrame:
        """The states that the first levels go on from."""
        depth, made, trails = len(beginning.levels), self.made, self.written.trails
        columns = (TypedColumn("step", "BIGINT"), *made.list_next_state(beginning.frontier[0][1]), *trails)
        rows = []
        for step, begun in beginning.frontier:
            trail = [made.collect_trail(beginning.trace_path(begun, depth) if depth else [])] if trails else []
            rows.append((step, *made.list_next_state(begun).values(), *trail))
        return self.store.load_rows(columns, rows)

    # --- paths -------------------------------------------------------------------------------------------

    def _read_goals(self, depth: int, goals: DataFrame, count: int) -> Iterator[Found]:
        rows = goals.select("step", "place", *self.written.shown)
        few = count <= MAX_COLLECTED_GOALS
        block: list[int] = []
        for step, place, *values in sorted(rows.collect(), key=itemgetter(0)) if few else rows.toLocalIterator():
            self.known[depth, step] = place, values
            block.append(step)
            if len(block) == MAX_COLLECTED_GOALS:
                yield from self._iterate_paths(depth, block)
                block.clear()
        yield from self._iterate_paths(depth, block)

    def _iterate_paths(self, depth: int, goals: list[int]) -> Iterator[Found]:
        """The paths to some goals of a level, which are put together here: they are results.

        Most of a path is known from goals of levels before, and from the levels that began here.
        """
        missing, above = goals, depth
        while missing and above > 1:
            wanted = {self.known[above, step][0] // MAX_ELEMENTS for step in missing}
            above -= 1
            missing = sorted(step for step in wanted if (above, step) not in self.known)
            self._remember_steps(above, missing)
        for goal in goals:
            path_steps, step = list[tuple[int, Sequence[Any]]](), goal
            for above in range(depth, 0, -1):
                path_steps.append(self.known[above, step])
                step = path_steps[-1][0] // MAX_ELEMENTS
            last = self.made.read_last_part(*path_steps[0], path_steps[1][1] if depth > 1 else None)
            yield [self.made.read_row(shown) for _, shown in reversed(path_steps)], last

    def _remember_steps(self, depth: int, steps: list[int]) -> None:
        """Has this process know some steps of a level."""
        if not steps:
            return
        level = self.levels[depth]
        if len(steps) <= STEPS_PER_QUERY:
            some = level.where(f"step IN ({join_column_names(*steps)})")
        else:
            some = level.join(self.store.load_rows((TypedColumn("step", "BIGINT"),), [[s] for s in steps]), "step")
        for step, place, *values in some.select("step", "place", *self.written.shown).collect():
            self.known[depth, step] = place, values

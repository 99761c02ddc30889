"""How the steps of a level are made in Spark: by Python processes of the executors, or by SQL."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ss2sql.errors import ExecutionError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.rows import Row
from ss2sql.runtime.external.level_statements import SparkLevelStatements
from ss2sql.runtime.external.level_steps import SqlSteps, make_level_steps
from ss2sql.runtime.external.spark_executor import expand_batches, read_account
from ss2sql.runtime.external.spark_store import SparkStore, write_spark_schema
from ss2sql.runtime.external.spark_tasks import make_task
from ss2sql.runtime.external.task_pickle import add_executor_counts, pickle_search
from ss2sql.runtime.search.search_run import SearchRun

if TYPE_CHECKING:
    from pyspark import Broadcast
    from pyspark.sql import DataFrame

TASKS_PER_CORE = 2  # of each level for each core where Python tries the steps, because some take longer than others


@dataclass(frozen=True, slots=True)
class LevelCounts:
    """What became of a level: how many steps were tried and kept, how many of these are goals, and how many go on."""

    tried: int
    kept: int
    goals: int
    continuing: int


class SparkSteps:
    """The steps of a search in a store."""

    def __init__(self, search_run: SearchRun, store: SparkStore, written: SparkLevelStatements) -> None:
        self.search_run, self.store, self.written = search_run, store, written
        self.made = make_level_steps(search_run, written)
        self.parcel: Broadcast[bytes] | None = None

    def check_transferable(self) -> None:
        """Raises UnsupportedError where the executors cannot have what they need."""
        if not isinstance(self.made, SqlSteps):
            self.packed = pickle_search(self.search_run)

    def send_to_executors(self) -> None:
        """Has the executors get what they need for all levels: the search itself, or the values of elements."""
        if isinstance(self.made, SqlSteps):
            elements = self.store.load_rows(self.written.elements, self.made.elements)
            elements.coalesce(1).createOrReplaceTempView("elements")
        else:
            self.parcel = self.store.context.broadcast(self.packed)

    def release_broadcast(self) -> None:
        if self.parcel is not None:
            self.parcel.destroy()

    def make_level_views(self, frontier: DataFrame) -> None:
        """Makes the views of a level that has these states to go on from."""
        cores = self.store.context.defaultParallelism
        if self.parcel is None:
            frontier.repartition(cores, "step").createOrReplaceTempView("frontier")
            return
        frontier.createOrReplaceTempView("frontier")
        spread = frontier.select("step", "state").repartition(cores * TASKS_PER_CORE, "step")
        columns = [(column.name, column.type) for column in self.written.tries]
        steps = make_task(expand_batches, self.store.name, self.parcel, columns)
        spread.mapInArrow(steps, write_spark_schema(self.written.tries)).createOrReplaceTempView("tries")

    def read_counts(self, counts: Row, frontier: DataFrame, expanded: int) -> LevelCounts:
        """What the row of `counts` tells. Raises what has kept a task from its work, or has failed there."""
        kept, goals, going, accounts = counts
        stats, before = self.search_run.stats, self.search_run.stats.generated
        if isinstance(self.made, SqlSteps):
            self.made.count_tries(expanded)
        told: list[dict[str, Any]] = [read_account(bytes(state)) for state in accounts]
        for one in told:
            if one["trouble"]:
                hint = "what functions import has to be installed there, or sent with spark.sparkContext.addPyFile"
                raise ExecutionError(
                    "X009", f"an executor cannot make the search ready: {one['trouble']}", hints=(hint,)
                )
            add_executor_counts(stats, one)
        refused = [one["refused"] for one in told if one["refused"] is not None]
        if refused:
            self._retry_locally(min(refused), frontier)
        return LevelCounts(stats.generated - before, kept, goals, going)

    def _retry_locally(self, step: int, frontier: DataFrame) -> None:
        """Tries the steps from a state in this process, which raises what an executor met there."""
        ((state,),) = frontier.where(f"step = {step}").select("state").collect()
        for _ in self.made.trial.evaluate_steps(step, bytes(state)):
            pass
        hint = "see whether a function is declared immutable that is not"
        raise ExecutionError("X009", "a step that failed did not fail again", hints=(hint,))

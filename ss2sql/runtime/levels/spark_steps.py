"""How the steps of a level are made in Spark: by Python processes of the executors, or by SQL."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import cached_property
from marshal import loads
from typing import TYPE_CHECKING, Any

from ss2sql.errors import ExecutionError
from ss2sql.lowering.portable.steps import ELEMENTS, Typed, too_many_elements
from ss2sql.records import dataclass
from ss2sql.runtime.levels.beginning import Begun
from ss2sql.runtime.levels.executor import account, tried
from ss2sql.runtime.levels.level import TABLES
from ss2sql.runtime.levels.parcel import add_counts, packed
from ss2sql.runtime.levels.sending import sent
from ss2sql.runtime.levels.spark_level import SparkStatements, TypedSparkStatements
from ss2sql.runtime.levels.spark_store import Store, spark_schema
from ss2sql.runtime.levels.statements import Value, columns_of, listed
from ss2sql.runtime.levels.trial import Trial
from ss2sql.runtime.levels.typed_search import combinations
from ss2sql.runtime.memorize.hunt import Hunt
from ss2sql.runtime.memorize.pieces import Last
from ss2sql.runtime.rows import Row
from ss2sql.runtime.run import Stats

if TYPE_CHECKING:
    from pyspark import Broadcast
    from pyspark.sql import DataFrame

TASKS = 2  # of each level for each core where Python tries the steps, because some take longer than others


@dataclass(frozen=True, slots=True)
class Counts:
    """What became of a level: how many steps were tried and kept, how many of these are goals, and how many go on;
    the place of the first one that failed and counts.
    """

    tried: int
    kept: int
    goals: int
    going: int
    failed: int | None


def heard(
    states: Iterable[bytes], trial: Trial, state_of: Callable[[int], bytes], stats: Stats
) -> list[dict[str, Any]]:
    """What the accounts of tasks tell, counted. Raises what has kept a task from its work."""
    told = [account(bytes(state)) for state in states]
    for trouble in filter(None, (one["trouble"] for one in told)):
        hint = "what functions import has to be installed there, or sent with spark.sparkContext.addPyFile"
        raise ExecutionError("X009", f"an executor cannot make the search ready: {trouble}", hints=(hint,))
    refused = [one["refused"] for one in told if one["refused"] is not None]
    if refused:
        step = min(refused)
        for _ in trial.steps(step, state_of(step)):
            pass
        hint = "see whether a function is declared immutable that is not"
        raise ExecutionError("X009", "a step that an executor refused was not refused again", hints=(hint,))
    for one in told:
        add_counts(stats, one)
    return told


class Steps:
    """The steps of a search, tried in Python."""

    def __init__(self, hunt: Hunt, store: Store, written: SparkStatements, trial: Trial) -> None:
        self.hunt, self.store, self.trial = hunt, store, trial
        self.written = written
        self.parcel: Broadcast[bytes] | None = None

    def prepare(self) -> None:
        """Raises UnsupportedError where the executors cannot have what they need."""
        self.packed = packed(self.hunt, self.trial)

    def load(self) -> None:
        """Has the executors get what they need for all levels."""
        self.parcel = self.store.context.broadcast(self.packed)

    def close(self) -> None:
        if self.parcel is not None:
            self.parcel.destroy()

    @property
    def values(self) -> dict[str, Value]:
        """What the queries name."""
        return {}

    def look_at(self, frontier: DataFrame) -> None:
        """Makes the views of a level that has these states to go on from."""
        frontier.createOrReplaceTempView("frontier")
        assert self.parcel is not None
        spread = frontier.select("step", "state").repartition(self._tasks * TASKS, "step")
        schema = spark_schema(Typed(*column) for column in columns_of(TABLES["tries"]))
        steps = sent(tried, self.store.name, self.parcel, TABLES["tries"])
        spread.mapInArrow(steps, schema).createOrReplaceTempView("tries")

    def without_accounts(self, kept: DataFrame) -> DataFrame:
        return kept.where("place >= 0")

    @property
    def _tasks(self) -> int:
        return self.store.context.defaultParallelism

    def counted(self, counts: Row, frontier: DataFrame, expanded: int) -> Counts:
        """What the row of `counts` tells. Raises what has kept a task from its work."""
        kept, goals, going, failed, states = counts
        told = heard(states, self.trial, lambda step: self.state_of(step, frontier), self.hunt.stats)
        return Counts(sum(one["tried"] for one in told), kept, goals, going, failed)

    def state_of(self, step: int, frontier: DataFrame) -> bytes:
        ((state,),) = frontier.where(f"step = {step}").select("state").collect()
        return bytes(state)

    # --- steps that this process knows -------------------------------------------------------------------

    def key_of(self, begun: Begun) -> Sequence[Any]:
        """What tells the row of a step from others, see `written.key`."""
        return (begun.key,)

    def known(self, begun: Begun) -> Sequence[Any]:
        """What is shown of a step, see `written.shown`."""
        return begun.row, begun.last

    def expanded(self, begun: Begun) -> tuple[tuple[Typed, Any], ...]:
        """What its level has of a state to go on from."""
        return ((Typed("state", "BLOB"), begun.state),)

    # --- paths -------------------------------------------------------------------------------------------

    def row(self, values: Sequence[Any]) -> Row:
        """The row of a step of which this is shown."""
        row: Row = loads(values[0])
        return row

    def last(self, place: int, values: Sequence[Any], before: Sequence[Any] | None) -> Any:
        """The last part of a step; `before` is shown of the one before, None where that is the start."""
        return None if values[1] is None else loads(values[1])


class TypedSteps(Steps):
    """The steps of a search as SQL: nothing but results passes through Python."""

    def __init__(self, hunt: Hunt, store: Store, written: TypedSparkStatements, trial: Trial) -> None:
        super().__init__(hunt, store, written, trial)
        self.steps = written.steps
        self.elements = written.elements_of(hunt.run)
        if len(self.elements) > ELEMENTS:
            raise too_many_elements("FROM")

    def prepare(self) -> None:
        """Nothing is sent but the values of elements."""

    def load(self) -> None:
        columns = (Typed("nth", "BIGINT"), *self.steps.reads)
        rows = [(nth, *row[: len(self.steps.reads)]) for nth, row in enumerate(self.elements)]
        self.store.loaded(listed(*columns), rows).coalesce(1).createOrReplaceTempView("elements")

    @cached_property
    def values(self) -> dict[str, Value]:
        return {label: self.hunt.run.source(name) for label, name in self.steps.parameters.items()}

    def look_at(self, frontier: DataFrame) -> None:
        frontier.repartition(self._tasks, "step").createOrReplaceTempView("frontier")

    def without_accounts(self, kept: DataFrame) -> DataFrame:
        return kept

    def counted(self, counts: Row, frontier: DataFrame, expanded: int) -> Counts:
        tried = expanded * len(self.elements)
        self.hunt.stats.generated += tried
        self.hunt.stats.expanded += expanded
        kept, goals, going, *_ = counts
        return Counts(tried, kept, goals, going, None)

    def key_of(self, begun: Begun) -> Sequence[Any]:
        row: Row = loads(begun.row)
        return row

    def known(self, begun: Begun) -> Sequence[Any]:
        return [*self.key_of(begun), *(self._after(begun).get(column) for column in self.steps.own)]

    def expanded(self, begun: Begun) -> tuple[tuple[Typed, Any], ...]:
        return tuple((column, self._after(begun)[column]) for column in dict.fromkeys(self.steps.states))

    def _after(self, begun: Begun) -> dict[Typed, Any]:
        """The state after a step by its columns; nothing where it stops."""
        return self.steps.after(begun.values)

    def row(self, values: Sequence[Any]) -> Row:
        return tuple(values[: len(self.steps.rows)])

    def last(self, place: int, values: Sequence[Any], before: Sequence[Any] | None) -> Any:
        if not self.hunt.keyed:
            return None
        if before is None:
            return (*self._combinations[place % ELEMENTS], *self.hunt.start)
        columns = dict(zip((*self.steps.rows, *self.steps.own), before, strict=True))
        return (*self._combinations[place % ELEMENTS], *(columns[column] for column in self.steps.states))

    @cached_property
    def _combinations(self) -> list[Last]:
        return combinations(self.hunt)

"""Searches in tables of Apache Spark, whose executors also try the steps.

What a level keeps is written to files that all executors can reach; from there Spark goes on when an executor is lost.
Everything else of a level stays with the executors, on their disks where it does not fit into memory. Through the
driver go counts and results.
"""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from itertools import accumulate
from os import environ
from typing import TYPE_CHECKING, Any

from ss2sql.errors import ExecutionError, SessionError
from ss2sql.runtime.levels.executor import account, paths_here, task
from ss2sql.runtime.levels.level import TABLES
from ss2sql.runtime.levels.parcel import add_counts, packed
from ss2sql.runtime.levels.spark_store import Part, Store, from_to, is_plain, union
from ss2sql.runtime.levels.statements import (
    Add,
    AddNumbered,
    Ask,
    Create,
    Drop,
    Make,
    Number,
    Statement,
    Value,
    Walk,
    columns_of,
)
from ss2sql.runtime.levels.tables import Row, Tally, walked_ways
from ss2sql.runtime.levels.trial import Trial
from ss2sql.runtime.memorize.hunt import Hunt

if TYPE_CHECKING:
    from pyspark import Broadcast
    from pyspark.sql import SparkSession

FEW = 100_000  # tries of a level that are numbered in one partition, which takes a job less
GOALS = 10_000  # of a level, the ways to which are looked up one by one
AT_ONCE = 1_000  # steps that are looked up
TASKS = 2  # of each level for each core, because some take longer than others


class Spark:
    """A session of Spark: the user's, or one of its own, which is started by the first search."""

    def __init__(self, session: SparkSession | None) -> None:
        self.session = session
        self.own = False
        if session is None:
            _check_java()
        else:
            _check_session(session)

    def open(self, hunt: Hunt) -> SparkTables:
        from pyspark.sql import SparkSession

        if self.session is None:
            self.session = SparkSession.getActiveSession()
        if self.session is None:
            builder = SparkSession.builder.appName("ss2sql").config("spark.ui.enabled", "false")
            self.session = builder.getOrCreate()
            self.own = True
            if "PYSPARK_PYTHON" not in environ:
                self.session.sparkContext.pythonExec = sys.executable  # else any that is called python3
        return SparkTables(self.session, hunt)

    def close(self) -> None:
        if self.own and self.session is not None:
            self.session.stop()
        self.session = None


def _check_java() -> None:
    home = environ.get("JAVA_HOME")
    if shutil.which(f"{home}/bin/java" if home else "java") is None:
        hint = "install it, for example with apt install openjdk-17-jre-headless; JAVA_HOME says where it is"
        raise SessionError("S003", "engine='spark' needs Java 17 or newer, which was not found", hints=(hint,))


def _check_session(session: Any) -> None:
    from pyspark.errors import PySparkException
    from pyspark.sql import SparkSession

    hint = "give spark = SparkSession.builder.getOrCreate(), or nothing"
    if not isinstance(session, SparkSession):
        message = f"the session of engine='spark' is a SparkSession, not {type(session).__name__}"
        raise SessionError("S002", message, hints=(hint,))
    try:
        context = session.sparkContext
    except PySparkException as error:
        message = "engine='spark' needs the driver's own session, not one of Spark Connect"
        raise SessionError("S002", message, hints=(hint,)) from error
    if not (context.master or "").startswith("local") and context.getCheckpointDir() is None:
        message = "the session has no folder that all executors can reach"
        raise SessionError("S002", message, hints=('spark.sparkContext.setCheckpointDir("hdfs://...")',))


class SparkTables:
    """The tables of one run."""

    def __init__(self, session: SparkSession, hunt: Hunt) -> None:
        self.hunt = hunt
        self.store = Store(session)
        self.context = session.sparkContext
        self.parcel: Broadcast[bytes] | None = None
        self.tried = self.before = 0
        self.known: dict[int, tuple[int, bytes]] = {}  # steps on ways to goals: the one before, and the row

    # --- statements --------------------------------------------------------------------------------------

    def run(self, statement: Statement, **values: Value) -> None:
        store = self.store
        match statement:
            case Create(table=table):
                store.put(table, [self._empty(table)])
            case Make(table=table, select=select):
                part = store.part(select, values)
                store.put(table, [part if is_plain(select) else store.written(part)])
            case Number(table=table, select=select):
                before = values["before"]
                assert isinstance(before, int)
                self.before = before
                store.put(table, [self._numbered(store.part(select, {}))])
            case Walk():
                self._walk(statement)
            case Add(table=table, select=select):
                part = store.part(select, values)
                part = part if is_plain(select) else store.written(part)
                store.add(table, replace(part, first=self.before + 1))
            case Drop(table=table):
                store.drop(table)
            case Ask() | AddNumbered():
                raise TypeError("`rows` gives what is asked; nothing that goes by length adds and numbers")

    def rows(self, question: Ask, **values: Value) -> Iterator[Row]:
        frame = self.store.part(question.select, values).frame
        if "ORDER BY" in question.select:  # all of some result, so read in parts
            return map(tuple, frame.toLocalIterator())
        return iter([tuple(row) for row in frame.collect()])

    def load(self, table: str, columns: Sequence[Sequence[Any]]) -> None:
        written = (", ".join(map(_literal, row)) for row in zip(*columns, strict=True))
        frame = self.store.session.sql(f"VALUES {', '.join(f'({row})' for row in written)}")
        self.store.add(table, Part(frame.toDF(*(name for name, _ in columns_of(TABLES[table])))))

    def try_all(self, trial: Trial, pause: Callable[[], None]) -> Tally:
        pause()
        if self.parcel is None:
            self.parcel = self.context.broadcast(packed(self.hunt, trial))
        store = self.store
        frontier = store.frame("frontier").repartition(TASKS * self.context.defaultParallelism, "step")
        steps = task(store.name, self.parcel, paths_here())
        # What was tried is used several times: a function must not be called again for each.
        tried = store.persisted(Part(frontier.mapInArrow(steps, _schema("tries"))))
        told = [account(row[0]) for row in tried.frame.where("place IS NULL").select("state").collect()]
        pause()
        self._look(trial, told)
        store.put("tries", [replace(tried, frame=tried.frame.where("place IS NOT NULL"))])
        for counts in told:
            add_counts(self.hunt.stats, counts)
        self.tried = sum(counts["tried"] for counts in told)
        return Tally(self.tried, sum(counts["failed"] for counts in told))

    def ways(self) -> Iterator[Row]:
        found = self.rows(Ask(f"SELECT step, parent, row, last FROM kept WHERE goal LIMIT {GOALS + 1}"))
        goals = sorted((step, parent, bytes(row), last) for step, parent, row, last in found)
        return self._way_by_way(goals) if len(goals) <= GOALS else walked_ways(self)

    def interrupt(self) -> None:
        self.store.stopping = True
        self.context.cancelJobsWithTag(self.store.name)

    def close(self) -> None:
        self.store.close()
        if self.parcel is not None:
            self.parcel.destroy()

    # --- the steps of a level ----------------------------------------------------------------------------

    def _look(self, trial: Trial, told: list[dict[str, Any]]) -> None:
        """Raises what has kept a task from its work."""
        for trouble in filter(None, (counts["trouble"] for counts in told)):
            hint = "what functions import has to be installed there, or sent with spark.sparkContext.addPyFile"
            raise ExecutionError("X009", f"an executor cannot make the search ready: {trouble}", hints=(hint,))
        refused = [counts["refused"] for counts in told if counts["refused"] is not None]
        if refused:
            frontier = self.store.frame("frontier")
            ((state,),) = frontier.where(f"step = {min(refused)}").select("state").collect()
            for _ in trial.steps(min(refused), bytes(state)):
                pass
            hint = "see whether a function is declared immutable that is not"
            raise ExecutionError("X009", "a step that an executor refused was not refused again", hints=(hint,))

    def _numbered(self, part: Part) -> Part:
        """The rows with a column `step`, which counts them in the order of `place`."""
        before = self.before
        if self.tried <= FEW:
            number = "row_number() OVER (ORDER BY place)"
            return replace(part, frame=part.frame.selectExpr(f"{before} + {number} AS step", "*"))
        # Sorted parts in the order of `place`; where each begins follows from the counts of those before it.
        ranged = part.frame.repartitionByRange("place").sortWithinPartitions("place")
        numbers = ("spark_partition_id() AS part", f"monotonically_increasing_id() & {(1 << 33) - 1} AS nth", "*")
        in_order = self.store.persisted(replace(part, frame=ranged.selectExpr(*numbers)))
        counts = dict(map(tuple, in_order.frame.groupBy("part").count().collect()))
        starts = accumulate((counts.get(number, 0) for number in range(max(counts, default=0))), initial=before)
        offsets = ", ".join(f"{start}L" for start in starts)
        frame = in_order.frame.selectExpr(f"array({offsets})[part] + nth + 1 AS step", "place")
        return replace(in_order, frame=frame)

    def _walk(self, walk: Walk) -> None:
        """Goes on as long as there are rows; reads those parts of `steps` only to which the walk leads."""
        store, parts, select = self.store, list[Part](), walk.first
        steps = store.tables["steps"]
        while True:
            part = store.persisted(store.part(select, {}, walk.columns))
            ((count, first, last),) = part.frame.selectExpr("COUNT(*)", "MIN(previous)", "MAX(previous)").collect()
            parts.append(part)
            needed = from_to(steps, first, last) if count else []
            if not needed:
                break
            store.put("walk", [part])
            store.put("steps", needed)
            select = walk.then
        store.put("steps", steps)
        store.put(walk.table, parts)
        if "walk" in store.tables:
            store.drop("walk")

    def _way_by_way(self, goals: list[Row]) -> Iterator[Row]:
        """The ways to a few goals, which are results, and so come to the driver: there the steps are put together.

        Most of them are known from the goals of levels before. By joins it would take as many jobs again and again.
        """
        self.known.update((step, (parent, row)) for step, parent, row, _ in goals)
        wanted = {parent for _, parent, _, _ in goals}
        while missing := sorted(step for step in wanted if step and step not in self.known):
            self._learn(missing)
            wanted = {self.known[step][0] for step in missing}
        for goal, _, _, last in goals:
            way, step = [], goal
            while step:
                step, row = self.known[step]
                way.append(row)
            yield from ((goal, row, None if number else last) for number, row in reversed(list(enumerate(way))))

    def _learn(self, steps: list[int]) -> None:
        """Has the driver know some steps."""
        for start in range(0, len(steps), AT_ONCE):
            some = steps[start : start + AT_ONCE]
            frame = union(from_to(self.store.tables["steps"], some[0], some[-1]))
            rows = frame.where(f"step IN ({', '.join(map(str, some))})").select("step", "parent", "row").collect()
            self.known.update((step, (parent, bytes(row))) for step, parent, row in rows)

    def _empty(self, table: str) -> Part:
        nothing = ", ".join(f"CAST(NULL AS {kind}) AS {name}" for name, kind in columns_of(_schema(table)))
        return Part(self.store.session.sql(f"SELECT {nothing} WHERE FALSE"))


def _schema(table: str) -> str:
    return TABLES[table].replace("BLOB", "BINARY")


def _literal(value: int | bytes) -> str:
    return f"{value}L" if isinstance(value, int) else f"X'{value.hex()}'"

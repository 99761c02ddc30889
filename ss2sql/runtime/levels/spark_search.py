"""Going from level to level in Spark.

Each level is one query, whose rows the executors keep, and one job, which counts them. While the job runs the next
level is planned, because a plan takes as long as the job of a level with some thousand steps. The levels of a search
that are smaller than that this process does itself, see beginning.py.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from itertools import accumulate
from typing import TYPE_CHECKING, Any

from ss2sql.lowering.portable.steps import ELEMENTS, Typed
from ss2sql.records import dataclass
from ss2sql.runtime.levels.beginning import Beginning
from ss2sql.runtime.levels.level import SparkLevel
from ss2sql.runtime.levels.spark_steps import Counts, SparkSteps
from ss2sql.runtime.levels.spark_store import Store
from ss2sql.runtime.levels.statements import listed, names_of
from ss2sql.runtime.memorize.hunt import Found, Hunt
from ss2sql.runtime.run import Level

if TYPE_CHECKING:
    from pyspark.sql import DataFrame

TABLES = 16  # of rows, before they become one; to plan with each takes some milliseconds
FEW = 100_000  # steps of a level that are numbered in one partition, which takes a job less
GOALS = 10_000  # whose ways are looked up at once
SECONDS = 0.1  # that a level may take here, where Spark takes about 0.3
AT_ONCE = 1_000  # steps that are looked up by naming them in a query


@dataclass(frozen=True, slots=True, eq=False)
class Planned:
    """A level that was not computed yet: the states to go on from, what will be kept, and what counts that."""

    frontier: DataFrame
    kept: DataFrame
    counts: DataFrame


@dataclass(frozen=True, slots=True, eq=False)
class Reached:
    """A level that was computed."""

    depth: int
    planned: Planned
    counts: Counts

    @property
    def goals(self) -> DataFrame:
        return self.planned.kept.where("goal")


class SparkSearch:
    """One search in a store of Spark."""

    def __init__(self, hunt: Hunt, store: Store, written: SparkLevel) -> None:
        self.hunt, self.store, self.written = hunt, store, written
        self.steps = SparkSteps(hunt, store, written)
        self.planner = ThreadPoolExecutor(1)
        self.levels: dict[int, DataFrame] = {}
        self.met: DataFrame | None = None  # the rows of all levels, for UNIQUE
        self.tables = 0  # of which they are put together
        # Steps on ways to goals, by level and number: their place, and what is shown of them.
        self.known: dict[tuple[int, int], tuple[int, Sequence[Any]]] = {}

    def results(self) -> Iterator[Found]:
        """The paths and the last parts of their last steps."""
        with self._begun() as beginning:
            for goal in beginning.goals():
                yield beginning.found(goal)
            for reached in self._levels(beginning):
                yield from self._found(reached)

    @contextmanager
    def _begun(self) -> Iterator[Beginning]:
        """The first levels, for the time of the search."""
        try:
            self.steps.prepare()
            yield Beginning(self.hunt, seconds=SECONDS)
        finally:
            self.planner.shutdown(cancel_futures=True)
            self.steps.close()

    def _pause(self) -> None:
        self.hunt.flush()
        self.hunt.check()

    # --- from level to level -----------------------------------------------------------------------------

    def _levels(self, beginning: Beginning) -> Iterator[Reached]:
        """The levels after the first ones."""
        expanded = len(beginning.frontier)
        if not expanded:
            return
        self.steps.load()
        self._load(beginning)
        depth = len(beginning.levels)
        planned = self._planned(self._frontier(beginning), few=True)
        while expanded:
            depth += 1
            self._pause()
            self.levels[depth] = planned.kept
            following = self.planner.submit(self._following, depth)
            counts = self.steps.counted(tuple(planned.counts.collect()[0]), planned.frontier, expanded)
            yield Reached(depth, planned, counts)
            self.hunt.stats.levels.append(Level(counts.kept, counts.kept, counts.tried - counts.kept))
            few = counts.going * counts.kept <= FEW * expanded  # that will be kept, if as many for each state
            expanded = counts.going
            if expanded:
                planned = following.result()
                if not few:
                    planned = self._planned(self._going_on(depth), few)

    def _following(self, depth: int) -> Planned:
        """Plans the level after one that is being computed."""
        if self.written.search.repeats == "unique":
            self._meet(self.levels[depth].where("place >= 0"))
        return self._planned(self._going_on(depth), few=True)

    def _going_on(self, depth: int) -> DataFrame:
        return self.levels[depth].where("goes_on")

    def _planned(self, frontier: DataFrame, few: bool) -> Planned:
        """Plans a level and makes its job ready, which takes a tenth of a second or more.

        Done while the job before runs, the gap between the jobs of the 8-puzzle is 24 ms, not 45 ms.
        """
        self.steps.look_at(frontier)
        if self.met is not None:
            self.met.createOrReplaceTempView("steps")
        kept = self._kept_by_few() if few else self._kept_by_many()
        kept.createOrReplaceTempView("kept")
        counts = self.store.query(self.written.counts)
        counts._jdf.queryExecution().toRdd()
        return Planned(frontier, kept, counts)

    def _kept_by_few(self) -> DataFrame:
        return self.store.persisted(self.store.query(self.written.kept, self.steps.made.values))

    def _kept_by_many(self) -> DataFrame:
        """The same without bringing all rows into one partition."""
        chosen = self.store.query(self.written.chosen, self.steps.made.values)
        return self._numbered(self.store.persisted(chosen), "place", "step")  # it is read twice to be sorted

    def _numbered(self, rows: DataFrame, order: str, name: str) -> DataFrame:
        """Rows with their numbers from 1: sorted parts; where each begins follows from the counts of those before."""
        numbers = ("spark_partition_id() AS part", f"monotonically_increasing_id() & {(1 << 33) - 1} AS nth_of_part")
        ranged = rows.repartitionByRange(order).sortWithinPartitions(order).selectExpr(*numbers, "*")
        in_order = self.store.persisted(ranged)
        found = dict(map(tuple, in_order.groupBy("part").count().collect()))
        starts = accumulate((found.get(number, 0) for number in range(max(found, default=0))), initial=0)
        offsets = listed(*(f"{start}L" for start in starts))
        return in_order.selectExpr(f"array({offsets})[part] + nth_of_part + 1 AS {name}", *rows.columns)

    def _meet(self, rows: DataFrame) -> None:
        """Notes rows, for UNIQUE."""
        rows = rows.select(*names_of(self.written.steps.rows))
        self.met = rows if self.met is None else self.met.unionAll(rows)
        self.tables += 1
        if self.tables == TABLES:
            self.met, self.tables = self.store.persisted(self.met), 1

    # --- from this process to Spark ----------------------------------------------------------------------

    def _load(self, beginning: Beginning) -> None:
        """Hands over what the first levels have come to."""
        made = self.steps.made
        for depth, level in enumerate(beginning.levels, 1):
            for step, begun in enumerate(level, 1):
                self.known[depth, step] = begun.place, made.shown_of(begun)
        if self.written.search.repeats == "unique":
            keys = [made.key_of(begun) for level in beginning.levels for begun in level]
            self._meet(self.store.loaded(self.written.steps.rows, keys))

    def _frontier(self, beginning: Beginning) -> DataFrame:
        """The states that the first levels go on from."""
        depth, made, trails = len(beginning.levels), self.steps.made, self.written.trails
        columns = (Typed("step", "BIGINT"), *made.expanded(beginning.frontier[0][1]), *trails)
        rows = []
        for step, begun in beginning.frontier:
            trail = [made.trail_of(beginning.way(begun, depth) if depth else [])] if trails else []
            rows.append((step, *made.expanded(begun).values(), *trail))
        return self.store.loaded(columns, rows)

    # --- paths -------------------------------------------------------------------------------------------

    def _found(self, reached: Reached) -> Iterator[Found]:
        """The paths to the goals of a level."""
        depth, counts = reached.depth, reached.counts
        if counts.goals:
            rows = reached.goals.select("step", "place", *self.written.shown)
            few = counts.goals <= GOALS
            block: list[int] = []
            for step, place, *values in sorted(rows.collect(), key=_step) if few else rows.toLocalIterator():
                self.known[depth, step] = place, values
                block.append(step)
                if len(block) == GOALS:
                    yield from self._paths(depth, block)
                    block.clear()
            yield from self._paths(depth, block)

    def _paths(self, depth: int, goals: list[int]) -> Iterator[Found]:
        """The paths to some goals of a level, which are put together here: they are results.

        Most of a way is known from goals of levels before, and from the levels that began here.
        """
        missing, above = goals, depth
        while missing and above > 1:
            wanted = {self.known[above, step][0] // ELEMENTS for step in missing}
            above -= 1
            missing = sorted(step for step in wanted if (above, step) not in self.known)
            self._learn(above, missing)
        for goal in goals:
            way, step = list[tuple[int, Sequence[Any]]](), goal
            for above in range(depth, 0, -1):
                way.append(self.known[above, step])
                step = way[-1][0] // ELEMENTS
            last = self.steps.made.last(*way[0], way[1][1] if depth > 1 else None)
            yield [self.steps.made.row(shown) for _, shown in reversed(way)], last

    def _learn(self, depth: int, steps: list[int]) -> None:
        """Has this process know some steps of a level."""
        if not steps:
            return
        level = self.levels[depth]
        if len(steps) <= AT_ONCE:
            some = level.where(f"step IN ({listed(*steps)})")
        else:
            some = level.join(self.store.loaded((Typed("step", "BIGINT"),), [[step] for step in steps]), "step")
        for step, place, *values in some.select("step", "place", *self.written.shown).collect():
            self.known[depth, step] = place, values


def _step(row: Any) -> int:
    step: int = row[0]
    return step

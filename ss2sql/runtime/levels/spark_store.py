"""The tables of one run in Spark: what their rows are read from, and where that is kept."""

from __future__ import annotations

import tempfile
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from functools import cache, reduce
from typing import TYPE_CHECKING, Any
from uuid import uuid4

import sqlglot
from sqlglot import exp

from ss2sql.errors import ExecutionError
from ss2sql.lowering.dialects import SPARK
from ss2sql.runtime.levels.statements import Value, printed

if TYPE_CHECKING:
    from pyspark.sql import DataFrame, SparkSession

PARTS = 32  # file sets of a table, before they become one; each takes a millisecond of planning


@dataclass(frozen=True, slots=True, eq=False)
class Kept:
    """Rows that were computed: in files of a folder, or with the executors."""

    folder: str | None = None
    frame: DataFrame | None = None


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """Some rows of a table, what they are read from, and the first one of their steps.

    Those of a higher `tier` have become one of many.
    """

    frame: DataFrame
    kept: frozenset[Kept] = frozenset()
    first: int = 0
    tier: int = 0


class Store:
    """The tables of one run by their names.

    They are views in a session of the run's own, which has the settings of the user's and runs with its executors. What
    is computed goes into a `folder` of the run's own.
    """

    def __init__(self, session: SparkSession) -> None:
        self.session, self.context = _like(session), session.sparkContext
        self.name = f"ss2sql-{uuid4().hex[:12]}"
        self.folder = f"{self.context.getCheckpointDir() or tempfile.gettempdir()}/{self.name}"
        self.tables: dict[str, list[Part]] = {}
        self.stopping = False
        self._kept: set[Kept] = set()
        self._folders = 0
        self._stale: set[str] = set()  # tables whose views are not what they should be
        self.context.addJobTag(self.name)

    def close(self) -> None:
        self.context.removeJobTag(self.name)
        for kept in list(self._kept):
            self._forget(kept)
        self.tables.clear()
        self._delete(self.folder)

    # --- tables ------------------------------------------------------------------------------------------

    def put(self, table: str, parts: list[Part]) -> None:
        """Makes a table of some parts."""
        self.tables[table] = parts
        self._stale.add(table)

    def add(self, table: str, part: Part) -> None:
        """Adds rows, whose steps come after all that the table has. Where it has many parts, some become one."""
        parts = [*self.tables[table], part]
        while len(last := [one for one in parts if one.tier == parts[-1].tier]) >= PARTS:
            whole = self.written(Part(union(last), _kept(last)))
            parts[-len(last) :] = [replace(whole, first=last[0].first, tier=last[0].tier + 1)]
        self.put(table, parts)
        self._let_go()

    def drop(self, table: str) -> None:
        del self.tables[table]
        self._stale.discard(table)
        self._let_go()

    def frame(self, table: str) -> DataFrame:
        """All rows of a table."""
        return union(self.tables[table])

    # --- parts -------------------------------------------------------------------------------------------

    def part(self, select: str, values: dict[str, Value], columns: str = "") -> Part:
        """The rows of a query, not computed yet."""
        if self.stopping:
            raise ExecutionError("X009", "the run has ended")
        tables = _tables(select)
        for table in self._stale.intersection(tables):
            self.frame(table).createOrReplaceTempView(table)
            self._stale.discard(table)
        given = {name: value for name, value in values.items() if f":{name}" in select}
        frame = self.session.sql(printed(SPARK, select), given)
        if columns:
            frame = frame.toDF(*columns.split(", "))
        return Part(frame, _kept(part for table in tables for part in self.tables[table]))

    def written(self, part: Part) -> Part:
        """The same rows in files."""
        self._folders += 1
        kept = Kept(folder=f"{self.folder}/{self._folders}")
        self._kept.add(kept)
        part.frame.write.parquet(kept.folder)  # type: ignore[arg-type]
        frame = self.session.read.schema(part.frame.schema).parquet(kept.folder)  # type: ignore[arg-type]
        return Part(frame, frozenset([kept]))

    def persisted(self, part: Part) -> Part:
        """The same rows, computed when they are first read, and kept by the executors."""
        from pyspark import StorageLevel

        frame = part.frame.persist(StorageLevel.MEMORY_AND_DISK)
        kept = Kept(frame=frame)
        self._kept.add(kept)
        return Part(frame, part.kept | {kept})

    # --- where they are kept -----------------------------------------------------------------------------

    def _let_go(self) -> None:
        """Forgets what was kept for tables that are gone."""
        for kept in self._kept - _kept(part for parts in self.tables.values() for part in parts):
            self._forget(kept)

    def _forget(self, kept: Kept) -> None:
        self._kept.discard(kept)
        if kept.frame is not None:
            kept.frame.unpersist()
        if kept.folder is not None:
            self._delete(kept.folder)

    def _delete(self, folder: str) -> None:
        """Deletes a folder, wherever Spark keeps files."""
        context: Any = self.context
        path = context._jvm.org.apache.hadoop.fs.Path(folder)
        path.getFileSystem(context._jsc.hadoopConfiguration()).delete(path, True)


def union(parts: Sequence[Part]) -> DataFrame:
    """The rows of some parts."""
    return reduce(lambda one, other: one.unionAll(other), (part.frame for part in parts))


def from_to(parts: Sequence[Part], first: int, last: int) -> list[Part]:
    """The parts that have steps between two of them; each has those up to the first one of the next."""
    firsts = [*(part.first for part in parts[1:]), last + 1]
    return [part for part, following in zip(parts, firsts, strict=True) if part.first <= last and first < following]


def _kept(parts: Iterable[Part]) -> frozenset[Kept]:
    return frozenset[Kept]().union(*(part.kept for part in parts))


def _like(session: SparkSession) -> SparkSession:
    """A new session with the settings of another one, and the same executors."""
    own = session.newSession()
    before = own.conf.getAll
    for name, value in session.conf.getAll.items():
        if before.get(name) != value and own.conf.isModifiable(name):
            own.conf.set(name, value)
    return own


@cache
def _tables(select: str) -> frozenset[str]:
    return frozenset(table.name for table in sqlglot.parse_one(select, read="duckdb").find_all(exp.Table))


@cache
def is_plain(select: str) -> bool:
    """Whether each row of a query is made of one row of a table, which need not be kept beside that."""
    return sqlglot.parse_one(select, read="duckdb").find(exp.Join, exp.Group, exp.AggFunc, exp.Subquery) is None

"""The tables of a search in Spark by COST, PROBABILITY or MEMORIZE, whose statements are those of DuckDB.

A table is a view of what was put into it. It is computed when something is asked that depends on it, so statements that
follow each other are few jobs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import reduce
from typing import TYPE_CHECKING, Any, assert_never

from ss2sql.lowering.portable.steps import Typed
from ss2sql.records import dataclass
from ss2sql.runtime.levels.executor import tried
from ss2sql.runtime.levels.level import STATE_OF
from ss2sql.runtime.levels.parcel import packed
from ss2sql.runtime.levels.sending import sent
from ss2sql.runtime.levels.spark_steps import TASKS, heard
from ss2sql.runtime.levels.spark_store import Store, spark_schema
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
    from pyspark.sql import DataFrame, SparkSession

PARTS = 16  # of a table, before they become one; to plan with each takes some milliseconds


@dataclass(slots=True)
class Table:
    """What was put into a table, part by part; `columns` are written as in `Create` where it was made empty."""

    parts: list[DataFrame]
    columns: str = ""


class SparkTables(Store):
    """The tables of one run."""

    def __init__(self, session: SparkSession, hunt: Hunt) -> None:
        super().__init__(session)
        self.hunt = hunt
        self.tables: dict[str, Table] = {}
        self.parcel: Broadcast[bytes] | None = None

    def close(self) -> None:
        if self.parcel is not None:
            self.parcel.destroy()
        super().close()

    # --- statements --------------------------------------------------------------------------------------

    def run(self, statement: Statement, **values: Value) -> None:
        match statement:
            case Create(table, columns):
                self._show(table, Table([self.loaded(columns, [])], columns))
            case Make(table, select):
                self._show(table, Table([self.persisted(self.query(select, values))]))
            case Number(table):
                self._show(table, Table([self.persisted(self.query(statement.query, values))]))
            case Add(table, select):
                self._add(table, self.persisted(self.query(select, values)))
            case Walk(table):
                self._show(table, Table(self._walked(statement, values)))
            case Drop(table):
                del self.tables[table]
                self.session.catalog.dropTempView(table)
            case Ask() | AddNumbered():
                raise AssertionError("only steps in SQL add numbered rows, and `rows` asks")
            case _:
                assert_never(statement)

    def rows(self, question: Ask, **values: Value) -> Iterator[Row]:
        return map(_values, self.query(question.select, values).collect())

    def load(self, table: str, columns: Sequence[Sequence[Any]]) -> None:
        rows = list(zip(*columns, strict=True))
        self._add(table, self.loaded(self.tables[table].columns, rows))

    def ways(self) -> Iterator[Row]:
        return walked_ways(self)

    def _show(self, name: str, table: Table) -> None:
        self.tables[name] = table
        reduce(_both, table.parts).createOrReplaceTempView(name)

    def _add(self, name: str, rows: DataFrame) -> None:
        table = self.tables[name]
        table.parts.append(rows)
        if len(table.parts) > PARTS:
            table.parts[:] = [self.persisted(reduce(_both, table.parts))]
        self._show(name, table)

    def _walked(self, walk: Walk, values: dict[str, Value]) -> list[DataFrame]:
        """The parts of a walk: a step of all ways at a time."""
        columns = walk.columns.split(", ")
        parts = [self.persisted(self.query(walk.first, values).toDF(*columns))]
        while parts[-1].count():
            parts[-1].createOrReplaceTempView("walk")
            parts.append(self.persisted(self.query(walk.then, values).toDF(*columns)))
        self.session.catalog.dropTempView("walk")
        return parts

    # --- steps -------------------------------------------------------------------------------------------

    def try_all(self, trial: Trial, pause: Callable[[], None]) -> Tally:
        pause()
        if self.parcel is None:
            self.parcel = self.context.broadcast(packed(self.hunt, trial))
        columns = self.tables["tries"].columns
        spread = self.session.table("frontier").repartition(self.context.defaultParallelism * TASKS, "step")
        steps = sent(tried, self.name, self.parcel, columns)
        made = self.persisted(spread.mapInArrow(steps, spark_schema(Typed(*column) for column in columns_of(columns))))
        told = heard(self._accounts(made), trial, self._state_of, self.hunt.stats)
        self._show("tries", Table([made.where("place >= 0")], columns))
        return Tally(sum(one["tried"] for one in told), sum(one["failed"] for one in told))

    def _accounts(self, made: DataFrame) -> list[bytes]:
        return [bytes(state) for (state,) in made.where("place < 0").select("state").collect()]

    def _state_of(self, step: int) -> bytes:
        ((state,),) = self.rows(STATE_OF, step=step)
        return bytes(state)


def _both(one: DataFrame, other: DataFrame) -> DataFrame:
    return one.unionAll(other)


def _values(row: Any) -> Row:
    """A row with bytes where Spark gives arrays of them."""
    return tuple(bytes(value) if isinstance(value, bytearray) else value for value in row)

"""One level of a search in Spark as one query, so that it is one job.

The tables: `frontier` has the states that are expanded, `tries` the steps from them, which are a query where the steps
are SQL; `kept` are those that are kept, and `steps` has the rows of all levels before. Steps are numbered within their
level, from 1, so a level can be planned before it is known how many the one before has kept. For NO CYCLE each has with
it the `trail` of the rows of its path.

A row of `tries` with a `place` below 0 is the account of a task, see executor.py. It passes through to `kept`, so that
what is counted there belongs to the rows, however often Spark begins a task anew.
"""

from __future__ import annotations

from collections.abc import Iterator

from ss2sql import plan
from ss2sql.lowering.portable.steps import ELEMENTS, Typed, WrittenSteps
from ss2sql.runtime.levels.level import TABLES
from ss2sql.runtime.levels.statements import Add, Ask, Drop, Make, Statement, columns_of, listed
from ss2sql.runtime.native.compiled import NativeQuery
from ss2sql.runtime.rows import Row
from ss2sql.runtime.run import Run


class SparkStatements:
    """The statements of a search whose steps are tried in Python."""

    key: tuple[Typed, ...] = (Typed("row_key", "BLOB"),)  # what tells rows apart
    shown: tuple[str, ...] = ("row", "last")  # what paths are made of
    counts = """
        SELECT COUNT(CASE WHEN place >= 0 AND NOT failed THEN 1 END), COUNT(CASE WHEN goal THEN 1 END),
          COUNT(CASE WHEN goes_on THEN 1 END), MIN(CASE WHEN failed THEN place END),
          LIST(CASE WHEN place < 0 THEN state END)
        FROM kept
    """

    def __init__(self, search: plan.Search) -> None:
        self.search = search
        self.columns = tuple(Typed(*column) for column in columns_of(TABLES["tries"]) if column[0] != "parent")
        self.tries = "SELECT * FROM tries"
        self._write()

    def _write(self) -> None:
        names = listed(*(column.name for column in self.columns))
        keys = [column.name for column in self.key]
        trail = _struct(keys, "tries")
        match self.search.repeats:
            case "unique":
                # The rows before are looked up for the first try to each row alone.
                first = f"ROW_NUMBER() OVER (PARTITION BY {listed(*keys)} ORDER BY place) AS nth_to_row"
                met = " AND ".join(f"steps.{name} = tries.{name}" for name in keys)
                chosen = f"""
                    SELECT tries.* FROM (SELECT *, {first} FROM ({self.tries}) AS every) AS tries
                    ANTI JOIN steps ON {met}
                    WHERE tries.nth_to_row = 1
                """
            case "no cycle":
                names = f"{names}, trail"
                chosen = f"""
                    SELECT tries.*, LIST_CONCAT(frontier.trail, [{trail}]) AS trail
                    FROM ({self.tries}) AS tries
                    LEFT JOIN frontier ON frontier.step = tries.place // {ELEMENTS}
                    WHERE NOT COALESCE(LIST_CONTAINS(frontier.trail, {trail}), FALSE)
                """
            case _:
                chosen = self.tries
        self.chosen = f"SELECT {names} FROM ({chosen}) AS chosen"
        step = "CAST(ROW_NUMBER() OVER (ORDER BY place) AS BIGINT) AS step"
        self.kept = f"SELECT {step}, * FROM ({self.chosen}) AS unnumbered"

    def level(self) -> Iterator[Statement]:
        """All of one level, in order, once its steps are tried."""
        yield Make("kept", self.kept)
        yield Ask(self.counts)
        yield Drop("frontier")
        yield Make("frontier", "SELECT * FROM kept WHERE goes_on")
        if self.search.repeats == "unique":
            yield Add("steps", f"SELECT {listed(*(column.name for column in self.key))} FROM kept WHERE place >= 0")


class TypedSparkStatements(SparkStatements):
    """The same for steps that are SQL. `elements` has what is read of the sources, `nth` counts them."""

    counts = """
        SELECT COUNT(*), COUNT(CASE WHEN goal THEN 1 END), COUNT(CASE WHEN goes_on THEN 1 END), NULL, [] FROM kept
    """

    def __init__(self, steps: WrittenSteps, search: plan.Search) -> None:
        self.search, self.steps = search, steps
        self._elements = NativeQuery(steps.elements)
        self.key = steps.rows
        flags = (Typed("goal", "BOOLEAN"), Typed("goes_on", "BOOLEAN"))
        self.columns = (Typed("place", "BIGINT"), *steps.rows, *flags, *steps.own)
        self.shown = tuple(column.name for column in (*steps.rows, *steps.own))
        self.tries = steps.tries
        self._write()

    def elements_of(self, run: Run) -> list[Row]:
        """What is read of the elements in a run."""
        rows = self._elements.rows(run).rows
        assert rows is not None
        return rows


def _struct(names: list[str], table: str) -> str:
    """Several columns as one."""
    if len(names) == 1:
        return f"{table}.{names[0]}"
    fields = ", ".join(f"'{name}': {table}.{name}" for name in names)
    return f"{{{fields}}}"

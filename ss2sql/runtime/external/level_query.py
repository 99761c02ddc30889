"""Compiling a search for the tables of another database: one level as statements, and what these cannot do.

`steps` has all steps that were kept. `tries` has the steps from the states of a level: a SELECT where they are SQL,
else a table that Python fills. Their `place` orders them as a search would try them that takes one step after the
other: by the step before, then by their elements. For NO CYCLE each step has the `trail` of the rows of its path.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, Protocol

from ss2sql.errors import ExecutionError, Span, UnsupportedError
from ss2sql.language import plan
from ss2sql.language.plan_traversal import walk
from ss2sql.language.rows import Rows
from ss2sql.lowering.portable.search_steps import MAX_ELEMENTS, StepSelect, TypedColumn, write_portable_steps
from ss2sql.lowering.sql_builder import DUCKDB, SPARK, Dialect
from ss2sql.runtime.external.table_statements import (
    interrupt_when_due,
    join_column_names,
    list_duckdb_columns,
    translate_duckdb_sql,
)
from ss2sql.runtime.python.codegen_context import CodegenContext, ExpressionAnalysis
from ss2sql.runtime.python.native_query import NativeQuery, QueryCompiler
from ss2sql.runtime.python.search_compiler import can_be_noted
from ss2sql.runtime.run.run_state import Run
from ss2sql.runtime.search.search_run import Found, SearchRun

if TYPE_CHECKING:
    from ss2sql.runtime.external.duckdb_search import DuckTables
    from ss2sql.runtime.external.duckdb_sources import DuckSources
    from ss2sql.runtime.external.spark_session import SparkStore


# What Python notes of each step: a `row_key` that is the same for equal rows; the others are bytes.
_KEY = (TypedColumn("row_key", "BLOB"),)
_NOTED = (TypedColumn("row", "BLOB"), TypedColumn("last", "BLOB"), TypedColumn("state", "BLOB"))
TRIED = StepSelect("SELECT * FROM tries", _KEY, _NOTED, (), (), None, {})


class LevelStatements:
    """What the statements of a level consist of. `frontier` has the states that are expanded.

    `hindrance` says what keeps the steps from being SQL, if anything.
    """

    dialect: Dialect
    frontier = "frontier"
    met = ""  # a condition on a row of `steps` that was met, beside being the same

    def __init__(self, search: plan.Search, steps: StepSelect, hindrance: str | None = None) -> None:
        self.search, self.steps, self.hindrance = search, steps, hindrance
        self.tries = (TypedColumn("place", "BIGINT"), *steps.rows, *FLAGS, *steps.own)
        self.elements = (TypedColumn("nth", "BIGINT"), *steps.reads)
        self.shown = ["row", "last"] if steps is TRIED else list_duckdb_columns((*steps.rows, *steps.own))  # of paths
        keys = list_duckdb_columns(steps.rows)
        fields = join_column_names(*map(str, steps.rows))
        self.trail = TypedColumn("trail", f"{steps.rows[0].type if len(keys) == 1 else f'STRUCT({fields})'}[]")
        self.trails = (self.trail,) if search.repeats == "no cycle" else ()
        self._keys = keys
        self.outputs = join_column_names(*list_duckdb_columns((*self.tries[1:], *self.trails)))
        match search.repeats:
            case "unique":
                self.chosen = self._write_first_to_each_row()
            case "no cycle":
                self.chosen = self._write_off_the_trail()
            case _:
                self.chosen = steps.tries

    @property
    def sql(self) -> str:
        """The statements of one level, as the database has them."""
        return "\n".join(f"{translate_duckdb_sql(self.dialect, text)};" for text in self.list_statements())

    def list_statements(self) -> Iterator[str]:
        """All of one level, in order, once its steps are tried."""
        raise NotImplementedError

    def _write_first_to_each_row(self) -> str:
        keys = join_column_names(*(f"tries.{name}" for name in self._keys))
        # One value for both takes 8 % less time.
        flags = "MIN_BY(CASE WHEN goal THEN 2 ELSE 0 END + CASE WHEN goes_on THEN 1 ELSE 0 END, place) AS flags"
        others = (f"MIN_BY({name}, place) AS {name}" for name in list_duckdb_columns(self.steps.own))
        # NOT EXISTS takes 1.3 times as long in DuckDB, which looks for other ways to ask it.
        same = " AND ".join(f"steps.{name} = tries.{name}" for name in self._keys)
        tries = f"SELECT tries.* FROM ({self.steps.tries}) AS tries ANTI JOIN steps ON {same} {self.met}"
        columns = join_column_names(keys, "MIN(place) AS place", flags, *others)
        firsts = f"SELECT {columns} FROM ({tries}) AS tries GROUP BY {keys}"
        return f"SELECT *, flags > 1 AS goal, flags % 2 = 1 AS goes_on FROM ({firsts}) AS firsts"

    def _write_off_the_trail(self) -> str:
        row = f"tries.{self._keys[0]}"
        if len(self._keys) > 1:
            fields = join_column_names(*(f"'{name}': tries.{name}" for name in self._keys))
            row = f"{{{fields}}}"
        return f"""
            SELECT tries.*, LIST_CONCAT(frontier.trail, [{row}]) AS trail
            FROM ({self.steps.tries}) AS tries
            LEFT JOIN {self.frontier} AS frontier ON frontier.step = tries.place // {MAX_ELEMENTS}
            WHERE NOT COALESCE(LIST_CONTAINS(frontier.trail, {row}), FALSE)
        """


FLAGS = (TypedColumn("goal", "BOOLEAN"), TypedColumn("goes_on", "BOOLEAN"))


class DuckLevelStatements(LevelStatements):
    """A level in DuckDB. Steps are numbered from 1 through all levels; step 0 is the start, which is no row."""

    dialect, frontier = DUCKDB, "steps"
    met = "AND steps.depth > 0"

    def __init__(self, search: plan.Search, steps: StepSelect, hindrance: str | None = None) -> None:
        super().__init__(search, steps, hindrance)
        numbers = (TypedColumn(name, "BIGINT") for name in ("step", "parent", "nth", "depth"))
        self.columns = (*numbers, *self.tries[1:], *self.trails)
        places, more = "*", ""
        if steps is TRIED:  # they may be large, so they are put together at the end
            places, more = join_column_names("place", *list_duckdb_columns(self.trails)), "JOIN tries USING (place)"
        self.kept = f"""
            INSERT INTO steps
            SELECT step, place // {MAX_ELEMENTS}, place % {MAX_ELEMENTS}, :depth, {self.outputs}
            FROM (
              SELECT ROW_NUMBER() OVER (ORDER BY place) + :before AS step, {places} FROM ({self.chosen}) AS unnumbered
            ) AS numbered {more}
        """
        shown = join_column_names(*(f"steps.{name}" for name in self.shown))
        self.paths = f"""
            SELECT backpointers.goal, steps.nth, {shown}
            FROM backpointers
            JOIN steps ON steps.step = backpointers.step
            ORDER BY backpointers.goal, backpointers.distance DESC
        """

    # The steps on the paths from goals back to the start, by their numbers alone: rows may be large.
    backpointers = """
        CREATE OR REPLACE TABLE backpointers AS
        WITH RECURSIVE walk(goal, step, previous, distance) AS (
          SELECT step, step, parent, 0 FROM steps WHERE depth = :depth AND goal
          UNION ALL
          SELECT walk.goal, steps.step, steps.parent, walk.distance + 1
          FROM walk
          JOIN steps ON steps.step = walk.previous AND steps.depth > 0
        )
        SELECT goal, step, distance FROM walk
    """
    counts = """
        SELECT COUNT(CASE WHEN goal THEN 1 END), COUNT(CASE WHEN goes_on THEN 1 END) FROM steps WHERE depth = :depth
    """
    # In pages, so that nothing large waits while the steps from some states are tried.
    page = """
        SELECT step, state FROM steps
        WHERE depth = :depth - 1 AND goes_on AND step > :after
        ORDER BY step
        LIMIT 5000
    """

    def list_statements(self) -> Iterator[str]:
        yield from (self.kept, self.counts, self.backpointers, self.paths)


class SparkLevelStatements(LevelStatements):
    """A level in Spark as one query, so that it is one job.

    `kept` are the steps that are kept, `steps` has the rows of all levels before. Steps are numbered within their
    level, from 1, so a level can be planned before it is known how many the one before has kept.

    A row of `tries` with a `place` below 0 is the account of a task, see task_pickle.py. It passes through to
    `kept`, so that what is counted there belongs to the rows, however often Spark begins a task anew.
    """

    dialect = SPARK
    counts = """
        SELECT COUNT(CASE WHEN place >= 0 THEN 1 END), COUNT(CASE WHEN goal THEN 1 END),
          COUNT(CASE WHEN goes_on THEN 1 END), {accounts}, ({counted})
        FROM kept
    """

    def __init__(self, search: plan.Search, steps: StepSelect, hindrance: str | None = None) -> None:
        super().__init__(search, steps, hindrance)
        step = "CAST(ROW_NUMBER() OVER (ORDER BY place) AS BIGINT) AS step"
        self.chosen = f"SELECT place, {self.outputs} FROM ({self.chosen}) AS chosen"
        self.kept = f"SELECT {step}, * FROM ({self.chosen}) AS unnumbered"
        accounts = "LIST(CASE WHEN place < 0 THEN state END)" if steps is TRIED else "[]"
        self.counts = self.counts.format(accounts=accounts, counted=steps.counted or "SELECT NULL")

    def list_statements(self) -> Iterator[str]:
        yield f"CREATE TABLE kept AS {self.kept}"
        yield self.counts
        yield "DROP TABLE frontier"
        yield "CREATE TABLE frontier AS SELECT * FROM kept WHERE goes_on"
        if self.search.repeats == "unique":
            yield f"INSERT INTO steps SELECT {join_column_names(*self._keys)} FROM kept WHERE place >= 0"


# The databases that search by levels, whether they are here or not.
LEVEL_STATEMENTS: dict[str, type[LevelStatements]] = {"duckdb": DuckLevelStatements, "spark": SparkLevelStatements}


class TableEngine(Protocol):
    """Such a database: its name, and the errors that it raises.

    `sources` are its own tables, where scripts can read them; then queries that are no searches run there, too.
    """

    name: str
    errors: tuple[type[Exception], ...]
    sources: DuckSources | None

    def open_tables(self) -> DuckTables | SparkStore:
        """Opens the database for a run."""

    def find_results(self, search_run: SearchRun, opened: Any, written: Any) -> Iterator[Found]:
        """The results of a search in what was opened."""

    def close(self) -> None:
        """Ends what was begun for the session."""


def plan_level_search(query: plan.Query, database: str) -> LevelStatements:
    """The search as it goes by levels in the tables of a database. Raises UnsupportedError where it does not."""
    assert query.search is not None
    refused, statements = _refuse_search(query, database), LEVEL_STATEMENTS[database]
    if refused is not None:
        reason, cure, place = refused
        raise UnsupportedError("U001", f"{reason}, which the tables of {database} cannot do", place, (cure,))
    try:
        return statements(query.search, write_portable_steps(query, apart=statements.frontier == "frontier"))
    except UnsupportedError as error:
        return statements(query.search, TRIED, error.message)


class LevelQuery:
    """A search to be run many times. Raises UnsupportedError where it does not go by levels."""

    def __init__(self, query: plan.Query, engine: TableEngine) -> None:
        self.engine = engine.name
        self.database = engine
        self.query = query
        self.level_plan = plan_level_search(query, engine.name)
        self._native = NativeQuery(query, find=self._iterate_results)

    @property
    def sql(self) -> str:
        return self.level_plan.sql

    def compute_rows(self, run: Run, sink: Rows | None = None) -> Rows:
        """The answer of the query, see `NativeQuery.compute_rows`."""
        return self._native.compute_rows(run, sink)

    def _iterate_results(self, search_run: SearchRun) -> Iterator[Found]:
        tables = self.database.open_tables()
        try:
            with interrupt_when_due(search_run.run, tables.interrupt_statement):
                yield from self.database.find_results(search_run, tables, self.level_plan)
        except self.database.errors as error:
            hint = "look at its limit of memory and the room on its disk"
            raise ExecutionError("X009", f"{self.engine}: {error}", search_run.query.span, (hint,)) from error
        finally:
            tables.close_tables()


def _refuse_search(query: plan.Query, database: str) -> tuple[str, str, Span] | None:
    """What keeps a search from going by levels, if anything: the reason, the cure, and the place."""
    search, leave = query.search, "leave the engine to ss2sql"
    assert search is not None
    if search.weight or search.repeats == "memorize":
        return "COST, PROBABILITY and MEMORIZE do not go by length", leave, query.span
    if query.last or not search.plain:
        reason = "LAST, a condition, EACH, BY, ORDER SIBLINGS BY and greedy search go on from step to step"
        return reason, leave, query.span
    if search.order != "breadth first":
        return (
            f"{search.order.upper()} does not go level by level",
            "write BREADTH FIRST, or UNIQUE without DEPTH FIRST",
            query.span,
        )
    if query.aggregated:
        return "aggregates count over whole paths", leave, (query.group or (query.columns[0].expr,))[0].span
    if not can_be_noted(QueryCompiler(CodegenContext(query.span, ExpressionAnalysis((query,)))), query):
        cure = "register functions with volatility='immutable' or 'stable' if that is true"
        return "a volatile function or an assignment keeps the written order", cure, query.span
    world = next((node for node in walk(query) if isinstance(node, plan.WorldSource)), None)
    if world is not None and database == "spark":
        return "a world is in this process only", f"copy its table into a variable, or {leave}", world.span
    return None

"""Compiling a search for the tables of another database, and what of searches these cannot do."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from ss2sql.errors import ExecutionError, Span, UnsupportedError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.rows import Rows
from ss2sql.lowering.dialects import Dialect
from ss2sql.lowering.portable.search_steps import StepSelect, write_portable_steps
from ss2sql.lowering.unsupported import Rule
from ss2sql.runtime.external.level_statements import TRIED, LevelStatements
from ss2sql.runtime.external.statement_cancellation import OpenedDatabase, interrupt_when_due
from ss2sql.runtime.external.table_statements import translate_sql
from ss2sql.runtime.python.codegen_context import CodegenContext
from ss2sql.runtime.python.expression_facts import ExpressionAnalysis
from ss2sql.runtime.python.native_query import NativeQuery
from ss2sql.runtime.python.noted_steps import can_be_noted
from ss2sql.runtime.python.query_compiler import QueryCompiler
from ss2sql.runtime.run.run_state import Run
from ss2sql.runtime.search.search_run import Found, SearchRun

if TYPE_CHECKING:
    from ss2sql.runtime.external.duckdb_sources import DuckSources


@dataclass(frozen=True, slots=True)
class EngineAbilities:
    """What is known of a database that searches by levels, whether it is here or not.

    Its name, its dialect, its statements, whether they find the states that are expanded in a table `apart`, and what
    it cannot do beside what no such database can.
    """

    name: str
    dialect: Dialect
    write: Callable[[plan.Search, StepSelect], LevelStatements]
    apart: bool = False
    rules: tuple[Rule, ...] = ()


@dataclass(frozen=True, slots=True)
class TableEngine:
    """Such a database: what opens it for a run, what ends it, the errors that it raises, and what finds the results of
    a search in what was opened.

    `make_dataframe` gives the first paths, all without a number, as a DataFrame of the database, where it has such.
    `sources` are its own tables, where scripts can read them; then queries that are no searches run there, too.
    """

    abilities: EngineAbilities
    open: Callable[[SearchRun], OpenedDatabase]
    close: Callable[[], None]
    errors: tuple[type[Exception], ...]
    search: Callable[[SearchRun, Any, Any], Iterator[Found]]
    frame: Callable[[SearchRun, Any, Any, int | None], Any] | None = None
    sources: DuckSources | None = None


@dataclass(frozen=True, slots=True)
class LevelPlan:
    """How a search goes by levels: its statements, and what hinders its steps from being SQL, if anything."""

    written: LevelStatements
    sql_hindrance: str | None
    dialect: Dialect

    @property
    def sql(self) -> str:
        """The statements of one level."""
        return "\n".join(f"{translate_sql(self.dialect, statement)};" for statement in self.written.list_statements())


def plan_level_search(query: plan.Query, abilities: EngineAbilities) -> LevelPlan:
    """The search as it goes by levels in the tables of a database. Raises UnsupportedError where it does not."""
    assert query.search is not None
    for rule in (*RULES, *abilities.rules):
        place = rule.find(query, False)
        if place is not None:
            reason = f"{rule.reason}, which the tables of {abilities.name} cannot do"
            raise UnsupportedError("U001", reason, place, (rule.cure,))
    try:
        steps, hindrance = write_portable_steps(query, abilities.apart), None
    except UnsupportedError as error:
        steps, hindrance = TRIED, error.message
    return LevelPlan(abilities.write(query.search, steps), hindrance, abilities.dialect)


class LevelQuery:
    """A search to be run many times. Raises UnsupportedError where it does not go by levels."""

    def __init__(self, query: plan.Query, engine: TableEngine) -> None:
        self.engine = engine.abilities.name
        self.database = engine
        self.query = query
        self.level_plan = plan_level_search(query, engine.abilities)
        self._native = NativeQuery(query, find=self._iterate_results)

    @property
    def sql(self) -> str:
        return self.level_plan.sql

    def compute_rows(self, run: Run, sink: Rows | None = None) -> Rows:
        """The answer of the query, see `NativeQuery.compute_rows`."""
        return self._native.compute_rows(run, sink)

    def make_dataframe(self, run: Run, most: int | None) -> tuple[tuple[str, ...], Any]:
        """The columns of the query, and its first `most` paths as a DataFrame of the database; without it all.

        `most` is what LIMIT and MAXIMUM came to, which are not evaluated again.
        """
        made: list[Any] = []
        assert self.query.search is not None, "dataframe_answer.py has looked"
        query = replace(self.query, limit=None, search=replace(self.query.search, maximum=None))
        rows = NativeQuery(query, find=partial(self._build_frame, most, made)).compute_rows(run)
        return rows.columns, made[0]

    def _build_frame(self, most: int | None, made: list[Any], search_run: SearchRun) -> Iterator[Found]:
        frame = self.database.frame
        assert frame is not None, "dataframe_answer.py has looked"
        with self._open_database(search_run) as tables:
            made.append(frame(search_run, tables, self.level_plan.written, most))
        yield from ()

    def _iterate_results(self, search_run: SearchRun) -> Iterator[Found]:
        with self._open_database(search_run) as tables:
            yield from self.database.search(search_run, tables, self.level_plan.written)

    @contextmanager
    def _open_database(self, search_run: SearchRun) -> Iterator[Any]:
        tables = self.database.open(search_run)
        try:
            with interrupt_when_due(search_run.run, tables):
                yield tables
        except self.database.errors as error:
            hint = "look at its limit of memory and the room on its disk"
            raise ExecutionError("X009", f"{self.engine}: {error}", search_run.query.span, (hint,)) from error
        finally:
            tables.close_tables()


# --- what is refused -----------------------------------------------------------------------------------


def _find_weight_span(query: plan.Query, nested: bool) -> Span | None:
    return query.span if query.search and (query.search.weight or query.search.repeats == "memorize") else None


def _find_depth_first(query: plan.Query, nested: bool) -> Span | None:
    return query.span if query.search and query.search.order == "depth first" else None


def _find_special_clauses(query: plan.Query, nested: bool) -> Span | None:
    search = query.search
    return query.span if search and (query.last or not search.plain) else None


def _find_aggregates(query: plan.Query, nested: bool) -> Span | None:
    return (query.group or (query.columns[0].expr,))[0].span if query.aggregated else None


def _find_volatile_clauses(query: plan.Query, nested: bool) -> Span | None:
    builder = QueryCompiler(CodegenContext(query.span, ExpressionAnalysis((query,))))
    return None if can_be_noted(builder, query) else query.span


RULES = (
    Rule("COST, PROBABILITY and MEMORIZE do not go by length", "leave the engine to ss2sql", _find_weight_span),
    Rule(
        "LAST, a condition, EACH, BY, ORDER SIBLINGS BY and greedy search go on from step to step",
        "leave the engine to ss2sql",
        _find_special_clauses,
    ),
    Rule(
        "DEPTH FIRST goes on from the last step",
        "write BREADTH FIRST, or UNIQUE without DEPTH FIRST",
        _find_depth_first,
    ),
    Rule("aggregates count over whole paths", "leave the engine to ss2sql", _find_aggregates),
    Rule(
        "a volatile function or an assignment keeps the written order",
        "register functions with volatility='immutable' or 'stable' if that is true",
        _find_volatile_clauses,
    ),
)

"""Compiling a search for the tables of another database, and what of searches these cannot do."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from ss2sql import plan
from ss2sql.errors import ExecutionError, Span, UnsupportedError
from ss2sql.lowering.dialects import Dialect
from ss2sql.lowering.portable.steps import WrittenSteps, write_steps
from ss2sql.lowering.unsupported import Rule
from ss2sql.records import dataclass
from ss2sql.runtime.levels.level import TRIED, Level
from ss2sql.runtime.levels.statements import printed
from ss2sql.runtime.levels.watch import Opened, watched
from ss2sql.runtime.memorize.hunt import Found, Hunt
from ss2sql.runtime.native.builder import Builder
from ss2sql.runtime.native.compiled import NativeQuery
from ss2sql.runtime.native.facts import Analysis
from ss2sql.runtime.native.noted_steps import can_be_noted
from ss2sql.runtime.native.unit import Unit
from ss2sql.runtime.rows import Rows
from ss2sql.runtime.run import Run

if TYPE_CHECKING:
    from ss2sql.runtime.duck.tables import DuckSources


@dataclass(frozen=True, slots=True)
class Abilities:
    """What is known of a database that searches by levels, whether it is here or not.

    Its name, its dialect, its statements, whether they find the states that are expanded in a table `apart`, and what
    it cannot do beside what no such database can.
    """

    name: str
    dialect: Dialect
    write: Callable[[plan.Search, WrittenSteps], Level]
    apart: bool = False
    rules: tuple[Rule, ...] = ()


@dataclass(frozen=True, slots=True)
class TableEngine:
    """Such a database: what opens it for a run, what ends it, the errors that it raises, and what finds the results of
    a search in what was opened.

    `frame` gives the first paths, all without a number, as a DataFrame of the database, where it has such. `sources`
    are its own tables, where scripts can read them; then queries that are no searches run there, too.
    """

    abilities: Abilities
    open: Callable[[Hunt], Opened]
    close: Callable[[], None]
    errors: tuple[type[Exception], ...]
    search: Callable[[Hunt, Any, Any], Iterator[Found]]
    frame: Callable[[Hunt, Any, Any, int | None], Any] | None = None
    sources: DuckSources | None = None


@dataclass(frozen=True, slots=True)
class InTables:
    """How a search goes by levels: its statements, and what hinders its steps from being SQL, if anything."""

    written: Level
    hindrance: str | None
    dialect: Dialect

    @property
    def sql(self) -> str:
        """The statements of one level."""
        return "\n".join(f"{printed(self.dialect, statement)};" for statement in self.written.statements())


def in_tables(query: plan.Query, abilities: Abilities) -> InTables:
    """The search as it goes by levels in the tables of a database. Raises UnsupportedError where it does not."""
    assert query.search is not None
    for rule in (*RULES, *abilities.rules):
        place = rule.find(query, False)
        if place is not None:
            reason = f"{rule.reason}, which the tables of {abilities.name} cannot do"
            raise UnsupportedError("U001", reason, place, (rule.cure,))
    try:
        steps, hindrance = write_steps(query, abilities.apart), None
    except UnsupportedError as error:
        steps, hindrance = TRIED, error.message
    return InTables(abilities.write(query.search, steps), hindrance, abilities.dialect)


class LevelQuery:
    """A search to be run many times. Raises UnsupportedError where it does not go by levels."""

    def __init__(self, query: plan.Query, engine: TableEngine) -> None:
        self.engine = engine.abilities.name
        self.database = engine
        self.query = query
        self.in_tables = in_tables(query, engine.abilities)
        self._native = NativeQuery(query, find=self._found)

    @property
    def sql(self) -> str:
        return self.in_tables.sql

    def rows(self, run: Run, sink: Rows | None = None) -> Rows:
        """The answer of the query, see `NativeQuery.rows`."""
        return self._native.rows(run, sink)

    def frame(self, run: Run, most: int | None) -> tuple[tuple[str, ...], Any]:
        """The columns of the query, and its first `most` paths as a DataFrame of the database; without it all.

        `most` is what LIMIT and MAXIMUM came to, which are not evaluated again.
        """
        made: list[Any] = []
        assert self.query.search is not None, "framed.py has looked"
        query = replace(self.query, limit=None, search=replace(self.query.search, maximum=None))
        rows = NativeQuery(query, find=partial(self._framed, most, made)).rows(run)
        return rows.columns, made[0]

    def _framed(self, most: int | None, made: list[Any], hunt: Hunt) -> Iterator[Found]:
        frame = self.database.frame
        assert frame is not None, "framed.py has looked"
        with self._opened(hunt) as tables:
            made.append(frame(hunt, tables, self.in_tables.written, most))
        yield from ()

    def _found(self, hunt: Hunt) -> Iterator[Found]:
        with self._opened(hunt) as tables:
            yield from self.database.search(hunt, tables, self.in_tables.written)

    @contextmanager
    def _opened(self, hunt: Hunt) -> Iterator[Any]:
        """What the run has opened in the database."""
        tables = self.database.open(hunt)
        try:
            with watched(hunt.run, tables):
                yield tables
        except self.database.errors as error:
            hint = "look at its limit of memory and the room on its disk"
            raise ExecutionError("X009", f"{self.engine}: {error}", hunt.query.span, (hint,)) from error
        finally:
            tables.close()


# --- what is refused -----------------------------------------------------------------------------------


def _by_weight(query: plan.Query, nested: bool) -> Span | None:
    return query.span if query.search and (query.search.weight or query.search.repeats == "memorize") else None


def _depth_first(query: plan.Query, nested: bool) -> Span | None:
    return query.span if query.search and query.search.order == "depth first" else None


def _not_plain(query: plan.Query, nested: bool) -> Span | None:
    search = query.search
    return query.span if search and (query.last or not search.plain) else None


def _aggregated(query: plan.Query, nested: bool) -> Span | None:
    return (query.group or (query.columns[0].expr,))[0].span if query.aggregated else None


def _unsteady(query: plan.Query, nested: bool) -> Span | None:
    builder = Builder(Unit(query.span, Analysis((query,))))
    return None if can_be_noted(builder, query) else query.span


RULES = (
    Rule("COST, PROBABILITY and MEMORIZE do not go by length", "leave the engine to ss2sql", _by_weight),
    Rule(
        "LAST, a condition, EACH, BY, ORDER SIBLINGS BY and greedy search go on from step to step",
        "leave the engine to ss2sql",
        _not_plain,
    ),
    Rule("DEPTH FIRST goes on from the last step", "write BREADTH FIRST, or UNIQUE without DEPTH FIRST", _depth_first),
    Rule("aggregates count over whole paths", "leave the engine to ss2sql", _aggregated),
    Rule(
        "a volatile function or an assignment keeps the written order",
        "register functions with volatility='immutable' or 'stable' if that is true",
        _unsteady,
    ),
)

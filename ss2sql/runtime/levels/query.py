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
from ss2sql.lowering.unsupported import Rule
from ss2sql.records import dataclass
from ss2sql.runtime.levels.kinds import BY_COST, IN_TABLES, Kind, Written, kinds_of
from ss2sql.runtime.levels.statements import printed
from ss2sql.runtime.levels.watch import Opened, watched
from ss2sql.runtime.memorize.hunt import Found, Hunt
from ss2sql.runtime.native.builder import Builder
from ss2sql.runtime.native.compiled import NativeQuery
from ss2sql.runtime.native.facts import Analysis
from ss2sql.runtime.native.pieces import can_be_taken_apart
from ss2sql.runtime.native.unit import Unit
from ss2sql.runtime.rows import Rows
from ss2sql.runtime.run import Run

if TYPE_CHECKING:
    from ss2sql.runtime.duck.tables import DuckSources


@dataclass(frozen=True, slots=True)
class Abilities:
    """What is known of a database that searches by levels, whether it is here or not.

    Its name, its dialect, what it cannot do beside what no such database can, and what searches by length and by cost
    are made of in it.
    """

    name: str
    dialect: Dialect
    rules: tuple[Rule, ...] = ()
    by_length: tuple[Kind, ...] = IN_TABLES
    by_cost: Kind = BY_COST


@dataclass(frozen=True, slots=True)
class TableEngine:
    """Such a database: what opens it for a run, what ends it, and the errors that it raises.

    `sources` are its own tables, where scripts can read them; then queries that are no searches run there, too.
    """

    abilities: Abilities
    open: Callable[[Hunt], Opened]
    close: Callable[[], None]
    errors: tuple[type[Exception], ...]
    sources: DuckSources | None = None


@dataclass(frozen=True, slots=True)
class InTables:
    """How a search goes by levels: its kind, its statements, and what hinders its steps from being SQL, if anything."""

    kind: Kind
    written: Written
    hindrance: str | None
    abilities: Abilities

    @property
    def sql(self) -> str:
        """The statements of one level."""
        dialect = self.abilities.dialect
        return "\n".join(f"{printed(dialect, statement.text)};" for statement in self.written.level())


def in_tables(query: plan.Query, abilities: Abilities) -> InTables:
    """The search as it goes by levels in the tables of a database. Raises UnsupportedError where it does not."""
    assert query.search is not None
    for rule in (*RULES, *abilities.rules):
        place = rule.find(query, False)
        if place is not None:
            reason = f"{rule.reason}, which the tables of {abilities.name} cannot do"
            raise UnsupportedError("U001", reason, place, (rule.cure,))
    hindrance: str | None = None
    for kind in kinds_of(query.search, abilities.by_length, abilities.by_cost):
        try:
            return InTables(kind, kind.write(query), hindrance, abilities)
        except UnsupportedError as error:
            hindrance = error.message
    raise AssertionError("the last kind can be written")


class LevelQuery:
    """A search to be run many times. Raises UnsupportedError where it does not go by levels."""

    def __init__(self, query: plan.Query, engine: TableEngine) -> None:
        self.engine = engine.abilities.name
        self.database = engine
        self.query = query
        self.in_tables = in_tables(query, engine.abilities)
        self._native = NativeQuery(taken_apart(query), find=self._found)

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
        query = taken_apart(replace(self.query, limit=None, search=replace(self.query.search, maximum=None)))
        rows = NativeQuery(query, find=partial(self._framed, most, made)).rows(run)
        return rows.columns, made[0]

    def _framed(self, most: int | None, made: list[Any], hunt: Hunt) -> Iterator[Found]:
        frame = self.in_tables.kind.frame
        assert frame is not None, "framed.py has looked"
        with self._opened(hunt) as tables:
            made.append(frame(hunt, tables, self.in_tables.written, most))
        yield from ()

    def _found(self, hunt: Hunt) -> Iterator[Found]:
        with self._opened(hunt) as tables:
            yield from self.in_tables.kind.search(hunt, tables, self.in_tables.written).results()

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


def taken_apart(query: plan.Query) -> plan.Query:
    """The search by MEMORIZE, which asks for the clauses one by one, and leaves it to others what becomes of steps."""
    assert query.search is not None
    order = query.search.order if query.search.weight else "depth first"
    return replace(query, search=replace(query.search, order=order, repeats="memorize"))


def _depth_first(query: plan.Query, nested: bool) -> Span | None:
    search = query.search
    return query.span if search and search.order == "depth first" and search.repeats != "memorize" else None


def _not_plain(query: plan.Query, nested: bool) -> Span | None:
    search = query.search
    return query.span if search and (query.last or not search.plain) else None


def _guided(query: plan.Query, nested: bool) -> Span | None:
    return query.search.heuristic.span if query.search and query.search.heuristic else None


def _aggregated(query: plan.Query, nested: bool) -> Span | None:
    return (query.group or (query.columns[0].expr,))[0].span if query.aggregated else None


def _unsteady(query: plan.Query, nested: bool) -> Span | None:
    builder = Builder(Unit(query.span, Analysis((query,))))
    return None if can_be_taken_apart(builder, taken_apart(query)) else query.span


RULES = (
    Rule(
        "LAST, a condition, EACH, BY, ORDER SIBLINGS BY and greedy search go on from step to step",
        "leave the engine to ss2sql",
        _not_plain,
    ),
    Rule("DEPTH FIRST goes on from the last step", "write BREADTH FIRST, or UNIQUE without DEPTH FIRST", _depth_first),
    Rule("HEURISTIC goes on from one path at a time", "leave HEURISTIC out, the costs are the same", _guided),
    Rule("aggregates count over whole paths", "leave the engine to ss2sql", _aggregated),
    Rule(
        "a volatile function or an assignment keeps the written order",
        "register functions with volatility='immutable' or 'stable' if that is true",
        _unsteady,
    ),
)

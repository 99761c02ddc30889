"""Compiling a search for the tables of another database, and what of searches these cannot do."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from ss2sql import plan
from ss2sql.errors import ExecutionError, Span, UnsupportedError
from ss2sql.lowering.dialects import Dialect
from ss2sql.lowering.unsupported import Rule
from ss2sql.runtime.levels.kinds import Kind, kinds_of
from ss2sql.runtime.levels.statements import shown
from ss2sql.runtime.levels.tables import Tables
from ss2sql.runtime.levels.watch import watched
from ss2sql.runtime.memorize.hunt import Found, Hunt
from ss2sql.runtime.native.builder import Builder
from ss2sql.runtime.native.compiled import NativeQuery
from ss2sql.runtime.native.facts import Analysis
from ss2sql.runtime.native.pieces import can_be_taken_apart
from ss2sql.runtime.native.unit import Unit
from ss2sql.runtime.rows import Rows
from ss2sql.runtime.run import Run


@dataclass(frozen=True, slots=True)
class TableEngine:
    """A database that searches by levels.

    Its name among the engines, its dialect, what opens tables for a run, what ends it, the errors that it raises, what
    it cannot do beside what no such database can, what searches can be made of in it, whether it has recursive queries.
    """

    name: str
    dialect: Dialect
    open: Callable[[Hunt], Tables]
    close: Callable[[], None]
    errors: tuple[type[Exception], ...]
    rules: tuple[Rule, ...] = ()
    kinds: Callable[[plan.Search], tuple[Kind, ...]] = kinds_of
    recursive: bool = True


@dataclass(frozen=True, slots=True)
class InTables:
    """How a search goes by levels: the SQL of one, its kind, and what hinders its steps from being SQL, if anything."""

    sql: str
    kind: Kind
    hindrance: str | None


class LevelQuery:
    """A search to be run many times. Raises UnsupportedError where it does not go by levels."""

    def __init__(self, query: plan.Query, engine: TableEngine) -> None:
        search = query.search
        assert search is not None
        for rule in (*RULES, *engine.rules):
            place = rule.find(query, False)
            if place is not None:
                reason = f"{rule.reason}, which the tables of {engine.name} cannot do"
                raise UnsupportedError("U001", reason, place, (rule.cure,))
        self.engine = engine.name
        self.database = engine
        self._hindrance: str | None = None
        self._choose(query)
        self._native = NativeQuery(taken_apart(query), find=self._found)

    def _choose(self, query: plan.Query) -> None:
        """Takes the first kind of search that can be written."""
        assert query.search is not None
        for kind in self.database.kinds(query.search):
            try:
                self.kind, self.written = kind, kind.write(query)
                return
            except UnsupportedError as error:
                self._hindrance = error.message
        raise AssertionError("the last kind can be written")

    @property
    def in_tables(self) -> InTables:
        database = self.database
        texts = (shown(database.dialect, statement, database.recursive) for statement in self.written.level())
        return InTables("\n".join(texts), self.kind, self._hindrance)

    def rows(self, run: Run, sink: Rows | None = None) -> Rows:
        """The answer of the query, see `NativeQuery.rows`."""
        return self._native.rows(run, sink)

    def _found(self, hunt: Hunt) -> Iterator[Found]:
        tables = self.database.open(hunt)
        try:
            with watched(hunt.run, tables):
                yield from self.kind.search(hunt, tables, self.written).results()
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


def _guided(query: plan.Query, nested: bool) -> Span | None:
    return query.search.heuristic.span if query.search and query.search.heuristic else None


def _aggregated(query: plan.Query, nested: bool) -> Span | None:
    return query.group[0].span if query.aggregated else None


def _unsteady(query: plan.Query, nested: bool) -> Span | None:
    builder = Builder(Unit(query.span, Analysis((query,))))
    return None if can_be_taken_apart(builder, taken_apart(query)) else query.span


RULES = (
    Rule("DEPTH FIRST goes on from the last step", "write BREADTH FIRST, or UNIQUE without DEPTH FIRST", _depth_first),
    Rule("HEURISTIC goes on from one path at a time", "leave HEURISTIC out, the costs are the same", _guided),
    Rule("aggregates count over whole paths", "leave the engine to ss2sql", _aggregated),
    Rule(
        "a volatile function or an assignment keeps the written order",
        "register functions with volatility='immutable' or 'stable' if that is true",
        _unsteady,
    ),
)

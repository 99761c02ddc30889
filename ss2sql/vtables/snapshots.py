"""What a query reads of a world apart from its walk: tables copied at its start, columns read after its rows are found.

Passing a value through SQLite costs 0.3 us, a list 4 us. Where a query shows only elements of worlds and their columns,
SQLite selects the keys alone, and each row is made from these.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from itertools import chain, tee
from operator import itemgetter
from typing import TYPE_CHECKING, Any, TypeAlias

from ss2sql.errors import Span
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Kind
from ss2sql.language.plan_traversal import walk
from ss2sql.vtables.contract import QueryCache
from ss2sql.vtables.reading import Readings

if TYPE_CHECKING:
    from ss2sql.vtables.attached_worlds import AttachedWorldTable


Row: TypeAlias = tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class LateColumns:
    """Makes the rows of a query from keys, which its SQL selects.

    `tables` are the tables of the sources, with the places where errors show them; `cells` are what is shown:
    the number of a source and the name of its column, None for its element.
    """

    tables: tuple[tuple[AttachedWorldTable, Span], ...]
    cells: tuple[tuple[int, str | None], ...]

    def iterate_rows(self, readings: Readings, keys: Iterable[Sequence[Any]]) -> Iterator[Row]:
        known = [readings.get_reading(table.table, span) for table, span in self.tables]
        columns = []
        for (number, name), copy in zip(self.cells, tee(keys, len(self.cells)), strict=True):
            read = known[number].get_element if name is None else known[number].make_reader(name)
            columns.append(map(read, map(itemgetter(number), copy)))
        return zip(*columns, strict=True)  # row by row, each from the left to the right


def find_late_columns(query: plan.Query) -> tuple[plan.Column, ...]:
    """The columns of keys that SQL selects where the other columns are better read late; else none.

    The query may show elements and columns only, since expressions must fail in their written order.
    """
    worlds = {source.id: source for source in query.sources if isinstance(source, plan.WorldSource)}
    shown = [output.expr for output in query.columns]
    keys: dict[int, plan.Column] = {}
    for expr in shown:
        if not isinstance(expr, (plan.Element, plan.Column)) or expr.source not in worlds:
            return ()
        schema = worlds[expr.source].table.schema
        key = getattr(schema.keyed, "key", "")
        if not key or schema.kinds[key].kinds != Kind.INT:
            return ()
        keys[expr.source] = plan.Column(expr.source, key, schema.kinds[key], span=expr.span)
    plain = sum(isinstance(expr, plan.Column) and not expr.type.may_be(Kind.STRUCTURED) for expr in shown)
    return tuple(keys.values()) if len(keys) < plain or plain < len(shown) else ()


def plan_late_columns(query: plan.Query, keys: Sequence[plan.Column]) -> LateColumns:
    """How the rows of a query are made from these keys."""
    worlds = {source.id: source for source in query.sources if isinstance(source, plan.WorldSource)}
    number_of = {key.source: number for number, key in enumerate(keys)}
    cells = [
        (number_of[expr.source], None if isinstance(expr, plan.Element) else expr.name)
        for expr in (output.expr for output in query.columns)
        if isinstance(expr, (plan.Element, plan.Column))  # all are
    ]
    tables = tuple((worlds[key.source].table, worlds[key.source].span) for key in keys)
    return LateColumns(tables, tuple(cells))


# --- snapshots: the tables that a query copies at its start, because it may move the world during the walk
@dataclass(frozen=True, slots=True)
class Snapshot:
    """The columns that a query copies at its start, by table; none where it reads the world directly.

    `places` are the first spans of its tables.
    """

    columns: tuple[tuple[AttachedWorldTable, Span | None, tuple[str, ...]], ...] = ()
    places: tuple[tuple[AttachedWorldTable, Span | None], ...] = ()

    def copy_tables(self, remembered: QueryCache | None, check: Callable[[], None]) -> Readings:
        """The readings of a run of the query, with the copy made. `remembered` gets the caches of worlds.

        `check` raises where the run has to end.
        """
        readings = Readings(remembered, self.places, check)
        for table, place, columns in self.columns:
            readings.get_reading(table.table, place).freeze_columns(columns)
        return readings


NO_SNAPSHOT = Snapshot()


def plan_snapshot(roots: Collection[Any]) -> Snapshot:
    """The snapshot for these parts of a plan, which run together.

    Only functions of the user or of a world can move it. The string of an `eval` may call any, and read any column.
    """
    nodes = list(chain.from_iterable(map(walk, roots)))
    sources = [node for node in nodes if isinstance(node, plan.WorldSource)]
    if not sources:
        return NO_SNAPSHOT
    places = tuple(
        (table, find_first_table_place(table, roots)) for table in {source.table: None for source in sources}
    )
    if not any(map(_can_world_read_move, nodes)):
        return Snapshot((), places)
    texts = any(isinstance(node, plan.Eval) for node in nodes)
    columns: dict[AttachedWorldTable, dict[str, None]] = {}
    for source in sources:
        wanted = columns.setdefault(source.table, {})
        if texts:
            wanted.update(dict.fromkeys(name for name, _ in source.columns))
        for node in nodes:
            if isinstance(node, plan.Column) and node.source == source.id:
                wanted[node.name] = None
    copied = tuple((table, find_first_table_place(table, roots), tuple(wanted)) for table, wanted in columns.items())
    return Snapshot(copied, places)


def find_first_table_place(table: AttachedWorldTable, roots: Iterable[Any]) -> Span | None:
    """The first span of the table in FROM in these parts of a plan."""
    nodes = chain.from_iterable(walk(root) for root in roots if root is not None)
    return next((node.span for node in nodes if isinstance(node, plan.WorldSource) and node.table is table), None)


def can_move_world(query: plan.Query) -> bool:
    return any(map(_can_world_read_move, walk(query)))


def _can_world_read_move(node: Any) -> bool:
    if isinstance(node, plan.Eval):
        return True
    return isinstance(node, plan.Call) and not node.function.builtin and node.function.volatility == "volatile"

"""Late materialization: columns of worlds that are only shown are read after SQLite has found a row.

Passing a value through SQLite costs 0.3 us, a list 4 us. Where a query shows only elements of worlds and their columns,
SQLite selects the keys alone, and each row is made from these.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, TypeAlias

from ss2sql.errors import Span
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Kind
from ss2sql.vtables.column_layouts import Place
from ss2sql.vtables.reading import Readings

if TYPE_CHECKING:
    from ss2sql.vtables.attached_worlds import AttachedTable

Row: TypeAlias = tuple[Any, ...]
Cell: TypeAlias = tuple[int, int | None, Place | None]  # source, group; a key has no group, an element no place either


@dataclass(frozen=True, slots=True)
class LateColumns:
    """Makes the rows of a query from keys, which its SQL selects.

    `tables` are the tables of the sources, with the places where errors show them; `groups` are (source, group), in
    the order in which they are first shown.
    """

    tables: tuple[tuple[AttachedTable, Span], ...]
    groups: tuple[tuple[int, str], ...]
    cells: tuple[Cell, ...]

    def iterate_rows(self, readings: Readings, keys: Iterable[Sequence[Any]]) -> Iterator[Row]:
        """An iterator of the rows of these keys."""
        known = [readings.get_reading(table.table, span) for table, span in self.tables]
        constants: list[Any] = [reading.get_element for reading in known]
        for source, group in self.groups:
            constants += [known[source].get_read_values(group), known[source].get_fetcher(group)]
        return _make_row_maker(len(known), tuple(source for source, _ in self.groups), self.cells)(*constants)(keys)


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
    groups: dict[tuple[int, str], int] = {}
    cells: list[Cell] = []
    for output in query.columns:
        expr: Any = output.expr
        source, schema = number_of[expr.source], worlds[expr.source].table.schema
        if isinstance(expr, plan.Element):
            cells.append((source, None, None))
        elif expr.name == schema.keyed.key:
            cells.append((source, None, Place(0)))
        else:
            group = schema.group_of[expr.name]
            number = groups.setdefault((source, group), len(groups))
            cells.append((source, number, schema.groups[group].places[expr.name]))
    tables = tuple((worlds[key.source].table, worlds[key.source].span) for key in keys)
    return LateColumns(tables, tuple(groups), tuple(cells))


@cache
def _make_row_maker(
    sources: int, groups: tuple[int, ...], cells: tuple[Cell, ...]
) -> Callable[..., Callable[[Iterable[Sequence[Any]]], Iterator[Row]]]:
    """Makes the function from keys to rows; `groups` are the sources of groups."""
    names = [f"element{number}" for number in range(sources)]
    for number in range(len(groups)):
        names += [f"known{number}", f"fetch{number}"]
    lines = [f"def make({', '.join(names)}):", " def rows(keys):"]
    lines.append(f"  for {' '.join(f'key{number},' for number in range(sources))} in keys:")
    for number, source in enumerate(groups):
        lines += [f"   values{number} = known{number}(key{source})", f"   if values{number} is None:"]
        lines += [f"    values{number} = fetch{number}(key{source})"]
    shown = []
    for source, group, place in cells:
        if place is None:
            shown.append(f"element{source}(key{source})")
        else:
            shown.append(f"key{source}" if group is None else place.write_code(f"values{group}"))
    lines += [f"   yield ({', '.join(shown)},)", " return rows"]
    made: dict[str, Any] = {}
    exec("\n".join(lines), made)  # the code comes from this file, apart from numbers
    return made["make"]  # type: ignore[no-any-return]

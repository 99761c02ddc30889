"""Descriptions of worlds: their tables, columns and functions, from the declarations."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from ss2sql.errors import SessionError, suggest_names
from ss2sql.language.plan_printer import format_type
from ss2sql.vtables.attached_worlds import AttachedTable, AttachedWorld
from ss2sql.vtables.declared_types import format_declared_type

if TYPE_CHECKING:
    from ss2sql.runtime.sqlite.database_tables import Tables
    from ss2sql.session.variables import OtherTables


def describe_world(world: AttachedWorld) -> str:
    """The tables of a world with columns, types, units, filters and texts, and its functions."""
    about = world.world.text or type(world.world).__doc__ or type(world.world).__name__
    lines = [f"{world.name}: {_take_first_line(about)}"]
    for table in world.tables.values():
        lines += ["", *format_table(table)]
    if world.functions:
        lines += ["", "functions"]
        width = max(map(len, world.functions))
        for name, (method, volatility) in world.functions.items():
            lines.append(f"  {name:<{width}}  {_take_first_line(method.__doc__ or '')} ({volatility})")
    return "\n".join(line.rstrip() for line in lines)


def format_table(table: AttachedTable) -> Iterator[str]:
    """The lines for one table."""
    schema = table.schema
    text = table.table.text or (f"elements of {schema.walked.name}" if schema.walked else "")
    yield f"FROM {write_name(table)}" + (f": {text}" if text else "")
    rows = list(list_columns(table))
    widths = [max(len(row[place]) for row in rows) for place in range(4)]
    for row in rows:
        cells = [cell.ljust(width) for cell, width in zip(row, widths, strict=False)]
        yield "  " + "  ".join([*cells, row[4]]).rstrip()


def list_columns(table: AttachedTable) -> Iterator[tuple[str, str, str, str, str]]:
    """The columns of a table: name, type, unit, the comparisons that the world can use, text."""
    for column in table.schema.columns:
        yield column.name, format_declared_type(column.type), column.unit, column.filter, column.text


def list_tables(
    tables: Tables, worlds: Mapping[str, AttachedWorld], others: OtherTables | None
) -> dict[str, tuple[str, ...]]:
    """The columns of the tables of databases and of worlds, by their names in FROM.

    A view that cannot be read, because one of its tables is gone, has none.
    """
    found: dict[str, tuple[str, ...]] = {}
    tables.refresh_copies()
    for name in tables.list_names():
        found[name] = tables.list_columns(name)
    if others is not None:
        for name in others.list_names():
            found.setdefault(name, tuple(column for column, _ in others.read_columns(name)))
    for world in worlds.values():
        found.update((write_name(table), tuple(table.schema.kinds)) for table in world.tables.values())
    return found


def describe_name(name: str, tables: Tables, worlds: Mapping[str, AttachedWorld], others: OtherTables | None) -> str:
    """The description of a world or a table. Raises SessionError S002 for an unknown name."""
    owner, _, rest = name.partition(".")
    if owner in worlds and not rest:
        return describe_world(worlds[owner])
    if owner in worlds and rest in worlds[owner].tables:
        return "\n".join(format_table(worlds[owner].tables[rest]))
    source = tables.find_table(owner, rest) if rest else tables.find_table(None, name)
    columns = source.columns if source is not None else () if others is None else others.read_columns(name)
    if not columns:
        known = [*worlds, *tables.list_names(), *(() if others is None else others.list_names())]
        known += [table.title for world in worlds.values() for table in world.tables.values()]
        raise SessionError("S002", f"there is no world or table '{name}'", hints=suggest_names(name, known))
    width = max(len(column) for column, _ in columns)
    return "\n".join([f"FROM {name}", *(f"  {column:<{width}}  {format_type(kind)}" for column, kind in columns)])


def write_name(table: AttachedTable) -> str:
    """The name of a table in FROM, with the parameters of a table function."""
    return f"{table.world_name}.{table.schema.signature}" if table.schema.parameters else table.title


def _take_first_line(text: str) -> str:
    return (text.strip().splitlines() or [""])[0]

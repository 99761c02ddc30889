"""What a session says of itself: its worlds, tables, lists and frames, functions and representations."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from inspect import signature
from typing import TYPE_CHECKING, Any

from ss2sql.errors import SessionError, suggest_names
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.kinds import Kind, Type
from ss2sql.language.operations import WRITTEN
from ss2sql.language.plan_traversal import format_type
from ss2sql.vtables.frames import Frame, list_source_elements

if TYPE_CHECKING:
    from ss2sql.session.host import SessionHost
    from ss2sql.vtables.attached_worlds import AttachedWorld, AttachedWorldTable


def describe_world(world: AttachedWorld) -> str:
    """The tables of a world with columns, types, units, filters and texts, and its functions."""
    about = world.world.text or type(world.world).__doc__ or type(world.world).__name__
    lines = [f"{world.name}: {take_first_line(about)}"]
    for table in world.tables.values():
        lines += ["", *describe_table_lines(table)]
    if world.functions:
        lines += ["", "functions"]
        width = max(map(len, world.functions))
        for name, (method, volatility) in world.functions.items():
            lines.append(f"  {name:<{width}}  {take_first_line(method.__doc__)} ({volatility})")
    return "\n".join(line.rstrip() for line in lines)


def describe_table_lines(table: AttachedWorldTable) -> Iterator[str]:
    schema = table.schema
    text = table.table.text or (f"elements of {schema.walked.name}" if schema.walked else "")
    yield f"FROM {describe_table_call(table)}" + (f": {text}" if text else "")
    rows = list(describe_table_columns(table))
    widths = [max(len(row[place]) for row in rows) for place in range(4)]
    for row in rows:
        cells = [cell.ljust(width) for cell, width in zip(row, widths, strict=False)]
        yield "  " + "  ".join([*cells, row[4]]).rstrip()


def describe_table_columns(table: AttachedWorldTable) -> Iterator[tuple[str, str, str, str, str]]:
    """The columns of a table: name, type, unit, the comparisons that the world can use, text."""
    from ss2sql.vtables.schema import format_declared_type

    for column in table.schema.columns:
        yield column.name, format_declared_type(column.type), column.unit, column.filter, column.text


@dataclass(frozen=True, slots=True)
class TableAbout:
    """What FROM finds under a name: its kind, its columns, and the number of its rows where that is known at once."""

    kind: str
    columns: tuple[str, ...]
    rows: int | None = None


def list_tables(host: SessionHost) -> dict[str, TableAbout]:
    """What FROM finds: tables of databases and of worlds, data frames, lists, by their names.

    A view that cannot be read, because one of its tables is gone, has no columns.
    """
    found: dict[str, TableAbout] = {}
    tables, names = host.tables, host.names
    tables.refresh_copies()
    for title, (home, name) in tables.list_full_names().items():
        found[title] = TableAbout("table", tables.list_columns(name, home))
    if names.others is not None:
        for name in names.others.list_names():
            columns = tuple(column for column, _ in names.others.describe_table(name))
            found.setdefault(name, TableAbout("table", columns))
    for world in names.worlds.values():
        for table in world.tables.values():
            found[describe_table_call(table)] = TableAbout("table of a world", tuple(table.schema.kinds))
    for name in names:
        value = None if name in names.worlds else names.get_source(name)
        columns = tuple(column for column, _ in _list_value_columns(host, name, value))
        if isinstance(value, Frame):
            found[name] = TableAbout("data frame", columns, value.length)
        elif type(value) is list or (type(value) is dict and columns != ("this",)):
            found[name] = TableAbout("list", columns, len(list_source_elements(value)))
    return found


def _list_value_columns(host: SessionHost, name: str, value: Any) -> list[tuple[str, Type]]:
    """The columns of a value that stands in FROM, with their types."""
    kind = value.type if isinstance(value, Frame) else host.names.get_type(name, value)
    if kind.is_only(Kind.LIST):
        return list(kind.columns or ()) or [("this", kind.element or Type())]
    if kind.is_only(Kind.DICT) and kind.columns and all(part.is_only(Kind.LIST) for _, part in kind.columns):
        return [(word, part.element or Type()) for word, part in kind.columns]
    return [("this", kind)]


def describe_source(host: SessionHost, name: str) -> str:
    """The description of a world, or of what FROM finds under a name. Raises SessionError S002 for an unknown one."""
    tables, worlds, others = host.tables, host.names.worlds, host.names.others
    owner, _, rest = name.partition(".")
    if owner in worlds and not rest:
        return describe_world(worlds[owner])
    if owner in worlds and rest in worlds[owner].tables:
        return "\n".join(describe_table_lines(worlds[owner].tables[rest]))
    columns: list[tuple[str, Type]] = []
    if name in host.names:
        columns = _list_value_columns(host, name, host.names.get_source(name))
    else:
        source = tables.find_table(owner, rest) if rest else tables.find_table(None, name)
        columns = list(source.columns if source is not None else () if others is None else others.describe_table(name))
    if not columns:
        known = [*worlds, *host.names, *tables.list_names(), *(() if others is None else others.list_names())]
        known += [table.title for world in worlds.values() for table in world.tables.values()]
        raise SessionError("S002", f"there is no world or table '{name}'", hints=suggest_names(name, known))
    width = max(len(column) for column, _ in columns)
    return "\n".join([f"FROM {name}", *(f"  {column:<{width}}  {format_type(kind)}" for column, kind in columns)])


def describe_table_call(table: AttachedWorldTable) -> str:
    """The name of a table in FROM, with the parameters of a table function."""
    return f"{table.world_name}.{table.schema.signature}" if table.schema.parameters else table.title


def take_first_line(text: str | None) -> str:
    return ((text or "").strip().splitlines() or [""])[0]


@dataclass(frozen=True, slots=True)
class FunctionAbout:
    """A function or representation: how it is called, its parameters as they are written, and a line about it.

    A representation without parameters has None; `reason` is why a function of the user has its volatility.
    """

    name: str
    call: str
    parameters: tuple[str, ...] | None
    about: str
    volatility: str = ""
    reason: str = ""


def describe_functions(host: SessionHost) -> dict[str, FunctionAbout]:
    """All functions that scripts can call by their names, the user's own first."""
    found = {}
    for name, entry in sorted({**host.world_functions, **host.functions}.items()):
        parameters, about = _list_parameters(entry.function, 0), take_first_line(entry.function.__doc__)
        call = f"{name}({', '.join(parameters)})"
        found[name] = FunctionAbout(name, call, parameters, about, entry.volatility, entry.reason)
    for name, row in sorted(WRITTEN.items()):
        inside = row.call.rpartition("(")[2].rstrip(")")  # the parameters of its longest call
        parameters = tuple(inside.split(", ")) if inside else ()
        found.setdefault(name, FunctionAbout(name, row.call, parameters, row.about, row.volatility))
    return found


def describe_representations(host: SessionHost) -> dict[str, FunctionAbout]:
    """The names after AS."""
    found = {}
    for name, make in host.shapes.functions.items():
        parameters = _list_parameters(make, 1)
        call = f"{name}({', '.join(parameters)})" if parameters else name
        found[name] = FunctionAbout(name, call, parameters or None, take_first_line(make.__doc__).rstrip("."))
    return found


def _list_parameters(function: Callable[..., Any], skipped: int) -> tuple[str, ...]:
    try:
        parameters = list(signature(function).parameters.values())[skipped:]
    except (TypeError, ValueError):  # functions in C may have no signature
        return ("...",)
    return tuple(str(one.replace(annotation=one.empty)) for one in parameters)


def write_about(entry: FunctionAbout) -> str:
    """The line about a function, with the reason of its volatility."""
    return f"{entry.about or 'registered'} ({entry.volatility}: {entry.reason})" if entry.reason else entry.about

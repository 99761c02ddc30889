"""Built-in functions that need the session: print, help, var, clear, getTime, and descriptions of worlds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from inspect import getmodule, signature
from typing import TYPE_CHECKING, Any

from ss2sql.errors import ExecutionError, SessionError, suggest_names
from ss2sql.errors.exceptions import escape_controls
from ss2sql.language.operations import OPERATIONS, WRITTEN
from ss2sql.language.plan_traversal import format_type
from ss2sql.language.values import copy_for_python
from ss2sql.runtime import representations
from ss2sql.runtime.run.value_sizes import ValueSizes

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


def list_tables(host: SessionHost) -> dict[str, tuple[str, ...]]:
    """The columns of the tables of databases and of worlds, by their names in FROM.

    A view that cannot be read, because one of its tables is gone, has none.
    """
    found: dict[str, tuple[str, ...]] = {}
    tables, worlds, others = host.tables, host.names.worlds, host.names.others
    tables.refresh_copies()
    for name in tables.list_names():
        found[name] = tables.list_columns(name)
    if others is not None:
        for name in others.list_names():
            found.setdefault(name, tuple(column for column, _ in others.describe_table(name)))
    for world in worlds.values():
        found.update((describe_table_call(table), tuple(table.schema.kinds)) for table in world.tables.values())
    return found


def describe_attached_table(host: SessionHost, name: str) -> str:
    """The description of a world or a table. Raises SessionError S002 for an unknown name."""
    tables, worlds, others = host.tables, host.names.worlds, host.names.others
    owner, _, rest = name.partition(".")
    if owner in worlds and not rest:
        return describe_world(worlds[owner])
    if owner in worlds and rest in worlds[owner].tables:
        return "\n".join(describe_table_lines(worlds[owner].tables[rest]))
    source = tables.find_table(owner, rest) if rest else tables.find_table(None, name)
    columns = source.columns if source is not None else () if others is None else others.describe_table(name)
    if not columns:
        known = [*worlds, *tables.list_names(), *(() if others is None else others.list_names())]
        known += [table.title for world in worlds.values() for table in world.tables.values()]
        raise SessionError("S002", f"there is no world or table '{name}'", hints=suggest_names(name, known))
    width = max(len(column) for column, _ in columns)
    return "\n".join([f"FROM {name}", *(f"  {column:<{width}}  {format_type(kind)}" for column, kind in columns)])


def describe_table_call(table: AttachedWorldTable) -> str:
    """The name of a table in FROM, with the parameters of a table function."""
    return f"{table.world_name}.{table.schema.signature}" if table.schema.parameters else table.title


def take_first_line(text: str | None) -> str:
    return ((text or "").strip().splitlines() or [""])[0]


def describe_representation(make: Callable[..., Any]) -> str:
    """A line about a representation; a built-in one has it at the top of its file."""
    about, module = make.__doc__, getmodule(make)
    if module is not None and module.__name__.startswith(representations.__name__):
        about = (module.__doc__ or "").partition(": ")[2]
    return take_first_line(about).rstrip(".")


class SessionFunctions:
    """Methods named after the functions of the language."""

    def __init__(self, host: SessionHost) -> None:
        self.host = host

    def get_function(self, name: str) -> Callable[..., Any]:
        """The Python form of a built-in function that needs the session."""
        found: Callable[..., Any] = getattr(self, f"_{name}")
        return found

    def _print(self, *values: Any) -> Any:
        """Prints the values with blanks between them and gives the last one."""
        text = " ".join(escape_controls(str(copy_for_python(value))) for value in values)
        if self.host.limits.max_output is not None and self.host.active_runs:
            run = self.host.active_runs[0]  # the outermost
            run.printed += len(text) + 1
            if run.printed > self.host.limits.max_output:
                message = f"the script printed more than max_output={self.host.limits.max_output} characters"
                raise ExecutionError("X015", message, hints=("print less, or raise max_output",))
        print(text)
        return values[-1] if values else None

    def _help(self, name: Any = None) -> str:
        world = next((known for known in self.host.names.worlds.values() if name in (known.world, known.name)), None)
        if world is not None and name not in self.host.functions:
            return describe_world(world)
        if name is None:
            lines = [f"{known:<12} {text}" for known, text in sorted(self._describe_all().items())]
            return "\n".join(lines)
        texts = self._describe_all()
        if type(name) is not str or name not in texts:  # a list could not even be looked up
            hints = suggest_names(str(name), texts) or ("help() lists all of them",)
            raise ExecutionError("X007", f"there is no function '{name}'", hints=hints)
        return f"{self._format_call(name)}: {texts[name]}"

    def _format_call(self, name: str) -> str:
        entry = self.host.functions.get(name) or self.host.world_functions.get(name)
        if entry is None:
            return OPERATIONS[name].call
        try:
            return f"{name}({', '.join(signature(entry.function).parameters)})"
        except (TypeError, ValueError):  # functions in C may have no signature
            return name

    def _describe_all(self) -> dict[str, str]:
        texts = {name: row.about for name, row in WRITTEN.items() if name not in ("item", "slice")}
        for name, entry in {**self.host.world_functions, **self.host.functions}.items():
            about = take_first_line(entry.function.__doc__) or "registered"
            texts[name] = f"{about} ({entry.volatility}: {entry.reason})"
        return texts

    def _var(self, name: str | None = None) -> Any:
        if name is None:
            ValueSizes(self.host.limits.max_size).check_value(self.host.names.values)
            return self.host.names.copy_values()
        variables = self.host.names.values
        if type(name) is not str or name not in variables:
            hints = suggest_names(str(name), variables) or ("var() gives all of them",)
            raise ExecutionError("X007", f"there is no variable '{name}'", hints=hints)
        return copy_for_python(variables[name])

    def _clear(self) -> None:
        self.host.names.clear_variables()

    def _getTime(self) -> float:  # noqa: N802 - the language's name
        return self.host.names.temporal_store.clock()

    def _eval(self, text: str) -> Any:
        raise AssertionError("eval is a construct of the plan, not a call")

    _to = _eval

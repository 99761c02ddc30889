"""The worlds of a session: their tables as sources of plans, their columns and methods as functions."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Iterator, Mapping
from itertools import chain
from typing import Any

from ss2sql.errors import Error, ExecutionError, SessionError
from ss2sql.frontend.user_functions import UserFunction, check_user_function_name
from ss2sql.language.conversion import format_value
from ss2sql.language.kinds import Kind, Type
from ss2sql.language.operations import OPERATIONS
from ss2sql.vtables.contract import (
    CacheOfQuery,
    Element,
    Gone,
    QueryCaches,
    Table,
    TableFunction,
    Volatility,
    World,
    WorldFunction,
)
from ss2sql.vtables.reading import unwrap_world_key
from ss2sql.vtables.schema import AdapterGuard, Schema, get_schema, get_world_tables, make_adapter_error

_OBJECT = Type(Kind.OBJECT)


class AttachedWorldTable:
    """A table as plans know it. `module` is the name of its virtual table, `title` its name in scripts."""

    __slots__ = ("columns", "element", "module", "schema", "table", "title", "world", "world_name")

    def __init__(self, world_name: str, world: World, table: Table | TableFunction, title: str, module: str) -> None:
        self.world_name = world_name
        self.world = world
        self.table = table
        self.schema: Schema = get_schema(table)
        self.title = title
        self.module = module
        self.columns: tuple[tuple[str, Type], ...] = tuple(self.schema.kinds.items())
        keyed = self.schema.keyed is not None
        self.element = _OBJECT if keyed else Type(Kind.DICT, columns=self.columns)

    @property
    def signature(self) -> tuple[Any, ...]:
        """What identifies a virtual table; another signature needs a new one."""
        schema = self.schema
        filters = tuple((column.name, column.operators) for column in schema.columns)
        return filters, schema.parameters, schema.required, self.key

    @property
    def key(self) -> str:
        """The column that is the key, if any."""
        return "" if self.schema.keyed is None else self.schema.keyed.key

    def __repr__(self) -> str:
        return f"<table {self.title}>"


class AttachedWorld:
    """A world under its name. `build_module_name` names the virtual tables."""

    def __init__(self, name: str, world: World, module_of: Callable[[str, AttachedWorldTable], str]) -> None:
        self.name = name
        self.world = world
        self.tables: dict[str, AttachedWorldTable] = {}
        for number, table in enumerate(get_world_tables(world)):
            title = name if number == 0 else f"{name}.{table.name}"
            attached = self.tables[table.name] = AttachedWorldTable(name, world, table, title, "")
            attached.module = module_of(f"{name}.{table.name}", attached)
        self.principal = next(iter(self.tables.values()))
        self.functions = dict(_collect_world_methods(world))
        # Its columns and functions, each of which can be called with an element.
        self.names = [*chain.from_iterable(table.schema.kinds for table in self.tables.values()), *self.functions]
        # The columns that are read of a body by its id or name, too: `type("kuka")` is that of a text, though.
        findable = self.principal.schema.kinds.keys() if hasattr(world, "find_body") else ()
        self.body_columns = frozenset(findable) - OPERATIONS.keys() - self.functions.keys()

    def read_time(self) -> Any:
        """The time of the world's clock. Raises ExecutionError X011 where that fails."""
        with AdapterGuard(self.principal.schema):
            return self.world.time

    def get_declaration(self, name: str) -> WorldFunction:
        note = getattr(getattr(type(self.world), name, None), "__ss2sql__", None)
        return note if isinstance(note, WorldFunction) else WorldFunction()


def _collect_world_methods(world: World) -> Iterator[tuple[str, tuple[Callable[..., Any], Volatility]]]:
    for name, method in inspect.getmembers(type(world), callable):
        note = getattr(method, "__ss2sql__", None)
        if isinstance(note, WorldFunction):
            check_user_function_name(name)
            if note.volatility not in ("immutable", "stable", "volatile"):
                message = f"the volatility of {type(world).__name__}.{name} is {note.volatility!r}"
                raise SessionError("S002", message, hints=("write stable, volatile or immutable",))
            yield name, (getattr(world, name), note.volatility)


_WEAKNESS: tuple[Volatility, ...] = ("immutable", "stable", "volatile")


class WorldFunctions:
    """The functions of the attached worlds: for each name a column or method, dispatched by the element."""

    def __init__(self, worlds: Mapping[str, AttachedWorld], memories: QueryCaches) -> None:
        self.worlds = worlds
        self.memories = memories

    def list_functions(self) -> dict[str, UserFunction]:
        """The functions by their names in scripts; one named like a built-in has another name in plans and SQL."""
        names = {name: None for world in self.worlds.values() for name in world.names}
        found = {name: self._make_function(name, self.worlds.values()) for name in names}
        if len(self.worlds) > 1:  # then `space.move(...)` distinguishes them
            for world in self.worlds.values():
                for name in (*world.functions, *world.body_columns):
                    found[f"{world.name}.{name}"] = self._make_function(name, (world,))
        return found

    def _make_function(self, name: str, worlds: Collection[AttachedWorld]) -> UserFunction:
        methods = [world.functions[name] for world in worlds if name in world.functions]
        counts = [_read_world_method_arity(method) for method, _ in methods]
        tables = [table.schema for world in worlds for table in world.tables.values()]
        column = not methods or any(name in schema.kinds for schema in tables if schema.keyed is not None)
        least = min([low for low, _ in counts] + [1] * column)
        highs = [high for _, high in counts if high is not None] + [1] * column
        most = max(highs) if len(highs) == len(counts) + column else None
        stable: Volatility = "stable"
        weakest = max((volatility for _, volatility in methods), key=_WEAKNESS.index, default=stable)
        owners = [world.name for world in worlds if name in world.names]
        planned = f"world_{name}" if name in OPERATIONS else name
        if len(worlds) < len(self.worlds):
            planned = f"{owners[0]}.{name}"
        reason = f"of the world {', '.join(owners)}"
        called = self._make_dispatcher(name, worlds)
        body = "belongs to a world"
        return UserFunction(planned, called, weakest, False, reason, least, most, body=body, of_world=name)

    def _make_dispatcher(self, name: str, worlds: Collection[AttachedWorld]) -> Callable[..., Any]:
        def dispatch_call(*arguments: Any) -> Any:
            return self.call_function(name, arguments, worlds)

        method = next((world.functions[name][0] for world in worlds if name in world.functions), None)
        text = next(self._list_column_texts(name), f"the column {name} of an element")
        dispatch_call.__doc__ = method.__doc__ if method is not None and method.__doc__ else text
        element = inspect.Parameter("this", inspect.Parameter.POSITIONAL_ONLY)
        shown = inspect.signature(method) if method is not None else inspect.Signature([element])
        dispatch_call.__signature__ = shown  # type: ignore[attr-defined]
        return dispatch_call

    def _list_column_texts(self, name: str) -> Iterator[str]:
        for world in self.worlds.values():
            for table in world.tables.values():
                for column in table.schema.columns:
                    if column.name == name and (column.text or column.unit):
                        yield column.text + (f" [{column.unit}]" if column.unit else "")

    def call_function(self, name: str, arguments: tuple[Any, ...], worlds: Collection[AttachedWorld]) -> Any:
        """The column of the one argument, or the method of the world that the first element belongs to.

        Without an element it is that of the one world that has it; a column is then that of a body by its id or name.
        """
        element = next((argument for argument in arguments if isinstance(argument, Element)), None)
        if element is not None and len(arguments) == 1 and name in get_schema(element.table).kinds:
            return get_schema(element.table).read_value(element.key, name)
        owner = self._find_owner(name, arguments, element, worlds)
        if owner is None:
            return self._report_missing_world(name, arguments, element)
        world = owner.world
        try:
            with CacheOfQuery(world, self.memories.get_cache(world)):
                with AdapterGuard(owner.principal.schema):
                    world.check()
                if name in owner.body_columns:
                    body: Any = world
                    return body.read_column(body.find_body(*arguments), name)
                method, _ = owner.functions[name]
                return method(*[unwrap_world_key(argument, world) for argument in arguments])
        except Error:
            raise
        except Exception as error:
            if element is not None and isinstance(error, Gone):
                raise make_adapter_error(get_schema(element.table), error, element.key) from error
            raise

    @staticmethod
    def _find_owner(
        name: str, arguments: tuple[Any, ...], element: Element | None, worlds: Collection[AttachedWorld]
    ) -> AttachedWorld | None:
        having = [world for world in worlds if name in world.functions]
        if element is not None:
            own = (w for w in having if w.world is element.world or w.world.source is element.world.source)
            return next(own, None)
        if name in OPERATIONS and str not in map(type, arguments):  # the name of an element is enough
            return None
        if len(arguments) == 1:
            having += [world for world in worlds if name in world.body_columns]
        if len(having) > 1:
            spellings = " or ".join(f"{world.name}.{name}(...)" for world in having)
            hints = (f"give an element of one, or write {spellings}",)
            names = ", ".join(world.name for world in having)
            raise ExecutionError("X007", f"'{name}' belongs to several worlds: {names}", hints=hints)
        return having[0] if having else None

    def _report_missing_world(self, name: str, arguments: tuple[Any, ...], element: Element | None) -> Any:
        row = OPERATIONS.get(name)
        if row is not None and row.value is not None:
            return row.value(*arguments)
        if element is not None:
            hints = (f"{element.table.name} have {', '.join(get_schema(element.table).kinds)}",)
            raise ExecutionError("X008", f"{element!r} has no '{name}'", hints=hints)
        shown = ", ".join(map(format_value, arguments))
        tables = (table for world in self.worlds.values() for table in world.tables.values())
        walked = (table.title for table in tables if name in table.schema.kinds and isinstance(table.table, Table))
        example = next((f": SELECT {name} FROM {title}" for title in walked), "")
        hints = (f"elements are what a query over the world has in `this`{example}",)
        raise ExecutionError("X007", f"'{name}' needs an element of a world, not {shown}", hints=hints)


def _read_world_method_arity(method: Callable[..., Any]) -> tuple[int, int | None]:
    parameters = inspect.signature(method).parameters.values()
    if any(p.kind is inspect.Parameter.VAR_POSITIONAL for p in parameters):
        return sum(p.default is inspect.Parameter.empty for p in parameters) - 1, None
    return sum(p.default is inspect.Parameter.empty for p in parameters), len(parameters)

"""The symbols of a session: functions, variables, tables, representations by their names."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING

import apsw

from ss2sql.errors import Error
from ss2sql.language.conversion import format_value as written
from ss2sql.language.kinds import Kind, Type
from ss2sql.language.operations import OPERATOR_FUNCTIONS
from ss2sql.language.plan_traversal import format_type
from ss2sql.results import cut_script
from ss2sql.session.descriptions import (
    FunctionAbout,
    describe_functions,
    describe_representations,
    describe_table_call,
    describe_table_columns,
)

if TYPE_CHECKING:
    from ss2sql.session.session import Session

MOST_VALUE = 50  # characters of a variable's value


class SymbolTable:
    """A snapshot of a session's symbols, each part made at the first request."""

    def __init__(self, session: Session) -> None:
        self.session = session
        self.host = session.host
        self._columns: dict[str, dict[str, str]] = {}

    @cached_property
    def functions(self) -> dict[str, FunctionAbout]:
        """Functions by name, the user's own first, without those of operators."""
        every = describe_functions(self.host).items()
        return {name: entry for name, entry in every if entry.reason or name not in OPERATOR_FUNCTIONS}

    @cached_property
    def representations(self) -> dict[str, FunctionAbout]:
        """The names after AS."""
        return describe_representations(self.host)

    @cached_property
    def variables(self) -> dict[str, str]:
        """Variables, data frames and other values that are attached, each with a text of its value."""
        names = self.host.names
        return {name: self._describe_value(name) for name in sorted({*names, *names.late} - names.worlds.keys())}

    def _describe_value(self, name: str) -> str:
        names = self.host.names
        if name in names.late:
            return "a list that is read again for each row"
        value = names.attached[name] if name in names.attached else names.values[name]
        if name in names.frames:
            return f"file {value}" if isinstance(value, Path) else f"data frame of {len(value):,} rows"
        kind = type(value).__name__
        if isinstance(value, (list, dict)) and len(value) > 3:
            return f"{kind} of {len(value):,}"
        return (
            f"{kind}: {written(value, MOST_VALUE)}"
            if isinstance(value, (list, dict, str))
            else cut_script(repr(value), MOST_VALUE)
        )

    @cached_property
    def tables(self) -> dict[str, str]:
        """Tables of the database and of worlds, as FROM writes them, each with a line about it."""
        others = self.host.names.others
        found = dict.fromkeys([*self._list_own_tables(), *(() if others is None else others.list_names())], "table")
        for world in self.host.names.worlds.values():
            found.update(
                (describe_table_call(table), table.table.text or "table of a world") for table in world.tables.values()
            )
        return found

    def _list_own_tables(self) -> list[str]:
        try:
            return sorted(self.host.tables.list_full_names())
        except apsw.Error:  # a view of a missing table, for instance: the script will raise the error
            return []

    @cached_property
    def owners(self) -> dict[str, list[str]]:
        """Worlds and attached files with the names of their tables."""
        found: dict[str, list[str]] = {name: list(world.tables)[1:] for name, world in self.host.names.worlds.items()}
        for name in self.host.tables.attached:
            found[name] = [table[len(name) + 1 :] for table in self.tables if table.startswith(f"{name}.")]
        return found

    def list_columns(self, source: str) -> dict[str, str]:
        """The columns of a source in FROM, with their types, as far as they are known."""
        if source not in self._columns:
            try:
                self._columns[source] = dict(self._read_columns(source))
            except Error:  # an attached object that cannot be read: the script will raise the error
                self._columns[source] = {}
        return self._columns[source]

    def _read_columns(self, source: str) -> Iterator[tuple[str, str]]:
        owner, _, rest = source.partition(".")
        names = self.host.names
        if owner in names.worlds:
            tables = names.worlds[owner].tables
            table = tables.get(rest) if rest else next(iter(tables.values()))
            for name, kind, unit, _, text in describe_table_columns(table) if table is not None else ():
                yield name, "  ".join(part for part in (kind, unit, text) if part)
        elif source in names:
            whole = self.host.make_catalog().variable_type(source)
            of_lists = whole.kinds == Kind.DICT
            for name, own in whole.columns or ():
                yield name, _format_symbol_type(own.element if of_lists and own.element is not None else own)
        else:
            others = self.host.names.others
            found = self.host.tables.list_columns(rest or source)
            yield from ((name, "") for name in found)
            if not found and others is not None:
                yield from ((name, _format_symbol_type(kind)) for name, kind in others.describe_table(source))


def _format_symbol_type(kind: Type) -> str:
    """A type without bounds of numbers."""
    return format_type(Type(kind.kinds, element=None if kind.element is None else Type(kind.element.kinds)))

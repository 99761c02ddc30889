"""Tables of worlds as virtual tables of SQLite: one module for each set of columns, for all worlds.

A table has the columns `this`, those that it declares, and hidden ones: its parameters, and the position of a row in
the walk, by which results keep the order of the table. Conditions are passed on to the adapter, and tested again by
SQLite.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import apsw

from ss2sql.lowering.sql_names import ROW_NUMBER, choose_sql_names, quote_names
from ss2sql.runtime.sqlite.interning import Interning
from ss2sql.runtime.sqlite.table_cursor import Cursor
from ss2sql.vtables.attached_worlds import AttachedWorldTable
from ss2sql.vtables.reading import Reading
from ss2sql.vtables.schema import world_error

if TYPE_CHECKING:
    from ss2sql.runtime.sqlite.executor import SqliteExecution

SqlValue: TypeAlias = Any
Current: TypeAlias = Callable[[], tuple[Reading, Interning]]

_OPERATORS = {
    apsw.SQLITE_INDEX_CONSTRAINT_EQ: "=",
    apsw.SQLITE_INDEX_CONSTRAINT_IS: "=",
    apsw.SQLITE_INDEX_CONSTRAINT_LT: "<",
    apsw.SQLITE_INDEX_CONSTRAINT_LE: "<=",
    apsw.SQLITE_INDEX_CONSTRAINT_GT: ">",
    apsw.SQLITE_INDEX_CONSTRAINT_GE: ">=",
}
_ROWS = 1000.0  # the estimate for a table


class WorldModules:
    """The modules of a connection: one for each name and set of columns, since SQLite caches the columns.

    `current` gives the execution that runs.
    """

    def __init__(self, connection: apsw.Connection, current: Callable[[], SqliteExecution]) -> None:
        self.connection = connection
        self.current = current
        self.tables: dict[str, AttachedWorldTable] = {}  # by module, those that are attached now
        self._signatures: dict[str, object] = {}

    def choose_name(self, wanted: str, table: AttachedWorldTable) -> str:
        """The name of the module for a table, registered at the first request."""
        name, count = wanted, 1
        while self._signatures.get(name, table.signature) != table.signature or self._is_taken(name):
            count += 1
            name = f"{wanted} {count}"
        if name not in self._signatures:
            self._register_module(name, table)
        self.tables[name] = table
        return name

    def _is_taken(self, name: str) -> bool:
        rows = self.connection.execute("SELECT 1 FROM pragma_table_list WHERE name = ? COLLATE NOCASE", (name,))
        return name not in self._signatures and rows.fetchone() is not None

    def _register_module(self, name: str, table: AttachedWorldTable) -> None:
        module = WorldModule(table, lambda: self._get_current(name))
        self.connection.create_module(
            name, cast(Any, module), use_bestindex_object=True, eponymous=True, eponymous_only=True, read_only=True
        )
        self._signatures[name] = table.signature

    def _get_current(self, name: str) -> tuple[Reading, Interning]:
        """The running query's reading of a table, and its Interning."""
        table = self.tables.get(name)
        if table is None:
            raise world_error(f"the table '{name}' is not attached any more")
        execution = self.current()
        readings = execution.readings
        return readings.get_reading(table.table, readings.places.get(table)), execution.interning

    def forget_tables(self, tables: Iterable[AttachedWorldTable]) -> None:
        """Releases tables that are no longer attached."""
        for table in tables:
            if self.tables.get(table.module) is table:
                del self.tables[table.module]


class WorldModule:
    """The module for tables of one schema. `current` gives the reading of the query that runs, and its Interning.

    `columns` are those of the table with the comparisons that each can pass on.
    """

    def __init__(self, table: AttachedWorldTable, current: Current) -> None:
        schema = table.schema
        own = schema.walked is None and not schema.parameters
        self.name, self.key, self.signature = table.title, table.key, schema.signature
        self.columns = tuple((c.name, c.operators if own else frozenset[str]()) for c in schema.columns)
        self.names = tuple(choose_sql_names(tuple(schema.kinds)).values())
        self.parameters = tuple(schema.parameters)
        self.required = schema.required  # the first ones, which have no default
        self.current = current

    @property
    def first_parameter(self) -> int:
        """The number of the first hidden column."""
        return len(self.columns) + 1

    def Connect(  # noqa: N802 - the name is SQLite's
        self, connection: apsw.Connection, module: str, database: str, table: str, *arguments: str
    ) -> tuple[str, _Table]:
        shown = quote_names(("this", *self.names))
        hidden = ", ".join(f'"parameter {name}" HIDDEN' for name in self.parameters)
        return f'CREATE TABLE world({shown}{", " + hidden if hidden else ""}, "{ROW_NUMBER}" HIDDEN)', _Table(self)

    Create = Connect


class _Table:
    def __init__(self, module: WorldModule) -> None:
        self.module = module

    def BestIndexObject(self, index: Any) -> bool:  # noqa: N802
        """Passes conditions on; a plan in which a parameter is unknown is rejected."""
        module = self.module
        positions: dict[int, int] = {}
        texts: list[str] = []
        rows = _ROWS
        first = module.first_parameter
        mentioned = set()
        for number in range(index.nConstraint):
            column = index.get_aConstraint_iColumn(number)
            operator = _OPERATORS.get(index.get_aConstraint_op(number))
            usable = index.get_aConstraint_usable(number)
            if first <= column < first + len(module.parameters):
                mentioned.add(column)
                if not usable or operator != "=" or column in positions:
                    return False
                positions[column] = number
            elif usable and 0 < column < first and self._can_pass(index, number, column, operator):
                name = module.columns[column - 1][0]
                texts.append(f"{name} {operator} ?")
                index.set_aConstraintUsage_argvIndex(number, len(texts))
                rows = min(rows, 1.0) if name == module.key else rows / (100 if operator == "=" else 4)
        required = enumerate(module.parameters[: module.required], first)
        missing = [name for column, name in required if column not in mentioned]
        if missing:
            raise apsw.SQLError(f"{module.name}: {module.signature} needs {' and '.join(missing)}")
        for column, number in sorted(positions.items()):
            texts.append(f"{module.parameters[column - first]} := ?")
            index.set_aConstraintUsage_argvIndex(number, len(texts))
            index.set_aConstraintUsage_omit(number, True)  # SQLite ignores this after sixteen other conditions
        if module.parameters:
            rows = 10.0
        index.estimatedCost = max(rows, 1.0)
        index.estimatedRows = max(int(rows), 1)
        index.idxStr = ", ".join(texts) or "all"
        return True

    def _can_pass(self, index: Any, number: int, column: int, operator: str | None) -> bool:
        """Whether the adapter can use a condition. For IN SQLite would filter value by value, and change the order."""
        return operator in self.module.columns[column - 1][1] and not index.get_aConstraintUsage_in(number)

    def Open(self) -> Cursor:  # noqa: N802
        return Cursor(self.module)

    def Disconnect(self) -> None:  # noqa: N802
        return

    Destroy = Disconnect

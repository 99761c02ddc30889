"""Tables of worlds as virtual tables of SQLite: a module for each set of columns, and its cursor.

A table has the columns `this`, those that it declares, and hidden ones: its parameters, and the position of a row in
the walk, by which results keep the order of the table. Conditions are passed on to the adapter, and tested again by
SQLite.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import apsw

from ss2sql.language.kinds import Kind
from ss2sql.lowering.sql_query import ROW_NUMBER, choose_sql_names, quote_names
from ss2sql.runtime.sqlite.interning import Interning
from ss2sql.vtables.reading import NOTHING, Reading
from ss2sql.vtables.schema import world_error

if TYPE_CHECKING:
    from ss2sql.runtime.sqlite.executor import SqliteExecution
    from ss2sql.vtables.attached_worlds import AttachedWorldTable


# --- tables of worlds as virtual tables of SQLite: one module for each set of columns, for all worlds
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
        return readings.get_reading(table.table), execution.interning

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


# --- the cursor of a world's table, by SQLite's protocol: Filter, then Eof, Column and Next for each row
Read: TypeAlias = Callable[[Any], SqlValue]
_PLAIN = Kind.NONE | Kind.INT | Kind.FLOAT | Kind.STR


@lru_cache(maxsize=1000)
def read_cursor_plan(plan: str) -> tuple[tuple[str, str], ...]:
    """The columns and comparisons, or the parameters, of a plan's arguments, in their order."""
    if plan == "all":
        return ()
    parts = (text.split(" ") for text in plan.split(", "))
    return tuple((name, operator) for name, operator, _ in parts)


class Cursor:
    """One walk over elements, by their keys; of a table function over its rows."""

    def __init__(self, module: WorldModule) -> None:
        self.module = module
        self.reading: Reading | None = None
        self.interning: Interning | None = None
        self.parameters: dict[str, SqlValue] = {}
        self.readers: dict[int, Read] = {}  # by the numbers of columns
        self.keys: Sequence[Any] = ()
        self.position = self.count = 0

    def Filter(self, number: int, plan: str, arguments: Sequence[SqlValue]) -> None:  # noqa: N802 - SQLite's names
        if self.reading is None:
            self.reading, self.interning = self.module.current()
        demands = read_cursor_plan(plan)
        if self.module.parameters:
            self.keys = self._read_rows(self.reading, demands, arguments)
        else:
            self.keys = self.reading.find_keys(demands, arguments) if demands else self.reading.list_keys(NOTHING)
        self.position, self.count = 0, len(self.keys)

    def _read_rows(
        self, reading: Reading, demands: Sequence[tuple[str, str]], arguments: Sequence[SqlValue]
    ) -> Sequence[Any]:
        """The rows of a table function, without filters on its columns."""
        assert self.interning is not None
        pairs = zip(demands, arguments, strict=True)
        self.parameters = {name: value for (name, operator), value in pairs if operator == ":="}
        values = [self.interning.decode(self.parameters[n]) for n in self.module.parameters if n in self.parameters]
        return reading.call_function(values)

    def Eof(self) -> bool:  # noqa: N802
        return self.position >= self.count

    def Next(self) -> None:  # noqa: N802
        self.position += 1

    def Column(self, number: int) -> SqlValue:  # noqa: N802
        try:
            read = self.readers[number]
        except KeyError:
            read = self.readers[number] = self.make_reader(number)
        return read(self.keys[self.position])

    def Rowid(self) -> int:  # noqa: N802
        """The identity of the row, the same in every plan: SQLite combines the parts of OR by it."""
        assert self.reading is not None
        keyed = self.reading.schema.keyed is not None
        return self.reading.number_key(self.keys[self.position]) if keyed else self.position

    def Close(self) -> None:  # noqa: N802
        # Frees all that was read at the end of the query, before the collector of cycles runs.
        self.keys, self.reading, self.interning = (), None, None
        self.readers.clear()

    def make_reader(self, number: int) -> Read:
        """The function that reads a column of SQL."""
        module, reading, interning = self.module, self.reading, self.interning
        assert reading is not None
        assert interning is not None
        first = module.first_parameter
        if number < 0:
            return lambda key: self.Rowid()
        if number == 0:
            return _make_this_reader(reading, interning)
        if number < first:
            name = module.columns[number - 1][0]
            read, kind = reading.make_reader(name), reading.schema.kinds[name]
            if kind.is_only(_PLAIN) or kind.kinds == Kind.BOOL:  # which have their own form in SQL
                return read
            if reading.schema.keyed is None:
                return lambda row: interning.encode(read(row))
            return _make_encoder(read, interning.encode, reading.get_handles(name))
        if number < first + len(module.parameters):
            parameter = module.parameters[number - first]
            return lambda key: self.parameters.get(parameter)
        return lambda key: self.position


def _make_this_reader(reading: Reading, interning: Interning) -> Read:
    if reading.schema.keyed is not None:
        return _make_encoder(reading.get_element, interning.encode, reading.get_handles(""))
    names = tuple(reading.schema.kinds)
    return lambda row: interning.encode(dict(zip(names, row, strict=True)))


def _make_encoder(read: Callable[[Any], Any], encode: Callable[[Any], SqlValue], known: dict[Any, SqlValue]) -> Read:
    def encode_key(key: Any) -> SqlValue:
        value = known.get(key)
        if value is None:
            value = known[key] = encode(read(key))
        return value

    return encode_key

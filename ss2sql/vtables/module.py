"""Tables of worlds as virtual tables of SQLite: one module for each set of columns, for all worlds.

A table has the columns `this`, those that it declares, and hidden ones: its parameters, and the place of a row in the
walk, by which results keep the order of the table. What SQLite tells of conditions is passed on to the adapter, and
tested again by SQLite.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import cache, lru_cache
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import apsw

from ss2sql.kinds import Kind, Type
from ss2sql.lowering.sources import sql_names
from ss2sql.runtime.pool import Pool
from ss2sql.vtables.attached import AttachedTable
from ss2sql.vtables.copies import first_place
from ss2sql.vtables.names import PLACE
from ss2sql.vtables.reading import Reading, where_of
from ss2sql.vtables.schema import failure

if TYPE_CHECKING:
    from ss2sql.runtime.database import Execution

SqlValue: TypeAlias = Any
Current: TypeAlias = Callable[[], tuple[Reading, Pool]]

_OPERATORS = {
    apsw.SQLITE_INDEX_CONSTRAINT_EQ: "=",
    apsw.SQLITE_INDEX_CONSTRAINT_IS: "=",
    apsw.SQLITE_INDEX_CONSTRAINT_LT: "<",
    apsw.SQLITE_INDEX_CONSTRAINT_LE: "<=",
    apsw.SQLITE_INDEX_CONSTRAINT_GT: ">",
    apsw.SQLITE_INDEX_CONSTRAINT_GE: ">=",
}
Load: TypeAlias = "Callable[[_Row, Any], SqlValue]"  # reads a column of the element with a key, and notes it in a row
_ROWS = 1000.0  # that a table is taken to have
_PLAIN = Kind.NONE | Kind.INT | Kind.FLOAT | Kind.STR
_END = object()


class WorldModules:
    """The modules of a connection: one for each name and set of columns, for SQLite keeps what it knows of columns.

    `current` gives the execution that runs.
    """

    def __init__(self, connection: apsw.Connection, current: Callable[[], Execution]) -> None:
        self.connection = connection
        self.current = current
        self.tables: dict[str, AttachedTable] = {}  # by module, those that are attached now
        self._signatures: dict[str, object] = {}

    def name_for(self, wanted: str, table: AttachedTable) -> str:
        """The name of the module that a table is read by, which is registered if there is none yet."""
        name, count = wanted, 1
        while self._signatures.get(name, table.signature) != table.signature or self._is_taken(name):
            count += 1
            name = f"{wanted} {count}"
        if name not in self._signatures:
            self._register(name, table)
        self.tables[name] = table
        return name

    def _is_taken(self, name: str) -> bool:
        rows = self.connection.execute("SELECT 1 FROM pragma_table_list WHERE name = ? COLLATE NOCASE", (name,))
        return name not in self._signatures and rows.fetchone() is not None

    def _register(self, name: str, table: AttachedTable) -> None:
        schema = table.schema
        names = sql_names(tuple(schema.kinds))
        own = schema.walked is None and not schema.parameters
        columns = [(c.name, c.operators if own else frozenset[str]()) for c in schema.columns]
        module = WorldModule(
            table.title,
            columns,
            tuple(names.values()),
            table.key,
            schema.parameters,
            schema.required,
            schema.signature,
            lambda: self._current(name),
        )
        self.connection.create_module(
            name, cast(Any, module), use_bestindex_object=True, eponymous=True, eponymous_only=True, read_only=True
        )
        self._signatures[name] = table.signature

    def _current(self, name: str) -> tuple[Reading, Pool]:
        """What the query that runs reads of a table, and its pool."""
        table = self.tables.get(name)
        if table is None:
            raise failure(f"the table '{name}' is not attached any more")
        execution = self.current()
        return execution.readings.of(table.table, first_place(table, (execution.query,))), execution.pool

    def forget(self, tables: Iterable[AttachedTable]) -> None:
        """Lets go of tables that are attached no longer."""
        for table in tables:
            if self.tables.get(table.module) is table:
                del self.tables[table.module]


class WorldModule:
    """The module for one table. `current` gives the reading of the query that runs, and its pool.

    `names` are the names of the columns in SQL, `columns` those of the table with the comparisons that each can pass
    on; `parameters` are those of a table function, the first `required` of which have no default.
    """

    def __init__(
        self,
        name: str,
        columns: Sequence[tuple[str, frozenset[str]]],
        names: Sequence[str],
        key: str,
        parameters: Sequence[str],
        required: int,
        signature: str,
        current: Current,
    ) -> None:
        self.name = name
        self.columns = tuple(columns)
        self.names = tuple(names)
        self.key = key
        self.parameters = tuple(parameters)
        self.required = required
        self.signature = signature
        self.current = current

    @property
    def first_parameter(self) -> int:
        """The number of the first hidden column."""
        return len(self.columns) + 1

    def Connect(  # noqa: N802 - the name is SQLite's
        self, connection: apsw.Connection, module: str, database: str, table: str, *arguments: str
    ) -> tuple[str, _Table]:
        shown = ", ".join('"' + name.replace('"', '""') + '"' for name in ("this", *self.names))
        hidden = ", ".join(f'"parameter {name}" HIDDEN' for name in self.parameters)
        return f'CREATE TABLE world({shown}{", " + hidden if hidden else ""}, "{PLACE}" HIDDEN)', _Table(self)

    Create = Connect


class _Table:
    def __init__(self, module: WorldModule) -> None:
        self.module = module

    def BestIndexObject(self, index: Any) -> bool:  # noqa: N802
        """Passes conditions on; a parameter that is not known in this plan makes the plan impossible."""
        module = self.module
        given: dict[int, int] = {}
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
                if not usable or operator != "=" or column in given:
                    return False
                given[column] = number
            elif usable and 0 < column < first and self._passes(index, number, column, operator):
                name = module.columns[column - 1][0]
                texts.append(f"{name} {operator} ?")
                index.set_aConstraintUsage_argvIndex(number, len(texts))
                rows = min(rows, 1.0) if name == module.key else rows / (100 if operator == "=" else 4)
        required = enumerate(module.parameters[: module.required], first)
        missing = [name for column, name in required if column not in mentioned]
        if missing:
            raise apsw.SQLError(f"{module.name}: {module.signature} needs {' and '.join(missing)}")
        for column, number in sorted(given.items()):
            texts.append(f"{module.parameters[column - first]} := ?")
            index.set_aConstraintUsage_argvIndex(number, len(texts))
            index.set_aConstraintUsage_omit(number, True)  # SQLite ignores this behind sixteen other conditions
        if module.parameters:
            rows = 10.0
        index.estimatedCost = max(rows, 1.0)
        index.estimatedRows = max(int(rows), 1)
        index.idxStr = ", ".join(texts) or "all"
        return True

    def _passes(self, index: Any, number: int, column: int, operator: str | None) -> bool:
        """Whether the adapter can use a condition. Of IN SQLite would ask value by value, and mix up the order."""
        return operator in self.module.columns[column - 1][1] and not index.get_aConstraintUsage_in(number)

    def Open(self) -> _Cursor:  # noqa: N802
        return _Cursor(self.module)

    def Disconnect(self) -> None:  # noqa: N802
        return

    Destroy = Disconnect


@lru_cache(maxsize=1000)
def demands_of(plan: str) -> tuple[tuple[str, str], ...]:
    """The columns and comparisons, or the parameters, that the arguments of a plan stand for, in their order."""
    if plan == "all":
        return ()
    parts = (text.split(" ") for text in plan.split(", "))
    return tuple((name, operator) for name, operator, _ in parts)


class _Row(dict[int, SqlValue]):
    """The columns of the current row that have been read so far, by number.

    SQLite asks for them by the dict's own method. Only the first column of a group comes to Python code, which takes
    the others along: a scan of eight columns in three groups takes half the time of a call for each.
    """

    __slots__ = ("key", "load_of", "loads")

    def __init__(self, load_of: Callable[[int], Load]) -> None:
        super().__init__()
        self.load_of = load_of
        self.loads: dict[int, Load] = {}
        self.key: Any = _END

    def __missing__(self, number: int) -> SqlValue:
        load = self.loads.get(number)
        if load is None:
            load = self.loads[number] = self.load_of(number)
        return load(self, self.key)


@cache
def _loader_of_group(numbers: tuple[int, ...], place: int) -> Callable[[Any, Any], Load]:
    """Makes what notes the columns with these numbers, and gives the one at a place.

    As assignments one by one they take 0.2 us for three columns, in a loop 0.8.
    """
    lines = [
        "def loader(known, fetch):",
        " def load(row, key):",
        "  values = known(key)",
        "  if values is None: values = fetch(key)",
        f"  {', '.join(f'row[{number}]' for number in numbers)}, = values",
        f"  return values[{place}]",
        " return load",
    ]
    made: dict[str, Any] = {}
    exec("\n".join(lines), made)  # a text of this file, with nothing but numbers in it from elsewhere
    return made["loader"]  # type: ignore[no-any-return]


def _loader(read: Callable[[Any], SqlValue], number: int) -> Load:
    """What reads a column that comes alone."""

    def load(row: _Row, key: Any) -> SqlValue:
        value = row[number] = read(key)
        return value

    return load


class _Cursor:
    """Walks a table. SQLite calls Filter, then Eof, Column and Next per row; each is a Python call."""

    def __init__(self, module: WorldModule) -> None:
        self.module = module
        self.reading: Reading | None = None
        self.pool: Pool | None = None
        self.given: dict[str, SqlValue] = {}
        self.keys: Iterator[Any] = iter(())
        self.place = 0
        self.row = _Row(self.load_of)
        self.Column = self.row.__getitem__

    def Filter(self, number: int, plan: str, arguments: Sequence[SqlValue]) -> None:  # noqa: N802
        if self.reading is None:
            self.reading, self.pool = self.module.current()
        demands = demands_of(plan)
        if self.module.parameters:
            self._call(demands, arguments)
        else:
            asked = ((name, operator, value) for (name, operator), value in zip(demands, arguments, strict=True))
            self.keys = iter(self.reading.keys(where_of(asked, self.reading.schema)))
        self.place = 0
        self.row.key = next(self.keys, _END)
        self.row.clear()

    def _call(self, demands: Sequence[tuple[str, str]], arguments: Sequence[SqlValue]) -> None:
        """Reads the rows of a table function, and leaves alone what is demanded of its columns."""
        assert self.reading is not None
        assert self.pool is not None
        pairs = zip(demands, arguments, strict=True)
        self.given = {name: value for (name, operator), value in pairs if operator == ":="}
        values = [self.pool.decode(self.given[name]) for name in self.module.parameters if name in self.given]
        self.keys = iter(self.reading.rows(values))

    def Eof(self) -> bool:  # noqa: N802
        return self.row.key is _END

    def Next(self) -> None:  # noqa: N802
        self.place += 1
        row = self.row
        row.clear()
        row.key = next(self.keys, _END)

    def Rowid(self) -> int:  # noqa: N802
        """The identity of the row, the same in every plan: SQLite puts OR together by it."""
        assert self.reading is not None
        return self.place if self.reading.schema.keyed is None else self.reading.number(self.row.key)

    def Close(self) -> None:  # noqa: N802
        self.keys = iter(())
        self.row.clear()

    def load_of(self, number: int) -> Load:
        """How a column is read: with its group, or alone."""
        module, reading = self.module, self.reading
        assert reading is not None
        if 0 < number < module.first_parameter:
            found = reading.group_reader(module.columns[number - 1][0])
            kinds = reading.schema.kinds
            if found is not None and all(_travels(kinds[name]) for name in found.names):
                all_names = [name for name, _ in module.columns]
                numbers = tuple(all_names.index(name) + 1 for name in found.names)
                return _loader_of_group(numbers, numbers.index(number))(found.known, found.fetch)
        return _loader(self.read(number), number)

    def read(self, number: int) -> Callable[[Any], SqlValue]:
        """The function that reads a column of SQL."""
        module, reading, pool = self.module, self.reading, self.pool
        assert reading is not None
        assert pool is not None
        first = module.first_parameter
        if number < 0:
            return lambda key: self.Rowid()
        if number == 0:
            return self._this(reading, pool)
        if number < first:
            name = module.columns[number - 1][0]
            read, kind = reading.reader(name), reading.schema.kinds[name]
            return read if _travels(kind) else _encoded(read, pool.encode)
        if number < first + len(module.parameters):
            parameter = module.parameters[number - first]
            return lambda key: self.given.get(parameter)
        return lambda key: self.place

    def _this(self, reading: Reading, pool: Pool) -> Callable[[Any], SqlValue]:
        if reading.schema.keyed is not None:
            return _encoded(reading.element, pool.encode)
        names = tuple(reading.schema.kinds)
        return lambda row: pool.encode(dict(zip(names, row, strict=True)))


def _travels(kind: Type) -> bool:
    """Whether values travel through SQL as they are; a bool that is nothing else is 0 or 1."""
    return kind.only(_PLAIN) or kind.kinds == Kind.BOOL


def _encoded(read: Callable[[Any], Any], encode: Callable[[Any], SqlValue]) -> Callable[[Any], SqlValue]:
    return lambda key: encode(read(key))

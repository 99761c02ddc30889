"""The elements of a value as a virtual table.

`elements(value)` has one row per element, in order; its column `this` is the element. For lists whose
elements have columns there is one module per set of columns, with these columns after `this`. The argument
is a hidden column, so it may come from a table to the left: that is what makes a source lateral.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeAlias, cast

import apsw

from ss2sql.lowering.names import sql_names
from ss2sql.vtables.names import quoted

SqlValue: TypeAlias = Any


class Walked(dict[int, Sequence[SqlValue]]):
    """The elements of a value as columns of SQL values by number: `this` is 0, the module's columns follow.

    After them stands the value itself, and -1 are the numbers of the rows. `make` gives a column when it is first
    read, so one that nobody reads costs nothing.
    """

    __slots__ = ("length", "make", "value", "width")

    def __init__(self, value: SqlValue, length: int, width: int, make: Callable[[int], Sequence[SqlValue]]) -> None:
        super().__init__()
        self.value = value
        self.length = length
        self.width = width
        self.make = make

    def __missing__(self, number: int) -> Sequence[SqlValue]:
        if number < 0:
            column: Sequence[SqlValue] = range(self.length)
        else:
            column = self.make(number) if number < self.width else [self.value] * self.length
        self[number] = column
        return column


# Walks a value for a module with these columns, and for the cursor that asks.
Walk: TypeAlias = Callable[[SqlValue, tuple[str, ...], Any], Walked]
NOTHING = Walked(None, 0, 0, lambda number: ())

# Elements, as SQLite is told when it plans, without the value. Below 25 it makes no index for a join that is sorted.
LENGTH = 100
ARGUMENT = "source value"  # the hidden column; the blank keeps it apart from the names of users


class Elements:
    """The module for one set of columns. `names` are their names in SQL, `columns` those in the elements."""

    def __init__(self, walk: Walk, columns: tuple[str, ...], names: tuple[str, ...]) -> None:
        self.walk = walk
        self.columns = columns
        self.names = names

    def Connect(  # noqa: N802 - the name is SQLite's
        self, connection: apsw.Connection, module: str, database: str, table: str, *arguments: str
    ) -> tuple[str, _Table]:
        shown = quoted(("this", *self.names))
        return f'CREATE TABLE elements({shown}, "{ARGUMENT}" HIDDEN)', _Table(self)

    Create = Connect


class ListModules:
    """The modules of a connection, one for each set of columns; `walk` walks a value for them."""

    def __init__(self, connection: apsw.Connection, walk: Walk) -> None:
        self.connection = connection
        self.walk = walk
        self._made: set[str] = set()
        self._first: set[str] = set()  # those that hide a table of the database

    def make(self, wanted: Mapping[str, tuple[str, ...]]) -> None:
        """Registers the modules with these names, for lists whose elements have these columns, where there are none."""
        for name, columns in wanted.items():
            if name not in self._made:
                module = cast(Any, Elements(self.walk, columns, tuple(sql_names(columns).values())))
                self.connection.create_module(
                    name, module, use_bestindex_object=True, eponymous=True, eponymous_only=False, read_only=True
                )
                self._made.add(name)

    def come_first(self, wanted: Iterable[str]) -> bool:
        """Has the modules hide tables of the same names; whether there are any that they have not hidden before.

        SQLite looks for a name among temporary tables before it looks elsewhere. Scripts still find the table that is
        hidden: its schema stands before its name.
        """
        found = [name for name in wanted if name not in self._first and self._is_table(name)]
        for name in found:
            self.connection.execute(f"CREATE VIRTUAL TABLE temp.{quoted((name,))} USING {quoted((name,))}")
            self._first.add(name)
        return bool(found)

    def _is_table(self, name: str) -> bool:
        text = "SELECT 1 FROM pragma_table_list WHERE name = ? COLLATE NOCASE AND type IN ('table', 'view')"
        return self.connection.execute(text, (name,)).fetchone() is not None


class _Table:
    def __init__(self, module: Elements) -> None:
        self.module = module

    def BestIndexObject(self, index: Any) -> bool:  # noqa: N802
        """Demands the argument; everything else SQLite checks by itself."""
        argument = len(self.module.names) + 1
        for number in range(index.nConstraint):
            if index.get_aConstraint_iColumn(number) != argument:
                continue
            if index.get_aConstraint_op(number) != apsw.SQLITE_INDEX_CONSTRAINT_EQ:
                continue
            if not index.get_aConstraint_usable(number):
                return False  # the table that the argument comes from stands further to the right in this plan
            index.set_aConstraintUsage_argvIndex(number, 1)
            index.set_aConstraintUsage_omit(number, True)  # SQLite ignores this behind sixteen other conditions
            index.estimatedCost = LENGTH
            index.estimatedRows = LENGTH
            index.idxStr = "each element"
            return True
        raise apsw.SQLError("elements(value) needs its value")

    def Open(self) -> _Cursor:  # noqa: N802
        return _Cursor(self.module)

    def Disconnect(self) -> None:  # noqa: N802
        return

    Destroy = Disconnect


class _Cursor:
    """Walks the elements. SQLite calls Filter, then Eof, Column and Next per row; each is a Python call."""

    def __init__(self, module: Elements) -> None:
        self.module = module
        self.columns = NOTHING
        self.position = 0
        self.length = 0

    def Filter(self, number: int, name: str, arguments: Sequence[SqlValue]) -> None:  # noqa: N802
        self.columns = self.module.walk(arguments[0], self.module.columns, self)
        self.length = self.columns.length
        self.position = 0

    def Eof(self) -> bool:  # noqa: N802
        return self.position >= self.length

    def Column(self, number: int) -> SqlValue:  # noqa: N802
        return self.columns[number][self.position]

    def Rowid(self) -> int:  # noqa: N802
        return self.position

    def Next(self) -> None:  # noqa: N802
        self.position += 1

    def Close(self) -> None:  # noqa: N802
        self.columns = NOTHING

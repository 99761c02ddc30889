"""The elements of a value as a virtual table.

`elements(value)` has one row per element, in order; its column `this` is the element. For lists whose
elements have columns there is one module per set of columns, with these columns after `this`, and then those of calls
with each element. `elements_from_f(a, b)` walks what the function f gives for a and b: its list is never made one SQL
value, which takes 0.4 of the time of `elements(f(a, b))`.
The arguments are hidden columns, so they may come from a table to the left: the source is lateral.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, TypeAlias, cast

import apsw

from ss2sql.fast_dataclasses import dataclass
from ss2sql.lowering.sql_names import choose_sql_names, quote_names
from ss2sql.lowering.sql_query import ListTable

SqlValue: TypeAlias = Any


class ElementColumns:
    """The elements of a value as `columns` of SQL values: `this` is the first, those of the module follow.

    After them follow the value itself and the numbers of the rows. None is a column that has not been read yet:
    `read_column` gives it, and `make` one of the first `width`.
    """

    __slots__ = ("columns", "length", "make", "value", "width")

    def __init__(self, value: SqlValue, length: int, width: int, make: Callable[[int], Sequence[SqlValue]]) -> None:
        self.columns: list[Sequence[SqlValue] | None] = [None] * (width + 2)
        self.value = value
        self.length = length
        self.width = width
        self.make = make

    def read_column(self, number: int) -> Sequence[SqlValue]:
        """The column with this number, -1 for the numbers of the rows."""
        column = self.columns[number]
        if column is None:
            if number < 0:
                column = range(self.length)
            else:
                column = self.make(number) if number < self.width else [self.value] * self.length
            self.columns[number] = column
        return column


def build_callback_columns(elements: Sequence[SqlValue], arguments: tuple[SqlValue, ...]) -> ElementColumns:
    """The same for a module that calls a function: `elements` of what it gives for the arguments, which follow."""
    length = len(elements)
    made = ElementColumns(None, length, 1 + len(arguments), lambda number: [arguments[number - 1]] * length)
    made.columns[0] = elements
    return made


# Walks a value for the module of this name, given its arguments and the cursor.
Walk: TypeAlias = Callable[[str, tuple[SqlValue, ...], Any], ElementColumns]
Found: TypeAlias = Sequence[Sequence[SqlValue]]  # columns; the requested ones are filled
# Gives the number of rows and the columns of a table with calls, for its arguments.
ColumnsFor: TypeAlias = Callable[[tuple[SqlValue, ...]], tuple[int, Found]]


@dataclass(frozen=True, slots=True)
class CallRequest:
    """A request to a table with calls: these columns, without rows whose column `without` is the last argument."""

    columns: tuple[int, ...]
    without: int | None


# Makes it for the module of this name, for the duration of the cursor's statement.
Calls: TypeAlias = Callable[[str, Any, CallRequest], ColumnsFor]
NOTHING = ElementColumns(None, 0, 0, lambda number: ())

# The estimate of elements for SQLite's planner. Below 25 it makes no index for a join that is sorted.
LENGTH = 100
MANY = 63  # all columns from this one on, in SQLite's mask of used columns
ARGUMENT = "source value"  # the hidden columns; the blank distinguishes them from users' names
ARGUMENTS = 8  # of a module; one with more is made anew


class ElementModule:
    """The module of this name for one set of columns; `names` are the columns' own in SQL."""

    def __init__(self, walk: Walk, calls: Calls, name: str, table: ListTable) -> None:
        self.walk = walk
        self.calls = calls
        self.cursor = _CallingCursor if table.calls else _Cursor
        self.name = name
        self.names = (*choose_sql_names(table.columns).values(), *(call.name for call in table.calls))
        self.first_call = len(table.columns) + 1
        self.requests: list[CallRequest] = []  # of plans, by their numbers
        self.arguments = max(table.arguments, ARGUMENTS)

    def Connect(  # noqa: N802 - the name is SQLite's
        self, connection: apsw.Connection, module: str, database: str, table: str, *arguments: str
    ) -> tuple[str, _Table]:
        shown = quote_names(("this", *self.names))
        hidden = "".join(f', "{ARGUMENT} {number}" HIDDEN' for number in range(self.arguments))
        return f"CREATE TABLE elements({shown}{hidden})", _Table(self)

    Create = Connect


class ListModules:
    """The modules of a connection, one for each set of columns; `walk` walks a value for them."""

    def __init__(self, connection: apsw.Connection, walk: Walk, calls: Calls) -> None:
        self.connection = connection
        self.walk = walk
        self.calls = calls
        self._made: dict[str, int] = {}  # the number of arguments that each can take
        self._first: set[str] = set()  # those that hide a table of the database

    def register_modules(self, wanted: Mapping[str, ListTable]) -> None:
        """Registers the modules with these names where there are none.

        Tables of one name have the same columns; they may call a function with other arguments.
        """
        for name, table in wanted.items():
            if self._made.get(name, -1) < table.arguments:
                module = ElementModule(self.walk, self.calls, name, table)
                self.connection.create_module(
                    name,
                    cast(Any, module),
                    use_bestindex_object=True,
                    eponymous=True,
                    eponymous_only=False,
                    read_only=True,
                )
                self._made[name] = module.arguments

    def do_shadow_tables(self, wanted: Iterable[str]) -> bool:
        """Makes the modules shadow tables of the same names; whether there are any that were not shadowed before.

        SQLite looks a name up among temporary tables first. Scripts still find the shadowed table, by its schema.
        """
        found = [name for name in wanted if name not in self._first and self._is_table(name)]
        for name in found:
            self.connection.execute(f"CREATE VIRTUAL TABLE temp.{quote_names((name,))} USING {quote_names((name,))}")
            self._first.add(name)
        return bool(found)

    def _is_table(self, name: str) -> bool:
        text = "SELECT 1 FROM pragma_table_list WHERE name = ? COLLATE NOCASE AND type IN ('table', 'view')"
        return self.connection.execute(text, (name,)).fetchone() is not None


class _Table:
    def __init__(self, module: ElementModule) -> None:
        self.module = module

    def BestIndexObject(self, index: Any) -> bool:  # noqa: N802
        """Requires the arguments, and applies a filter by the value of one call: `move IS NOT ?`.

        SQLite tests everything else.
        """
        first = len(self.module.names) + 1
        found, excluding, without = 0, None, None
        for number in range(index.nConstraint):
            if without is None and self._is_exclusion(index, number):
                excluding, without = number, index.get_aConstraint_iColumn(number)
                continue
            argument = index.get_aConstraint_iColumn(number) - first
            if argument < 0 or index.get_aConstraint_op(number) != apsw.SQLITE_INDEX_CONSTRAINT_EQ:
                continue
            if not index.get_aConstraint_usable(number):
                return False  # the argument's table is further to the right in this plan
            index.set_aConstraintUsage_argvIndex(number, argument + 1)
            index.set_aConstraintUsage_omit(number, True)  # SQLite ignores this after sixteen other conditions
            found += 1
        if not found:
            raise apsw.SQLError(f"{self.module.name} needs its arguments")
        if excluding is not None:
            index.set_aConstraintUsage_argvIndex(excluding, found + 1)
            index.set_aConstraintUsage_omit(excluding, True)
        index.estimatedCost = LENGTH
        index.estimatedRows = LENGTH
        index.idxStr = "each element"
        if without is not None:
            index.idxStr += f", {self.module.names[without - 1]} IS NOT ?"
        used = range(first) if MANY in index.colUsed else sorted(index.colUsed.intersection(range(first)))
        request = CallRequest(tuple(used), without)
        if request not in self.module.requests:
            self.module.requests.append(request)
        index.idxNum = self.module.requests.index(request)
        return True

    def _is_exclusion(self, index: Any, number: int) -> bool:
        """Whether a condition excludes a value of a call."""
        calls = range(self.module.first_call, len(self.module.names) + 1)
        return (
            index.get_aConstraint_op(number) == apsw.SQLITE_INDEX_CONSTRAINT_ISNOT
            and index.get_aConstraint_iColumn(number) in calls
            and bool(index.get_aConstraint_usable(number))
        )

    def Open(self) -> _Cursor:  # noqa: N802
        return self.module.cursor(self.module)

    def Disconnect(self) -> None:  # noqa: N802
        return

    Destroy = Disconnect


class _Cursor:
    """Walks the elements. SQLite calls Filter, then Eof, Column and Next per row; each is a Python call."""

    def __init__(self, module: ElementModule) -> None:
        self.module = module
        self.walked: Any = NOTHING
        self.columns: Any = NOTHING.columns
        self.position = 0
        self.length = 0

    def Filter(self, number: int, name: str, arguments: tuple[SqlValue, ...]) -> None:  # noqa: N802
        self.walked = self.module.walk(self.module.name, arguments, self)
        self.columns, self.length = self.walked.columns, self.walked.length
        self.position = 0

    def Eof(self) -> bool:  # noqa: N802
        return self.position >= self.length

    def Column(self, number: int) -> SqlValue:  # noqa: N802
        column = self.columns[number]  # 0.1 us for a value, a fifth of it for each look-up
        if column is None:
            column = self.walked.read_column(number)
        return column[self.position]

    def Rowid(self) -> int:  # noqa: N802
        return self.position

    def Next(self) -> None:  # noqa: N802
        self.position += 1

    def Close(self) -> None:  # noqa: N802
        self.walked, self.columns = NOTHING, NOTHING.columns


class _CallingCursor(_Cursor):
    """Walks the elements and the values of calls, which are computed for all elements together."""

    def __init__(self, module: ElementModule) -> None:
        super().__init__(module)
        self.columns_for: ColumnsFor | None = None
        self.number = 0  # of the plan

    def Filter(self, number: int, name: str, arguments: tuple[SqlValue, ...]) -> None:  # noqa: N802
        if self.columns_for is None or number != self.number:
            self.columns_for, self.number = (
                self.module.calls(self.module.name, self, self.module.requests[number]),
                number,
            )
        self.length, self.columns = self.columns_for(arguments)
        self.position = 0

    def Close(self) -> None:  # noqa: N802
        super().Close()
        self.columns_for = None

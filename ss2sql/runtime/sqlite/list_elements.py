"""The elements of a value as a virtual table, with calls of functions with each element as its columns.

`elements(value)` has one row per element, in order; its column `this` is the element. For lists whose
elements have columns there is one module per set of columns, with these columns after `this`, and then those of calls
with each element. `elements_from_f(a, b)` walks what the function f gives for a and b: its list is never made one SQL
value, which takes 0.4 of the time of `elements(f(a, b))`.

Rows whose column is within bounds, `o.t <= s.t`, are looked up in the order of the elements by that column. ORDER BY
the column takes them from it, too, so that LIMIT ends the walk: the last of 8,000 rows before each of 8,000 times takes
0.2 s, not 33 s. Where columns must equal something as well, `o.robot = s.robot`, it is the order of the rows that do.

The arguments are hidden columns, so they may come from a table to the left: the source is lateral.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import compress, repeat, starmap
from marshal import dumps, loads
from types import NoneType
from typing import TYPE_CHECKING, Any, TypeAlias, cast

import apsw

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.values import SCALARS
from ss2sql.lowering.sql_query import ElementCall, ListTable, choose_sql_names, quote_names
from ss2sql.runtime.run.key_order import MIN_LENGTH, order_keys
from ss2sql.runtime.run.run_state import keep_bounded

if TYPE_CHECKING:
    from ss2sql.runtime.sqlite.executor import SqliteExecution
    from ss2sql.runtime.sqlite.search_functions import SearchState
    from ss2sql.runtime.sqlite.sql_functions import FunctionCallback


# --- the elements of a value as a virtual table
SqlValue: TypeAlias = Any


class ElementColumns:
    """The elements of a value as `columns` of SQL values: `this` is the first, those of the module follow.

    After them follow the value itself and the numbers of the rows. None is a column that has not been read yet:
    `read_column` gives it, and `make` one of the first `width`.
    """

    __slots__ = ("columns", "groups", "length", "make", "orders", "value", "width")

    def __init__(self, value: SqlValue, length: int, width: int, make: Callable[[int], Sequence[SqlValue]]) -> None:
        self.columns: list[Sequence[SqlValue] | None] = [None] * (width + 2)
        self.value = value
        self.length = length
        self.width = width
        self.make = make
        self.orders: dict[tuple[int, bool], OrderedElements | None] = {}
        self.groups: dict[tuple[int, ...], dict[tuple[SqlValue, ...], ChosenElements]] = {}

    def find_group(self, columns: tuple[int, ...], values: tuple[SqlValue, ...]) -> ElementColumns:
        """The elements whose columns with these numbers have these values."""
        groups = self.groups.get(columns)
        if groups is None:
            places = defaultdict[tuple[SqlValue, ...], list[int]](list)
            for place, key in enumerate(zip(*map(self.read_column, columns), strict=True)):
                places[key].append(place)
            groups = self.groups[columns] = {key: ChosenElements(self, found) for key, found in places.items()}
        return groups.get(values) or ChosenElements(self, ())

    def sort_by(self, column: int, descending: bool) -> OrderedElements:
        """The elements in the order of a column."""
        made = self.orders.get((column, descending))
        if made is None:
            made = self.orders[column, descending] = OrderedElements(self, column, descending)
        return made

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


class ChosenElements(ElementColumns):
    """Those of the elements that stand at `places`, in their order."""

    __slots__ = ("every", "places")

    def __init__(self, every: ElementColumns, places: Sequence[int]) -> None:
        super().__init__(every.value, len(places), every.width, every.make)
        self.every = every
        self.places = places

    def read_column(self, number: int) -> Sequence[SqlValue]:
        column = self.columns[number]
        if column is None:
            read = self.every.read_column(number)
            column = self.columns[number] = [read[place] for place in self.places]
        return column


class OrderedElements(ChosenElements):
    """The elements in SQLite's order of a column; equal ones keep theirs.

    `order` is None where the column has neither numbers alone nor texts alone: nothing is looked up then. Else what is
    None, which no comparison meets, is left out.
    """

    __slots__ = ("order",)

    def __init__(self, every: ElementColumns, column: int, descending: bool) -> None:
        values = every.read_column(column)
        self.order = order_keys(values, descending)
        if self.order is None:
            ranks = list(map(_rank_sql_value, values))
            places = sorted(range(len(values)), key=ranks.__getitem__, reverse=descending)
        else:
            places = self.order.places
        super().__init__(every, places)


_COMPARISONS = {
    apsw.SQLITE_INDEX_CONSTRAINT_LT: "lt",
    apsw.SQLITE_INDEX_CONSTRAINT_LE: "le",
    apsw.SQLITE_INDEX_CONSTRAINT_GT: "gt",
    apsw.SQLITE_INDEX_CONSTRAINT_GE: "ge",
}
_EQUALITIES = frozenset({apsw.SQLITE_INDEX_CONSTRAINT_EQ, apsw.SQLITE_INDEX_CONSTRAINT_IS})


def _rank_sql_value(value: SqlValue) -> tuple[Any, ...]:
    """What puts values in SQLite's order: NULL, numbers, texts, blobs."""
    if value is None:
        return (0,)
    kind = type(value)
    if kind is str:
        return 2, value.encode("utf-8", "surrogatepass")
    return (3, value) if kind is bytes else (1, value)


def build_callback_columns(elements: Sequence[SqlValue], arguments: tuple[SqlValue, ...]) -> ElementColumns:
    """The same for a module that calls a function: `elements` of what it gives for the arguments, which follow."""
    length = len(elements)
    made = ElementColumns(None, length, 1 + len(arguments), lambda number: [arguments[number - 1]] * length)
    made.columns[0] = elements
    return made


# Walks a value for the module of this name, given its arguments.
Walk: TypeAlias = Callable[[str, tuple[SqlValue, ...]], ElementColumns]
Found: TypeAlias = Sequence[Sequence[SqlValue]]  # columns; the requested ones are filled
# Gives the number of rows and the columns of a table with calls, for its arguments.
ColumnsFor: TypeAlias = Callable[[tuple[SqlValue, ...]], tuple[int, Found]]


@dataclass(frozen=True, slots=True)
class ColumnRange:
    """Comparisons of a column with arguments; `descending` is None where the rows keep their order.

    The last arguments are what other columns must `equal`.
    """

    column: int
    operators: tuple[str, ...]
    descending: bool | None
    equal: tuple[int, ...]

    def choose_rows(self, walked: ElementColumns, arguments: tuple[SqlValue, ...]) -> tuple[ElementColumns, int, int]:
        """Elements of which those from one number to another may meet the comparisons."""
        end = len(arguments) - len(self.equal)
        values = arguments[end - len(self.operators) : end]
        if self.equal:
            walked = walked.find_group(self.equal, arguments[end:])
        key = self.column, bool(self.descending)
        if self.descending is None and (key not in walked.orders or walked.length < MIN_LENGTH):
            walked.orders[key] = None  # to walk them once takes no longer than to sort them
            return walked, 0, walked.length
        ordered = walked.sort_by(*key)
        order = ordered.order
        start, end = (0, ordered.length) if order is None else order.find_bounds(self.operators, values)
        if self.descending is not None:
            return ordered, start, end
        if order is None or order.ascends:
            return walked, start, end
        places = sorted(order.places[start:end])
        return ChosenElements(walked, places), 0, len(places)


@dataclass(frozen=True, slots=True)
class TableRequest:
    """A request to a table: these columns, without rows whose column `without` is the last argument, or of a range."""

    columns: tuple[int, ...]
    without: int | None
    range: ColumnRange | None


# Makes it for the module of this name, for the duration of the cursor's statement.
Calls: TypeAlias = Callable[[str, TableRequest], ColumnsFor]
NOTHING = ElementColumns(None, 0, 0, lambda number: ())

# The estimate of elements for SQLite's planner. Below 25 it makes no index for a join that is sorted.
LENGTH = 100
RANGE_COST = 60  # more than half: for `a OR b` SQLite would else walk two ranges, and put the rows out of order
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
        self.walks_list = not table.calls and table.function is None
        self.requests: list[TableRequest] = []  # of plans, by their numbers
        self.arguments = max(table.arguments, ARGUMENTS)

    def Connect(  # noqa: N802 - the name is SQLite's
        self, connection: apsw.Connection, module: str, database: str, table: str, *arguments: str
    ) -> tuple[str, _Table]:
        shown = quote_names(("this", *self.names))
        hidden = "".join(f', "{ARGUMENT} {number}" HIDDEN' for number in range(self.arguments))
        return f"CREATE TABLE elements({shown}{hidden})", _Table(self)


class ListModules:
    """The modules of a connection, one for each set of columns; `walk` walks a value for them."""

    def __init__(self, connection: apsw.Connection, walk: Walk, calls: Calls) -> None:
        self.connection = connection
        self.walk = walk
        self.calls = calls
        self._made: dict[str, int] = {}  # the number of arguments that each can take

    def register_modules(self, wanted: Mapping[str, ListTable]) -> None:
        """Registers the modules with these names where there are none.

        Tables of one name have the same columns; they may call a function with other arguments. A table of the database
        with the name of a module hides it, and SQLite refuses the statement.
        """
        for name, table in wanted.items():
            if self._made.get(name, -1) < table.arguments:
                module = ElementModule(self.walk, self.calls, name, table)
                self.connection.create_module(
                    name,
                    cast(Any, module),
                    use_bestindex_object=True,
                    eponymous=True,
                    eponymous_only=True,
                    read_only=True,
                )
                self._made[name] = module.arguments


class _Table:
    def __init__(self, module: ElementModule) -> None:
        self.module = module

    def BestIndexObject(self, index: Any) -> bool:  # noqa: N802
        """Requires the arguments, and applies a filter by the value of one call: `move IS NOT ?`.

        Of a list it looks up a range of a column. SQLite tests everything else, and that again.
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
        asked = self._request_range(index, found) if self.module.walks_list else None
        index.estimatedCost = LENGTH if asked is None else RANGE_COST
        index.estimatedRows = LENGTH
        index.idxStr = "each element" if asked is None else f"elements in order of {self._name_column(asked.column)}"
        if without is not None:
            index.idxStr += f", {self.module.names[without - 1]} IS NOT ?"
        used = range(first) if MANY in index.colUsed else sorted(index.colUsed.intersection(range(first)))
        request = TableRequest(tuple(used), without, asked)
        if request not in self.module.requests:
            self.module.requests.append(request)
        index.idxNum = self.module.requests.index(request)
        return True

    def _request_range(self, index: Any, found: int) -> ColumnRange | None:
        """The range of one column that comparisons ask for; of that which puts the rows in order, if it is one."""
        first, asked, equal = len(self.module.names) + 1, dict[int, list[int]](), dict[int, int]()
        for number in range(index.nConstraint):
            column, operator = index.get_aConstraint_iColumn(number), index.get_aConstraint_op(number)
            if not (index.get_aConstraint_usable(number) and 0 <= column < first):
                continue
            if operator in _COMPARISONS:
                asked.setdefault(column, []).append(number)
            elif operator in _EQUALITIES and not index.get_aConstraintUsage_in(number):  # IN would reorder rows
                equal[column] = number
        if not asked:
            return None
        order = [(index.get_aOrderBy_iColumn(at), index.get_aOrderBy_desc(at)) for at in range(index.nOrderBy)]
        ordered = bool(order) and order[0][0] in asked and order[1:] in ([], [(-1, False)])
        column = order[0][0] if ordered else max(asked, key=lambda column: (len(asked[column]), -column))
        for place, number in enumerate((*asked[column], *equal.values()), found + 1):
            index.set_aConstraintUsage_argvIndex(number, place)
        index.orderByConsumed = ordered
        operators = tuple(_COMPARISONS[index.get_aConstraint_op(number)] for number in asked[column])
        return ColumnRange(column, operators, order[0][1] if ordered else None, tuple(equal))

    def _name_column(self, number: int) -> str:
        return ("this", *self.module.names)[number]

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


class _Cursor:
    """Walks the elements. SQLite calls Filter, then Eof, Column and Next per row; each is a Python call."""

    def __init__(self, module: ElementModule) -> None:
        self.module = module
        self.walked: Any = NOTHING
        self.columns: Any = NOTHING.columns
        self.position = 0
        self.length = 0
        self.chosen = False  # whether some of the elements are walked, or all in another order

    def Filter(self, number: int, name: str, arguments: tuple[SqlValue, ...]) -> None:  # noqa: N802
        walked = self.module.walk(self.module.name, arguments)
        self.position, self.length = 0, walked.length
        asked = self.module.requests[number].range
        if asked is not None:
            walked, self.position, self.length = asked.choose_rows(walked, arguments)
        self.chosen = isinstance(walked, ChosenElements)
        self.walked, self.columns = walked, walked.columns

    def Eof(self) -> bool:  # noqa: N802
        return self.position >= self.length

    def Column(self, number: int) -> SqlValue:  # noqa: N802
        column = self.columns[number]  # 0.1 us for a value, a fifth of it for each look-up
        if column is None:
            column = self.walked.read_column(number)
        return column[self.position]

    def Rowid(self) -> int:  # noqa: N802
        return cast(int, self.Column(-1)) if self.chosen else self.position

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
                self.module.calls(self.module.name, self.module.requests[number]),
                number,
            )
        self.length, self.columns = self.columns_for(arguments)
        self.position = 0

    def Column(self, number: int) -> SqlValue:  # noqa: N802
        return self.columns[number][self.position]  # all that are read are there

    def Close(self) -> None:  # noqa: N802
        super().Close()
        self.columns_for = None


# --- calls of functions with each element of a list, as columns of the list's table (lowering/from_clause.py)
Columns: TypeAlias = list[Sequence[Any]]  # of a list, in SQL values
Arguments: TypeAlias = tuple[Any, ...]  # of the table, the list first
Results: TypeAlias = Callable[[Arguments], Sequence[Any]]  # gives the values of a call for all elements of one list
UNAMBIGUOUS_TYPES = frozenset({bytes, str, NoneType})  # of SQL values that equal only what they are


class SqliteElementCalls:
    """Those of one table in one execution. `walk` gives the columns of a list, `search` counts the steps."""

    def __init__(
        self,
        table: ListTable,
        sql_callbacks: Mapping[str, FunctionCallback],
        limit: int,
        execution: SqliteExecution,
        walk: Callable[[Any], ElementColumns],
        search: SearchState,
    ) -> None:
        self.walk = walk
        self.search = search
        self.width = len(table.columns) + 1
        self.lists: dict[Any, tuple[Columns, list[Results]]] = {}
        self.limit = limit
        numbers = {name: number for number, name in enumerate(("this", *table.columns))}
        self.calls = [_ElementCall(c, sql_callbacks[c.function], numbers, limit, execution) for c in table.calls]

    def make_column_reader(self, request: TableRequest) -> ColumnsFor:
        """What gives the number of rows and the columns that are wanted."""
        lists, search, limit, callers = self.lists, self.search, self.limit, [call.caller for call in self.calls]
        wanted, without, memo = request.columns, request.without, callers[0].memo
        again: dict[Arguments | bytes, tuple[int, tuple[int, Found]]] = {}  # what is wanted again, its calls first

        def read_columns(arguments: Arguments) -> tuple[int, Found]:
            # What is kept as it is has no numbers, so no other arguments equal it; to make a key takes 0.2 us more.
            known = again.get(arguments) or (again.get(_make_sqlite_call_key(arguments)) if again else None)
            if known is not None:
                calls_saved, found = known
                search.generated += calls_saved
                for caller in callers:
                    caller.memo.hits += calls_saved
                return found
            try:
                of_list, calls = lists[arguments[0]]
            except KeyError:
                of_list, calls = self._get_list_columns(arguments[0])
            hits, kept = memo.hits, len(of_list[0])
            search.generated += kept
            own = arguments if without is None else arguments[:-1]
            columns = of_list + [results(own) for results in calls]
            if without is not None and arguments[-1] in columns[without]:
                left_out = arguments[-1]
                places = [value != left_out for value in columns[without]]
                for number in wanted:
                    columns[number] = tuple(compress(columns[number], places))
                kept = len(columns[without])
            if memo.hits > hits:
                made = len(of_list[0]), (kept, columns)
                keep_bounded(again, _make_sqlite_call_key(arguments), made, limit // (len(of_list[0]) + 1))
            return kept, columns

        return read_columns

    def _get_list_columns(self, value: Any) -> tuple[Columns, list[Results]]:
        walked = self.walk(value)
        columns = [walked.read_column(number) for number in range(self.width)]
        known = self.lists[value] = columns, [call.make_list_call(columns) for call in self.calls]
        return known

    def __iter__(self) -> Iterator[tuple[str, tuple[Any, ...], Any]]:
        """The calls that were made: the function's name, the arguments, the value, as SQL values."""
        for call in self.calls:
            for key, results in call.made.items():
                arguments = key if isinstance(key, tuple) else loads(key)
                columns, _ = self.lists[arguments[0]]
                for row, result in zip(call.make_argument_rows(columns, arguments), results, strict=True):
                    yield call.name, row, result


class _ElementCall:
    """One of the calls, remembered by its arguments for all elements together; `numbers` are those of the columns.

    No more than `limit` values are kept. A list that has an element twice is left to the memory of calls.
    """

    def __init__(
        self,
        call: ElementCall,
        caller: FunctionCallback,
        numbers: Mapping[str, int],
        limit: int,
        execution: SqliteExecution,
    ) -> None:
        self.name = call.function
        self.caller = caller
        # Where its arguments are: whether in a column of the list, and its number, or that of the table's argument.
        self.places = [(True, numbers[part]) if isinstance(part, str) else (False, part) for part in call.arguments]
        self.key = [0, *sorted({at for of_list, at in self.places if not of_list})]
        self.limit = limit
        self.execution = execution
        self.made: dict[Arguments | bytes, Sequence[Any]] = {}

    def make_list_call(self, columns: Columns) -> Results:
        """What gives the values of the call for all elements of a list, whose columns these are."""
        made, caller, used, rows = self.made, self.caller, self.key, self.make_argument_rows
        interning = self.execution.interning
        size, most = len(used), self.limit // (len(columns[0]) + 1)
        if self._has_repeats(columns):
            return lambda arguments: list(starmap(caller.call, rows(columns, arguments)))
        values, block = self._make_python_rows(columns), caller.call_in_blocks(self.execution)

        def call_for_list(arguments: Arguments) -> Sequence[Any]:
            if size < len(arguments):
                arguments = tuple([arguments[at] if at in used else None for at in range(len(arguments))])
            key = _make_sqlite_call_key(arguments)
            known = made.get(key)
            if known is not None:
                caller.memo.hits += len(known)
                return known
            # A tuple, which the collector of cycles soon leaves alone.
            found = tuple(block(values(arguments), lambda: rows(columns, arguments)))
            if interning.is_plain or all(caller.can_remember(interning, row) for row in rows(columns, arguments)):
                keep_bounded(made, key, found, most)
            return found

        return call_for_list

    def make_argument_rows(self, columns: Columns, arguments: Arguments) -> Iterable[tuple[Any, ...]]:
        """The arguments of each call as SQL values."""
        length = len(columns[0])
        inputs = [columns[at] if of_list else repeat(arguments[at], length) for of_list, at in self.places]
        return zip(*inputs, strict=True)

    def _make_python_rows(self, columns: Columns) -> Callable[[Arguments], Iterable[tuple[Any, ...]]]:
        """The same for Python code: lists anew for each call of a function that may change them."""
        interning, changes = self.execution.interning, self.caller.function.changes
        convert, marshalled = interning.decode_copy if changes else interning.decode_read_only, interning.marshalled.get
        inputs: list[Iterable[Any]] = [columns[at] if of_list else () for of_list, at in self.places]
        for place, (of_list, at) in enumerate(self.places):
            if of_list and place in self.caller.function.indexed:
                values = list(map(interning.decode_read_only, columns[at]))
                if all(type(value) is list and SCALARS.issuperset(map(type, value)) for value in values):
                    inputs[place] = values  # which it cannot change
        copied = [place for place, column in enumerate(inputs) if bytes in map(type, column)]
        moved = [(place, at) for place, (of_list, at) in enumerate(self.places) if not of_list]

        def make_rows(arguments: Arguments) -> Iterable[tuple[Any, ...]]:
            for place in copied:
                inputs[place] = map(convert, columns[self.places[place][1]])
            for place, at in moved:
                value = arguments[at]
                known = marshalled(value) if changes else None
                if known is not None:
                    inputs[place] = map(loads, repeat(known))
                else:
                    inputs[place] = map(convert, repeat(value)) if type(value) is bytes else repeat(value)
            return zip(*inputs, strict=False)  # as many as the elements are

        return make_rows

    def _has_repeats(self, columns: Columns) -> bool:
        """Whether two elements give the same arguments."""
        rows = [dumps(row, 2) for row in zip(*[columns[at] for of_list, at in self.places if of_list], strict=True)]
        return len(set(rows)) < len(rows)


def _make_sqlite_call_key(arguments: Arguments) -> Arguments | bytes:
    """A key: 1 and 1.0 are one for a dict, but two arguments."""
    return arguments if UNAMBIGUOUS_TYPES.issuperset(map(type, arguments)) else dumps(arguments, 2)

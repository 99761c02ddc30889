"""Calls of functions with each element of a list, as columns of the list's table (lowering/element_calls.py)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import compress, repeat, starmap
from marshal import dumps, loads
from typing import TYPE_CHECKING, Any, TypeAlias

from ss2sql.lowering.sql_query import ElementCall, ListTable
from ss2sql.runtime.run.call_memory import UNAMBIGUOUS_TYPES, forget_older_half
from ss2sql.runtime.sqlite.list_elements import CallRequest, ColumnsFor, ElementColumns, Found

if TYPE_CHECKING:
    from ss2sql.runtime.sqlite.executor import SqliteExecution
    from ss2sql.runtime.sqlite.function_callbacks import FunctionCallback
    from ss2sql.runtime.sqlite.search_functions import SearchState

Columns: TypeAlias = list[Sequence[Any]]  # of a list, in SQL values
Arguments: TypeAlias = tuple[Any, ...]  # of the table, the list first
Results: TypeAlias = Callable[[Arguments], Sequence[Any]]  # gives the values of a call for all elements of one list


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

    def make_column_reader(self, request: CallRequest) -> ColumnsFor:
        """What gives the number of rows and the columns that are wanted."""
        lists, search, limit, callers = self.lists, self.search, self.limit, [call.caller for call in self.calls]
        wanted, without, memo = request.columns, request.without, callers[0].memo
        again: dict[Arguments | bytes, tuple[int, tuple[int, Found]]] = {}  # what is wanted again, its calls first

        def read_columns(arguments: Arguments) -> tuple[int, Found]:
            known = again.get(_make_sqlite_call_key(arguments)) if again else None
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
                if len(again) * (len(of_list[0]) + 1) >= limit:
                    forget_older_half(again)
                again[_make_sqlite_call_key(arguments)] = len(of_list[0]), (kept, columns)
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
            if most and (
                interning.is_plain or all(caller.can_remember(interning, row) for row in rows(columns, arguments))
            ):
                if len(made) >= most:
                    forget_older_half(made)
                made[key] = found
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

"""Calls of functions with each element of a list, as columns of the list's table (lowering/element_calls.py)."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import repeat, starmap
from marshal import dumps, loads
from typing import TYPE_CHECKING, Any, TypeAlias

from ss2sql.lowering.sql_query import ElementCall, ListTable
from ss2sql.runtime.functions import ONE_KIND, forget_half
from ss2sql.vtables.sequences import Walked

if TYPE_CHECKING:
    from ss2sql.runtime.calls import Caller
    from ss2sql.runtime.database import Execution

Columns: TypeAlias = list[Sequence[Any]]  # of a list, in SQL values
Arguments: TypeAlias = tuple[Any, ...]  # of the table, the list first


class ElementCalls:
    """Those of one table in one execution. `walk` gives the columns of a list."""

    def __init__(
        self,
        table: ListTable,
        callers: Mapping[str, Caller],
        limit: int,
        execution: Execution,
        walk: Callable[[Any], Walked],
    ) -> None:
        self.walk = walk
        self.width = len(table.columns) + 1
        self.lists: dict[Any, Columns] = {}
        numbers = {name: number for number, name in enumerate(("this", *table.columns))}
        self.calls = [_Call(call, callers[call.function], numbers, limit, execution) for call in table.calls]

    def columns(self, arguments: Arguments) -> Columns:
        """The columns of the list and those of the calls."""
        try:
            columns = self.lists[arguments[0]]
        except KeyError:
            walked = self.walk(arguments[0])
            columns = self.lists[arguments[0]] = [walked[number] for number in range(self.width)]
        return columns + [call.results(columns, arguments) for call in self.calls]

    def __iter__(self) -> Iterator[tuple[str, tuple[Any, ...], Any]]:
        """The calls that were made: the function's name, the arguments, the value, as SQL values."""
        for call in self.calls:
            for key, results in call.made.items():
                arguments = key if isinstance(key, tuple) else loads(key)
                for row, result in zip(call.rows(self.lists[arguments[0]], arguments), results, strict=True):
                    yield call.name, row, result


class _Call:
    """One of the calls, remembered by its arguments for all elements together; `numbers` are those of the columns.

    No more than `limit` values are kept. A list that has an element twice is left to the memory of calls.
    """

    def __init__(
        self, call: ElementCall, caller: Caller, numbers: Mapping[str, int], limit: int, execution: Execution
    ) -> None:
        self.name = call.function
        self.caller = caller
        # Where its arguments are: whether in a column of the list, and its number, or that of the table's argument.
        self.places = [(True, numbers[part]) if isinstance(part, str) else (False, part) for part in call.arguments]
        self.key = [0, *sorted({at for of_list, at in self.places if not of_list})]
        self.limit = limit
        self.execution = execution
        self.made: dict[Arguments | bytes, Sequence[Any]] = {}
        self.scalars: dict[int, bool] = {}  # whether a column holds no lists or dicts, by its identity
        self.repeats: dict[Any, bool] = {}  # whether a list gives the same arguments twice

    def results(self, columns: Columns, arguments: Arguments) -> Sequence[Any]:
        """The values of the call for all elements."""
        made, caller = self.made, self.caller
        if len(self.key) < len(arguments):
            arguments = tuple([arguments[at] if at in self.key else None for at in range(len(arguments))])
        # 1 and 1.0 are one key, but two arguments.
        key = arguments if ONE_KIND.issuperset(map(type, arguments)) else dumps(arguments, 2)
        known = made.get(key)
        if known is not None:
            caller.memo.hits += len(known)
            return known
        if self._has_repeats(columns, arguments):
            return list(starmap(caller.call, self.rows(columns, arguments)))
        results = caller.block(self.execution, self._values(columns, arguments), lambda: self.rows(columns, arguments))
        pool = self.execution.pool
        plain = pool.is_plain or all(caller.may_keep(pool, row) for row in self.rows(columns, arguments))
        if self.limit and plain:
            if len(made) * (len(results) + 1) >= self.limit:
                forget_half(made)
            made[key] = tuple(results)  # which the collector of cycles soon leaves alone
        return results

    def rows(self, columns: Columns, arguments: Arguments) -> Iterable[tuple[Any, ...]]:
        """The arguments of each call as SQL values."""
        length = len(columns[0])
        given = [columns[at] if of_list else repeat(arguments[at], length) for of_list, at in self.places]
        return zip(*given, strict=True)

    def _values(self, columns: Columns, arguments: Arguments) -> Iterable[tuple[Any, ...]]:
        """The same for Python code: lists anew for each call of a function that may change them."""
        pool, changes = self.execution.pool, self.caller.function.changes
        convert = pool.fresh if changes else pool.unchanged
        given: list[Iterable[Any]] = []
        for of_list, at in self.places:
            if of_list:
                given.append(columns[at] if self._is_scalar(columns[at]) else map(convert, columns[at]))
                continue
            value = arguments[at]
            marshalled = pool.marshalled.get(value) if changes else None
            given.append(map(convert, repeat(value)) if marshalled is None else map(loads, repeat(marshalled)))
        return zip(*given, strict=False)  # as many as the elements are

    def _has_repeats(self, columns: Columns, arguments: Arguments) -> bool:
        known = self.repeats.get(arguments[0])
        if known is None:
            rows = [dumps(row, 2) for row in self.rows(columns, arguments)]
            known = self.repeats[arguments[0]] = len(set(rows)) < len(rows)
        return known

    def _is_scalar(self, column: Sequence[Any]) -> bool:
        known = self.scalars.get(id(column))
        if known is None:
            known = self.scalars[id(column)] = bytes not in map(type, column)
        return known

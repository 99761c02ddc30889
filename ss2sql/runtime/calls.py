"""Functions as SQL functions: those of the user, with fresh values and a memo, and the built-in ones.

What happens per call decides the speed of a search, so the way of a remembered call is as short as it can be:
0.2 us from SQL and back.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from marshal import dumps, loads
from typing import TYPE_CHECKING, Any

from ss2sql.errors import Error, note_place
from ss2sql.language.operations import OPERATIONS
from ss2sql.runtime.functions import Memo, Refused, UserFunction
from ss2sql.runtime.pool import OtherFormError, Pool

if TYPE_CHECKING:
    from ss2sql.runtime.database import Execution


_MISSING = object()
NONE = object()  # None in a memory where None says that nothing is known


class HeldError(Exception):
    """A StopIteration of a function on its way through SQLite: by itself it would only end the walk over the rows."""


def sql_function(function: UserFunction, memo: Memo, stack: list[Execution]) -> Callable[..., Any]:
    """What SQLite calls. The memo is that of the innermost execution, whoever puts it there."""
    name, body = function.name, function.function
    giver = f"the function '{name}'"
    remember = function.volatility != "volatile"
    changes = function.changes

    def passed_on(execution: Execution, arguments: tuple[Any, ...], error: Exception) -> Exception:
        """What goes through SQLite for an exception of the user's: noted, and remembered where calls are."""
        execution.failed = True
        note_place(error, name, execution.calls.get(name, ()))
        passing = HeldError(error) if isinstance(error, StopIteration) else error
        if remember:
            memo.failures[dumps(arguments, 2)] = passing
        return passing

    def call(*arguments: Any) -> Any:
        """A real call; what it costs beside the function itself is 1 us."""
        execution = stack[-1]
        pool, run = execution.pool, execution.run
        bytes_of = pool.marshalled
        whole = True
        try:
            if changes:
                values = [loads(bytes_of[value]) if type(value) is bytes else value for value in arguments]
            else:
                values = [pool.plain(value) if type(value) is bytes else value for value in arguments]
        except KeyError:  # there are objects inside
            whole = all(type(value) is not bytes or value in bytes_of for value in arguments)
            values = list(map(pool.fresh, arguments))
        if run.interrupted or run.bounds.deadline is not None:
            run.check()  # a slow function must not keep a timeout waiting
        memo.calls += 1
        try:
            result = body(*values)
        except Exception as error:
            if (passing := passed_on(execution, arguments, error)) is not error:
                raise passing from None
            raise
        other: OtherFormError | None = None
        try:
            try:
                encoded = pool.encode_foreign(result, giver)
            except OtherFormError as error:  # the statement is run again, but this call is not made again
                other, pool.watched = error, frozenset()
                encoded = pool.encode_foreign(result, giver)
        except Error as error:
            execution.failed = True
            spans = execution.calls.get(name, ())
            located = error.located(spans[0] if spans else None)
            if remember:
                memo.failures[dumps(arguments, 2)] = located
            raise located from None
        except Exception as error:  # the result is an object that fails when it is looked at, such as a generator
            if (passing := passed_on(execution, arguments, error)) is not error:
                raise passing from None
            raise
        # What was proved of plain data says nothing of other objects.
        if remember and (whole or not function.inferred):
            memo.keep(arguments, encoded)
        if other is not None:
            raise other
        return encoded

    def call_of_memo(*arguments: Any) -> Any:
        result = memo.plain.get(arguments)
        if result is not None:
            memo.hits += 1
            return result
        if memo.exact or memo.failures:
            key = dumps(arguments, 2)
            result = memo.exact.get(key, _MISSING)
            if result is not _MISSING:
                memo.hits += 1
                return result
            error = memo.failures.get(key)
            if error is not None:
                stack[-1].failed = True
                raise error
        return call(*arguments)

    return call_of_memo if remember else call


class CallsMade:
    """The calls that a statement has made before it ended, as values of the language, by the names of functions."""

    def __init__(self, pool: Pool, memos: Mapping[str, Memo]) -> None:
        self._pool = pool
        self._known = {name: (memo.plain, memo.exact, memo.failures) for name, memo in memos.items()}

    def __iter__(self) -> Iterator[tuple[str, tuple[Any, ...], Any]]:
        """Each call: the function's name, the arguments, and the value or what the call was Refused with."""
        decode = self._pool.decode
        for name, memories in self._known.items():
            for memory in memories:
                for key, answer in memory.items():
                    arguments = loads(key) if type(key) is bytes else key
                    yield name, tuple(map(decode, arguments)), self._as_value(answer)

    def _as_value(self, answer: Any) -> Any:
        if type(answer) is HeldError:
            return Refused(answer.args[0])
        if isinstance(answer, Exception):
            return Refused(answer)
        return None if answer is NONE else answer if type(answer) is Refused else self._pool.decode(answer)


def builtin_function(
    name: str, python: Callable[..., Any], stack: list[Execution], predicate: bool
) -> Callable[..., Any]:
    """A built-in function on values of the language; its last SQL argument is the place of the call."""

    makes = name in OPERATIONS and OPERATIONS[name].grows

    def function(*arguments: Any) -> Any:
        execution = stack[-1]
        run, pool = execution.run, execution.pool
        if run.interrupted or run.bounds.deadline is not None:
            run.check()
        try:
            make = pool.sizes.maker(name, python) if makes else python
            result = make(*map(pool.decode, arguments[:-1]))
            return int(result) if predicate else pool.encode_foreign(result, name)
        except Error as error:
            execution.failed = True
            raise error.located(execution.span(arguments[-1])) from error.__cause__

    quick = QUICK.get(name)
    return function if quick is None else quick(function, stack)


def located_final(aggregate: Any, execution: Execution) -> Callable[[], Any]:
    """The aggregate's `final`, whose errors get the place of its call."""
    final = aggregate.final

    def located() -> Any:
        try:
            return final()
        except Error as error:
            raise error.located(execution.span(aggregate.place)) from None

    return located


def _quick_item(general: Callable[..., Any], stack: list[Execution]) -> Callable[..., Any]:
    """`item`: the elements of a list are made SQL values once. 0.1 us, where the general way takes 1 us and more."""

    def item(container: Any, index: Any, place: str) -> Any:
        parts = stack[-1].parts
        try:
            if index >= 0:
                return parts[container][index]
        except (KeyError, IndexError, TypeError):
            pass
        return general(container, index, place)

    return item


def _quick_membership(negated: bool) -> Callable[..., Callable[..., Any]]:
    """`in` and `not_in`: the elements of a list are put into a set once."""

    def quick(general: Callable[..., Any], stack: list[Execution]) -> Callable[..., Any]:
        def contains(item: Any, container: Any, place: str) -> Any:
            execution = stack[-1]
            try:
                members = execution.members[container]
            except KeyError:
                return general(item, container, place)
            return (execution.pool.key(item) in members) is not negated

        return contains

    return quick


class Parts(dict[Any, list[Any]]):
    """The elements of lists as SQL values, by the lists' handles. KeyError for what is no list."""

    def __init__(self, pool: Pool) -> None:
        self.pool = pool

    def __missing__(self, handle: Any) -> list[Any]:
        value = self.pool.decode(handle)
        if type(value) is not list:
            raise KeyError
        parts = self[handle] = list(map(self.pool.encode, value))
        return parts


class Members(dict[Any, frozenset[Any]]):
    """The keys of the elements of lists, by the lists' handles. KeyError for what is no list."""

    def __init__(self, pool: Pool) -> None:
        self.pool = pool

    def __missing__(self, handle: Any) -> frozenset[Any]:
        value = self.pool.decode(handle)
        if type(value) is not list:
            raise KeyError
        members = self[handle] = frozenset(self.pool.key(self.pool.encode(item)) for item in value)
        return members


QUICK: dict[str, Callable[[Callable[..., Any], list[Any]], Callable[..., Any]]] = {
    "item": _quick_item,
    "in": _quick_membership(False),
    "not_in": _quick_membership(True),
}

"""Functions of the user as SQL functions: fresh values on each real call, remembered where their volatility allows it.

What happens per call decides the speed of a search, so the way of a remembered call is as short as it can be:
0.2 us from SQL and back.
"""

from __future__ import annotations

from collections.abc import Callable
from marshal import loads
from typing import TYPE_CHECKING, Any

from ss2sql.errors import Error, note_place
from ss2sql.runtime.functions import Memo, UserFunction, kinds_of

if TYPE_CHECKING:
    from ss2sql.runtime.database import Execution


def sql_function(function: UserFunction, memo: Memo, stack: list[Execution]) -> Callable[..., Any]:
    """What SQLite calls. The memo is that of the innermost execution, whoever puts it there."""
    name, body = function.name, function.function
    giver = f"the function '{name}'"
    remember = function.volatility != "volatile"

    def call(*arguments: Any) -> Any:
        """A real call."""
        execution = stack[-1]
        pool, run = execution.pool, execution.run
        bytes_of = pool.marshalled
        values: list[Any] = []
        has_numbers = False
        whole = True
        for argument in arguments:
            kind = type(argument)
            if kind is bytes:
                marshalled = bytes_of.get(argument)
                if marshalled is None:  # there are objects inside
                    whole = False
                    values.append(pool.fresh(argument))
                else:
                    values.append(loads(marshalled))
            else:
                has_numbers = has_numbers or kind is not str
                values.append(argument)
        if run.interrupted or run.deadline is not None:
            run.check()  # a slow function must not keep a timeout waiting
        memo.calls += 1
        try:
            result = body(*values)
        except Exception as error:
            execution.failed = True
            note_place(error, name, execution.calls.get(name, ()))
            if remember:
                memo.failures[arguments, kinds_of(arguments)] = error
            raise
        try:
            result = pool.encode_foreign(result, giver)
        except Error as error:
            execution.failed = True
            spans = execution.calls.get(name, ())
            raise error.located(spans[0] if spans else None) from None
        # What was proved of plain data says nothing of other objects.
        if remember and (whole or not function.inferred):
            memo.keep(arguments, result, has_numbers)
        return result

    def call_of_memo(*arguments: Any) -> Any:
        result = memo.plain.get(arguments)
        if result is not None:
            memo.hits += 1
            return result
        found = memo.find(arguments)
        if found is not None:
            memo.hits += 1
            return found[0]
        if memo.failures:
            error = memo.failures.get((arguments, kinds_of(arguments)))
            if error is not None:
                stack[-1].failed = True
                raise error
        return call(*arguments)

    return call_of_memo if remember else call

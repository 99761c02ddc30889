"""Calls of the user's functions from generated code.

A function gets fresh values, so whatever it does to its arguments changes nothing else; one that is proven to change
nothing gets them as they are. A call of an immutable or stable function is remembered by its arguments for the length
of one run; the memo is bounded. What comes back is converted to a value of the language.

What happens per call beside the function decides the speed of a search. Generated code therefore makes the keys of
arguments itself where one serves for many calls: that of the state for all steps, that of an element for all states.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from itertools import count
from marshal import dumps, loads
from types import NoneType
from typing import Any

from ss2sql.errors import Stopped
from ss2sql.frontend.user_functions import UserFunction
from ss2sql.language import plan
from ss2sql.language.conversion import is_marshalled_value, is_shallow_list_value
from ss2sql.language.values import SCALARS, convert_value, copy_deep, copy_for_python
from ss2sql.runtime.run.array_calls import ArrayFunction
from ss2sql.runtime.run.call_memory import FailedCall, forget_older_half
from ss2sql.runtime.run.run_state import Run
from ss2sql.runtime.sqlite.interning import Interning

# Of these kinds equal values are the same value; 1, 1.0 and True are one key of a dict but three arguments.
PLAIN_TYPES = frozenset({int, str, NoneType})

# The key of a value with objects inside: no bytes that marshal writes begin like this.
NO_KEY = b"\xff"


def are_call_arguments_plain(arguments: Iterable[Any]) -> bool:
    """Whether all arguments are of kinds in PLAIN."""
    return PLAIN_TYPES.issuperset(map(type, arguments))


def make_call_key(value: Any) -> bytes:
    """What tells a value from all that are not the same, 1 from 1.0; NO_KEY where objects are inside."""
    try:
        return dumps(value, 2)
    except ValueError:
        return NO_KEY


class FastCounter:
    """A count to which `add` adds one, in C: 0.03 us, where a counter by name takes 0.15."""

    __slots__ = ("_told", "add")

    def __init__(self) -> None:
        self.add = count(1).__next__
        self._told = 1

    def count_more(self, number: int) -> None:
        self._told -= number

    def take_count(self) -> int:
        """How much was added since the last call."""
        now, before = self.add(), self._told
        self._told = now + 1
        return now - before


class MemoizedCalls:
    """The calls of one function in one run, which share what is remembered.

    `call_any(*arguments)` gives the value. Generated code asks the memory itself: `get(arguments)` where all are of the
    kinds in PLAIN_TYPES, or `get(key)` with their exact keys joined, gives a tuple with the value, to be counted by a
    call of `hit`; where it does not, `call_new_plain` or `missed` gives the value. `report_counts` hands on to the run
    what was counted.

    `body` is the function itself, for calls that nobody makes twice; `count(number)` counts them. `make_single` gives
    the function on arguments that are `fresh`, or copied here, for a list whose elements are `checked`, or by the
    caller.
    `adopt(arguments, answer)` remembers what a call has given elsewhere; calls may then be `foretold`, as they may
    where another process makes them.

    Keys are bytes: of thousands of tuples and lists more than a third of the time of a search would go into looking
    through them for garbage.
    """

    __slots__ = ("adopt", "body", "call_any", "call_new_plain", "count", "foretold", "get", "hit", "make_single",
                 "missed", "report_counts")  # fmt: skip

    def __init__(self, function: UserFunction, run: Run, limit: int) -> None:
        memo, objects, copied = dict[Any, Any](), Interning(), function.changes
        made, hits = FastCounter(), FastCounter()
        get, hit = memo.get, hits.add
        call = make_checked_call(function, run, made.add)
        if run.foreteller is not None:
            call = run.foreteller.make_timed_call(function, call)

        def report_counts() -> None:
            for tally, counts in ((made, run.stats.calls), (hits, run.stats.remembered)):
                if more := tally.take_count():
                    counts[function.name] += more

        def call_plain(*arguments: Any) -> Any:
            found = get(arguments)
            return found[0] if type(found) is tuple and hit() else call_new_plain(found, arguments)

        def call_new_plain(found: FailedCall | None, arguments: tuple[Any, ...]) -> Any:
            return call_new(found, arguments, arguments)

        def missed(found: FailedCall | None, key: bytes, keys: tuple[bytes, ...], *arguments: Any) -> Any:
            if NO_KEY in keys:
                return call_with_objects(arguments)
            if type(arguments[-1]) is not list and are_call_arguments_plain(arguments):
                return keep_value(key, call_plain(*arguments))
            copies: Any = arguments
            if copied:  # the bytes of a key are a fresh value but for the reading of them
                pairs = zip(keys, arguments, strict=True)
                copies = [value if type(value) in SCALARS else loads(known) for known, value in pairs]
            return call_new(found, key, copies)

        def call_any(*arguments: Any) -> Any:
            if are_call_arguments_plain(arguments):
                return call_plain(*arguments)
            keys = tuple(map(make_call_key, arguments))
            key = b"".join(keys)
            found = get(key)
            return found[0] if type(found) is tuple and hit() else missed(found, key, keys, *arguments)

        def make_single(fresh: bool, checked: bool) -> Callable[..., Any]:
            work = call if checked else make_checked_call(function, run, made.add, make_call_list_check(function))
            if copied and not fresh:
                return lambda *arguments: work(map(copy_for_python, arguments))
            return lambda *arguments: work(arguments)

        def call_with_objects(arguments: tuple[Any, ...]) -> Any:
            if function.inferred:  # what was proved of plain data says nothing of other objects
                return call(map(copy_for_python, arguments))
            key = (objects.encode(list(arguments)),)
            found = get(key)
            if type(found) is tuple and hit():
                return found[0]
            return call_new(found, key, map(copy_for_python, arguments))

        def call_new(found: FailedCall | None, key: Hashable, copies: Iterable[Any]) -> Any:
            """A call for copies of its arguments; one that has failed already is not made again."""
            if found is not None:
                hit()
                raise found.error
            try:
                value = call(copies)
            except Exception as error:
                if len(memo) < limit and not isinstance(error, Stopped):
                    memo[key] = FailedCall(error)
                raise
            return keep_value(key, value)

        def keep_value(key: Hashable, value: Any) -> Any:
            if len(memo) >= limit:
                if not limit:
                    return value
                forget_older_half(memo)
            memo[key] = (value,)
            return value

        def adopt(arguments: tuple[Any, ...], answer: Any) -> None:
            self.foretold = True
            keys = tuple(map(make_call_key, arguments))
            if are_call_arguments_plain(arguments):
                key: Hashable = arguments
            elif NO_KEY not in keys:
                key = b"".join(keys)
            elif not function.inferred:
                key = (objects.encode(list(arguments)),)
            else:
                return
            if type(answer) is not FailedCall:
                keep_value(key, answer)
            elif len(memo) < limit:
                memo[key] = answer

        self.adopt, self.foretold = adopt, run.foreteller is not None
        self.body, self.count = function.function, made.count_more
        self.get, self.hit, self.report_counts = get, hit, report_counts
        self.call_any: Callable[..., Any] = call_any
        self.make_single = make_single
        self.missed, self.call_new_plain = missed, call_new_plain


def report_memo_counts(run: Run) -> None:
    """Hands on to the run how often functions were called, and their results remembered."""
    for known in run.callables.values():
        if isinstance(known, MemoizedCalls):
            known.report_counts()


def make_checked_call(
    function: UserFunction,
    run: Run,
    counted: Callable[[], object] | None = None,
    checked: Callable[[Any], Any] | None = None,
) -> Callable[[Iterable[Any]], Any]:
    """A real call: counted, and what comes back made a value of the language, or `checked` otherwise."""
    name, body, calls = function.name, function.function, run.stats.calls
    giver = function.giver

    def count_by_name() -> None:
        calls[name] += 1

    def check_result(result: Any) -> Any:
        # Lists of lists at most, as states of puzzles are: 0.7 us in place of 2.
        if type(result) is list and is_shallow_list_value(result) and is_marshalled_value(dumps(result, 2)):
            return result
        return convert_value(result, giver)

    counted, checked = counted or count_by_name, checked or check_result

    def call_and_check(arguments: Iterable[Any]) -> Any:
        if run.interrupted or run.bounds.deadline is not None:
            run.check()  # a slow function must not keep a timeout waiting
        counted()
        result = body(*arguments)
        return result if type(result) is bool else checked(result)

    return call_and_check


def make_call_list_check(function: UserFunction) -> Callable[[Any], Any]:
    """Makes what the function returns a list, each element of which the caller makes a value of the language."""
    giver = function.giver
    return lambda result: result if type(result) is list else convert_value(result, giver)


def bind_function(
    function: plan.Function, run: Run, find: Callable[[str], UserFunction], memo_limit: int
) -> Callable[..., Any]:
    """The function of the user on language values, as generated code calls it: what is volatile gives the value alone.

    `find` gives the function of a name. A run has one of each. The inverse of one takes a tuple of values.
    """
    if function.name not in run.callables:
        entry = find(function.inverse_of or function.name)
        entry = entry.make_inverse() if function.inverse_of else entry
        run.callables[function.name] = _make_memoized_callable(entry, bool(function.inverse_of), run, memo_limit)
    return run.callables[function.name]


def _make_memoized_callable(function: UserFunction, inverse: bool, run: Run, memo_limit: int) -> Any:
    if function.vectorized and not inverse:
        return ArrayFunction(function, run, memo_limit)
    if function.volatility != "volatile" and not inverse:
        return MemoizedCalls(function, run, memo_limit)
    call = make_checked_call(function, run)
    if not inverse:
        # The value stays as it is, even if the function has kept the list and changes it later.
        return lambda *arguments: copy_deep(call(map(copy_for_python, arguments)))
    return (lambda arguments: call(map(copy_for_python, arguments))) if function.changes else call

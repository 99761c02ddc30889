"""Calls of the user's functions from generated code.

A function gets fresh values, so whatever it does to its arguments changes nothing else; one that is proven to change
nothing gets them as they are. A call of an immutable or stable function is remembered by its arguments for the length
of one run; the memo is bounded. What comes back is converted to a value of the language.

What happens per call beside the function decides the speed of a search. Generated code therefore makes the keys of
arguments itself where one serves for many calls: that of the state for all steps, that of an element for all states.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable
from gc import get_referents
from itertools import count
from marshal import dumps, loads
from types import NoneType
from typing import Any, TypeAlias

from ss2sql.errors import Stopped
from ss2sql.frontend.user_functions import UserFunction
from ss2sql.language import plan
from ss2sql.language.conversion import is_finite
from ss2sql.language.kinds import INT_MAX, INT_MIN
from ss2sql.language.values import SCALARS, convert_value, copy_deep, copy_for_python, encode_list_value
from ss2sql.runtime.run.array_calls import ArrayFunction
from ss2sql.runtime.run.call_memory import FailedCall, forget_older_half
from ss2sql.runtime.run.run_state import Run
from ss2sql.runtime.sqlite.interning import Interning

# The value of a call, and its frozen form where that was at hand; None: `make_hashable` has to make it.
Result: TypeAlias = tuple[Any, Hashable]

# Of these kinds equal values are the same value; 1, 1.0 and True are one key of a dict but three arguments.
PLAIN_TYPES = frozenset({int, str, NoneType})

# A longer list is looked through item by item.
MAX_ITEMS = 64

# What marshal writes before a float, an integer of more than 32 bits, True, False, whatever is no value, and objects
# that it writes as bytes. A list without them is a value already, and its bytes are its frozen form. Others are found
# by chance, in text above all, which costs time only. Deleting takes 0.1 us, a pattern that looks for them 0.5 us.
_UNUSUAL = b"glTFsyxcS.({<>"
_NO_VALUES = b"lsyxcS.({<>"  # the same but for floats and bools

# The key of a value with objects inside: no bytes that marshal writes begin like this.
NO_KEY = b"\xff"

_NO_ITEMS: Result = ([], dumps([], 2))
_TRUE: Result = (True, True)
_FALSE: Result = (False, False)


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
    """The calls of one function in one run, in three ways that share what is remembered.

    `call_plain(*arguments)` takes arguments of the kinds in PLAIN, `call_by_keys(keys, *arguments)` any with their
    exact keys, `call_any(*arguments)` makes the keys itself. All give a `Result`. Generated code asks the memory
    itself: `get(key)` with the keys joined, or `get(arguments)` where they are plain, gives a Result, to be counted by
    a call of `hit`, or what `missed` or `call_new_plain` makes one of. `report_counts` hands on to the run what was
    counted.

    `body` is the function itself, for calls that nobody makes twice; `count(number)` counts them. `make_single` gives
    the function on arguments that are `fresh`, or copied here, for a list whose elements are `checked`, or by the
    caller.
    `adopt(arguments, answer)` remembers what a call has given elsewhere; calls may then be `foretold`, as they may
    where another process makes them.

    What is remembered is held as bytes until it is needed: of thousands of tuples and lists more than a third
    of the time of a search would go into looking through them for garbage. So keys are bytes, and so are lists.
    """

    __slots__ = ("adopt", "body", "call_any", "call_by_keys", "call_new_plain", "call_plain", "count", "foretold",
                 "get", "hit", "make_single", "missed", "report_counts")  # fmt: skip

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

        def call_plain(*arguments: Any) -> Result:
            found = get(arguments)
            return found if type(found) is tuple and hit() else call_new_plain(found, arguments)

        def call_new_plain(found: bytes | None, arguments: tuple[Any, ...]) -> Result:
            if found is not None:
                return recall_result(arguments, found)
            try:
                result = call(arguments)
            except Exception as error:
                refuse(arguments, error)
                raise
            if len(memo) < limit:  # as `keep_result` does it, without a call
                memo[arguments] = result[1] if type(result[1]) is bytes and result[0] else result
                return result
            return keep_result(arguments, result)

        def call_by_keys(keys: tuple[bytes, ...], *arguments: Any) -> Result:
            key = b"".join(keys)
            found = get(key)
            return found if type(found) is tuple and hit() else missed(found, key, keys, *arguments)

        def missed(found: bytes | None, key: bytes, keys: tuple[bytes, ...], *arguments: Any) -> Result:
            if found is not None:
                return recall_result(key, found)
            if NO_KEY in keys:
                return call_with_objects(arguments)
            if type(arguments[-1]) is not list and are_call_arguments_plain(arguments):
                return keep_result(key, call_plain(*arguments))
            copies: Any = arguments
            # The bytes of a key are a fresh value but for the reading of them.
            if copied and len(keys) == 2:
                one, other = arguments
                copies = (
                    one if type(one) in SCALARS else loads(keys[0]),
                    other if type(other) in SCALARS else loads(keys[1]),
                )
            elif copied:
                pairs = zip(keys, arguments, strict=True)
                copies = [value if type(value) in SCALARS else loads(known) for known, value in pairs]
            try:
                result = call(copies)
            except Exception as error:
                refuse(key, error)
                raise
            if len(memo) < limit:  # as `keep_result` does it, without a call
                memo[key] = result[1] if type(result[1]) is bytes and result[0] else result
                return result
            return keep_result(key, result)

        def call_any(*arguments: Any) -> Result:
            if are_call_arguments_plain(arguments):
                return call_plain(*arguments)
            return call_by_keys(tuple(map(make_call_key, arguments)), *arguments)

        def call_one(argument: Any) -> Result:
            """The same for one argument: 0.7 us less."""
            if type(argument) in PLAIN_TYPES:
                return call_plain(argument)
            key = make_call_key(argument)
            found = get(key)
            return found if type(found) is tuple and hit() else missed(found, key, (key,), argument)

        def make_single(fresh: bool, checked: bool) -> Callable[..., Result]:
            work = call if checked else make_checked_call(function, run, made.add, make_call_list_check(function))
            if copied and not fresh:
                return lambda *arguments: work(map(copy_for_python, arguments))
            return lambda *arguments: work(arguments)

        def call_with_objects(arguments: tuple[Any, ...]) -> Result:
            if function.inferred:  # what was proved of plain data says nothing of other objects
                return call(map(copy_for_python, arguments))
            key = (objects.encode(list(arguments)),)
            found = get(key)
            if found is None:
                try:
                    return keep_result(key, call(map(copy_for_python, arguments)))
                except Exception as error:
                    refuse(key, error)
                    raise
            if type(found) is not tuple:
                return recall_result(key, found)
            hit()
            return found

        def recall_result(key: Hashable, found: Any) -> Result:
            hit()
            if type(found) is FailedCall:
                raise found.error
            result = memo[key] = (loads(found), found)
            return result

        def keep_result(key: Hashable, found: Result) -> Result:
            if len(memo) >= limit:
                if not limit:
                    return found
                forget_older_half(memo)
            memo[key] = found[1] if type(found[1]) is bytes and found[0] else found
            return found

        def refuse(key: Hashable, error: Exception) -> None:
            """A call for a parameter of SQL may fail; where the query then begins again it is not made again."""
            if len(memo) < limit and not isinstance(error, Stopped):
                memo[key] = FailedCall(error)

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
                keep_result(key, (answer, None))
            elif len(memo) < limit:
                memo[key] = answer

        self.adopt, self.foretold = adopt, run.foreteller is not None
        self.body, self.count = function.function, made.count_more
        self.get, self.hit, self.report_counts = get, hit, report_counts
        self.call_plain, self.call_by_keys = call_plain, call_by_keys
        self.call_any: Callable[..., Result] = call_one if function.maximum == 1 else call_any
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
    checked: Callable[[Any], Result] | None = None,
) -> Callable[[Any], Result]:
    """A real call: counted, and what comes back made a value, by default by `make_result_check`."""
    name, body, calls = function.name, function.function, run.stats.calls
    checked = checked or make_result_check(function)

    def count_by_name() -> None:
        calls[name] += 1

    counted = counted or count_by_name

    def call_and_check(arguments: Any) -> Result:
        if run.interrupted or run.bounds.deadline is not None:
            run.check()  # a slow function must not keep a timeout waiting
        counted()
        return checked(body(*arguments))

    return call_and_check


def make_result_check(function: UserFunction) -> Callable[[Any], Result]:
    """Makes what the function returns a value of the language."""
    giver = f"the function '{function.name}'"

    def check_result(result: Any) -> Result:
        kind = type(result)
        if kind is list:
            if not result:
                return _NO_ITEMS
            # Lists of lists at most: marshal would follow a list that contains itself for ever. To look at the types
            # of all items takes 0.9 us for three lists of eight, to ask the garbage collector 0.16.
            if len(result) < MAX_ITEMS and not get_referents(*get_referents(*result)):
                try:
                    marshalled = dumps(result, 2)
                except ValueError:  # there are objects inside
                    return convert_value(result, giver), None
                if len(marshalled.translate(None, _UNUSUAL)) == len(marshalled):
                    return result, marshalled
                if len(marshalled.translate(None, _NO_VALUES)) == len(marshalled) and is_finite(result, marshalled):
                    return result, encode_list_value(
                        result
                    )  # floats; 1.1 us for a place, 2.6 by `convert_value` and `make_hashable`
        elif kind is bool:
            return _TRUE if result else _FALSE  # a tuple less to hold for each call
        elif kind is str or (kind is int and INT_MIN <= result <= INT_MAX):
            return result, result
        return convert_value(result, giver), None

    return check_result


def make_call_list_check(function: UserFunction) -> Callable[[Any], Result]:
    """Makes what the function returns a list, each element of which the caller makes a value of the language."""
    giver = f"the function '{function.name}'"
    return lambda result: (result if type(result) is list else convert_value(result, giver), None)


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
        return lambda *arguments: copy_deep(call(map(copy_for_python, arguments))[0])
    return (lambda arguments: call(map(copy_for_python, arguments))) if function.changes else call

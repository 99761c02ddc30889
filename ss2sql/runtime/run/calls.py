"""Calls of the user's functions from generated code, one by one or on arrays.

A function gets fresh values, so whatever it does to its arguments changes nothing else; one that is proven to change
nothing gets them as they are. A call of an immutable or stable function is remembered by its arguments for the length
of one run; the memo is bounded. What comes back is converted to a value of the language.

What happens per call beside the function decides the speed of a search. Generated code therefore makes the keys of
arguments itself where one serves for many calls: that of the state for all steps, that of an element for all states.

A function that takes arrays gets one array per argument for a block of rows, and gives one element for each row. The
code of a query is cut where it is called: the part before gives its rows with the arguments, the part after takes them
with the values, a block at a time. A block that fails is made smaller, down to one row, whose failure the script sees
if it comes to that row. In a search the first call for a state makes those for all its elements.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import count, islice, starmap
from marshal import dumps, loads
from types import NoneType
from typing import TYPE_CHECKING, Any, TypeAlias, TypeVar

from ss2sql.errors import Error, ExecutionError, Stopped
from ss2sql.frontend.user_functions import UserFunction
from ss2sql.language import plan
from ss2sql.language.conversion import format_value, is_marshalled_value, is_shallow_list_value
from ss2sql.language.plan_traversal import is_array_call, list_parts, walk
from ss2sql.language.values import SCALARS, convert_value, copy_deep, copy_for_python
from ss2sql.runtime.run.run_state import FailedCall, Run, keep_bounded
from ss2sql.runtime.sqlite.interning import Interning

if TYPE_CHECKING:
    import numpy


BLOCK = 8_192  # rows of a block: NumPy's 20 us for a call are then 2 ns for a row
FIRST = 16  # of a query that may end early
ROOM = 16 * BLOCK  # what a memory has to hold, so that no result is forgotten before its row comes
NUMBERS = (float, int, bool)

Arguments: TypeAlias = tuple[Any, ...]
Kinds: TypeAlias = tuple[type, ...]
Guards: TypeAlias = tuple[tuple[plan.Expr, bool], ...]  # conditions, and what the truth of each has to be
T = TypeVar("T")


# --- blocks --------------------------------------------------------------------------------------------


def has_calls_without_arrays(*nodes: Any) -> bool:
    """Whether a function of the user or of a world is called that does not take arrays, which LIMIT bounds."""
    calls = (part for node in nodes for part in walk(node) if isinstance(part, plan.Call))
    return any(not (call.function.builtin or call.function.vectorized) for call in calls)


def list_guarded_calls(node: Any, guards: Guards = ()) -> Iterator[tuple[plan.Call, Guards]]:
    """The calls of functions that take arrays, arguments first, each with the conditions under which it is made.

    Those of queries inside are left out, and those in what aggregates are computed of.
    """
    match node:
        case plan.And(parts=parts) | plan.Or(parts=parts):
            for part in parts:
                yield from list_guarded_calls(part, guards)
                guards = (*guards, (part, isinstance(node, plan.And)))
        case plan.If(condition=condition, then=then, otherwise=otherwise):
            yield from list_guarded_calls(condition, guards)
            for truth, branch in ((True, then), (False, otherwise)):
                for part in branch:
                    yield from list_guarded_calls(part, (*guards, (condition, truth)))
        case plan.Query() | plan.Aggregate():
            return
        case _:
            for part in list_parts(node):
                yield from list_guarded_calls(part, guards)
            if is_array_call(node):
                yield node, guards


def iterate_blocks(rows: Iterable[T], size: int) -> Iterator[list[T]]:
    """Lists of rows, which grow from `size`; of 1 they stay, so that no row is evaluated before it is wanted.

    What a row raises is raised after those before it.
    """
    rest, failure = iter(rows), None
    while True:
        block: list[T] = []
        try:
            block.extend(islice(rest, size))
        except Stopped:
            raise
        except Exception as error:
            failure = error
        if block:
            yield block
        if failure is not None:
            raise failure
        if not block:
            return
        size = size if size == 1 else min(4 * size, BLOCK)


def call_in_blocks(
    function: ArrayFunction, rows: Iterable[tuple[T, Arguments | None]], size: int | None
) -> Iterator[tuple[T, Any]]:
    """Each row with what the function gives for the arguments that come with it; None where none do.

    `size` is that of the first block, by default of all.
    """
    for block in iterate_blocks(rows, size or BLOCK):
        given = [arguments for _, arguments in block]
        called = [arguments for arguments in given if arguments is not None]
        answers = function.call_rows(called)
        if len(called) < len(given):
            answers = _fill_up(given, answers)
        yield from zip([row for row, _ in block], answers, strict=True)


def _fill_up(given: Sequence[Arguments | None], answers: Iterable[Any]) -> Iterator[Any]:
    rest = iter(answers)
    return (None if arguments is None else next(rest) for arguments in given)


# --- arrays --------------------------------------------------------------------------------------------


def make_call_array(values: Sequence[Any], kind: type) -> numpy.ndarray[Any, Any]:
    """The values of one argument; `kind` is object for all but numbers."""
    import numpy

    if kind is object:
        array = numpy.empty(len(values), object)
        for index, value in enumerate(values):  # NumPy would make a table of lists of one length
            array[index] = copy_for_python(value)
        return array
    return numpy.array(values, {float: numpy.float64, int: numpy.int64, bool: numpy.bool_}[kind])


def list_array_call_values(result: Any, number: int, name: str) -> list[Any]:
    """The elements of what a function returned for a number of rows. Raises ExecutionError X012."""
    import numpy

    if not isinstance(result, (list, tuple, numpy.ndarray, numpy.generic)) and hasattr(result, "__array__"):
        result = numpy.asarray(result)
    if isinstance(result, numpy.ndarray) and result.ndim:
        items: list[Any] = list(result) if result.dtype.kind in "mM" else result.tolist()  # dates would lose their unit
    elif isinstance(result, (list, tuple)):
        items = list(result)
    else:
        alone = isinstance(result, (numpy.generic, numpy.ndarray))
        raise _build_array_call_error(name, number, format_value(result.tolist() if alone else result))
    if len(items) != number:
        raise _build_array_call_error(name, number, "1 element" if len(items) == 1 else f"{len(items):,} elements")
    return items


def _build_array_call_error(name: str, number: int, got: str) -> ExecutionError:
    rows = "1 row" if number == 1 else f"{number:,} rows"
    hints = ("return an array or a list with one element for each row, or register it without vectorized=True",)
    return ExecutionError("X012", f"the function '{name}' takes arrays; for {rows} it returned {got}", hints=hints)


def are_array_numbers(result: Any) -> bool:
    """Whether the elements of an array are numbers of the language, which need no look at each."""
    numpy = sys.modules["numpy"]
    if type(result) is not numpy.ndarray or result.ndim != 1:
        return False
    return bool(result.dtype == numpy.int64 or (result.dtype == numpy.float64 and numpy.isfinite(result).all()))


def find_call_array_kinds(arguments: Arguments) -> Kinds:
    """For each argument float, int, bool, or object for all else."""
    return tuple([kind if kind in NUMBERS else object for kind in map(type, arguments)])


def call_for_rows(function: UserFunction, rows: Sequence[Arguments]) -> Any:
    """What the function returns for several rows, whose numbers are of one kind."""
    kinds = find_call_array_kinds(rows[0])
    return function.function(*map(make_call_array, zip(*rows, strict=True), kinds))


def make_row_call_function(function: UserFunction) -> UserFunction:
    """The same function called row by row, for where nothing is known of the rows that come."""

    def call(*arguments: Any) -> Any:
        return list_array_call_values(call_for_rows(function, [arguments]), 1, function.name)[0]

    return replace(function, function=call, vectorized=False)


# --- calls ---------------------------------------------------------------------------------------------


class ObjectKey(bytes):
    """The key of arguments with objects inside."""


class ArrayFunction:
    """The calls of one function in one run, with a memory of their own."""

    def __init__(self, function: UserFunction, run: Run, memo_limit: int) -> None:
        self.function = function
        self.name = function.name
        self.run = run
        self.limit = max(memo_limit, ROOM)
        self.memo: dict[Any, Any] = {}
        self.objects = Interning()

    def __call__(self, *arguments: Any) -> Any:
        key = self._make_key(arguments)
        answer = self.memo.get(key, self)
        if answer is self:
            self._call_block([key], [arguments])
            answer = self.memo[key] if self._can_remember(key) else self.memo.pop(key)
        else:
            self.run.stats.remembered[self.name] += 1
        if type(answer) is FailedCall:
            raise answer.error
        return answer

    def call_ahead(self, given: Callable[[], Iterable[Arguments]], *arguments: Any) -> Any:
        """A call; where it is not known yet, all those with the arguments that are given are made with it."""
        if self._make_key(arguments) not in self.memo:
            rows = list[Arguments]()
            try:
                rows.extend(given())
            except Stopped:
                raise
            except Exception:  # it fails again where the script comes to it, if it does
                pass
            self._call_unknown(rows)
        return self(*arguments)

    def call_rows(self, rows: Sequence[Arguments]) -> Iterable[Any]:
        """What the function gives for several rows; what it raises for one is raised when that is read."""
        keys, unknown = self._call_unknown(rows)
        answers = [self.memo.get(key, self) for key in keys]
        if not {ArrayFunction, FailedCall}.isdisjoint(map(type, answers)):
            return starmap(self, rows)
        self.run.stats.remembered[self.name] += len(rows) - unknown
        return answers

    def _call_unknown(self, rows: Sequence[Arguments]) -> tuple[list[Any], int]:
        """Makes the calls for rows that are not known; gives the keys of all, and the number of those calls."""
        try:
            keys: list[Any] = [dumps(row, 2) for row in rows]
        except ValueError:
            keys = list(map(self._make_key, rows))
        unknown = {key: row for key, row in zip(keys, rows, strict=True) if key not in self.memo}
        if self.function.inferred:
            unknown = {key: row for key, row in unknown.items() if self._can_remember(key)}
        for block in _split_call_blocks(unknown):
            self._call_block(*block)
        return keys, len(unknown)

    def _make_key(self, arguments: Arguments) -> Any:
        try:
            return dumps(arguments, 2)
        except ValueError:  # there are objects inside
            return ObjectKey(self.objects.encode(list(arguments)))

    def _can_remember(self, key: Any) -> bool:
        """Whether a result may be remembered: what was proved of plain data says nothing of objects."""
        return type(key) is bytes or not self.function.inferred

    def _call_block(self, keys: Sequence[Any], rows: Sequence[Arguments]) -> None:
        """Makes the calls of rows with numbers of one kind; ends where one fails."""
        first, size = 0, BLOCK
        while first < len(rows):
            part = rows[first : first + size]
            part_keys, size = keys[first : first + size], len(part)
            self.run.check()  # a slow function must not keep a timeout waiting
            self.run.stats.blocks[self.name] += 1
            try:
                result = call_for_rows(self.function, part)
            except Stopped:
                raise
            except Exception as error:
                if size > 1:
                    size = max(size // 8, 1)
                    continue
                self.run.stats.calls[self.name] += 1
                keep_bounded(self.memo, part_keys[0], FailedCall(error), self.limit)
                return
            self.run.stats.calls[self.name] += size
            self._keep_result(part_keys, result)
            first, size = first + size, min(4 * size, BLOCK)

    def _keep_result(self, keys: Sequence[Any], result: Any) -> None:
        try:
            elements = list_array_call_values(result, len(keys), self.name)
        except Error as error:
            elements = [FailedCall(error)] * len(keys)
        if are_array_numbers(result) and len(self.memo) + len(elements) < self.limit:
            self.memo.update(zip(keys, elements, strict=True))
            return
        giver = f"the function '{self.name}'"
        for key, element in zip(keys, elements, strict=True):
            try:
                answer = element if type(element) is FailedCall else convert_value(element, giver)
            except Error as error:
                answer = FailedCall(error)
            keep_bounded(self.memo, key, answer, self.limit)


def _split_call_blocks(rows: dict[Any, Arguments]) -> list[tuple[list[Any], list[Arguments]]]:
    """Blocks of keys and rows with numbers of one kind in each column."""
    if all(len(set(map(type, column))) == 1 for column in zip(*rows.values(), strict=True)):
        return [(list(rows), list(rows.values()))]
    blocks: dict[Kinds, tuple[list[Any], list[Arguments]]] = defaultdict(lambda: ([], []))
    for key, arguments in rows.items():
        keys, own = blocks[find_call_array_kinds(arguments)]
        keys.append(key)
        own.append(arguments)
    return list(blocks.values())


# --- calls of the user's functions from generated code
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
            if copied and run.cached_steps is None:  # the bytes of a key are a fresh value but for the reading of them
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
                value = call(copies) if run.cached_steps is None else run.cached_steps.make_call(function, call, copies)
            except Exception as error:
                if not isinstance(error, Stopped):
                    keep_bounded(memo, key, FailedCall(error), limit)
                raise
            return keep_value(key, value)

        def keep_value(key: Hashable, value: Any) -> Any:
            keep_bounded(memo, key, (value,), limit)
            return value

        def adopt(arguments: tuple[Any, ...], answer: Any) -> None:
            self.foretold = True
            if run.cached_steps is not None:
                run.cached_steps.note_call(function, arguments, answer)
            keys = tuple(map(make_call_key, arguments))
            if are_call_arguments_plain(arguments):
                key: Hashable = arguments
            elif NO_KEY not in keys:
                key = b"".join(keys)
            elif not function.inferred:
                key = (objects.encode(list(arguments)),)
            else:
                return
            keep_bounded(memo, key, answer if type(answer) is FailedCall else (answer,), limit)

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

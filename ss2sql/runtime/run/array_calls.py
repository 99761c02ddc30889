"""Functions that take arrays: one array per argument for a block of rows, one element of the result for each row.

Rows are evaluated one by one. Before a block of them is, each of its rows is tried: a call that is not known yet waits
and ends the attempt at its row, then one call is made for all that wait. What it gives is kept in the memory of calls,
where the rows find it. A block that fails is made smaller, down to one row, whose failure the script sees if it comes
to that row. So nothing may be tried that has an effect; what an attempt raises is raised again where its row is
evaluated.
"""

from __future__ import annotations

import sys
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import islice
from marshal import dumps
from typing import TYPE_CHECKING, Any, Generic, TypeAlias, TypeGuard, TypeVar

from ss2sql.errors import Error, ExecutionError, Stopped
from ss2sql.frontend.user_functions import UserFunction
from ss2sql.language import plan
from ss2sql.language.conversion import format_value
from ss2sql.language.plan_traversal import list_parts, walk
from ss2sql.language.values import convert_value, copy_for_python
from ss2sql.runtime.run.call_memory import FailedCall, forget_older_half
from ss2sql.runtime.run.run_state import Run
from ss2sql.runtime.sqlite.interning import Interning

if TYPE_CHECKING:
    import numpy

BLOCK = 8_192  # rows of a block: NumPy's 20 us for a call are then 2 ns for a row
FIRST = 16  # of a query that may end early
ROOM = 16 * BLOCK  # what a memory has to hold, so that no result is forgotten before its row comes
NUMBERS = (float, int, bool)

Arguments: TypeAlias = tuple[Any, ...]
Kinds: TypeAlias = tuple[type, ...]
T = TypeVar("T")


class PendingError(BaseException):
    """The result of a call is not known yet."""


class EnoughError(PendingError):
    """As many calls wait as make a block; the row makes more by itself."""


# --- blocks --------------------------------------------------------------------------------------------


def is_array_call(node: Any) -> TypeGuard[plan.Call]:
    return isinstance(node, plan.Call) and node.function.vectorized


def count_array_calls(*nodes: Any) -> int:
    """How many calls of functions that take arrays stand in parts of a plan."""
    return sum(is_array_call(part) for node in nodes for part in walk(node))


def has_calls_without_arrays(*nodes: Any) -> bool:
    """Whether a function of the user or of a world is called that does not take arrays, which LIMIT bounds."""
    calls = (part for node in nodes for part in walk(node) if isinstance(part, plan.Call))
    return any(not (call.function.builtin or call.function.vectorized) for call in calls)


def list_certain_calls(node: Any) -> Iterator[plan.Call]:
    """Those that are made whenever a part of a plan is evaluated, arguments first."""
    match node:
        case plan.And(parts=(first, *_)) | plan.Or(parts=(first, *_)) | plan.If(condition=first):
            yield from list_certain_calls(first)
        case plan.Query():
            return
        case _:
            for part in list_parts(node):
                yield from list_certain_calls(part)
            if is_array_call(node):
                yield node


class Blocks(Generic[T]):
    """Blocks of rows, which grow from `size`; of 1 they stay, so that no row is evaluated before it is wanted."""

    def __init__(self, rows: Iterable[T], size: int) -> None:
        self.rows, self.size = iter(rows), size
        self.error: Exception | None = None

    def collect_block(self, block: list[T]) -> list[T]:
        """The block with more rows; without any at the end. What a row raises is raised after those before it."""
        size = self.size
        self.size = size if size == 1 else min(4 * size, BLOCK)
        try:
            block.extend(islice(self.rows, max(size - len(block), 0)))
        except Stopped:
            raise
        except Exception as error:
            self.error = error
        if self.error is not None and not block:
            raise self.error
        return block


def iterate_call_blocks(run: Run, blocks: Blocks[T], try_item: Callable[[T], object], rounds: int) -> Iterator[T]:
    """The items of blocks, each after the calls were made that `try_item` makes of it."""
    rest = list[T]()
    while block := blocks.collect_block(rest):
        number = call_ahead(run, block, try_item, rounds)
        yield from block[:number]
        rest = block[number:]


def call_ahead(run: Run, items: Sequence[T], try_item: Callable[[T], object], rounds: int) -> int:
    """Makes the calls that `try_item` makes of the first items, and gives how many these are.

    A call whose arguments another call gives is found in the next of the `rounds`.
    """
    outer, number, left = run.waiting, 0, list[T]()
    waiting = run.waiting = {} if outer is None else outer
    try:
        while number < len(items) and len(waiting) < BLOCK:
            if _is_array_call_waiting(try_item, items[number]):
                left.append(items[number])
            number += 1
        if outer is not None:
            if number < len(items):
                raise EnoughError
            if left:
                raise PendingError
        for more in reversed(range(rounds)):
            if not (left and _make_array_calls(waiting) and more):
                break
            left = [item for item in left if _is_array_call_waiting(try_item, item)]
    finally:
        run.waiting = outer
    return number


def _is_array_call_waiting(try_item: Callable[[T], object], item: T) -> bool:
    """Whether a call waits that an item makes."""
    try:
        try_item(item)
    except EnoughError:
        return False
    except PendingError:
        return True
    except Stopped:
        raise
    except Exception:
        return False
    return False


def _make_array_calls(waiting: dict[Any, Arguments]) -> bool:
    """Makes the calls that wait; gives whether all of them are known now."""
    functions: dict[ArrayFunction, dict[Any, Arguments]] = defaultdict(dict)
    for (function, key), arguments in waiting.items():
        functions[function][key] = arguments
    waiting.clear()
    blocks = [(function, block) for function, rows in functions.items() for block in _split_call_blocks(rows)]
    known = [function.call_block(*block) for function, block in blocks]
    return bool(known) and all(known)


class StagedRows:
    """The generator of a query from those of its parts: each takes the rows of the one before, in blocks.

    With each stands a function, whose arguments the part before it gives with each row, or how many calls it makes
    itself: it has made them for a row when it gives the first of its own. `noticed`: functions are called that take no
    arrays, which LIMIT bounds.
    """

    def __init__(self, run: Run, noticed: bool, first: Callable[..., Any], *stages: Any) -> None:
        self.run, self.noticed, self.first, self.stages = run, noticed, first, stages

    def __call__(self, *outer: Any) -> Any:
        return self.find_rows(outer, limited=False)

    def find_rows(self, outer: tuple[Any, ...], limited: bool) -> Any:
        """The rows, of which LIMIT may cut some off where they are `limited`."""
        size = BLOCK if not limited and self.run.max_rows is None else 1 if limited and self.noticed else FIRST
        found = self.first(*outer)
        for stage, how in self.stages:
            if isinstance(how, ArrayFunction):
                found = _iterate_array_calls(how, Blocks(found, size))
            elif how:
                attempt = _make_array_call_attempt(stage, outer)
                found = iterate_call_blocks(self.run, Blocks[Any](found, size), attempt, how)
            found = stage(*outer, found)
        return found


def _make_array_call_attempt(stage: Callable[..., Any], outer: tuple[Any, ...]) -> Callable[[Any], object]:
    return lambda row: next(stage(*outer, (row,)), None)


def _iterate_array_calls(function: ArrayFunction, blocks: Blocks[tuple[Any, Arguments]]) -> Iterator[Any]:
    """Each row with what the function gives for the arguments that come with it."""
    while block := blocks.collect_block([]):
        answers = function.call_rows([arguments for _, arguments in block])
        if answers is not None:
            yield from zip([row for row, _ in block], answers, strict=True)
        else:
            for row, arguments in block:
                yield row, function(*arguments)


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
            if self.run.waiting is not None:
                if self._can_remember(key):
                    self.run.waiting[self, key] = arguments
                raise PendingError
            self.call_block([key], [arguments])
            answer = self.memo[key] if self._can_remember(key) else self.memo.pop(key)
        elif self.run.waiting is None:
            self.run.stats.remembered[self.name] += 1
        if type(answer) is FailedCall:
            raise answer.error
        return answer

    def call_ahead(self, given: Callable[[], Iterable[Arguments]], *arguments: Any) -> Any:
        """A call; where it is not known yet, all those with the arguments that are given are made with it."""
        try:
            answer = self.memo.get(dumps(arguments, 2), self)
        except ValueError:  # there are objects inside
            answer = self.memo.get(self._make_key(arguments), self)
        if answer is self:
            self._call_given(given)
        elif type(answer) is not FailedCall and self.run.waiting is None:
            self.run.stats.remembered[self.name] += 1
            return answer
        return self(*arguments)

    def _call_given(self, given: Callable[[], Iterable[Arguments]]) -> None:
        rows = list[Arguments]()
        waiting, self.run.waiting = self.run.waiting, None
        try:
            rows.extend(given())
        except Stopped:
            raise
        except Exception:  # it fails again where the script comes to it, if it does
            pass
        finally:
            self.run.waiting = waiting
        self.call_rows(rows, made=True)

    def call_rows(self, rows: Sequence[Arguments], made: bool = False) -> list[Any] | None:
        """What the function gives for several rows; None where that of some is not known, or an error.

        Calls of an attempt wait, unless they are to be `made`.
        """
        memo = self.memo
        try:
            keys = [dumps(row, 2) for row in rows]
        except ValueError:
            keys = list(map(self._make_key, rows))
        unknown = {key: row for key, row in zip(keys, rows, strict=True) if key not in memo}
        if self.function.inferred:
            unknown = {key: row for key, row in unknown.items() if type(key) is bytes}
        if unknown and not made and self.run.waiting is not None:
            self.run.waiting.update(((self, key), row) for key, row in unknown.items())
            raise PendingError
        known = [self.call_block(*block) for block in _split_call_blocks(unknown)]
        if made:
            return None
        answers = [memo.get(key, self) for key in keys]
        if not all(known) or not {ArrayFunction, FailedCall}.isdisjoint(map(type, answers)):
            return None
        self.run.stats.remembered[self.name] += len(rows) - len(unknown)
        return answers

    def _make_key(self, arguments: Arguments) -> Any:
        try:
            return dumps(arguments, 2)
        except ValueError:  # there are objects inside
            return ObjectKey(self.objects.encode(list(arguments)))

    def _can_remember(self, key: Any) -> bool:
        """Whether a result may be remembered: what was proved of plain data says nothing of objects."""
        return type(key) is bytes or not self.function.inferred

    def call_block(self, keys: Sequence[Any], rows: Sequence[Arguments]) -> bool:
        """Makes the calls of rows with numbers of one kind; gives whether all are known: it ends where one fails."""
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
                self._keep_answer(part_keys[0], FailedCall(error))
                return False
            self.run.stats.calls[self.name] += size
            self._keep_result(part_keys, result)
            first, size = first + size, min(4 * size, BLOCK)
        return True

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
                self._keep_answer(key, element if type(element) is FailedCall else convert_value(element, giver))
            except Error as error:
                self._keep_answer(key, FailedCall(error))

    def _keep_answer(self, key: Any, answer: Any) -> None:
        if len(self.memo) >= self.limit:
            forget_older_half(self.memo)
        self.memo[key] = answer


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

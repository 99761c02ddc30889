"""Functions of SQL: their names, the callbacks of the user's and the built-in ones, and helpers of the SQL of lowering.

What happens per call decides the speed of a search, so the way of a remembered call is as short as it can be:
0.2 us from SQL and back. The helpers build, take apart and collect interned values.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from itertools import starmap
from marshal import dumps, loads
from operator import itemgetter
from types import NoneType
from typing import TYPE_CHECKING, Any, NoReturn, TypeAlias

from ss2sql.errors import Error, Stopped, note_place_on_exception
from ss2sql.frontend.user_functions import UserFunction
from ss2sql.language.conversion import read_column
from ss2sql.language.kinds import Kind
from ss2sql.language.operations import GROUPS, OPERATIONS
from ss2sql.language.rows import Table
from ss2sql.language.values import convert_value
from ss2sql.lowering.sql_query import SQLITE_FUNCTIONS
from ss2sql.runtime.representations.shape import as_set
from ss2sql.runtime.run.run_state import CarriedStopError, FailedCall, keep_bounded
from ss2sql.runtime.sqlite.interning import Interning, OtherFormError
from ss2sql.runtime.sqlite.list_elements import UNAMBIGUOUS_TYPES, ElementColumns, build_callback_columns
from ss2sql.runtime.sqlite.search_functions import FUNCTIONS as SEARCH_FUNCTIONS
from ss2sql.vtables.frames import Frame, list_source_elements

if TYPE_CHECKING:
    from ss2sql.runtime.sqlite.executor import SqliteExecution
    from ss2sql.runtime.sqlite.list_elements import SqliteElementCalls

NO_LIMIT = 2**63  # more rows than any query has
_NUMBERS = frozenset({int, float, NoneType})


def make_list_function(interning: Interning, *items: Any) -> Any:
    """`list(a, b)`: a list literal."""
    return interning.encode_made(list(map(interning.decode, items)))


def make_record_function(interning: Interning, *pairs: Any) -> Any:
    """`record('name', value, ...)`: a row as a dict."""
    return interning.encode_made(dict(zip(pairs[::2], map(interning.decode, pairs[1::2]), strict=True)))


def make_sequence_function(interning: Interning, *values: Any) -> Any:
    """`in_turn(a, b)`: b, after a has been evaluated."""
    return values[-1]


def make_sql_dict_key(interning: Interning, value: Any) -> Any:
    """`as_key(a)`: the same SQL value for all values that equal a, for the equality of SQLite."""
    return interning.make_key(value)


SCALAR_FUNCTIONS: dict[str, Callable[..., Any]] = {
    "list": make_list_function,
    "record": make_record_function,
    "in_turn": make_sequence_function,
    "as_key": make_sql_dict_key,
}


def intern_element_columns(
    interning: Interning, value: Any, columns: tuple[str, ...], lasting: bool = False
) -> ElementColumns:
    """The elements of a source's value as columns of SQL values: the elements themselves, then their `columns`.

    `lasting`: nobody changes the value.
    """
    elements = interning.decode(value)
    encode = interning.encode
    if isinstance(elements, Frame):
        return _intern_frame_columns(interning, value, elements, columns)
    items = list_source_elements(elements)
    dicts: bool | None = None  # whether they are; nobody knows yet

    def make_column(number: int) -> list[Any]:
        nonlocal dicts
        if number and dicts is None:
            dicts = set(map(type, items)) == {dict}
        parts = _read_element_column(items, columns[number - 1], dicts is True) if number else items
        if _NUMBERS.issuperset(map(type, parts)):  # which are SQL values as they are
            return parts
        encoded = list(map(encode, parts))
        if lasting and not number:
            interning.keep_values(encoded, parts)
        return encoded

    return ElementColumns(value, len(items), len(columns) + 1, make_column)


def _read_element_column(items: list[Any], name: str, dicts: bool) -> list[Any]:
    """A column of elements, with None where one lacks it; of 10,000 dicts it takes 0.15 ms, one by one 3 ms."""
    if dicts:
        try:
            return list(map(itemgetter(name), items))
        except KeyError:
            return [item.get(name) for item in items]
    return [_intern_element_part(item, name) for item in items]


def _intern_frame_columns(interning: Interning, handle: Any, frame: Frame, columns: tuple[str, ...]) -> ElementColumns:
    """The columns of a data frame as they are read; numbers and texts are SQL values already."""

    def make_column(number: int) -> list[Any]:
        if number == 0:
            return list(map(interning.encode, frame.list_dicts()))
        column = frame.columns[columns[number - 1]]
        return column.values if column.type.is_only(_UNENCODED_KINDS) else list(map(interning.encode, column.values))

    return ElementColumns(handle, frame.length, len(columns) + 1, make_column)


_UNENCODED_KINDS = Kind.NONE | Kind.INT | Kind.FLOAT | Kind.STR


def _intern_element_part(element: Any, name: str) -> Any:
    """The column of an element; that of a list is one of its own elements, see lowering/union_branches.py."""
    if type(element) is list:
        return element[int(name.removeprefix("this_"))]
    return read_column(element, name, None)


class Collect:
    """`collect(a, b)`: all values, row after row, as one list."""

    def __init__(self, interning: Interning) -> None:
        self.interning = interning
        self.values: list[Any] = []
        self.room = interning.sizes.get_max_list_rows()

    def step(self, *row: Any) -> None:
        if self.check_row_room():
            self.values.extend(map(self.interning.decode, row))

    def check_row_room(self) -> bool:
        """Whether one more row is none too many. What raises here would not end the statement, so the run does."""
        self.room -= 1
        if self.room < 0:
            self.interning.sizes.refused = self.interning.sizes.build_row_count_error()
        return self.room >= 0

    def final(self) -> Any:
        """The value. What this raises ends no statement: apsw goes on and complains of the exception that is under way.

        It calls no function of the user any more. The run raises what was refused in place of that complaint.
        """
        sizes = self.interning.sizes
        try:
            if sizes.refused is not None:
                raise sizes.refused
            return self.value()
        except Exception as error:
            sizes.refused = error
            raise

    def value(self) -> Any:
        return self.interning.encode_made(self.values)


class CollectRows(Collect):
    """`collect_rows(a, b)`: a list of rows, each a list."""

    def step(self, *row: Any) -> None:
        if self.check_row_room():
            self.values.append(list(map(self.interning.decode, row)))


class CollectRecords(Collect):
    """`collect_records('a', a, 'b', b)`: a list of rows, each a dict."""

    def step(self, *pairs: Any) -> None:
        if self.check_row_room():
            self.values.append(dict(zip(pairs[::2], map(self.interning.decode, pairs[1::2]), strict=True)))


class CollectSet(CollectRows):
    """`collect_set(a, b)`: the different values; inside a script a set is a sorted list."""

    def value(self) -> Any:
        rows = [tuple(row) for row in self.values]
        return self.interning.encode_made(convert_value(as_set(Table((), rows)), "AS set"))


class CollectNothing(Collect):
    """`collect_nothing(a, b)`: the rows are evaluated, the value is None."""

    def __init__(self, interning: Interning) -> None:
        super().__init__(interning)
        self.room = NO_LIMIT if interning.sizes.rows is None else interning.sizes.rows

    def step(self, *row: Any) -> None:
        self.check_row_room()

    def value(self) -> Any:
        return None


class CollectValue(Collect):
    """`collect_value(a, b)`: a of the first row, after all rows have been evaluated; nobody keeps the others."""

    def step(self, *row: Any) -> None:
        if not self.values:
            self.values.append(row[0])

    def value(self) -> Any:
        return self.values[0] if self.values else None


def _make_aggregate_class(name: str) -> Callable[[Interning], Collect]:
    """`group_sum(value, place)` and its kin: the language's aggregates over a group."""

    class Aggregate(Collect):
        place = ""

        def step(self, value: Any, place: str) -> None:
            self.place = place
            self.values.append(self.interning.decode(value))

        def value(self) -> Any:
            return self.interning.encode(GROUPS[name].aggregate_group(self.values))

    return Aggregate


AGGREGATE_FUNCTIONS: dict[str, Callable[[Interning], Collect]] = {
    "collect": Collect,
    "collect_rows": CollectRows,
    "collect_records": CollectRecords,
    "collect_set": CollectSet,
    "collect_nothing": CollectNothing,
    "collect_value": CollectValue,
    **{f"group_{name}": _make_aggregate_class(name) for name in GROUPS},
}


# --- the names that functions of a session have in SQL
# Names that the SQL made by lowering uses for itself; a user's function of such a name gets another one in SQL.
RESERVED_NAMES = SQLITE_FUNCTIONS | {
    *("collect", "collect_nothing", "collect_records", "collect_rows", "collect_set", "collect_value"),
    *(f"group_{name}" for name in GROUPS),
    *("list", "record", "field"),
    *("truth", "in_turn", "recall", "remember", "elements", "search"),
    *("step_cost", "step_heuristic", "step_probability"),
    *("count_step", "expand", "next_number", "next_position", *SEARCH_FUNCTIONS),
}


def choose_function_names(functions: Mapping[str, Any]) -> dict[str, str]:
    """SQL names for registered functions: their own, but apart where SQL sees no difference or needs the name.

    The order of registration does not matter.
    """
    taken, names = (
        {word.lower() for word in RESERVED_NAMES} | {name.lower().replace(" ", "_") for name in OPERATIONS},
        {},
    )
    for name in sorted(functions, key=lambda word: (word.lower(), word)):
        candidate = stem = _shorten_sqlite_function(name)
        count = 1
        while candidate.lower() in taken and (name not in OPERATIONS or name in RESERVED_NAMES):
            count += 1
            candidate = f"{stem}_{count}"
        taken.add(candidate.lower())
        names[name] = candidate
    return names


def _shorten_sqlite_function(name: str) -> str:
    """A name that SQLite takes for a function, which has 255 bytes at most, with room for a number."""
    return name.encode()[:240].decode(errors="ignore")


# --- functions as SQL functions: those of the user, with fresh values and a memo, and the built-in ones
# Takes the arguments of several calls for Python code, and what gives them as SQL values; gives the calls' values.
CallBlock: TypeAlias = Callable[[Iterable[tuple[Any, ...]], Callable[[], Iterable[tuple[Any, ...]]]], list[Any]]
_MISSING = object()


class CallMemo:
    """The remembered results of one function, by its SQL arguments; the oldest go when there are too many.

    1 and 1.0 are one key of a dict but two arguments of a function, and so are 0.0 and -0.0: where there are numbers
    among the arguments, `exact` keeps the result by marshal's bytes of them, where a look costs 0.2 us. Handles and
    strings need no such care: their results are in `plain`, where it costs 0.1 us.

    In `exact` are also the lists of calls that stand in FROM, as tuples of elements, and what calls have raised, as a
    FailedCall: a statement that is run again must not call a second time. `calls` counts real calls, `hits` answers of
    the memo.
    """

    __slots__ = ("calls", "exact", "hits", "limit", "plain")

    def __init__(self, limit: int) -> None:
        self.plain: dict[Any, Any] = {}
        self.exact: dict[bytes, Any] = {}
        self.hits = 0
        self.calls = 0
        self.limit = limit

    def begin_execution(self) -> tuple[Any, ...]:
        """Empties the memo for one more execution and gives what it held, for `end_execution`."""
        outer = (self.plain, self.exact, self.calls, self.hits)
        self.plain, self.exact, self.calls, self.hits = {}, {}, 0, 0
        return outer

    def end_execution(self, outer: tuple[Any, ...]) -> tuple[int, int]:
        """Puts back what the memo held before, and gives the numbers of calls and of hits."""
        counts = self.calls, self.hits
        self.plain, self.exact, self.calls, self.hits = outer
        return counts

    def keep_result(self, arguments: tuple[Any, ...], result: Any) -> None:
        if type(result) not in _EXACT_RESULTS and UNAMBIGUOUS_TYPES.issuperset(map(type, arguments)):
            keep_bounded(self.plain, arguments, result, self.limit)
        else:
            keep_bounded(self.exact, dumps(arguments, 2), result, self.limit)


_EXACT_RESULTS = frozenset({NoneType, FailedCall, tuple})


class FunctionCallback:
    """What calls a function of the user for SQL. The memo is that of the innermost execution, whoever puts it there."""

    def __init__(self, function: UserFunction, memo: CallMemo, stack: list[SqliteExecution]) -> None:
        self.function = function
        self.memo = memo
        self.stack = stack
        self.remembers = function.volatility != "volatile"
        self.giver = function.giver
        self.call = self._make_sql_call()

    def _raise_through_sqlite(
        self, execution: SqliteExecution, arguments: tuple[Any, ...], error: Exception, result: Any
    ) -> NoReturn:
        """Raises what goes through SQLite for an exception of a call, and has it remembered where calls are."""
        if type(error) is OtherFormError:  # the statement is run again, but this call is not made again
            execution.interning.watched = frozenset()
            if self.remembers:
                self.memo.keep_result(arguments, execution.interning.encode_object(result, self.giver))
            raise error
        execution.failed = True
        name, passing = self.function.name, error
        spans = execution.calls.get(name, ())
        if isinstance(error, Error) and not isinstance(error, Stopped):  # of a world, or because a value is refused
            passing = error.with_span(spans[0] if spans else None)
        else:  # a function raised it, or an object that fails when it is looked at, such as a generator
            note_place_on_exception(error, name, spans)
            if isinstance(error, StopIteration):
                passing = CarriedStopError(error)
        if self.remembers:
            self.memo.keep_result(arguments, FailedCall(passing))
        if passing is error:
            raise error
        raise passing from None

    def can_remember(self, interning: Interning, arguments: Iterable[Any]) -> bool:
        """Whether calls with these are remembered: what was proved of plain data says nothing of other objects."""
        if not self.function.inferred:
            return True
        return all(type(value) is not bytes or value in interning.marshalled for value in arguments)

    def _make_sql_call(self) -> Callable[..., Any]:
        """What SQLite calls: a real call where no memory has its value, at 0.6 us beside the function itself."""
        memo, stack, giver, remembers = self.memo, self.stack, self.giver, self.remembers
        body, changes, name = self.function.function, self.function.changes, self.function.name

        def call_from_sql(*arguments: Any) -> Any:
            result: Any
            if memo.plain:
                result = memo.plain.get(arguments)
                if result is not None:
                    memo.hits += 1
                    return result
            execution = stack[-1]
            if memo.exact:
                result = memo.exact.get(dumps(arguments, 2), _MISSING)
                if type(result) is FailedCall:
                    execution.failed = True
                    raise result.error
                if type(result) is tuple:  # the call stands in FROM, too
                    result = execution.interning.encode(list(map(execution.interning.decode, result)))
                if result is not _MISSING:
                    memo.hits += 1
                    return result
            run, values = execution.run, arguments
            if bytes in map(type, arguments):
                convert = execution.interning.decode_copy if changes else execution.interning.decode_read_only
                values = tuple([convert(value) if type(value) is bytes else value for value in arguments])
            if run.interrupted or run.bounds.deadline is not None:
                run.check()  # a slow function must not keep a timeout waiting
            memo.calls += 1
            result = _MISSING
            try:
                result = body(*values)
                encoded = execution.interning.encode_object(result, giver)
                if (encoded is None or type(encoded) is str) and name in execution.truths:
                    raise OtherFormError  # SQLite would take it for false
            except Exception as reason:
                self._raise_through_sqlite(execution, arguments, reason, result)
            if remembers and self.can_remember(execution.interning, arguments):
                memo.keep_result(arguments, encoded)
            return encoded

        return call_from_sql

    def list_elements(self, execution: SqliteExecution, arguments: tuple[Any, ...]) -> ElementColumns:
        """The elements of what the function gives, for a table of SQL; a list is not made one SQL value."""
        memo, interning, giver = self.memo, execution.interning, self.giver
        key = dumps(arguments, 2)
        elements = memo.exact.get(key)
        if type(elements) is tuple:
            memo.hits += 1
            return build_callback_columns(elements, arguments)
        if arguments in memo.plain or key in memo.exact:  # called in another clause, too
            return intern_element_columns(interning, self.call(*arguments), ())
        run, result, encode = execution.run, _MISSING, interning.encode_object
        convert = interning.decode_copy if self.function.changes else interning.decode_read_only
        if run.interrupted or run.bounds.deadline is not None:
            run.check()
        memo.calls += 1
        remembers = self.remembers and self.can_remember(interning, arguments)
        try:
            result = self.function.function(*map(convert, arguments))
            if type(result) is list:
                kept: Any = tuple([encode(element, giver) for element in result])
                elements = kept
            else:
                kept = encode(result, giver)
                elements = tuple(intern_element_columns(interning, kept, ()).read_column(0))
        except Exception as reason:
            self._raise_through_sqlite(execution, arguments, reason, result)
        if remembers:
            memo.keep_result(arguments, kept)
        return build_callback_columns(elements, arguments)

    def call_in_blocks(self, execution: SqliteExecution) -> CallBlock:
        """What makes several calls and gives their values, which the caller remembers; 0.5 us each.

        It takes the arguments for Python code, and what gives them as SQL values.
        """
        memo, body, giver, run = self.memo, self.function.function, self.giver, execution.run
        encode, timed, call = execution.interning.encode_object, run.bounds.deadline is not None, self.call

        def call_block(values: Iterable[tuple[Any, ...]], reread: Callable[[], Iterable[tuple[Any, ...]]]) -> list[Any]:
            made: list[Any] = []
            if memo.plain or memo.exact:  # of an attempt before, or of calls elsewhere
                return list(starmap(call, reread()))
            result: Any = _MISSING
            try:
                for arguments in values:
                    if timed or run.interrupted:
                        run.check()
                    result = _MISSING
                    result = body(*arguments)
                    made.append(encode(result, giver))
            except Stopped:
                raise
            except Exception as error:
                memo.calls += 1
                rows = list(reread())
                for arguments, encoded in zip(rows, made, strict=False):
                    memo.keep_result(arguments, encoded)
                self._raise_through_sqlite(execution, rows[len(made)], error, result)
            finally:
                memo.calls += len(made)
            return made

        return call_block


class CompletedCalls:
    """The calls that a statement has made before it ended, as values of the language, by the names of functions."""

    def __init__(
        self, interning: Interning, memos: Mapping[str, CallMemo], element_calls: Iterable[SqliteElementCalls] = ()
    ) -> None:
        self._pool = interning
        self._known = [(name, {**memo.exact, **memo.plain}) for name, memo in memos.items()]
        self._element_calls = list(element_calls)

    def __iter__(self) -> Iterator[tuple[str, tuple[Any, ...], Any]]:
        """Each call: the function's name, the arguments, and the value or the FailedCall."""
        decode = self._pool.decode
        for name, results in self._known:
            for key, answer in results.items():
                arguments = loads(key) if type(key) is bytes else key
                yield name, tuple(map(decode, arguments)), self._decode_answer(answer)
        for made in self._element_calls:
            for name, arguments, answer in made:
                yield name, tuple(map(decode, arguments)), self._decode_answer(answer)

    def _decode_answer(self, answer: Any) -> Any:
        if type(answer) is tuple:
            return list(map(self._pool.decode, answer))
        if type(answer) is not FailedCall:
            return self._pool.decode(answer)
        return FailedCall(answer.error.args[0]) if type(answer.error) is CarriedStopError else answer


def make_builtin_callback(
    name: str, python: Callable[..., Any], stack: list[SqliteExecution], predicate: bool
) -> Callable[..., Any]:
    """A built-in function on values of the language; its last SQL argument is the place of the call."""

    makes = name in OPERATIONS and OPERATIONS[name].grows

    def call_builtin(*arguments: Any) -> Any:
        execution = stack[-1]
        run, interning = execution.run, execution.interning
        if run.interrupted or run.bounds.deadline is not None:
            run.check()
        try:
            make = interning.sizes.wrap_function(name, python) if makes else python
            *values, _ = arguments
            result = make(*(map(interning.decode, values) if bytes in map(type, values) else values))
            return int(result) if predicate else interning.encode(result)
        except Error as error:
            execution.failed = True
            raise error.with_span(execution.find_span(arguments[-1])) from error.__cause__

    if name in ("in", "not_in"):
        return _make_membership_callback(call_builtin, stack, name == "not_in")
    return call_builtin


def make_final_callback(aggregate: Any, execution: SqliteExecution) -> Callable[[], Any]:
    """The aggregate's `final`, whose errors get the place of its call."""
    final = aggregate.final

    def locate_errors() -> Any:
        try:
            return final()
        except Error as error:
            raise error.with_span(execution.find_span(aggregate.place)) from None

    return locate_errors


def _make_membership_callback(
    general: Callable[..., Any], stack: list[SqliteExecution], negated: bool
) -> Callable[..., Any]:
    """`in` or `not_in`: the elements of a list are put into a set once."""

    def contains_item(item: Any, container: Any, place: str) -> Any:
        execution = stack[-1]
        try:
            members = execution.members[container]
        except KeyError:
            return general(item, container, place)
        return (execution.interning.make_key(item) in members) is not negated

    return contains_item


class MemberCache(dict[Any, frozenset[Any]]):
    """The keys of the elements of lists, by the lists' handles. KeyError for what is no list or is tested first.

    To look through a list takes less than to make its keys, and one that grows in the state of a search is tested once.
    """

    def __init__(self, interning: Interning) -> None:
        self.interning = interning
        self.tested: set[bytes] = set()

    def __missing__(self, handle: Any) -> frozenset[Any]:
        if type(handle) is not bytes:
            raise KeyError
        if handle not in self.tested:
            self.tested.add(handle)
            raise KeyError
        value = self.interning.decode(handle)
        if type(value) is not list:
            raise KeyError
        members = self[handle] = frozenset(self.interning.make_key(self.interning.encode(item)) for item in value)
        return members

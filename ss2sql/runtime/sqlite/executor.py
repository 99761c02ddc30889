"""The SQLite executor: runs one lowered query on the session's connection and hands back its rows.

Functions are registered once per connection; what they need of the query that is running they find in
`Database.current`, the innermost `SqliteExecution`. A Python function that runs another script from inside a
query stacks a new one on top.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext
from functools import cached_property, partial
from itertools import islice
from marshal import dumps
from math import prod
from typing import TYPE_CHECKING, Any

import apsw

from ss2sql.errors import Error, Span, Stopped
from ss2sql.frontend.user_functions import UserFunction
from ss2sql.language import plan
from ss2sql.language.conversion import read_column
from ss2sql.language.operations import PREDICATES
from ss2sql.language.plan_traversal import walk
from ss2sql.language.rows import Row, Rows, check_row_limit, iterate_limited_rows
from ss2sql.language.values import get_truth
from ss2sql.lowering.sql_query import BlobValue, Bookkeeping, ListTable, Parameter, SqlQuery, get_builtin_name
from ss2sql.runtime.run.run_state import Run, check_cost, check_heuristic, check_probability, keep_bounded
from ss2sql.runtime.run.search_paths import SearchPaths
from ss2sql.runtime.sqlite.connections import CHECK_EVERY, READ_ERRORS, Authorizer, find_sqlite_run_error
from ss2sql.runtime.sqlite.interning import TRUE, Interning, OtherFormError, make_decoder, make_row_decoder
from ss2sql.runtime.sqlite.list_elements import (
    ColumnsFor,
    ElementColumns,
    ListModules,
    SqliteElementCalls,
    TableRequest,
)
from ss2sql.runtime.sqlite.search_functions import FUNCTIONS, SearchState, StepNumbers
from ss2sql.runtime.sqlite.sql_functions import (
    AGGREGATE_FUNCTIONS,
    SCALAR_FUNCTIONS,
    CallMemo,
    CompletedCalls,
    FunctionCallback,
    MemberCache,
    intern_element_columns,
    make_builtin_callback,
    make_final_callback,
)
from ss2sql.vtables.frames import Frame

if TYPE_CHECKING:
    from ss2sql.runtime.sqlite.virtual_table import WorldModules
    from ss2sql.vtables.reading import Readings, Snapshot

NO_LIMIT = 2**40
NO_CALLS: Mapping[str, Sequence[Span]] = {}


class SqliteExecution:
    """What the functions of one running statement share."""

    def __init__(
        self,
        run: Run,
        query: plan.Query | None = None,
        calls: Mapping[str, Sequence[Span]] = NO_CALLS,
        snapshot: Snapshot | None = None,
    ) -> None:
        self.run = run
        self.query = query
        self.calls = calls
        self.modules: dict[str, ListTable] = {}  # the lists that its statements walk
        self.element_calls: dict[str, SqliteElementCalls] = {}  # by the names of modules
        self.interning = Interning(run.sizes)
        self.members = MemberCache(self.interning)
        self.book = Bookkeeping()
        self.results: Callable[[], int] = int  # how many paths were found
        self.failed = False  # whether a function has raised
        self.truths: frozenset[str] = frozenset()  # functions whose values SQLite itself takes for true or false
        self.elements: dict[Any, ElementColumns] = {}
        self.memoized_values: dict[bytes, Any] = {}  # what was made of inner queries
        if snapshot is not None:
            self.readings = snapshot.copy_tables(run.host.memories.now, run.check)

    @cached_property
    def readings(self) -> Readings:
        """The tables of worlds that it reads."""
        from ss2sql.vtables.reading import Readings

        return Readings(self.run.host.memories.now, check=self.run.check)

    def keep_value(self, key: tuple[Any, ...], value: Any) -> Any:
        """Keeps a value for `recall`, by a key that tells 1 from 1.0."""
        keep_bounded(self.memoized_values, dumps(key, 2), value)
        return value

    def find_value_source(self) -> Span | None:
        """The place of the first source that is a value; a bad one is most likely this."""
        sources = (node for node in walk(self.query) if isinstance(node, plan.ValueSource)) if self.query else ()
        return next((source.span for source in sources), None)

    def find_span(self, place: str) -> Span | None:
        """The span of the call at a place `line:column` of the script."""
        for node in walk(self.query) if self.query is not None else ():
            for name in ("place", "span"):
                span = getattr(node, name, None)
                if isinstance(span, Span) and f"{span.line}:{span.column}" == place:
                    return span
        return None


class Database:
    """The connection of a session with everything registered that lowered queries need."""

    def __init__(self, connection: apsw.Connection, memo_limit: int, check_run: Callable[[], bool]) -> None:
        self.connection = connection
        self.guard = guard = Authorizer(connection)
        self.check_run = check_run  # SQLite calls it every so often
        self.stack: list[SqliteExecution] = []
        self.lists = ListModules(connection, self._open_table, self._make_element_calls)
        self.search = SearchState()
        self.memos: dict[str, CallMemo] = {}  # of each function of the user, for the execution that runs
        self.memo_limit = memo_limit
        self.sql_callbacks: dict[str, FunctionCallback] = {}  # of each function of the user
        self.registered: dict[str, UserFunction] = {}  # the same by their names in SQL
        for name, scalar in SCALAR_FUNCTIONS.items():
            guard.add_scalar(name, self._bind_interning(scalar))
        for name, factory in AGGREGATE_FUNCTIONS.items():
            guard.add_aggregate(name, self._wrap_factory(factory))
        for name, arguments in FUNCTIONS.items():
            guard.add_scalar(name, getattr(self.search, name), arguments)
        guard.add_scalar("reached", self.search.reached_value, 1)
        guard.add_scalar("improves", self.search.improves_value, 2)
        guard.add_scalar("on_path", self.search.is_value_on_path, 2)
        guard.add_scalar("enter_first", self.search.enter_first_row)
        guard.add_scalar("enter_best", self.search.enter_best_row)
        guard.add_scalar("next_number", self.search.numbers.next, 0)
        guard.add_scalar("count_step", self.search.trials.next_for_row, 1)
        guard.add_scalar("expand", self.search.expansions.next, 0)
        guard.add_scalar("expand", self.search.expand, 1)
        guard.add_scalar("next_position", StepNumbers().next, 0)  # of results that are put into groups
        guard.add_scalar("recall", lambda *key: self.stack[-1].memoized_values.get(dumps(key, 2)))
        guard.add_scalar("remember", lambda *values: self.stack[-1].keep_value(values[:-1], values[-1]))
        for name, check in (("cost", check_cost), ("heuristic", check_heuristic), ("probability", check_probability)):
            guard.add_scalar(f"step_{name}", self._make_weight_function(check), 2)
        guard.add_scalar("truth", self._call_truth, 1)
        self.register_builtin("field", read_column)
        for name, same in (("eq", True), ("ne", False)):
            guard.add_scalar(name, self._make_equality(same))
        connection.set_progress_handler(self._check_search, CHECK_EVERY)

    @cached_property
    def worlds(self) -> WorldModules:
        """The tables of worlds, registered with the connection."""
        from ss2sql.runtime.sqlite.virtual_table import WorldModules

        return WorldModules(self.connection, lambda: self.current)

    @property
    def current(self) -> SqliteExecution:
        return self.stack[-1]

    # --- registration ----------------------------------------------------------------------------------

    def _bind_interning(self, scalar: Callable[..., Any]) -> Callable[..., Any]:
        stack = self.stack
        return lambda *arguments: scalar(stack[-1].interning, *arguments)

    def _wrap_factory(self, factory: Callable[[Interning], Any]) -> Callable[[], Any]:
        def make_aggregate() -> Any:
            execution = self.current
            aggregate = factory(execution.interning)
            if hasattr(aggregate, "place"):
                aggregate.final = make_final_callback(aggregate, execution)
            return aggregate

        return make_aggregate

    def _make_weight_function(self, check: Callable[[Any], Any]) -> Callable[..., Any]:
        """`step_cost(value, place)` and its kin: the value, if it is one."""
        stack = self.stack

        def check_weight(value: Any, place: str) -> Any:
            execution = stack[-1]
            try:
                weight = check(execution.interning.decode(value))
            except Error as error:
                execution.failed = True
                raise error.with_span(execution.find_span(place)) from None
            # A float where sums could leave the integers of SQLite; nothing but the order of steps shows it.
            return int(weight) if type(weight) is bool else weight if weight <= NO_LIMIT else float(weight)

        return check_weight

    def _call_truth(self, value: Any) -> int:
        """`truth(value)`: Python's truth as 0 or 1."""
        if type(value) is not bytes:
            return 1 if value else 0
        return value == TRUE or int(get_truth(self.current.interning.decode(value)))

    def _make_equality(self, same: bool) -> Callable[..., int]:
        """`eq` and `ne` compare handles where they can, without a look at the values."""
        stack = self.stack

        def compare_values(left: Any, right: Any, place: str) -> int:
            return int(stack[-1].interning.are_equal(left, right) is same)

        return compare_values

    def register_builtin(self, name: str, python: Callable[..., Any]) -> None:
        """A built-in function on values of the language; its last SQL argument is the place of the call."""
        self.guard.add_scalar(
            get_builtin_name(name), make_builtin_callback(name, python, self.stack, name in PREDICATES)
        )

    def register_user(self, function: UserFunction, sql_name: str) -> None:
        """Registers a function of the user, unless it is known. Raises apsw.BusyError if a statement calls another."""
        if self.registered.get(sql_name) is function:
            return
        memo = self.memos.setdefault(function.name, CallMemo(self.memo_limit))
        called = function
        if function.vectorized:
            from ss2sql.runtime.run.calls import make_row_call_function

            called = make_row_call_function(function)
        caller = FunctionCallback(called, memo, self.stack)
        self.guard.add_scalar(sql_name, caller.call)
        self.sql_callbacks[function.name], self.registered[sql_name] = caller, function

    def _open_table(self, name: str, arguments: tuple[Any, ...]) -> ElementColumns:
        execution = self.current
        table = execution.modules[name]
        if table.function is not None:
            return self.sql_callbacks[table.function].list_elements(execution, arguments)
        return self._encode_elements(execution, arguments[0], table)

    def _make_element_calls(self, name: str, request: TableRequest) -> ColumnsFor:
        """What gives the columns of a table that calls functions with the elements of a list."""
        execution = self.current
        calls = execution.element_calls.get(name)
        if calls is None:
            table = execution.modules[name]
            walk = partial(self._encode_elements, execution, table=table)
            calls = SqliteElementCalls(table, self.sql_callbacks, self.memo_limit, execution, walk, self.search)
            execution.element_calls[name] = calls
        return calls.make_column_reader(request)

    def _encode_elements(self, execution: SqliteExecution, value: Any, table: ListTable) -> ElementColumns:
        """The elements of a value as columns of SQL values; kept, for inner loops ask again and again."""
        key = (value, type(value), table.columns)
        found = execution.elements.get(key)
        if found is None:
            try:
                lasting = not execution.run.reads_user_objects
                found = intern_element_columns(execution.interning, value, table.columns, lasting)
            except Error as error:
                execution.failed = True
                raise error.with_span(execution.find_value_source()) from None
            if len(execution.elements) >= 10_000:
                execution.elements.clear()
            execution.elements[key] = found
        return found

    def _check_search(self) -> bool:
        """Ends the run where it has to end, or its search has tried too many steps."""
        if self.stack and self.connection.txn_state() != apsw.SQLITE_TXN_WRITE:
            run, query = self.current.run, self.current.query
            if run.progress is not None:
                run.progress.search = self.search
            if run.steps_left is not None and query is not None and query.search is not None:
                run.check_steps(self.search.count_generated(self.current.book, self.current.results()))
        return self.check_run()

    # --- execution -------------------------------------------------------------------------------------

    def execute(
        self,
        lowered: SqlQuery,
        run: Run,
        evaluate: Callable[[Parameter], Any],
        by_value: Callable[[], SqlQuery],
        sink: Rows,
        most: int | None = None,
    ) -> list[tuple[Row, Row]]:
        """Runs the statement and fills `sink` with its rows, or with its paths.

        `evaluate` gives the value of a parameter; `by_value` the statement to run where a value equals one of these in
        another form; `most` bounds the results of a search. Gives for each result its group values and the sort keys
        that SQL left over. Raises what a user's function raised, ExecutionError X009
        for an error of SQLite, X010 for more results than run.max_rows; run.calls_made are then the calls so far.
        """
        execution = SqliteExecution(run, lowered.query, lowered.calls, lowered.snapshot)
        foreign = lowered.calls or lowered.snapshot is not None  # as may_run_foreign_code says
        with self._push_execution(execution), nullcontext() if foreign else run.pause_collector():
            try:
                return self._try_execution(lowered, execution, evaluate, sink, most)
            except OtherFormError:
                sink.clear_rows()
                execution.interning.watched = frozenset()
                return self._try_execution(by_value(), execution, evaluate, sink, most)

    def open_cursor(self, lowered: SqlQuery, interning: Interning, evaluate: Callable[[Parameter], Any]) -> apsw.Cursor:
        """The rows of a statement that runs beside another one; the caller closes them."""
        return self.guard.execute_reading(lowered.text, self._bind_values(lowered, interning, evaluate))

    def _bind_values(
        self, lowered: SqlQuery, interning: Interning, evaluate: Callable[[Parameter], Any]
    ) -> dict[str, Any]:
        """The values to be bound, when the statement's virtual tables are there."""
        self.lists.register_modules(lowered.modules)
        if self.stack:
            self.current.modules.update(lowered.modules)
        return {
            parameter.name: _encode_parameter(
                interning, evaluate(parameter), parameter.flag, parameter.name in lowered.only_iterated
            )
            for parameter in lowered.parameters
        }

    @contextmanager
    def _push_execution(self, execution: SqliteExecution) -> Iterator[None]:
        """Makes the execution the innermost one, with empty memos, and adds up at its end what it has done."""
        run, memos = execution.run, {name: self.memos[name] for name in execution.calls}
        outer = {name: memo.begin_execution() for name, memo in memos.items()}
        search = self.search.save_state()
        self.stack.append(execution)
        try:
            with run.sizes.raise_refusals():
                yield
        except Stopped as stopped:
            raise stopped.with_span(execution.query.span if execution.query else None) from None
        except Exception as error:
            run.calls_made = CompletedCalls(execution.interning, memos, execution.element_calls.values())
            if not isinstance(error, READ_ERRORS) or (execution.failed and isinstance(error, UnicodeDecodeError)):
                raise  # it comes from a function of the user
            raise find_sqlite_run_error(error, run).with_span(
                execution.query.span if execution.query else None
            ) from error
        finally:
            self.stack.pop()
            for name, memo in memos.items():
                calls, hits = memo.end_execution(outer[name])
                run.stats.calls[name] += calls
                run.stats.remembered[name] += hits
            if execution.query is not None and execution.query.search is not None:
                self.search.add_counts(run.stats, execution.book, execution.results())
                run.overestimated |= self.search.overestimated
            self.search.restore_state(search)

    def _try_execution(
        self,
        lowered: SqlQuery,
        execution: SqliteExecution,
        evaluate: Callable[[Parameter], Any],
        sink: Rows,
        most: int | None,
    ) -> list[tuple[Row, Row]]:
        interning = execution.interning
        execution.book, execution.truths = lowered.bookkeeping, lowered.truths
        if lowered.query.search is not None and not lowered.plain_keys:
            interning.key_all_values()
        self.search.begin_search({} if lowered.plain_keys else interning.keys, lowered.bookkeeping.keyed)
        values = self._bind_values(lowered, interning, evaluate)
        interning.watched = frozenset(values[name] for name in lowered.plain)
        walked = [self._encode_elements(execution, values[name], ListTable(())) for name in execution.book.sources]
        self.search.steps_per_state = execution.book.arms * prod(elements.length for elements in walked)
        if _has_other_handle(interning, values):
            raise OtherFormError
        cursor = self.connection.cursor()
        try:
            late = lowered.late
            self.guard.execute_reading(lowered.text, values, cursor)
            plain, searches = lowered.plain_rows, lowered.query.gives_paths
            if (plain or not searches) and not lowered.keys and not lowered.orders:
                # The rows are all that is wanted. Plain ones, and ends of paths, are what SQLite gives as it is.
                found = islice(cursor if late is None else late.iterate_rows(execution.readings, cursor), most)
                rows = found if execution.run.max_rows is None else iterate_limited_rows(found, execution.run.max_rows)
                if not searches:
                    assert sink.rows is not None
                    execution.results = sink.rows.__len__
                    sink.rows.extend(
                        rows if plain or late is not None else map(make_decoder(interning, lowered.outputs), rows)
                    )
                    return [((), ())] * len(sink.rows)
                paths = self._iterate_paths(lowered, execution, sink, tuple)
                paths.add_results(rows)
                return [((), ())] * len(paths)
            return list(islice(self._read_results(lowered, execution, cursor, sink), most))
        finally:
            cursor.close(True)  # else an error that somebody keeps would keep the statement open, and the file locked

    def _iterate_paths(
        self, lowered: SqlQuery, execution: SqliteExecution, sink: Rows, decode: Callable[[Row], Row]
    ) -> SearchPaths:
        paths = sink.paths = SearchPaths(
            None if lowered.bookkeeping.all_results else self.search.get_kept_steps(), decode
        )
        execution.results = paths.__len__
        return paths

    def _read_results(
        self, lowered: SqlQuery, execution: SqliteExecution, cursor: apsw.Cursor, sink: Rows
    ) -> Iterator[tuple[Row, Row]]:
        interning = execution.interning
        shown = (*lowered.outputs, *lowered.keys, *lowered.orders)
        width, keys = len(lowered.outputs), len(lowered.outputs) + len(lowered.keys)
        decode, most = make_decoder(interning, shown), execution.run.max_rows
        if not lowered.query.gives_paths:
            assert sink.rows is not None
            execution.results = sink.rows.__len__
            for raw in cursor:
                row = decode(raw)
                sink.rows.append(row[:width])
                check_row_limit(len(sink.rows), most)
                yield row[width:keys], row[keys:]
            return
        paths = self._iterate_paths(
            lowered, execution, sink, make_row_decoder(interning, execution.book.parts or [0] * width)
        )
        for raw in cursor:
            row = decode(raw[2:])
            paths.add_result((*raw[:2], *row[:width]))
            check_row_limit(len(paths), most)
            yield row[width:keys], row[keys:]


def _has_other_handle(interning: Interning, values: Mapping[str, Any]) -> bool:
    """Whether a parameter equals one whose handle stands for all such values, in another form."""
    others = [value for value in values.values() if type(value) is bytes and value not in interning.watched]
    return any(interning.are_equal(value, watched) for value in others for watched in interning.watched)


def _encode_parameter(interning: Interning, value: Any, flag: bool = False, only_walked: bool = False) -> Any:
    if flag:
        return int(value)
    if only_walked and type(value) is list:
        return interning.encode_frame(value)  # as one value a list of 10,000 dicts takes a quarter of a query's time
    if isinstance(value, Frame):
        return interning.encode_frame(value)
    return value if type(value) is BlobValue else interning.encode(value)

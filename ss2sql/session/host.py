"""What a session holds and what its runs ask for, one thread at a time."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import field, replace
from functools import cache, cached_property, wraps
from typing import TYPE_CHECKING, Any, Concatenate, ParamSpec, TypeVar

import apsw

from ss2sql.errors import Error, ExecutionError, SessionError, Source
from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.resolve.resolver import resolve, resolve_eval
from ss2sql.frontend.resolve.scope import Catalog, UnknownNames
from ss2sql.frontend.syntax import ast
from ss2sql.frontend.syntax.ast import collect_syntax_columns
from ss2sql.frontend.syntax.parser import parse
from ss2sql.frontend.user_functions import UserFunction
from ss2sql.language import plan
from ss2sql.language.cancellation import retry_with_stack
from ss2sql.language.conversion import is_unreadable
from ss2sql.language.kinds import Type
from ss2sql.language.operations import OPERATIONS
from ss2sql.lowering.rewrites.rewrite_context import RewriteContext
from ss2sql.runtime.representations.shape import REPRESENTATIONS, Representations
from ss2sql.runtime.run.run_state import MEMO_LIMIT, Limits, Run, defer_keyboard_interrupt, pause_collector
from ss2sql.runtime.run.value_sizes import ValueSizes
from ss2sql.runtime.sqlite.connections import CHECK_EVERY, close_file, while_using_files
from ss2sql.runtime.sqlite.database_tables import STORED, Tables
from ss2sql.session.compiled_query import open_session_engine
from ss2sql.session.variables import (
    History,
    SessionFunctions,
    TemporalFile,
    Triggers,
    Variables,
    convert_clock_time,
)
from ss2sql.vtables import contract
from ss2sql.vtables.contract import QueryCaches

if TYPE_CHECKING:
    from inspect import Signature

    from ss2sql.lowering.flat import TableFilter
    from ss2sql.runtime.external.level_query import TableEngine
    from ss2sql.runtime.graph_cache.cached_steps import CachePolicy
    from ss2sql.runtime.graph_cache.graph_store import GraphStore
    from ss2sql.runtime.parallel.process_pool import ProcessPool
    from ss2sql.runtime.sqlite.executor import Database
    from ss2sql.session.session import Session
    from ss2sql.vtables.attached_worlds import AttachedWorld


# --- who uses a session, one thread at a time, and what it lets go of when it is closed or forgotten
P = ParamSpec("P")
T = TypeVar("T")


class SessionLock:
    """Lets one thread use the connection of a session, which may enter again while it is inside.

    A second thread gets an error: waiting could be a deadlock, and two runs would read each other's values.
    """

    def __init__(self, host: SessionHost, in_file: bool) -> None:
        self._lock = threading.RLock()
        self._depth = 0
        self._host = host
        self._used: AbstractContextManager[None] | None = None
        self._closed = False
        self._process = os.getpid()
        self._in_file = in_file

    @property
    def here(self) -> bool:
        """Whether this process has opened the session, and is no copy made by `fork`."""
        return os.getpid() == self._process

    def __enter__(self) -> None:
        if self._in_file and not self.here:  # the locks of SQLite on a file are not those of the copy
            hint = "connect to the file anew in each process"
            raise SessionError("S004", "the session belongs to the process that this one is a copy of", hints=(hint,))
        if not self._lock.acquire(blocking=False):
            hints = ("give each thread a session of its own, or let them take turns with a lock",)
            raise SessionError("S004", "the session is in use in another thread", hints=hints)
        if not self._depth:
            used = self._host.while_using()
            try:
                used.__enter__()
            except BaseException:
                self._lock.release()
                raise
            self._used = used
        self._depth += 1

    def __exit__(self, kind: object, error: BaseException | None, *_: object) -> None:
        if is_session_file_damaged(error) and not self._closed:
            # SQLite checks a page when it reads it, and takes it as checked while it is kept.
            self._host.connection.release_memory()
        self._depth -= 1
        if not self._depth and self._used is not None:
            self._used.__exit__(None, None, None)
            self._used = None
        self._lock.release()
        if self._closed:
            self._end_if_free()

    def release_resources(self) -> None:
        """Releases the resources of the session, now or when the last user leaves."""
        self._closed = True
        self._end_if_free()

    def _end_if_free(self) -> None:
        if self._lock.acquire(blocking=False):  # else whoever is there does it
            try:
                if not self._depth:
                    self._host.release_resources()
            finally:
                self._lock.release()


def is_session_file_damaged(error: BaseException | None) -> bool:
    seen: set[int] = set()  # they may form a cycle
    while error is not None and id(error) not in seen:
        if isinstance(error, apsw.CorruptError):
            return True
        seen.add(id(error))
        error = error.__cause__ or error.__context__
    return False


def with_session_lock(work: Callable[Concatenate[Session, P], T]) -> Callable[Concatenate[Session, P], T]:
    """Decorator: a method of a session that uses its connection; Ctrl-C cannot interrupt it halfway."""

    @wraps(work)
    def call_locked(session: Session, /, *arguments: P.args, **named: P.kwargs) -> T:
        with defer_keyboard_interrupt(), session.host.session_lock:
            return work(session, *arguments, **named)

    return call_locked


# --- what a session holds outside of itself, and lets go of when it is closed or forgotten
@dataclass(slots=True)
class SessionResources:
    """The processes of `workers` and the databases that search by levels. A finalizer keeps it, so it knows no session.

    `session` is the user's connection of such a database; `active_runs` are the runs that are under way.
    """

    session: Any = None
    active_runs: Sequence[Run] = ()
    processes: ProcessPool | None = None
    engines: dict[str, TableEngine | None] = field(default_factory=dict)
    owner: int = field(default_factory=os.getpid)

    def get_engine(self, name: str) -> TableEngine | None:
        """The database of an engine, if there is one. Raises SessionError S003 if it is not installed."""
        if name not in self.engines:
            self.engines[name] = open_session_engine(name, self.session, self.active_runs)
        return self.engines[name]

    def end_all(self) -> None:
        """Ends all of it; a copy of the process made by `fork` leaves it to the original."""
        if self.processes is not None:
            self.processes.end_processes()
        while self.engines:
            _, engine = self.engines.popitem()
            if engine is not None and os.getpid() == self.owner:
                engine.close()
        self.session = None  # at the end of Python DuckDB tells of each connection that somebody holds, in twenty lines


# The built-in functions and operators as the plan knows them.
BUILT_IN: Mapping[str, plan.Function] = {name: row.make_function() for name, row in OPERATIONS.items()}


# --- what a session holds and what its runs ask for; `Session` is the face of it, `run.Host` its contract
class SessionHost:
    """The functions, variables, tables and representations of a session.

    `generation` counts registrations, so that compiled scripts notice them. `disabled` names the optimisations that are
    switched off.
    """

    def __init__(
        self,
        connection: apsw.Connection,
        file: TemporalFile | None,
        read_only: bool,
        disabled: frozenset[str],
        limits: Limits,
        engine_session: Any = None,
    ) -> None:
        self.connection = connection
        self.limits = limits
        self.session_lock = SessionLock(self, in_file=file is not None)
        self.disabled = disabled
        self.memo_limit = 0 if "memo" in disabled else MEMO_LIMIT
        self.active_runs: list[Run] = []  # what runs, or is compiled to run, the innermost last
        connection.set_progress_handler(self._check_active_run, CHECK_EVERY)
        connection.limit(apsw.SQLITE_LIMIT_LENGTH, limits.max_size)
        self.memories = QueryCaches()
        self.tables = Tables(connection)
        self.shapes = Representations(limits.max_size)
        self.own_representations: dict[str, Callable[..., Any]] = {}
        self.functions: dict[str, UserFunction] = {}
        self.world_functions: dict[str, UserFunction] = {}  # by the names that scripts use
        self.planned: dict[str, UserFunction] = {}  # by the names that plans use
        self._sql_names: dict[str, str] | None = None  # of these
        self.generation = 0
        self.runs: list[Run] = []
        self.held = SessionResources(engine_session, self.active_runs)
        histories: dict[str, History] = {}
        self.triggers = Triggers(self._read_clock)
        self.watched_scenes: list[list[Callable[[], object]]] = []  # to whom scenes tell that they have stepped
        self.graph_store: GraphStore | None = None
        if file is not None:
            try:
                histories = file.load_histories()
            except BaseException:
                close_file(connection)
                raise
            from ss2sql.runtime.graph_cache.graph_store import GraphStore

            self.graph_store = self.tables.graphs = GraphStore(connection, not read_only)
        self.names = Variables(self._read_clock, histories, None if read_only else file)
        self.names.let_go = self._restore_detached
        # What a run asks, see `Host` in runtime/run/run_state.py; the rest of it is below.
        self.get_variable, self.bind_late = self.names.read_value, self.names.bind_late
        self.store_temporal = self.names.store_temporal
        self.own = SessionFunctions(self)

    @cached_property
    def database(self) -> Database:
        """SQLite with what lowered queries call; a session without such queries does without."""
        from ss2sql.runtime.sqlite.executor import Database

        made = Database(self.connection, self.memo_limit, self._check_active_run)
        for name, row in OPERATIONS.items():
            # The database has its own `==` and `!=`; the others are constructs of the plan.
            if name not in ("eq", "ne", "eval", "to", "times"):
                made.register_builtin(name, row.value or self.own.get_function(name))
        return made

    @property
    def sql_names(self) -> dict[str, str]:
        """The names that registered functions have in SQL."""
        if self._sql_names is None:
            from ss2sql.runtime.sqlite.sql_functions import choose_function_names

            self._sql_names = choose_function_names(self.planned)
        return self._sql_names

    def _check_active_run(self) -> bool:
        """Ends a statement whose run has to end. What is written into the file is written to its end."""
        if self.active_runs and self.connection.txn_state() != apsw.SQLITE_TXN_WRITE:
            self.active_runs[-1].check()
        return False

    @cached_property
    def graphs(self) -> CachePolicy | None:
        """What keeps the graphs of searches, if the session has a file and keeps graphs."""
        if self.graph_store is None or "remember" in self.disabled:
            return None
        from ss2sql.runtime.graph_cache.cached_steps import CachePolicy

        return CachePolicy(self.graph_store, self._find_function, lambda: list(self.names.worlds.values()))

    def _find_function(self, name: str) -> UserFunction:
        """A function by its name in plans. Raises ExecutionError X011 if it was detached with its world."""
        try:
            return self.planned[name]
        except KeyError:
            message = f"the function '{name}' belongs to a world that is not attached any more"
            raise ExecutionError("X011", message) from None

    def register_function(self, entry: UserFunction) -> None:
        self.functions[entry.name] = entry
        self._collect_functions()

    def _collect_functions(self) -> None:
        self.generation += 1
        self.planned = {entry.name: entry for entry in self.world_functions.values()} | self.functions
        self._sql_names = None

    def prepare_database(self) -> Database:
        """The database with the present functions. Raises SessionError S004 if a running statement may call one."""
        for name, sql_name in self.sql_names.items():
            try:
                self.database.register_user(self.planned[name], sql_name)
            except apsw.BusyError:
                message = f"the function '{name}' was registered anew while a query runs"
                hints = ("register functions between queries",)
                raise SessionError("S004", message, hints=hints) from None
        return self.database

    def attach_world(self, name: str, world: contract.World) -> None:
        """Adds tables, functions and representations of a world. Raises SessionError S002 for wrong declarations."""
        from ss2sql.vtables.attached_worlds import AttachedWorld

        attached = AttachedWorld(name, world, self.database.worlds.choose_name)
        self.names.attach_source(name, world, attached)
        self._name_world_functions()

    def _watch_scenes(self, worlds: Iterable[AttachedWorld]) -> None:
        """Has the scenes of these worlds look after the triggers while they step, and no other scenes."""
        poll = self.triggers.run_due
        for listeners in self.watched_scenes:
            if poll in listeners:
                listeners.remove(poll)
        # an adapter may call the scene's simulator directly
        scenes = [getattr(attached.world, "scene", None) or attached.world.source for attached in worlds]
        watched = [getattr(scene, "listeners", None) for scene in scenes]
        self.watched_scenes = [listeners for listeners in watched if isinstance(listeners, list)]
        for listeners in self.watched_scenes:
            if poll not in listeners:
                listeners.append(poll)

    def end_triggers(self) -> None:
        """Ends all triggers, which no scene polls any more."""
        self._watch_scenes(())
        self.triggers.all.clear()

    @contextmanager
    def while_using(self) -> Iterator[None]:
        """While a thread uses the session: parks other copies of SQLite and refreshes copied databases."""
        for copied in self.tables.copied.values():
            copied.stale = True
        with while_using_files(self.connection):
            yield

    def release_resources(self) -> None:
        self.end_triggers()
        self.held.end_all()
        if self.session_lock.here:
            close_file(self.connection)

    def _restore_detached(self, world: AttachedWorld) -> None:
        self.database.worlds.forget_tables(world.tables.values())
        self._name_world_functions()

    def _name_world_functions(self) -> None:
        from ss2sql.vtables.attached_worlds import WorldFunctions

        self.world_functions.clear()
        self.world_functions.update(WorldFunctions(self.names.worlds, self.memories).list_functions())
        self.collect_representations()
        self._watch_scenes(self.names.worlds.values())
        self._collect_functions()

    def collect_representations(self) -> None:
        """The representations: a user's replaces any other of its name, a world's that of a world attached before."""
        brought: dict[str, Callable[..., Any]] = {}
        for attached in self.names.worlds.values():
            for word, method in attached.world.representations.items():
                brought[word.lower()] = getattr(attached.world, method)
        self.shapes.functions = REPRESENTATIONS | brought | REPRESENTATIONS | self.own_representations

    # --- what the compiler reads ------------------------------------------------------------------------

    def make_catalog(
        self,
        values: Mapping[str, Any] | None = None,
        unknown: UnknownNames = "wrong",
        read: Callable[[], frozenset[str] | None] = lambda: None,
    ) -> Catalog:
        """The names that scripts may use; `read` gives the known columns of tables that they read."""
        values_by_name = dict(values or {})
        snapshots: dict[str, Any] = {}

        def get_variable_type(name: str) -> Any:
            if name not in snapshots:
                snapshots[name] = self.get_present_value(name, values_by_name)
            return self.names.get_type(name, snapshots[name])

        functions = {**BUILT_IN, **{name: self._plan_function(entry) for name, entry in self.functions.items()}}
        return Catalog(
            functions,
            tuple(self.shapes.functions),
            {*self.names, *values_by_name},
            get_variable_type,
            lambda schema, name: self.tables.find_table(schema, name, read()),
            self._list_table_names,
            self.names.others.find_variable if self.names.others is not None else lambda name: None,
            dict(self.names.late),
            unknown,
            {name: world for name, world in self.names.worlds.items() if name not in values_by_name},
            {n: self._plan_function(f) for n, f in self.world_functions.items() if n not in self.functions},
            frames=self.names.frames.keys() - values_by_name.keys(),
            files=("main", *self.tables.attached),
            hidden_columns=self.shapes.list_hidden_columns(),
            signature=self._read_signature,
        )

    def _read_signature(self, name: str) -> Signature | None:
        from ss2sql.frontend.volatility import read_signature  # which nobody needs who registers no function

        return read_signature(self.planned[name].function)

    def _list_table_names(self) -> list[str]:
        """The tables and views of the session's database, and of the engine's own database."""
        others = self.names.others
        return [*self.tables.list_names(), *(() if others is None else others.list_names())]

    def get_present_value(self, name: str, values: Mapping[str, Any]) -> Any:
        """The given value, or else the present one, as it stands in FROM. Raises what `source` raises."""
        return values[name] if name in values else self.names.get_source(name)

    def _plan_function(self, entry: UserFunction) -> plan.Function:
        """The function for plans; its body counts only while the operators in it are the built-in ones."""
        function = entry.plan
        known = function.body is not None and "inline" not in self.disabled
        return function if known and not function.body.uses & self.functions.keys() else replace(function, body=None)

    def resolve_script(self, tree: ast.Script, values: Mapping[str, Any], unknown: UnknownNames) -> plan.Program:
        """The plan of a script, resolved against the present and the given values."""
        read = cache(lambda: collect_syntax_columns(tree, *self.names.late.values()))
        for run in self.active_runs[-1:]:
            run.reads = read
        catalog = self.make_catalog(values, unknown, read)
        return retry_with_stack(lambda: resolve(tree, catalog))

    def resolve_statement(self, tree: ast.Expr, run: Run, unknown: UnknownNames) -> plan.Statement:
        """The plan of one statement, resolved against the present values."""
        script = ast.Script((tree,), span=tree.span)
        return self.resolve_script(script, run.arguments, unknown).statements[0]

    def resolve_text(self, text: str, scope: Any) -> tuple[plan.Expr, ...]:
        """The statements of a text given to `eval`."""
        given = self.runs[-1].arguments if self.runs else {}
        return resolve_eval(parse(Source(text, "<eval>")), scope, self.make_catalog(given))

    def make_rewrite_context(self, variable: Callable[[str], Any]) -> RewriteContext:
        """What rewrites may know of the session. `variable` gives the values that variables will have."""
        meanings: dict[tuple[str, int], plan.Expr | None] = {}

        def resolve_string(text: str, scope: Any) -> plan.Expr | None:
            if (text, id(scope)) not in meanings:
                meanings[text, id(scope)] = self._resolve_single_statement(text, scope)
            return meanings[text, id(scope)]

        return RewriteContext(variable, resolve_string, frozenset(self.functions))

    def _resolve_single_statement(self, text: str, scope: Any) -> plan.Expr | None:
        """The only statement of a text given to `eval`; None if there are more, or if it cannot be resolved yet."""
        try:
            statements = self.resolve_text(text, scope)
        except Error:
            return None
        return statements[0] if len(statements) == 1 else None

    def has_table_changed(self, table: plan.TableSource | plan.WorldSource, run: Run) -> bool:
        """Whether a plan was made for other columns, or values of other kinds, than the table has now."""
        if isinstance(table, plan.WorldSource):
            name = table.table.world_name
            world = None if name in run.arguments else self.names.worlds.get(name)
            return world is None or table.table not in world.tables.values()
        read = {name for name, kind in table.columns if kind != Type(STORED)}
        try:
            now = self.tables.find_table(table.schema, table.table, read)
        except Error as error:
            raise error.with_span(table.span) from error.__cause__
        return now is None or replace(now, id=table.id, name=table.name) != table

    # --- what a run asks (see runtime/run/run_state.py) ----------------------------------------------------------

    def assign_variable(self, name: str, value: Any) -> None:
        self.names.assign_value(name, value)
        for run in self.runs:
            run.snapshots.pop(name, None)

    def get_callable(self, function: plan.Function, run: Run) -> Callable[..., Any]:
        if function.builtin:
            python = OPERATIONS[function.name].value or self.own.get_function(function.name)
            return run.sizes.wrap_function(function.name, python)
        from ss2sql.runtime.run.calls import bind_function  # of the Python engine

        return bind_function(function, run, self._find_function, self.memo_limit)

    def hand_over_calls(self, run: Run) -> None:
        """Adopts the results of calls that the statement before has made, so that nothing is called twice."""
        for name, arguments, answer in run.calls_made:
            if self.memo_limit:
                self.get_callable(self.planned[name].plan, run).adopt(arguments, answer)  # type: ignore[attr-defined]
        run.calls_made = ()

    def forget_stable_calls(self, run: Run) -> None:
        """Forgets the results of stable functions, which the statement before may have changed."""
        for name in list(run.callables):
            if name not in self.planned or self.planned[name].volatility == "stable":
                del run.callables[name]

    def _read_clock(self) -> float:
        """The time of getTime(): the user's own, else that of the first world with a clock, else the computer's."""
        entry = self.functions.get("getTime")
        if entry:
            return convert_clock_time(entry.function(), "the function 'getTime'")
        for attached in self.names.worlds.values():
            moment = attached.read_time()
            if moment is not None:
                return convert_clock_time(moment, f"the clock of {attached.name}")
        return time.time()

    def read_temporal(self, name: str, when: Any, times: bool) -> Any:
        value = self.names.read_temporal(name, when, times)
        ValueSizes(self.limits.max_size).check_value(value)
        return value

    def read_table_rows(
        self, source: plan.TableSource, run: Run | None = None, wanted: TableFilter | None = None
    ) -> list[tuple[Any, ...]]:
        try:
            with pause_collector():  # 0.7 of the time of an A* search over a table
                return self.tables.read_rows(source, wanted)
        except ExecutionError as error:
            if run is None or not is_unreadable(error):
                raise
        run.doubtful = True
        return self.tables.read_unreadable_rows(source)

    def read_integer_columns(self, source: plan.TableSource, *columns: str) -> list[Any] | None:
        return self.tables.read_integer_columns(source, *columns)

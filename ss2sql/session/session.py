"""The session: how it begins, what a user registers and attaches, and how scripts are compiled and run in it."""

from __future__ import annotations

import os
import sys
import weakref
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import TYPE_CHECKING, Any, TypeVar, overload

import apsw

from ss2sql.errors import SessionError, Source
from ss2sql.frontend.resolve.scope import UnknownNames
from ss2sql.frontend.syntax.parser import parse
from ss2sql.frontend.syntax.tokenizer import read_script
from ss2sql.frontend.user_functions import UserFunction, check_is_string, check_user_function_name, make_user_function
from ss2sql.language import plan
from ss2sql.language.values import copy_deep, copy_for_python
from ss2sql.lowering.rewrites import REWRITES
from ss2sql.results.result import Result
from ss2sql.runtime.run.run_state import (
    NO_LIMITS,
    Limits,
    Run,
    Stats,
    check_option_word,
    check_seconds,
    defer_keyboard_interrupt,
)
from ss2sql.runtime.run.value_sizes import MAX_SIZE
from ss2sql.runtime.sqlite.connections import close_file, lock_down_connection, open_sqlite_file
from ss2sql.runtime.sqlite.database_tables import CACHE_SIZE, find_parquet_path, find_sqlite_path
from ss2sql.session.compiled_query import Engine, RunOptions, check_engine, check_engine_session, join_parameters
from ss2sql.session.compiled_script import (
    Query,
    check_progress_option,
    execute_script,
    run_in_session,
    set_session_deadline,
)
from ss2sql.session.host import SessionHost, with_session_lock
from ss2sql.session.variables import TemporalFile, Trigger
from ss2sql.vtables.contract import find_adapter, make_attachable, refuse_without_adapter
from ss2sql.vtables.frames import convert_given_value, find_reader

if TYPE_CHECKING:
    from ss2sql.runtime.graph_cache.graph_store import Graphs
    from ss2sql.session.descriptions import TableAbout


BUSY_MILLISECONDS = 1000  # how long to wait for a file that somebody else is writing
# Pages are looked at when they are read, so that more damage is noticed: 2 of the 40 ms that a million rows take.
CHECK_CELLS = "PRAGMA cell_size_check = ON"
# How SQLite uses memory. Copies of tables stay there: searching a million edges without an index takes 1.9 s, not 3.4.
MEMORY_PRAGMAS = (f"PRAGMA cache_size = {CACHE_SIZE}", "PRAGMA temp_store = MEMORY")


def get_registered_name(function: Any) -> str:
    name = getattr(function, "__name__", "")
    if not name.isidentifier():
        raise SessionError("S002", f"{function!r} has no name of its own", hints=('give one: function("name", f)',))
    return str(name)


def open_session_connection(path: str | os.PathLike[str] | None, read_only: bool) -> apsw.Connection:
    flags = apsw.SQLITE_OPEN_READONLY if read_only else apsw.SQLITE_OPEN_READWRITE | apsw.SQLITE_OPEN_CREATE
    connection: apsw.Connection | None = None
    try:
        connection = apsw.Connection(":memory:") if path is None else open_sqlite_file(os.fspath(path), flags)
        connection.set_busy_timeout(BUSY_MILLISECONDS)
        lock_down_connection(connection)
        connection.execute("SELECT count(*) FROM sqlite_schema").fetchall()
        for pragma in (CHECK_CELLS, *MEMORY_PRAGMAS):
            connection.execute(pragma)
    except (apsw.Error, ValueError, TypeError) as error:  # a path may be none at all
        if connection is not None:
            close_file(connection)  # else it would hold the file for as long as somebody holds the error
        hint = "the folder has to exist, and the file has to be a SQLite database"
        if isinstance(error, (apsw.BusyError, apsw.LockedError)):
            hint = "another program is writing to it: try again when that has ended"
        raise SessionError("S002", f"{path} cannot be opened as a SQLite database: {error}", hints=(hint,)) from error
    return connection


def read_script_source(script: str | Path | Source) -> Source:
    """The text of a script with its name.

    Raises SessionError S002 for an unreadable file, ParseError P004 for one that is too large.
    """
    if isinstance(script, Path):
        try:
            with script.open("rb") as file:
                source = read_script(file, str(script))
            return replace(source, text=source.text.replace("\r\n", "\n").replace("\r", "\n"))
        except OSError as error:
            message = f"the script {script} cannot be read: {error.strerror}"
            raise SessionError("S002", message, hints=("look for the file and its name",)) from error
        except UnicodeDecodeError as error:
            message = f"the script {script} cannot be read: {error}"
            raise SessionError("S002", message, hints=("a script is text in UTF-8",)) from error
    if isinstance(script, Source):
        return script
    if not isinstance(script, str):
        hint = "bytes become text with decode()" if isinstance(script, bytes) else "put the script into quotes"
        raise SessionError("S002", f"a script is text or a pathlib.Path, not {type(script).__name__}", hints=(hint,))
    return Source(script)


F = TypeVar("F", bound=Callable[..., Any])
MAX_COMPILED_SCRIPTS = 64  # that a session has compiled and keeps
OFF_SWITCHES = {  # what `disable` switches off
    **{name: rewrite.purpose for name, rewrite in REWRITES.items()},
    "memo": "remembers calls of immutable and stable functions while a query runs",
    "remember": "keeps the graphs of MEMORIZE in the session's file",
}


class Session:
    """Functions, variables and tables that scripts see, and the connection that runs them. See `connect`."""

    def __init__(
        self,
        path: str | os.PathLike[str] | None = None,
        timeout: float | None = None,
        progress: str | bool = "auto",
        read_only: bool = False,
        disable: Sequence[str] = (),
        limits: Limits = NO_LIMITS,
        engine: Engine = "auto",
        session: Any = None,
    ) -> None:
        check_option_word("optimisation", disable, OFF_SWITCHES)
        check_seconds(timeout)
        check_progress_option(progress)
        limits.check_limits()
        check_engine(engine)
        check_engine_session(engine, session)
        connection = open_session_connection(path, read_only)
        self.timeout = timeout
        self.progress = progress
        self._closed = False
        self._place = "in memory" if path is None else f"on {os.fspath(path)}"
        self._texts: dict[Any, Query] = {}  # that were run, with their engines; the latest is the last
        file = None if path is None else TemporalFile(connection)
        self.engine: Engine = engine
        self.host = SessionHost(connection, file, read_only, frozenset(disable), limits, session)
        # apsw keeps the host of a session that nobody closes; a finalizer that did so too would keep all sessions.
        weakref.finalize(self, self.host.held.end_all)
        found = self.host.held.get_engine(engine)  # says now what is not installed
        self.host.names.others = found.sources if found is not None else None

    # --- registration ----------------------------------------------------------------------------------

    @overload
    def function(self, name: F, /, *, volatility: plan.Volatility | None = ...,
                 inverse: Callable[..., Any] | None = ..., vectorized: bool = ...) -> F: ...  # fmt: skip
    @overload
    def function(self, name: str, function: F, /, volatility: plan.Volatility | None = ...,
                 inverse: Callable[..., Any] | None = ..., vectorized: bool = ...) -> F: ...  # fmt: skip
    @overload
    def function(self, name: str | None = ..., /, *, volatility: plan.Volatility | None = ...,
                 inverse: Callable[..., Any] | None = ..., vectorized: bool = ...) -> Callable[[F], F]: ...  # fmt: skip

    def function(
        self,
        name: str | Callable[..., Any] | None = None,
        function: Callable[..., Any] | None = None,
        /,
        volatility: plan.Volatility | None = None,
        inverse: Callable[..., Any] | None = None,
        vectorized: bool = False,
    ) -> Any:
        """Registers a Python function for scripts: as a decorator, with or without arguments, or called.

        Args:
            name: the name in scripts; that of the function where it is missing. The name of a built-in
                function or operator (`add`, `lt`) replaces it.
            function: the function; missing when used as a decorator.
            volatility: "immutable", "stable" or "volatile"; inferred from the source where it is missing.
            inverse: the inverse of the function, for searches from both ends.
            vectorized: whether the function takes arrays: for a block of rows one NumPy array per argument, for
                which it returns an array or a list with one element for each row. Such a function is never
                volatile; it is stable where nothing is said and its source does not prove it immutable.

        Returns:
            The function itself, or a decorator.

        Raises:
            SessionError: S002 for a name, signature or volatility that cannot be used.
        """
        if callable(name):
            if function is not None:
                raise SessionError("S002", "the name of a function is a text", hints=('write function("name", f)',))
            return self._add_entry(make_user_function(get_registered_name(name), name, volatility, inverse, vectorized))

        def register_body(body: F) -> F:
            self._add_entry(
                make_user_function(name or get_registered_name(body), body, volatility, inverse, vectorized)
            )
            return body

        return register_body if function is None else register_body(function)

    @with_session_lock
    def _add_entry(self, entry: UserFunction) -> Callable[..., Any]:
        self._check_open()
        self.host.register_function(entry)
        return entry.function

    def aggregate(self, name: str | Callable[..., Any] | None = None, function: Callable[..., Any] | None = None, /,
                  volatility: plan.Volatility | None = None) -> Any:  # fmt: skip
        """Registers a Python function of a list as an aggregate: as a decorator, with or without a name, or called.

        With GROUP BY it gets the list of the values of a group that are not None, in their order, and the other
        arguments of the call; without it is a function of a list.

        Raises:
            SessionError: S002 for a name, signature or volatility that cannot be used.
        """

        def register_body(body: Callable[..., Any], called: str | None = None) -> Callable[..., Any]:
            entry = make_user_function(called or get_registered_name(body), body, volatility)
            if entry.maximum == 0:
                raise SessionError("S002", f"'{entry.name}' takes no list", hints=("give it a parameter for the list",))
            return self._add_entry(replace(entry, aggregate=True, body="is an aggregate"))

        if callable(name):
            return register_body(name)
        return partial(register_body, called=name) if function is None else register_body(function, name)

    def representation(self, name: str) -> Callable[[F], F]:
        """Decorator: registers `AS name(arguments)`.

        The function gets a table (`columns`, `rows` as tuples, `dicts()`) and the arguments of AS; what it
        returns is the value. Of a search it is called once per path.
        """
        self._check_name(name)

        def register_body(body: F) -> F:
            self.host.own_representations[name.lower()] = body
            self.host.collect_representations()
            self.host.generation += 1
            return body

        return register_body

    @with_session_lock
    def attach(self, name: str, source: Any) -> None:
        """Makes a Python object known under a name; each run sees its present contents.

        Args:
            name: the name in scripts.
            source: a world or an object with an adapter (see `ss2sql.World`): its first table is `name`, its others
                `name.table`; a list, a dict of columns or any other value of the language; a data frame of pandas or
                Polars, a table of Arrow, a structured NumPy array; the path of a SQLite file, or its text if it ends in
                .db, .sqlite or .sqlite3, with its tables as `name.table`; a connection of `sqlite3`, whose main
                database is copied when a run starts, in the thread of the connection; the path of a Parquet file, which
                DuckDB reads; an iterator, which is read once into a list; `pybullet`, or the number of a connection of
                it.

        Raises:
            SessionError: S002 for anything else, and for a world with invalid declarations; S003 if DuckDB is needed
                and missing; S004 for a connection of another thread; S005 for a file that another copy of SQLite has
                open in this process.
        """
        self._check_name(name)
        self._texts.clear()  # they would hold on to what was attached before
        source = make_attachable(name, source)
        file = find_parquet_path(source)
        if file is not None:
            duckdb = self.host.held.get_engine("duckdb")
            assert duckdb is not None
            assert duckdb.sources is not None
            parquet = duckdb.sources.make_parquet_reader(file, name)
            self.host.tables.detach_file(name)
            self.host.names.attach_source(name, file, reader=parquet)
            return
        path = find_sqlite_path(source)
        if path is not None:
            self.host.tables.attach_file(name, path)
            self.host.names.forget_name(name)
            return
        sqlite3 = sys.modules.get("sqlite3")  # whoever has a connection of it has loaded it
        if sqlite3 is not None and isinstance(source, sqlite3.Connection):
            self.host.tables.attach_connection(name, source)
            self.host.names.forget_name(name)
            return
        reader = find_reader(source, name)
        world = find_adapter(source) if reader is None else None
        if reader is None and world is None:
            refuse_without_adapter(source)
        self.host.tables.detach_file(name)
        if world is not None:
            self.host.attach_world(name, world)
        else:
            self.host.names.attach_source(name, source, reader=reader)

    @with_session_lock
    def detach(self, name: str) -> None:
        """Removes what was attached under the name. Raises KeyError if there is none."""
        self._check_open()
        if name not in self.host.names.attached and name not in self.host.tables.attached:
            raise KeyError(name)
        self._texts.clear()
        self.host.tables.detach_file(name)
        self.host.names.forget_name(name)

    @with_session_lock
    def tables(self) -> dict[str, TableAbout]:
        """What FROM finds, by its name: tables of databases and worlds, data frames and lists.

        Each has its `kind`, its `columns`, none of an unreadable view, and the number of its `rows` where it is known.
        """
        from ss2sql.session.descriptions import list_tables

        self._check_open()
        return list_tables(self.host)

    def describe(self, name: str) -> str:
        """The columns of what FROM finds under a name; of a world all its tables, with units and texts, and functions.

        Raises SessionError S002 where there is none of the name; Timeout and Cancelled, for it looks at all rows.
        """

        def describe_in_run(run: Run) -> str:
            from ss2sql.session.descriptions import describe_source

            self._check_open()
            check_is_string(name)
            set_session_deadline(run, self.host, self.timeout)
            return describe_source(self.host, name)

        return run_in_session(self.host, describe_in_run)

    @with_session_lock
    def set(self, name: str, value: Any) -> None:
        """Sets a script variable to a copy of the value: of a data frame its columns, of a Series its values.

        Raises ExecutionError X004 for NaN and its like in other values.
        """
        self._check_name(name)
        self.host.names.assign_value(name, copy_deep(convert_given_value(name, value)))

    def get(self, name: str) -> Any:
        """The value of a script variable, a copy. Raises KeyError if there is none."""
        if name in self.host.names.attached:
            return self.host.names.attached[name]
        return copy_for_python(self.host.names.values[name])

    def variables(self) -> dict[str, Any]:
        """All script variables with copies of their values, by name."""
        return self.host.names.copy_values()

    @with_session_lock
    def graphs(self) -> Graphs:
        """The graphs that searches with MEMORIZE have left in the session's file, the oldest first.

        They print as a table. `graphs().drop()` removes all of them, `graphs()[0].drop()` one.
        """
        self._check_open()
        from ss2sql.runtime.graph_cache.graph_store import Graphs, list_graphs

        return Graphs() if self.host.graph_store is None else list_graphs(self.host.graph_store)

    # --- running ---------------------------------------------------------------------------------------

    def compile(self, script: str | Path | Source, engine: Engine = "auto") -> Query:
        """Parses, resolves and lowers a script once; names that it does not know become its parameters.

        Reads its tables to learn their types. Raises ParseError, ResolveError, Timeout and Cancelled; UnsupportedError
        if the requested engine cannot run the script.
        """

        def compile_in_run(run: Run) -> Query:
            set_session_deadline(run, self.host, self.timeout)
            return self._compile_script(script, engine, {}, "parameter")

        return run_in_session(self.host, compile_in_run)

    def _compile_script(
        self,
        script: str | Path | Source,
        engine: Engine,
        values: Mapping[str, Any],
        unknown: UnknownNames,
        stats: Stats | None = None,
    ) -> Query:
        self._check_open()
        check_engine(engine)
        engine = self.engine if engine == "auto" else engine
        stats = stats or Stats()
        tree = stats.time_stage("parse", lambda: parse(read_script_source(script)))()
        program = stats.time_stage("resolve", lambda: self.host.resolve_script(tree, values, unknown))()
        return Query(self.host, self.execute, tree, program, engine, takes_parameters=unknown == "parameter")

    def _get_compiled(
        self, script: str | Path | Source, engine: Engine, values: Mapping[str, Any], stats: Stats
    ) -> Query:
        """The compiled script; a text that runs without values is compiled once: 0.1 ms instead of 1.3 ms."""
        key = (script, engine, self.engine)
        query = self._texts.pop(key, None) if isinstance(script, str) and not values else None
        if query is None or self._closed:
            query = self._compile_script(script, engine, values, "wrong", stats)
        if isinstance(script, str) and not values:
            self._texts[key] = query
            if len(self._texts) > MAX_COMPILED_SCRIPTS:
                del self._texts[next(iter(self._texts))]
        return query

    def run(
        self,
        script: str | Path | Source,
        engine: Engine | Mapping[str, Any] = "auto",
        timeout: float | None = None,
        maximum: int | None = None,
        workers: int = 1,
        max_rows: int | None = None,
        trace: int | None = None,
        parameters: Mapping[str, Any] | None = None,
        **variables: Any,
    ) -> Result:
        """Runs a script.

        Args:
            script: its text, the path of a file, or a text with the name that errors show.
            engine: "auto" (the session's; if that is "auto", SQLite for searches and for queries over tables, worlds
                and frames, Python for the rest and for what fails in SQL), "database" (an error instead), "native",
                "duckdb" for queries and searches by levels there, "spark" for such searches.
            timeout: seconds, in place of the session's.
            maximum: bounds the results of the last statement's search, like MAXIMUM.
            workers: processes for the calls of functions that a level of MEMORIZE needs. The result is the same, sooner
                where calls are slow. A `WorkersWarning` says where that has no effect, and why.
            max_rows: more results than that are an error, also of a query inside of others that gives a list, and more
                rows in the graph of MEMORIZE.
            trace: keeps the first so many events of the search that the script ends with, which then runs natively:
                see `Result.trace`.
            parameters: values for names of the script, for this run only; `run(script, {"k": 1})` is the same.
            variables: the same as `run(script, k=1)`, where the name is none of the above. The script need not use them
                all; a name that it lacks and that is nearly an option, such as `timout`, is an error.

        Returns:
            The result of the last statement.

        Raises:
            ParseError, ResolveError, UnsupportedError, ExecutionError, RepresentationError; Timeout, OutOfMemory,
            OutOfSteps and Cancelled, whose `partial` is the result so far; whatever a registered function raised, with
            a note that names the line of the script.
        """
        if isinstance(engine, Mapping):  # run(..., {"k": 1})
            parameters, engine = engine, "auto"
        values = join_parameters(parameters, variables)
        options = RunOptions(engine, timeout, maximum, workers, max_rows, trace)
        return self.execute(lambda run, known: self._get_compiled(script, engine, known, run.stats), options, values)

    def eval(self, script: str | Path, **variables: Any) -> Any:
        """The value of a script: `run(script, **variables).value`."""
        return self.run(script, **variables).value

    def execute(
        self, find: Callable[[Run, dict[str, Any]], Query], options: RunOptions, variables: Mapping[str, Any]
    ) -> Result:
        """Runs the compiled script that is found for a run and its values; `Query.run` and `Query.spark` end here."""

        def run_query(run: Run) -> Result:
            check_seconds(options.timeout)
            set_session_deadline(run, self.host, self.timeout if options.timeout is None else options.timeout)
            values = {name: convert_given_value(name, value) for name, value in variables.items()}
            query = find(run, values)
            query.check_variables(values)
            self._check_open()
            chosen = replace(options, engine=self.engine) if options.engine == "auto" else options
            return execute_script(self.host, query, chosen, self.progress, values, run)

        return run_in_session(self.host, run_query)

    # --- triggers --------------------------------------------------------------------------------------

    def on_change(self, script: str | Path, every: float = 0.1, engine: Engine = "auto") -> Callable[..., Trigger]:
        """Decorator: calls the function with the new value of a script whenever it has changed.

        The script runs at once, without a call, and then periodically: while an attached scene steps, else in `poll`.

        Args:
            script: its last statement gives the value.
            every: seconds of `getTime()` between two runs.
            engine: as for `run`.

        Returns:
            A decorator that gives a `Trigger`, which has `value`, `time`, `runs`, `changes` and `stop()`.

        Raises:
            Error: what `compile` and the first run raise. `poll`, or the scene's `step`, raises later errors.
        """
        query = self.compile(script, engine)
        return lambda function: self.host.triggers.add_trigger(query, every, function)

    def poll(self) -> int:
        """Runs the triggers that are due, and gives the number of those whose values have changed."""
        self._check_open()
        return self.host.triggers.run_due()

    def interrupt(self) -> None:
        """Ends all runs of the session, from any thread; they raise Cancelled."""
        for run in list(self.host.active_runs):
            run.interrupted = True

    def close(self) -> None:
        """Closes the connection; the session cannot run scripts any more. Closing twice does no harm.

        Running scripts are interrupted first, also in another thread.
        """
        self._closed = True
        self._texts.clear()
        self.interrupt()
        with defer_keyboard_interrupt():
            self.host.session_lock.release_resources()

    def __repr__(self) -> str:
        names = list(self.host.names)
        known = f", knows {', '.join(names[:8])}{', ...' if len(names) > 8 else ''}" if names else ""
        return f"<session {self._place}{', closed' if self._closed else known}>"

    def __enter__(self) -> Session:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self.close()

    def _check_open(self) -> None:
        if self._closed:
            raise SessionError("S001", "the session is closed", hints=("open a new one with ss2sql.connect()",))

    def _check_name(self, name: str) -> None:
        self._check_open()
        check_user_function_name(name)


def connect(
    path: str | os.PathLike[str] | None = None,
    timeout: float | None = None,
    progress: str | bool = "auto",
    read_only: bool = False,
    disable: Sequence[str] = (),
    max_size: int = MAX_SIZE,
    max_memory: int | None = None,
    max_steps: int | None = None,
    max_output: int | None = None,
    engine: Engine = "auto",
    session: Any = None,
) -> Session:
    """A new session.

    Args:
        path: a SQLite file whose tables scripts can read; it keeps temporal variables and remembered graphs. None for a
            database in memory.
        timeout: seconds after which a run is broken off; None for no limit.
        progress: "auto", True or False: whether long runs show a line of progress on a terminal.
        read_only: opens the file without the right to change it.
        disable: names of optimisations to switch off: "memo", "remember", "inline" and others.
        max_size: bytes of one value that a script makes, a text or a list: at least 262,144, at most 10**9.
        max_memory: bytes by which the process may grow while a script runs; None for no limit. Only on Linux.
        max_steps: steps that the searches of one run may try together, as `result.stats.generated` counts them.
        max_output: characters that one run may print.
        engine: where scripts run for which nothing else is said, see `Session.run`.
        session: with the engine "duckdb" a connection of DuckDB, whose tables and views scripts can read by their names
            and whose settings count: memory, threads, folder; with "spark" a SparkSession. No other engine has one.

    Raises:
        SessionError: the file cannot be opened, a name in `disable` is unknown, or the engine is not installed.
    """
    limits = Limits(max_size, max_memory, max_steps, max_output)
    return Session(path, timeout, progress, read_only, disable, limits, engine, session)

"""The session: what a user registers and attaches, and how scripts are compiled and run in it."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar, overload

import apsw

from ss2sql import plan
from ss2sql.errors import (
    Cancelled,
    Error,
    ExecutionError,
    RepresentationError,
    SessionError,
    Source,
    Stopped,
    did_you_mean,
)
from ss2sql.frontend import ast
from ss2sql.frontend.catalog import Catalog
from ss2sql.frontend.parser import parse
from ss2sql.frontend.resolve import resolve, resolve_text
from ss2sql.kinds import type_of
from ss2sql.runtime import representations
from ss2sql.runtime.builtins import BUILTINS
from ss2sql.runtime.compiled import ENGINES, Engine, Query, script_sql
from ss2sql.runtime.database import Database
from ss2sql.runtime.functions import (
    MEMO_LIMIT,
    UserFunction,
    builtin_functions,
    native_callable,
    sql_names,
    user_function,
)
from ss2sql.runtime.result import Answer, Result
from ss2sql.runtime.rows import Rows
from ss2sql.runtime.run import Run, Stats
from ss2sql.runtime.session_functions import SessionFunctions
from ss2sql.runtime.tables import Tables
from ss2sql.runtime.temporal import TemporalStore
from ss2sql.runtime.values import Opaque, fresh, normalise

F = TypeVar("F", bound=Callable[..., Any])
SWITCHES = ("memo",)


def connect(
    path: str | os.PathLike[str] | None = None,
    timeout: float | None = None,
    progress: str | bool = "auto",
    read_only: bool = False,
    disable: Sequence[str] = (),
) -> Session:
    """A new session.

    Args:
        path: a SQLite file whose tables scripts can read; None for a database in memory.
        timeout: seconds after which a run is broken off; None for no limit.
        progress: "auto", True or False: whether long runs show a line of progress on a terminal.
        read_only: opens the file without the right to change it.
        disable: names of optimisations to switch off: "memo".

    Raises:
        SessionError: the file cannot be opened, or a name in `disable` is unknown.
    """
    return Session(path, timeout, progress, read_only, disable)


class Session:
    """Functions, variables and tables that scripts see, and the connection that runs them. See `connect`."""

    def __init__(
        self,
        path: str | os.PathLike[str] | None = None,
        timeout: float | None = None,
        progress: str | bool = "auto",
        read_only: bool = False,
        disable: Sequence[str] = (),
    ) -> None:
        unknown = [word for word in disable if word not in SWITCHES]
        if unknown:
            raise SessionError(
                "S002", f"there is no optimisation '{unknown[0]}'", hints=did_you_mean(unknown[0], SWITCHES)
            )
        self.connection = _open(path, read_only)
        self.timeout = timeout
        self.progress = progress
        self.memo_limit = 0 if "memo" in disable else MEMO_LIMIT
        self.database = Database(self.connection)
        self.database.memo_limit = self.memo_limit
        self.tables = Tables(self.connection)
        self.functions: dict[str, UserFunction] = {}
        self.representations: dict[str, Callable[..., Any]] = dict(representations.ALL)
        self.sql_names: dict[str, str] = {}
        self._variables: dict[str, Any] = {}
        self._attached: dict[str, Any] = {}
        self._late: dict[str, ast.ListLiteral] = {}
        self._runs: list[Run] = []
        self.generation = 0  # counts registrations, so that compiled scripts notice them
        self.own = SessionFunctions(self)
        self.temporals = TemporalStore(self._clock)
        for name, builtin in BUILTINS.items():
            if name in ("eq", "ne"):
                continue  # the database has its own
            self.database.register_builtin(name, builtin.python or self.own.function(name))

    # --- registration ----------------------------------------------------------------------------------

    @overload
    def function(self, name: F, /) -> F: ...
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
            vectorized: whether the function takes arrays.

        Returns:
            The function itself, or a decorator.

        Raises:
            SessionError: S002 for a name, signature or volatility that cannot be used.
        """
        if callable(name):
            return self._register(user_function(_name_of(name), name))

        def register(body: F) -> F:
            self._register(user_function(name or _name_of(body), body, volatility, inverse, vectorized))
            return body

        return register if function is None else register(function)

    def _register(self, entry: UserFunction) -> Callable[..., Any]:
        self._check_open()
        self.functions[entry.name] = entry
        self.generation += 1
        before = self.sql_names
        self.sql_names = sql_names(self.functions)
        for name, sql_name in self.sql_names.items():
            if name == entry.name or before.get(name) != sql_name:
                self.database.register_user(self.functions[name], sql_name)
        return entry.function

    def representation(self, name: str) -> Callable[[F], F]:
        """Decorator: registers `AS name(arguments)`.

        The function gets a table (`columns`, `rows` as tuples, `dicts()`) and the arguments of AS; what it
        returns is the value. Of a search it is called once per path.
        """
        if not name.isidentifier():
            raise SessionError("S002", f"'{name}' is not a name that can stand after AS")

        def register(body: F) -> F:
            self.representations[name.lower()] = body
            self.generation += 1
            return body

        return register

    def attach(self, name: str, source: Any) -> None:
        """Makes a Python object known under a name; scripts see it as it is when they run.

        Args:
            name: the name in scripts.
            source: a list (of values, dicts or dataclass objects), a dict of columns, any other value, or
                the path of a SQLite file, whose tables are then `name.table`.
        """
        self._check_name(name)
        if isinstance(source, os.PathLike):
            self._attach_file(name, Path(source))
            return
        self._forget(name)
        self._attached[name] = source

    def _attach_file(self, name: str, path: Path) -> None:
        if not path.exists():
            raise SessionError("S002", f"there is no file {path}", hints=("give the path of a SQLite file",))
        try:
            self.connection.execute("ATTACH ? AS " + '"' + name.replace('"', '""') + '"', (str(path),))
            self.tables.names()
        except apsw.Error as error:
            raise SessionError("S002", f"{path} is not a SQLite file that can be read: {error}") from error

    def set(self, name: str, value: Any) -> None:
        """Sets a script variable to a copy of the value. Raises ExecutionError X004 for NaN and its like."""
        self._check_name(name)
        self.assign(name, normalise(fresh(value), f"the variable '{name}'"))

    def get(self, name: str) -> Any:
        """The value of a script variable, a copy. Raises KeyError if there is none."""
        if name in self._attached:
            return self._attached[name]
        if name not in self._variables:
            raise KeyError(name)
        return fresh(self._variables[name])

    def variables(self) -> dict[str, Any]:
        """All script variables with copies of their values, by name."""
        return {name: fresh(value) for name, value in sorted(self._variables.items())}

    # --- running ---------------------------------------------------------------------------------------

    def compile(self, script: str | Path, engine: Engine = "auto") -> Query:
        """Parses, resolves and lowers a script once; names that it does not know become its parameters.

        Raises ParseError and ResolveError, UnsupportedError if `engine` is "database" and that is impossible.
        """
        return self._compile(script, self._catalog(open_names=True), engine)

    def _compile(self, script: str | Path, catalog: Catalog, engine: Engine) -> Query:
        self._check_open()
        if engine not in ENGINES:
            raise SessionError("S002", f"there is no engine {engine!r}", hints=did_you_mean(str(engine), ENGINES))
        tree = parse(_source(script))
        return Query(self, tree, resolve(tree, catalog), engine)

    def run(
        self,
        script: str | Path,
        engine: Engine = "auto",
        timeout: float | None = None,
        maximum: int | None = None,
        workers: int = 1,
        max_rows: int | None = None,
        **variables: Any,
    ) -> Result:
        """Runs a script.

        Args:
            script: its text, or the path of a file.
            engine: "auto" (the database unless lowering objects), "database" (an error instead) or "native".
            timeout: seconds, in place of the session's.
            maximum: bounds the results of the last statement's search, like MAXIMUM.
            workers: processes for a search's levels.
            max_rows: more results than that are an error.
            variables: values for names of the script, for this run only.

        Returns:
            The result of the last statement.

        Raises:
            ParseError, ResolveError, UnsupportedError, ExecutionError, RepresentationError; Timeout and
            Cancelled, whose `partial` is the result so far; whatever a registered function raised, with a
            note that names the line of the script.
        """
        started = time.perf_counter()
        values = {name: normalise(value, f"the variable '{name}'") for name, value in variables.items()}
        query = self._compile(script, self._catalog(values), engine)
        return self.execute(query, engine, timeout, maximum, max_rows, values, time.perf_counter() - started)

    def eval(self, script: str | Path, **variables: Any) -> Any:
        """The value of a script: `run(script, **variables).value`."""
        return self.run(script, **variables).value

    def execute(
        self,
        query: Query,
        engine: Engine | None,
        timeout: float | None,
        maximum: int | None,
        max_rows: int | None,
        variables: Mapping[str, Any],
        compile_seconds: float = 0.0,
    ) -> Result:
        """Runs a compiled script; `Query.run` and `Session.run` end here."""
        self._check_open()
        seconds = self.timeout if timeout is None else timeout
        run = Run(self, Stats(), None if seconds is None else time.monotonic() + seconds, max_rows=max_rows)
        run.arguments = {name: normalise(value, f"the variable '{name}'") for name, value in variables.items()}
        run.stats.seconds["compile"] = compile_seconds
        started = time.perf_counter()
        statements = query.statements(engine)
        run.stats.seconds["lower"] = time.perf_counter() - started
        self._runs.append(run)
        started = time.perf_counter()
        value: Any = None
        last = statements[-1]
        try:
            for statement in statements:
                run.maximum = maximum if statement is last else None
                run.answer = None
                value = statement.value(run)
        except Stopped as stopped:
            stopped.partial = self._partial(run, "timeout" if stopped.code == "T001" else "cancelled")
            raise
        except KeyboardInterrupt:
            cancelled = Cancelled("T002", "the run was interrupted")
            cancelled.partial = self._partial(run, "cancelled")
            raise cancelled from None
        finally:
            self._runs.remove(run)
            run.stats.seconds["run"] = time.perf_counter() - started
        answer = run.answer if last.is_query else None
        engines = [compiled.engine for statement in statements for compiled in statement.queries]
        used = answer.engine if answer is not None else (engines[-1] if engines else "native")
        return Result(
            answer.value if answer is not None else fresh(value),
            used,
            answer.status if answer is not None else "complete",
            run.stats,
            script_sql(statements, run),
            answer,
        )

    def _partial(self, run: Run, status: str) -> Result | None:
        if run.sink is None:
            return None
        rows, engine = run.sink
        answer = Answer(rows, None, engine, status)  # type: ignore[arg-type]
        return Result(None, engine, answer.status, run.stats, script_sql([]), answer)

    def interrupt(self) -> None:
        """Ends all runs of the session, from any thread; they raise Cancelled."""
        for run in self._runs:
            run.interrupted = True

    def close(self) -> None:
        """Closes the connection; the session cannot run scripts any more. Closing twice does no harm."""
        self.connection.close()
        self._closed = True

    _closed = False

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
        if not name.isidentifier():
            raise SessionError(
                "S002", f"'{name}' is not a name that a script can use", hints=("use letters and digits",)
            )

    # --- what the compiler asks ------------------------------------------------------------------------

    def _catalog(self, values: Mapping[str, Any] | None = None, open_names: bool = False) -> Catalog:
        given = dict(values or {})
        snapshots: dict[str, Any] = {}

        def variable_type(name: str) -> Any:
            if name not in snapshots:
                snapshots[name] = given[name] if name in given else self._value(name)
            return type_of(snapshots[name])

        functions = builtin_functions()
        functions.update((name, entry.plan) for name, entry in self.functions.items())
        return Catalog(
            functions,
            tuple(self.representations),
            {*self._variables, *self._attached, *given},
            variable_type,
            self.tables.find,
            self.tables.names(),
            dict(self._late),
            open_names,
        )

    def resolve_statement(self, tree: ast.Expr, run: Run) -> plan.Statement:
        """The plan of one statement, resolved against the values that stand now."""
        catalog = self._catalog(run.arguments, open_names=False)
        return resolve(ast.Script((tree,), span=tree.span), catalog).statements[0]

    def resolve_text(self, text: str, scope: Any) -> tuple[plan.Expr, ...]:
        """The statements of a text given to `eval`."""
        return resolve_text(parse(Source(text, "<eval>")), scope, self._catalog(self._arguments()))

    def _arguments(self) -> Mapping[str, Any]:
        return self._runs[-1].arguments if self._runs else {}

    def table_changed(self, table: plan.TableSource) -> bool:
        """Whether a table has other columns, or values of other kinds, than a plan was made for."""
        now = self.tables.find(table.schema, table.table)
        return now is None or (now.columns, now.order, now.collated) != (table.columns, table.order, table.collated)

    def knows(self, name: str) -> bool:
        return name in self._variables or name in self._attached

    # --- what a run asks (see runtime/run.py) ----------------------------------------------------------

    def _value(self, name: str) -> Any:
        if name in self._attached:
            return normalise(self._attached[name], f"the variable '{name}'")
        return self._variables[name]

    def variable(self, name: str, run: Run) -> Any:
        if name in run.snapshots:
            return run.snapshots[name]
        if not self.knows(name):
            raise ExecutionError(
                "R001", f"the variable '{name}' has no value yet", hints=("assign it before it is read",)
            )
        value = self._value(name)
        if name in self._attached:
            run.snapshots[name] = value
        return value

    def assign(self, name: str, value: Any) -> None:
        self._forget(name)
        self._variables[name] = value

    def _forget(self, name: str) -> None:
        """Makes room for a new meaning of a name."""
        self._variables.pop(name, None)
        self._attached.pop(name, None)
        self._late.pop(name, None)
        self.temporals.drop(name)
        for run in self._runs:
            run.snapshots.pop(name, None)

    def clear(self) -> None:
        """Forgets all script variables; what is attached stays."""
        for name in [*self._variables, *self._late]:
            self._forget(name)

    def bind_late(self, name: str, literal: ast.ListLiteral) -> None:
        self._forget(name)
        self._late[name] = literal

    def call(self, function: plan.Function, run: Run) -> Callable[..., Any]:
        if function.builtin:
            return BUILTINS[function.name].python or self.own.function(function.name)
        known = run.callables.get(function.name)
        if known is None:
            known = native_callable(self.functions[function.name], run, self.memo_limit)
            run.callables[function.name] = known
        return known

    def _clock(self) -> float:
        """The time of getTime(), which the user may have replaced."""
        entry = self.functions.get("getTime")
        return float(entry.function()) if entry else time.time()

    def temporal(self, name: str, when: Any) -> Any:
        if name not in self.temporals.histories:
            hint = f"store it with {name}{{5.0}} = ..."
            raise ExecutionError("X007", f"'{name}' is not a temporal variable", hints=(hint,))
        return self.temporals.read(name, when)

    def store_temporal(self, name: str, keep: Any, value: Any) -> None:
        if name not in self.temporals.histories:
            self._forget(name)
        self.temporals.store(name, keep, value)
        self._variables[name] = value

    def table_rows(self, source: plan.TableSource) -> list[tuple[Any, ...]]:
        columns = ", ".join('"' + name.replace('"', '""') + '"' for name, _ in source.columns)
        order = f" ORDER BY {', '.join(_quoted(key) for key in source.order)}" if source.order else ""
        text = f"SELECT {columns} FROM {_quoted(source.schema)}.{_quoted(source.table)}{order}"
        return [tuple(row) for row in self.connection.execute(text)]

    # --- representations -------------------------------------------------------------------------------

    def represent(
        self, representation: plan.Representation, rows: Rows, arguments: tuple[Any, ...], named: Mapping[str, Any]
    ) -> Any:
        """The value that AS makes of rows, as the user gets it: nothing in it is shared."""
        function = self.representations[representation.name]

        def shaped(table_rows: list[Any]) -> Any:
            table = representations.Table(rows.columns, [tuple(map(fresh, row)) for row in table_rows])
            try:
                return function(table, *map(fresh, arguments), **{k: fresh(v) for k, v in named.items()})
            except Error as error:
                raise error.located(representation.span) from None
            except TypeError as error:
                if error.__traceback__ is None or error.__traceback__.tb_next is None:
                    raise _wrong_arguments(representation, error) from error
                raise

        def form(positions: Sequence[int] | None) -> Any:
            if representation.name == "void":
                return None
            if rows.paths is not None:
                paths = rows.paths if positions is None else [rows.paths[index] for index in positions]
                return [shaped(path) for path in paths]
            assert rows.rows is not None
            return shaped(rows.rows if positions is None else [rows.rows[index] for index in positions])

        if rows.groups is None:
            return form(None)
        return {fresh(key): form(positions) for key, positions in rows.groups}

    def language_value(self, name: str, value: Any) -> Any:
        """A representation's value as scripts go on with it: of the user's own it stays the object that it is."""
        if name in representations.ALL or isinstance(value, (bool, int, float, str, list, dict, type(None))):
            return normalise(value, f"AS {name}")
        try:
            hash(value)
        except TypeError:
            return Opaque(value)
        return value

    def shape(self, query: plan.Query, rows: Rows, arguments: tuple[Any, ...], named: dict[str, Any]) -> Any:
        raw = self.represent(query.representation, rows, arguments, named)
        return self.language_value(query.representation.name, raw)


def _wrong_arguments(representation: plan.Representation, error: TypeError) -> RepresentationError:
    return RepresentationError(
        "V001", f"AS {representation.name} cannot take these arguments: {error}", representation.span
    )


def _quoted(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'


def _name_of(function: Any) -> str:
    name = getattr(function, "__name__", "")
    if not name.isidentifier():
        raise SessionError("S002", f"{function!r} has no name of its own", hints=('give one: function("name", f)',))
    return str(name)


def _open(path: str | os.PathLike[str] | None, read_only: bool) -> apsw.Connection:
    flags = apsw.SQLITE_OPEN_READONLY if read_only else apsw.SQLITE_OPEN_READWRITE | apsw.SQLITE_OPEN_CREATE
    try:
        connection = apsw.Connection(":memory:" if path is None else os.fspath(path), flags=flags)
        connection.execute("SELECT count(*) FROM sqlite_schema")
    except apsw.Error as error:
        raise SessionError("S002", f"{path} cannot be opened as a SQLite database: {error}") from error
    return connection


def _source(script: str | Path) -> Source:
    if isinstance(script, Path):
        try:
            return Source(script.read_text(encoding="utf-8"), str(script))
        except (OSError, UnicodeDecodeError) as error:
            raise SessionError("S002", f"the script {script} cannot be read: {error}") from error
    if not isinstance(script, str):
        raise SessionError("S002", f"a script is text or a pathlib.Path, not {type(script).__name__}")
    return Source(script)

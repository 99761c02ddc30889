"""Compiled scripts, and their runs.

Every statement is resolved and, query by query, lowered to SQL or compiled to Python. A run executes one statement
after the other. A long one says on the terminal how far it is:

    12 s | 402,116 steps, 33,509/s | 12 results

The line appears after a second, is written anew ten times a second at the most, and is gone in the end. It has neither
colours nor control codes but for the carriage return, so it looks the same everywhere.
"""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from typing import TYPE_CHECKING, Any, TypeVar

from ss2sql.errors import (
    Cancelled,
    ExecutionError,
    ResolveError,
    SessionError,
    Stopped,
    Timeout,
    UnsupportedError,
    suggest_names,
    suggest_similar,
)
from ss2sql.frontend.resolve.scope import UnknownNames
from ss2sql.frontend.syntax import ast
from ss2sql.language import plan
from ss2sql.language.cancellation import install_cancellation_check, retry_with_stack
from ss2sql.language.kinds import ANY, NOTHING, Type, is_supertype
from ss2sql.language.plan_traversal import list_plan_calls, walk, write_test_for_none
from ss2sql.language.values import NONE_HINT, copy_for_python
from ss2sql.lowering.sql_query import Sql
from ss2sql.results.notes import note_unread_arguments, suggest_timeout_cure
from ss2sql.results.result import OutlinedStatement, QueryResult, Result, Status, join_outlined_sql
from ss2sql.runtime.parallel import IN_WORKER
from ss2sql.runtime.run.run_state import (
    CarriedStopError,
    Places,
    Run,
    Stats,
    close_frames,
    defer_keyboard_interrupt,
    measure_memory,
    translate_memory_error,
)
from ss2sql.runtime.run.value_sizes import ValueSizes
from ss2sql.session.compiled_query import (
    OPTIONS,
    CompiledQuery,
    Engine,
    RunOptions,
    compile_expression,
    join_parameters,
)
from ss2sql.session.variables import predict_variables

if TYPE_CHECKING:
    from ss2sql.lowering.sql_builder import Dialect
    from ss2sql.results.explain.explanation import Explanation
    from ss2sql.results.watching.search_trace import SearchTrace
    from ss2sql.runtime.parallel.block_calls import CallPrefetcher
    from ss2sql.session.host import SessionHost
    from ss2sql.session.progress_line import Progress


ASSIGNMENTS = (plan.Assign, plan.TemporalAssign, plan.AssignLate)


class CompiledStatement:
    """One compiled statement. `variable` gives the values that variables will have, as far as they are known."""

    def __init__(
        self,
        host: SessionHost,
        tree: ast.Expr,
        statement: plan.Statement,
        engine: Engine,
        generation: int,
        variable: Callable[[str], Any],
        unknown: UnknownNames,
    ) -> None:
        self.host = host
        self.tree = tree
        self.engine = engine
        self.unknown: UnknownNames = unknown
        self._compile_statement(statement, generation, variable)

    def _compile_statement(self, statement: plan.Statement, generation: int, variable: Callable[[str], Any]) -> None:
        function, queries = retry_with_stack(lambda: self._make_function(statement.expr, variable))
        self.function: Callable[[Run], Any] = function
        self.queries: list[CompiledQuery] = queries
        self.statement = statement
        self.assigns = frozenset(node.name for node in walk(statement.expr) if isinstance(node, ASSIGNMENTS))
        self.types_seen: dict[str, Type] = {}  # of variables, which the plan fits
        self.generation = generation  # last: what was broken off before is made anew

    def _make_function(
        self, expr: plan.Expr, variable: Callable[[str], Any]
    ) -> tuple[Callable[[Run], Any], list[CompiledQuery]]:
        """The function that computes the statement, and the queries in it."""
        queries: list[CompiledQuery] = []

        def compile_query(query: plan.Query) -> CompiledQuery:
            queries.append(CompiledQuery(self.host, query, self.engine, variable))
            return queries[-1]

        if isinstance(expr, plan.Subquery):
            return compile_query(expr.query).find_located_answer, queries
        return compile_expression(expr, lambda query: compile_query(query).compute_value), queries

    @property
    def is_query(self) -> bool:
        """Whether the statement's value is that of one query, assigned or not."""
        expr = self.statement.expr
        return isinstance(expr.value if isinstance(expr, plan.Assign) else expr, plan.Subquery)

    def compute_value(self, run: Run) -> Any:
        if self.statement.tentative or self.is_outdated(run, run.get_source):
            statement = self.host.resolve_statement(self.tree, run, self.unknown)
            self._compile_statement(statement, self.host.generation, run.get_source)
        try:
            return self.function(run)
        except ExecutionError as error:
            if error.hints and error.hints[0].startswith(NONE_HINT):
                error.hints = write_test_for_none(self.statement.expr, error.span) or error.hints
            raise

    def is_outdated(self, run: Run, source: Callable[[str], Any], but: Container[str] = ()) -> bool:
        """Whether the plan relies on outdated columns or types, of other variables than those in `but`."""
        if self.generation != self.host.generation:
            return True
        for name, kind in self.statement.reads:
            if kind == ANY or name in but:
                continue
            present = self._get_variable_type(source, name)
            if present is self.types_seen.get(name):
                continue
            if not is_supertype(kind, present):
                return True
            self.types_seen[name] = present
        return any(self.host.has_table_changed(table, run) for table in self.statement.tables)

    def _get_variable_type(self, source: Callable[[str], Any], name: str) -> Type:
        """The type of a variable's present value; the unknown type if there is none any more."""
        try:
            return self.host.names.get_type(name, source(name))
        except KeyError:
            return ANY
        except ExecutionError as error:  # it cannot be read now, or is a parameter that this run does not give
            return ANY if error.code == "R001" and self.unknown == "missing" else NOTHING


class Query:
    """A compiled script, to be run many times; its names are resolved again when their meaning changes.

    `parameters` are the names that the script does not know, which `run` takes as keywords; a name that may be a column
    of one of them is known when it runs. `plan` is the resolved program, `sql` the text that runs. A script that does
    not take parameters was resolved for its next run.
    """

    def __init__(
        self,
        host: SessionHost,
        execute: Callable[[Callable[[Run, dict[str, Any]], Query], RunOptions, Mapping[str, Any]], Result],
        script: ast.Script,
        program: plan.Program,
        engine: Engine,
        takes_parameters: bool = False,
    ) -> None:
        self.parameters, self._mentions = program.parameters, program.mentions
        self._host = host
        self._execute = execute
        self._script = script
        self._program = program
        self._engine: Engine = engine
        self._generation = host.generation
        self._statements: dict[Engine, list[CompiledStatement]] = {}
        self._open: set[Engine] = set()  # those whose statements were made before parameters had values
        self._unknown: UnknownNames = "missing" if takes_parameters else "wrong"  # what a name without a value is
        self._fresh = not takes_parameters

    def statements(self, engine: Engine | None = None, run: Run | None = None) -> list[CompiledStatement]:
        """The compiled statements for an engine; for a run that has begun, with its values."""
        chosen = engine or self._engine
        if chosen not in self._statements:
            self._statements[chosen] = self._compile_now(chosen, run)
        if run is not None and not self._fresh and self._is_outdated(chosen, run):
            self._statements[chosen] = self._resolve_now(chosen, run)
        self._fresh = False
        return self._statements[chosen]

    def _is_outdated(self, engine: Engine, run: Run) -> bool:
        """Whether names in statements after the first might have another meaning; the first one checks for itself."""
        first, *others = self._statements[engine]
        if engine in self._open and any(compiled.statement.tentative for compiled in others):
            return True

        assigned = set(first.assigns)
        for compiled in others:
            if compiled.is_outdated(run, lambda name: self._host.get_present_value(name, run.arguments), assigned):
                return True
            assigned |= compiled.assigns
        return False

    def _compile_now(self, engine: Engine, run: Run | None) -> list[CompiledStatement]:
        """Compiles for an engine; after a refusal once more, with the present sources and the values of parameters."""
        if self._program.parameters:
            self._open.add(engine)
        with suppress(UnsupportedError):
            return self._compile_statements(self._program, self._generation, engine, run)
        return self._resolve_now(engine, run)

    def _resolve_now(self, engine: Engine, run: Run | None) -> list[CompiledStatement]:
        """The statements resolved against the present values, and those given to the run."""
        values, stats = ({}, Stats()) if run is None else (run.arguments, run.stats)
        unknown: UnknownNames = "parameter" if run is None else self._unknown
        resolved = stats.time_stage("resolve", lambda: self._host.resolve_script(self._script, values, unknown))
        statements = self._compile_statements(resolved(), self._host.generation, engine, run)
        if run is not None:
            self._open.discard(engine)
        return statements

    def _compile_statements(
        self, program: plan.Program, generation: int, engine: Engine, run: Run | None
    ) -> list[CompiledStatement]:
        started = time.perf_counter()
        statements: list[CompiledStatement] = []
        assigned: dict[str, plan.Constant | None] = {}
        for tree, part in zip(self._script.statements, program.statements, strict=True):
            variable = predict_variables(self._host.names, dict(assigned), {} if run is None else run.arguments)
            statements.append(CompiledStatement(self._host, tree, part, engine, generation, variable, self._unknown))
            assigned |= dict.fromkeys(statements[-1].assigns)
            if isinstance(part.expr, plan.Assign) and isinstance(part.expr.value, plan.Constant):
                assigned[part.expr.name] = part.expr.value
        if run is not None:
            lowering = sum(query.lowering_seconds for compiled in statements for query in compiled.queries)
            run.stats.seconds |= {"lower": lowering, "compile": time.perf_counter() - started - lowering}
        return statements

    @cached_property
    def call_places(self) -> dict[str, Places]:
        """Where the script calls functions of the user; empty if that is not known."""
        return list_plan_calls(*(statement.expr for statement in self._program.statements))

    def __repr__(self) -> str:
        text = " ".join(self._script.span.text.rstrip("; \n").split())
        takes = f"; takes {', '.join(self.parameters)}" if self.parameters else ""
        return f"<query {text if len(text) <= 70 else text[:67] + '...'}{takes}>"

    @property
    def plan(self) -> plan.Program:
        return self._program

    @property
    def sql(self) -> Sql:
        return join_outlined_sql(outline_compiled_script(self.statements()))

    def explain(self) -> Explanation:
        """Explains the script as `Result.explain` does, without what only a run can tell."""
        from ss2sql.results.explain.collector import explain_run

        missing = [name for name in self.parameters if name not in self._host.names]
        return explain_run(outline_compiled_script(self.statements()), missing=missing)

    def run(self, engine: Engine | Mapping[str, Any] | None = None, timeout: float | None = None,
            maximum: int | None = None, workers: int = 1, max_rows: int | None = None, trace: int | None = None,
            parameters: Mapping[str, Any] | None = None, **variables: Any) -> Result:  # fmt: skip
        """Runs the script; see `Session.run`. Raises ResolveError R009 for a parameter without a value."""
        if isinstance(engine, Mapping):  # run(..., {"k": 1})
            parameters, engine = engine, None
        values = join_parameters(parameters, variables)
        options = RunOptions(engine, timeout, maximum, workers, max_rows, trace)
        return self._execute(lambda run, known: self, options, values)

    def spark(self, timeout: float | None = None, maximum: int | None = None, **variables: Any) -> Any:
        """The rows of `run(engine="spark")` as a DataFrame in the session of Spark that `connect` was given.

        It has the columns and types of `Result.arrow`. Raises what that raises, and what `run` raises.
        """
        rows = self.run("spark", timeout, maximum, **variables).arrow()
        engine: Any = self._host.held.get_engine("spark")
        return engine.load_table(rows)

    def check_variables(self, variables: Iterable[str]) -> None:
        """Checks the names that a run gives.

        Raises SessionError S002 for one that the script does not have and that is nearly an option of `run`,
        ResolveError R009 for a parameter without a value.
        """
        text = self._script.span.source.text
        for name in (name for name in variables if not re.search(rf"\b{re.escape(name)}\b", text)):
            from difflib import get_close_matches

            for option in get_close_matches(name, OPTIONS, n=1, cutoff=0.8):
                message = f"neither the script nor run knows the name '{name}'"
                raise SessionError("S002", message, hints=(f"did you mean {option}=...?",))
        missing = [name for name in self.parameters if name not in variables and name not in self._host.names]
        if missing:
            hints = [f"run(..., {', '.join(f'{name}=...' for name in missing)})"]
            # Others may be columns of a missing source.
            meant = (n for n in variables if n not in self.parameters and suggest_similar(n, missing))
            hints += [f"'{name}' is no parameter of the script" for name in meant]
            for name in missing:
                known = self._mentions[name][1]
                hints = [*(suggest_names(name, known) if suggest_similar(name, known) else ()), *hints]
            span = self._mentions[missing[0]][0]
            raise ResolveError("R009", f"the script needs a value for {', '.join(missing)}", span, hints)


def outline_compiled_script(
    statements: Iterable[CompiledStatement], run: Run | None = None
) -> tuple[OutlinedStatement, ...]:
    """The statements as they are compiled now, with the values that a run has bound."""
    return tuple(
        OutlinedStatement(statement.tree.span.text, tuple(query.outline_query(run) for query in statement.queries))
        for statement in statements
    )


# --- compiled scripts in the SQL of other databases, to be read or to be taken there
def translate_script(statements: Sequence[CompiledStatement], dialect: Dialect) -> Sql:
    """The script in a dialect: queries as one SELECT each, searches as the statements of one level.

    Raises UnsupportedError where a query could mean something else there.
    """
    if dialect.name == "sqlite":
        return join_outlined_sql(outline_compiled_script(statements))
    texts = []
    for statement, outlined in zip(statements, outline_compiled_script(statements), strict=True):
        queries = [query.translate_query(dialect) for query in statement.queries]
        texts.append("\n".join(queries) or outlined.sql)
    return Sql("\n\n".join(texts))


# --- running a compiled script: its statements one after the other, and what becomes of them in the end
T = TypeVar("T")


def run_in_session(host: SessionHost, work: Callable[[Run], T]) -> T:
    """Calls `work` with a new run that Ctrl-C and `interrupt` can end. Raises Stopped with what was found."""
    run: Run | None = None
    try:
        run = Run(host, Stats(), sizes=ValueSizes(host.limits.max_size))
        with defer_keyboard_interrupt(run), host.session_lock:
            host.active_runs.append(run)
            try:
                result = work(run)
            except BaseException as error:
                if run.interrupted:
                    close_frames(error)
                raise
            finally:
                host.active_runs.remove(run)
                for end in run.cleanups:
                    end()
        if not run.interrupted:
            return result
    except KeyboardInterrupt:
        pass
    except Exception as error:
        if run is not None and run.interrupted and not isinstance(error, Cancelled):
            raise _build_script_cancelled(run) from error
        if isinstance(error, Stopped):
            error.partial = _build_session_partial(run, error.status)
            if isinstance(error, Timeout) and run is not None and run.sink is not None:
                error.hints = (suggest_timeout_cure(run.sink.query),)
        elif isinstance(error, MemoryError):
            raise translate_memory_error(error) from None
        elif isinstance(error, CarriedStopError):
            raise error.args[0] from None
        raise
    raise _build_script_cancelled(run) from None


def set_session_deadline(run: Run, host: SessionHost, seconds: float | None) -> None:
    """Sets the end of a run that starts now; that of an inner run is not later than the outer one's."""
    times = [outer.bounds.deadline for outer in host.runs]
    times.append(None if seconds is None else time.monotonic() + seconds)
    run.bounds.deadline = min((moment for moment in times if moment is not None), default=None)


def _build_script_cancelled(run: Run | None) -> Cancelled:
    cancelled = Cancelled("T002", "the run was interrupted")
    cancelled.partial = _build_session_partial(run, cancelled.status)
    return cancelled


def execute_script(
    host: SessionHost, query: Query, options: RunOptions, progress: str | bool, variables: dict[str, Any], run: Run
) -> Result:
    """Runs a compiled script and gives the result of its last statement. The `variables` are values of the language."""
    options.check_options()
    run.bounds.ceiling = _find_session_memory_limit(host)
    run.max_rows = run.sizes.rows = options.max_rows
    run.steps_left = _count_session_steps(host)
    run.arguments = variables
    with install_cancellation_check(run.check):
        return _execute_statements(host, query, options, progress, run)


def _execute_statements(host: SessionHost, query: Query, options: RunOptions, progress: str | bool, run: Run) -> Result:
    engine = options.engine if options.trace is None else "native"
    statements = run.statements = query.statements(engine, run)
    if options.trace is not None:
        from ss2sql.results.watching.search_trace import find_traced_query

        find_traced_query(statements[-1].tree)
    run.call_places = query.call_places
    run.foreteller = _start_session_workers(host, run, options.workers)
    run.progress = None if host.runs else make_progress(run, progress)  # one inside of another shows none
    host.runs.append(run)
    run.sizes.pause = run.check  # until its end: in a cycle all that it holds would wait for the garbage collector
    started = time.perf_counter()
    try:
        value = _execute_for_last_value(host, run, statements, options)
    finally:
        host.runs.remove(run)
        if host.runs:
            host.runs[-1].inner_run_steps += run.steps
        run.graph = run.sizes.pause = None
        if run.progress is not None:
            run.progress.remove_line()
        run.stats.add_seconds("run", started)
        run.stats.seconds["run"] -= run.stats.seconds.get("shape", 0.0)  # what was shaped meanwhile
    if run.foreteller is not None:
        run.foreteller.report_idle()
    return _build_script_result(run, statements, value)


def _execute_for_last_value(
    host: SessionHost, run: Run, statements: Sequence[CompiledStatement], options: RunOptions
) -> Any:
    value: Any = None
    for statement in statements:
        run.check()
        run.maximum = options.maximum if statement is statements[-1] else None
        run.trace = None
        if options.trace and statement is statements[-1]:
            from ss2sql.runtime.search.trace import Trace

            run.trace = Trace(options.trace)
        run.answer = run.sink = run.graph = None
        if run.progress is not None:
            run.progress.search = None  # that of the statement before
        host.forget_stable_calls(run)
        value = statement.compute_value(run)
        run.check_steps()
    return value


def _collect_session_trace(run: Run, statement: CompiledStatement) -> tuple[SearchTrace | None, tuple[str, ...]]:
    if run.trace is None:
        return None, ()
    from ss2sql.results.watching.search_trace import collect_notes, make_trace

    tree, written = statement.tree, statement.queries[-1].written
    return make_trace(run.trace, tree, written), tuple(collect_notes(run.trace, tree))


def _build_script_result(run: Run, statements: Sequence[CompiledStatement], value: Any) -> Result:
    answer: QueryResult | None = run.answer if statements[-1].is_query else None
    if answer is not None:
        answer.begin = run.bounds.get_remaining().begin_reading
    traced, told = _collect_session_trace(run, statements[-1])
    engines = [compiled.engine for statement in statements for compiled in statement.queries]
    used = answer.engine if answer is not None else (engines[-1] if engines else "native")
    return Result(
        None if answer is not None else copy_for_python(value),
        used,
        answer.status if answer is not None else "complete",
        run.stats,
        answer,
        outline_compiled_script(statements, run),
        (*told, *run.notes, *note_unread_arguments(run.arguments, [one.statement for one in statements])),
        traced,
    )


def _start_session_workers(host: SessionHost, run: Run, workers: int) -> CallPrefetcher | None:
    """Starts other processes for calls of functions if `workers` is more than one and this is not one of them."""
    if workers == 1 or IN_WORKER in os.environ:
        return None
    from ss2sql.runtime.parallel.block_calls import CallPrefetcher
    from ss2sql.runtime.parallel.process_pool import ProcessPool

    if host.held.processes is None:
        host.held.processes = ProcessPool()
    return CallPrefetcher(run, workers, host.held.processes, host.planned, host.memo_limit > 0)


def _find_session_memory_limit(host: SessionHost) -> int | None:
    """The bytes that the process may hold; an inner run has the ceiling of the outer one."""
    if host.limits.max_memory is None:
        return None
    ceilings = [run.bounds.ceiling for run in host.runs if run.bounds.ceiling is not None]
    return min(ceilings, default=(measure_memory() or 0) + host.limits.max_memory)


def _count_session_steps(host: SessionHost) -> int | None:
    """The steps that a run may try; an inner run has those that the outer one has left."""
    outer = host.runs[-1] if host.runs else None
    if outer is None or outer.steps_left is None:
        return host.limits.max_steps
    return outer.steps_left - outer.steps


def _build_session_partial(run: Run | None, status: Status) -> Result | None:
    """The rows that the interrupted query has found; None if no query was running."""
    if run is None or run.sink is None:
        return None
    rows, engine = run.sink.rows, run.sink.engine
    shown = run.answer.rows if run.answer is not None else rows.name_as_selected()
    form = None if run.sink.query is None else run.sink.query.representation
    answer = QueryResult(shown, None, engine, status, form=form)
    outlined, notes = outline_compiled_script(run.statements, run), tuple(run.notes)
    traced, _ = _collect_session_trace(run, run.statements[-1])
    return Result(None, engine, status, run.stats, answer, outlined, notes=notes, traced=traced)


# --- one line on the terminal that says how far a long run is
def check_progress_option(wanted: str | bool) -> None:
    """Raises SessionError S002 for anything but "auto", True and False."""
    if wanted is not True and wanted is not False and wanted != "auto":
        raise SessionError("S002", f'progress is "auto", True or False, not {wanted!r}')


def make_progress(run: Run, wanted: str | bool) -> Progress | None:
    """The line for a run; None where nobody would see it."""
    stream = sys.stderr
    if stream is None or wanted is False:
        return None
    if wanted == "auto" and (not stream.isatty() or os.environ.get("TERM") == "dumb"):
        return None
    from shutil import get_terminal_size  # takes 2 ms

    from ss2sql.session.progress_line import Progress  # for those who see it

    return Progress(run, stream, time.monotonic, lambda: get_terminal_size().columns)

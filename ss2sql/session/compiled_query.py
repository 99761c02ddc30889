"""The engines, and one query that is ready to run on its own: in SQLite, natively, or in another database."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Mapping, Sequence
from functools import cache, cached_property, partial
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, TypeGuard, get_args

import apsw

from ss2sql.errors import (
    Error,
    ExecutionError,
    SessionError,
    Stopped,
    UnsupportedError,
    note_place_on_exception,
    require_package,
)
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.cancellation import retry_with_stack
from ss2sql.language.kinds import Kind
from ss2sql.language.plan_traversal import can_move_world, has_array_calls, walk
from ss2sql.language.rows import Rows
from ss2sql.lowering.rewrites import optimise
from ss2sql.lowering.sql_query import Parameter, Sql, SqlQuery
from ss2sql.results.notes import explain_empty_result, explain_overestimates, find_notes, has_dropped_steps
from ss2sql.results.result import OutlinedQuery, QueryResult, Status
from ss2sql.results.time_notes import TimeComparison, explain_times, find_time_comparisons
from ss2sql.runtime.representations.shape import PATH_FORMS, represent_starred_columns
from ss2sql.runtime.run.post_processing import finish_sql_rows
from ss2sql.runtime.run.run_state import (
    ResultSink,
    Run,
    check_count_value,
    check_option_word,
    check_run_limit,
    find_lowest_run_limit,
)

if TYPE_CHECKING:
    from ss2sql.lowering.sql_builder import Dialect
    from ss2sql.runtime.external.duckdb_query import DuckQuery, PredicatePushdown
    from ss2sql.runtime.external.level_query import LevelQuery, TableEngine
    from ss2sql.runtime.python import NativeQuery
    from ss2sql.session.host import SessionHost


Engine: TypeAlias = Literal["auto", "database", "native", "duckdb", "spark"]
ENGINES: tuple[Engine, ...] = get_args(Engine)


def check_engine(engine: Any) -> None:
    check_option_word("engine", (engine,), ENGINES)


def check_engine_session(engine: Engine, session: Any) -> None:
    """Raises SessionError S002 for the connection of an engine that is not the session's."""
    if session is not None and engine not in _PACKAGES:
        message = f"session is the connection of the engine 'duckdb' or 'spark', not of {engine!r}"
        raise SessionError("S002", message, hints=("write connect(engine='duckdb', session=...)",))


OPTIONS = (
    "engine",
    "timeout",
    "maximum",
    "workers",
    "max_rows",
    "parameters",
)  # of `run`, which a misspelt name may mean


@dataclass(frozen=True, slots=True)
class RunOptions:
    """The options of one run, see `Session.run`."""

    engine: Engine | None
    timeout: float | None
    maximum: int | None
    workers: int = 1
    max_rows: int | None = None
    trace: int | None = None

    def check_options(self) -> None:
        if self.engine is not None:
            check_engine(self.engine)
        check_run_limit("maximum", self.maximum, 1)
        check_run_limit("workers", self.workers, 1)
        check_run_limit("max_rows", self.max_rows, 0)
        check_run_limit("trace", self.trace, 1)


def join_parameters(parameters: Mapping[str, Any] | None, variables: Mapping[str, Any]) -> dict[str, Any]:
    """The values that a run is given by `parameters` and by names."""
    if parameters is not None and not (isinstance(parameters, Mapping) and all(type(n) is str for n in parameters)):
        raise SessionError("S002", "parameters are values by their names", hints=('write parameters={"k": 1}',))
    return {**(parameters or {}), **variables}


def open_session_engine(name: str, session: Any = None, begun: Sequence[Run] = ()) -> TableEngine | None:
    """The database of an engine; None if SQLite or Python do the work.

    `session` is the user's connection of that database, whose settings count; `begun` are the active runs in order.
    """
    for package in _PACKAGES.get(name, ()):
        require_package(package, name, f"engine='{name}'")
    if name == "duckdb":
        from ss2sql.runtime.external.duckdb_search import DuckEngine

        return DuckEngine(session, begun)
    if name == "spark":
        from ss2sql.runtime.external.spark_session import SparkEngine

        return SparkEngine(session)
    return None


_PACKAGES = {"duckdb": ("duckdb", "pyarrow"), "spark": ("pyspark", "pyarrow", "pandas")}


# --- the Python engine, which is loaded when something asks for it: a query in SQLite does without
def make_native_query(query: plan.Query, watched: bool = False) -> NativeQuery:
    from ss2sql.runtime.python import NativeQuery

    return NativeQuery(query, watched=watched)


def compile_expression(
    expr: plan.Expr, dispatch: Callable[[plan.Query], Callable[[Run], Any]] | None = None
) -> Callable[[Run], Any]:
    """A function of the run that computes an expression; `dispatch` gives those of the queries in it."""
    match expr:
        case plan.Constant(value=value):
            return lambda run: value
        case plan.Variable():
            return partial(_read_variable, expr)
    from ss2sql.runtime.python import compile_statement

    return compile_statement(expr, dispatch)


def _read_variable(variable: plan.Variable, run: Run) -> Any:
    try:
        return run.get_source(variable.name) if variable.frame else run.get_variable(variable.name)
    except Error as error:
        raise error.with_span(variable.span) from error.__cause__
    except Exception as error:  # of an object of the user
        note_place_on_exception(error, variable.name, [variable.span])
        raise


# --- one query that is ready to run on its engine
LIMIT_CODES = ("X010", "X014")  # of rows and of the size of values: no reason to begin again

READS_VALUES = "all its sources are Python values, which SQLite would read one by one"
TAKES_ARRAYS = "it calls a function that takes arrays, which SQLite would call for one row at a time"
CUT_DEEP_DOWN = "SQLite would call functions for steps that a depth-first search never takes"

COUNTS_RESULTS = "maximum= counts the results, of which SQL shows the groups alone"

SCALAR_KINDS = Kind.NONE | Kind.NUMBER | Kind.STR


class CompiledQuery:
    """One query that stands by itself in a statement, ready to run on its engine.

    With the engine `auto` SQLite runs searches and what reads tables, worlds and frames, unless lowering objects;
    `reason` says why it does not. What fails in SQL is run again natively. What it was made for may rely on values of
    variables, which `variable` foretells; it is made anew when they differ.
    """

    def __init__(self, host: SessionHost, query: plan.Query, engine: Engine, variable: Callable[[str], Any]) -> None:
        self.host = host
        self.written = query
        self.required_engine = engine == "database"
        self.wanted = engine
        self.refusal: UnsupportedError | None = None
        self._compile_query(variable)
        if self.refusal is not None and None not in self.world.lists.values():
            raise self.refusal

    def _compile_query(self, variable: Callable[[str], Any]) -> None:
        """Rewrites and lowers the query, or compiles it to Python."""
        host, started = self.host, time.perf_counter()
        self.made = False  # until all is: Ctrl-C may come before that
        self.world = host.make_rewrite_context(variable)
        query, self.rewrites = optimise(self.written, host.disabled, self.world)
        self.query = query
        self.handed: dict[str, PredicatePushdown] = {}
        self.lowered: SqlQuery | None = None
        self.reason, self.cures = "engine='native' was given", tuple[str, ...]()
        self.refusal = None
        self.native: NativeQuery | LevelQuery | DuckQuery | None = None
        self.levels: LevelQuery | None = None  # a search by levels in another database
        self.duck: DuckQuery | None = None  # any other query in DuckDB
        tables = host.held.get_engine(self.wanted)
        levels = tables if query.search else None
        sources = None if tables is None or query.search else tables.sources
        # Nobody has a table of DuckDB while the module is not loaded.
        if sources is None and "ss2sql.runtime.external.duckdb_sources" in sys.modules:
            from ss2sql.runtime.external.duckdb_query import push_down_predicates

            query, self.handed = push_down_predicates(query, variable)
            self.query = query
        try:
            if sources is not None:
                from ss2sql.runtime.external.duckdb_query import DuckQuery

                self.native = self.duck = DuckQuery(query, sources, variable)
                self.reason = f"engine='{self.wanted}' was given"
            elif levels is not None:
                from ss2sql.runtime.external.level_query import LevelQuery

                self.native = self.levels = LevelQuery(query, levels)
                self.reason = f"engine='{self.wanted}' was given"
            elif self.wanted == "auto" and self._does_read_only_values(query):
                self.reason = READS_VALUES
            elif self.wanted == "auto" and has_array_calls(query):
                self.reason = TAKES_ARRAYS
            elif self.wanted == "auto" and can_stop_early(query):
                self.reason = CUT_DEEP_DOWN
            elif self.wanted != "native":
                self.lowered = self._lower_query(query)
                self.rewrites = (*self.rewrites, *self.lowered.applied)
        except UnsupportedError as error:
            self.reason, self.cures = error.message, tuple(error.hints)
            self.refusal = error if self.required_engine or levels or sources else None
        self.lowering_seconds = time.perf_counter() - started
        if not (self.native or self.lowered or self.refusal):
            self.native = make_native_query(query)
        self.bounded: SqlQuery | None = None
        self.by_value: SqlQuery | None = None
        self.plain = all(output.expr.type.is_only(SCALAR_KINDS) for output in query.columns)
        self.bindings: dict[int, tuple[plan.Expr, Callable[[Run], Any]]] = {}  # by the identities of the expressions
        self.arguments = [compile_expression(expr) for expr in query.representation.arguments]
        self.named = {name: compile_expression(expr) for name, expr in query.representation.named}
        self.moves = can_move_world(query)
        self.doubtful = any(_can_be_infinite(node) for node in walk(query) if isinstance(node, plan.TableSource))
        self.made = True

    def _does_read_only_values(self, query: plan.Query) -> bool:
        """Whether a query that is no search reads Python values alone, and nothing that lies in a table or a frame."""
        nodes = list(walk(query))
        if any(isinstance(node, (plan.TableSource, plan.WorldSource)) for node in nodes):
            return False
        read = {node.name for node in nodes if isinstance(node, plan.Variable)}
        return query.search is None and not any(map(self.host.names.is_frame, read))

    @property
    def engine(self) -> str:
        return "database" if self.lowered else self.native.engine if self.native else "native"

    @cached_property
    def notes(self) -> tuple[str, ...]:
        """What a person should know of the query whatever it finds."""
        return find_notes(self.written)

    @cached_property
    def notes_on_dropped_steps(self) -> tuple[str, ...]:
        """The same where a search has dropped steps as repeated."""
        return find_notes(self.written, dropped=True)

    @cached_property
    def time_comparisons(self) -> tuple[TimeComparison, ...]:
        """What may be compared with a time of a data frame in another spelling."""
        return tuple(find_time_comparisons(self.written))

    def compute_value(self, run: Run) -> Any:
        """Runs the query; its answer becomes the run's last one, its value is one of the language."""
        shapes, form = self.host.shapes, self.query.representation
        answer = self._find_answer(run)
        if shapes.is_shared(form, answer.rows):
            return run.stats.time_stage("shape", partial(shapes.share_values, form, answer.rows, run.sizes))()
        return shapes.make_language_value(form.name, answer.value)

    def find_located_answer(self, run: Run) -> QueryResult:
        """`run_query`, with errors that know no other place at the query's."""
        try:
            return self.run_query(run)
        except Error as error:
            raise error.with_span(self.query.span) from error.__cause__

    def run_query(self, run: Run) -> QueryResult:
        """Runs the query; its answer becomes the run's last one. The value of a search is made when it is read."""
        answer, form, shapes = self._find_answer(run), self.query.representation, self.host.shapes
        if not (shapes.is_built_in(form) and form.name in PATH_FORMS and answer.rows.paths is not None):
            answer.value  # noqa: B018 - it may fail, which has to be now
        return answer

    def _find_answer(self, run: Run) -> QueryResult:
        """The answer, whose value is not made yet."""
        self.refresh_if_outdated(run)
        query = self.query
        columns = tuple(output.name for output in query.columns)
        paths = query.gives_paths
        form, shapes = query.representation, self.host.shapes
        sink = Rows(columns, None if paths else [], [] if paths else None, plain=self.plain, hidden=form.hidden)
        run.sink = ResultSink(sink, self.engine, query)
        run.notes |= dict.fromkeys(self.notes)
        before = run.stats.steps
        outer = run.handed  # of a query whose clauses ask for this one
        own = {name: cache(partial(handed.read_table, run)) for name, handed in self.handed.items()}
        run.handed = {**outer, **own}
        try:
            with self.host.memories.begin_query(self.moves):
                found = self._read_database_rows(run, sink) if self.lowered else self._read_native_rows(run, sink)
                rows = represent_starred_columns(query, found, run.check)
                if self.doubtful or run.doubtful:
                    rows.check_values()
                if run.reads_user_objects and self.lowered is None:
                    rows.copy_values()
            if self.lowered is None:
                run.bound[self] = {**self.host.names.values, **run.snapshots, **run.arguments}
        finally:
            run.handed = outer
        arguments = tuple([argument(run) for argument in self.arguments])  # a generator changes StopIteration
        named = {name: argument(run) for name, argument in self.named.items()}
        if has_dropped_steps(query, run.stats, before[-1]):
            run.notes |= dict.fromkeys(self.notes_on_dropped_steps)
        run.notes |= dict.fromkeys(explain_empty_result(self.written, rows, run.stats, before, run.get_variable))
        run.notes |= dict.fromkeys(explain_times(self.time_comparisons, run.get_source))
        if run.overestimated:
            run.notes |= dict.fromkeys(explain_overestimates(self.written))
            run.overestimated = False
        status: Status = "maximum" if rows.ended else "complete"
        make = run.stats.time_stage("shape", partial(shapes.represent_rows, form, rows, arguments, named))
        answer = run.answer = QueryResult(
            rows.name_as_selected(), make, self.engine, status, query.columns, begin=lambda: run.check
        )
        return answer

    def refresh_if_outdated(self, run: Run) -> None:
        """Makes the query anew where it relies on what is no longer so. Raises what keeps it from its engine."""
        if not (self.made and self.world.is_still_valid(run.get_source)):
            self._compile_query(run.get_source)
        if run.maximum is not None and self.lowered and self.wanted == "auto" and can_stop_early(self.query, True):
            self.native, self.lowered, self.reason = make_native_query(self.query), None, CUT_DEEP_DOWN
        if run.maximum is not None and self.lowered and self.query.search and self.query.aggregated:
            self.native, self.lowered, self.reason = make_native_query(self.query), None, COUNTS_RESULTS
        if self.refusal is not None:
            raise self.refusal

    def _read_native_rows(self, run: Run, sink: Rows) -> Rows:
        assert self.native is not None
        if run.trace is not None:
            return make_native_query(self.query, watched=True).compute_rows(run, sink)
        return self.native.compute_rows(run, sink)

    def _read_database_rows(self, run: Run, sink: Rows) -> Rows:
        assert self.lowered is not None
        limit = self._evaluate_count(self.query.limit, run, 0, "LIMIT")
        offset = self._evaluate_count(self.query.offset, run, 0, "OFFSET") or 0
        own, maximum = self._evaluate_maximum(run)
        # They are evaluated once, although the statement has them as parameters.
        counts = [(self.query.limit, limit), (self.query.offset, offset)]
        counts += [(self.query.search.maximum, own)] if self.query.search else []
        cut_early = limit is not None and not self.query.order and not self.query.grouped
        if cut_early and limit == 0:
            return sink  # nothing of the query is evaluated; SQLite would bind values and take first steps
        end = None if limit is None else limit + offset
        most = find_lowest_run_limit(maximum, end if cut_early else None)
        bound = run.bound[self] = {}

        def evaluate_parameter(parameter: Parameter) -> Any:
            expr = parameter.expr
            known = next((count for counted, count in counts if counted is not None and counted == expr), None)
            value = bound[parameter.name] = parameter.encode_value(
                self._compile_binding(expr)(run) if known is None else known
            )
            return value

        def lower_by_value() -> SqlQuery:
            """The statement that compares values by their values."""
            if self.by_value is None:
                self.by_value = self._lower_query(self.query, cut=True, by_value=True)
            run.lowered[self] = self.by_value
            return self.by_value

        database = self.host.prepare_database()
        lowered = run.lowered[self] = self.by_value or self.lower_for_run(run)
        before = run.stats.steps
        try:
            extras = database.execute(lowered, run, evaluate_parameter, lower_by_value, sink, most)
        except Stopped:
            raise
        except Exception as error:
            if self.required_engine and _is_sqlite_limit(error):
                from ss2sql.lowering.unsupported import build_sql_size_refusal

                raise build_sql_size_refusal(self.query, error) from error
            if self.required_engine or (isinstance(error, ExecutionError) and error.code in LIMIT_CODES):
                raise
            refusal = error
        else:
            sink.ended = maximum is not None and len(extras) >= maximum
            return finish_sql_rows(lowered, sink, extras, slice(offset, end))
        # Outside of the handler: what is raised now has nothing to do with why SQL gave up.
        run.stats.steps = before
        return self._retry_natively(refusal, run, sink)

    def _retry_natively(self, error: Exception, run: Run, sink: Rows) -> Rows:
        """SQL has given up: the native rows, or the native error. Calls that were made are not made again."""
        # The text of an exception is the user's own.
        reason = error.message if isinstance(error, Error) else f"a function raised {type(error).__name__}"
        native = make_native_query(self.query)
        self.host.hand_over_calls(run)
        sink.clear_rows()
        if run.sink is not None:
            run.sink = run.sink._replace(engine=native.engine)
        rows = native.compute_rows(run, sink)
        self.native, self.lowered, self.reason = native, None, f"{reason}, so it runs natively"
        run.notes |= {f"the query ran twice: SQL gave up ({reason}), and Python decided": None}
        return rows

    def _compile_binding(self, expr: plan.Expr) -> Callable[[Run], Any]:
        """What computes the value of a parameter; compiled once, 0.1 ms."""
        known = self.bindings.get(id(expr))
        if known is None:
            known = self.bindings[id(expr)] = (expr, compile_expression(expr))
        return known[1]

    def lower_for_run(self, run: Run | None) -> SqlQuery:
        """The statement for a run: another one where the run, not the script, bounds the results of a search."""
        assert self.lowered is not None
        query = self.query
        if run is None or run.maximum is None or query.search is None or query.search.maximum or query.limit:
            return self.lowered
        if self.bounded is None:
            self.bounded = self._lower_query(query, cut=True)
        return self.bounded

    def _lower_query(self, query: plan.Query, cut: bool = False, by_value: bool = False) -> SqlQuery:
        """The statement of a query; some are needed while a script runs."""
        from ss2sql.lowering.lower import lower  # which takes 60 ms to load; a native query does without

        names, disabled = self.host.sql_names, self.host.disabled
        return retry_with_stack(lambda: lower(query, names, cut=cut, by_value=by_value, disabled=disabled))

    def _evaluate_maximum(self, run: Run) -> tuple[int | None, int | None]:
        """MAXIMUM, and the lower one of it and that of the run."""
        if self.query.search is None:
            return None, None
        own = self._evaluate_count(self.query.search.maximum, run, 1, "MAXIMUM")
        return own, find_lowest_run_limit(own, run.maximum)

    def _evaluate_count(self, expr: plan.Expr | None, run: Run, least: int, word: str) -> int | None:
        if expr is None:
            return None
        try:
            return check_count_value(self._compile_binding(expr)(run), least, word)
        except ExecutionError as error:
            raise error.with_span(expr.span) from None

    def make_sql_reader(self, run: Run | None = None) -> Callable[[], Sql]:
        """What gives the text that runs, with the values of its parameters: those of a run, else those in the text.

        Of a query that runs natively it is the text that SQLite would run, which is made when it is first read.
        """
        lowered = self.get_shown_statement(run)
        if lowered is None and self.duck is None and self.levels is None:
            return partial(self._write_unrun_sql, self.query, {} if run is None else run.bound.get(self, {}))
        if lowered is None:
            text = self.duck.text if self.duck is not None else self.levels.sql if self.levels else ""
            return partial(Sql, text, {} if run is None or self.duck is None else run.bound.get(self.duck))
        values = {p.name: p.encode_value(p.expr.value) for p in lowered.parameters if isinstance(p.expr, plan.Constant)}
        if run is not None:
            values.update(run.bound.get(self, ()))
        return partial(Sql, lowered.text, values, modules=lowered.modules)

    def _write_unrun_sql(self, query: plan.Query, known: Mapping[str, Any]) -> Sql:
        """What engine="database" would run, with the values of variables as far as they are known."""
        try:
            lowered = self._lower_query(query)
        except UnsupportedError as error:
            return Sql(f"-- no SQL: {error.message}")
        bound = {}
        for parameter in lowered.parameters:
            match parameter.expr:
                case plan.Constant(value=value):
                    bound[parameter.name] = parameter.encode_value(value)
                case plan.Variable(name=name) if name in known:
                    bound[parameter.name] = parameter.encode_value(known[name])
        return Sql(lowered.text, bound, modules=lowered.modules)

    def outline_query(self, run: Run | None) -> OutlinedQuery:
        """The query as it is compiled now, with the values that a run has bound."""
        return OutlinedQuery(
            self.host,
            self.written,
            self.query,
            self.engine,
            self.get_shown_statement(run),
            self.levels,
            self.duck,
            self.reason,
            self.cures,
            self.rewrites,
            self.make_sql_reader(run),
            tuple(self.handed.values()),
        )

    def translate_query(self, dialect: Dialect) -> str:
        """The query in a dialect as one SELECT, a search as the statements of one level. Raises UnsupportedError."""
        from ss2sql.lowering.portable.portable_flat import write_flat
        from ss2sql.runtime.external.level_query import LEVEL_STATEMENTS, plan_level_search

        if self.query.search is None:
            return f"{dialect.print_tree(write_flat(self.query, self.world.variable))};"
        if dialect.name not in LEVEL_STATEMENTS:
            reason = f"a search needs many statements, and nothing runs them in {dialect.name}"
            cures = ("--dialect duckdb and --dialect spark print them",)
            raise UnsupportedError("U001", reason, self.query.span, cures)
        return plan_level_search(self.query, dialect.name).sql

    def get_shown_statement(self, run: Run | None) -> SqlQuery | None:
        """The statement that a run has executed last, else the one that would run."""
        return self.lowered if run is None or self.lowered is None else run.lowered.get(self, self.lowered)


def can_stop_early(query: plan.Query, cut: bool = False) -> bool:
    """Whether a depth-first search ends early and calls functions of the user or of a world.

    SQLite evaluates all steps from a state before it takes the first of them, so it would call them for the rest, too.
    """
    search = query.search
    if search is None or search.order != "depth first" or search.repeats == "memorize":
        return False
    if not (cut or search.maximum or query.limit):
        return False
    return any(isinstance(node, plan.Call) and not node.function.builtin for node in walk(query))


def _can_be_infinite(table: plan.TableSource) -> bool:
    """Whether a table may hold what is no float of the language: it is looked for in columns of numbers alone.

    A view has no order.
    """
    others = Kind.STR | Kind.OBJECT
    return any(kind.may_be(Kind.FLOAT) and (not table.order or kind.may_be(others)) for _, kind in table.columns)


def _is_sqlite_limit(error: Exception) -> TypeGuard[ExecutionError]:
    """Too many terms, too deep, too long for SQLite: found out by its own prepare, before any row."""
    too_much = isinstance(error.__cause__, (apsw.SQLError, apsw.TooBigError))
    return isinstance(error, ExecutionError) and error.code == "X009" and too_much

"""Compiled scripts: every statement resolved and, query by query, lowered to SQL or compiled to Python."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from typing import TYPE_CHECKING, Any

from ss2sql.errors import ExecutionError, ResolveError, SessionError, UnsupportedError, suggest_similar
from ss2sql.frontend.resolve.scope import UnknownNames
from ss2sql.frontend.syntax import ast
from ss2sql.language import plan
from ss2sql.language.cancellation import retry_with_stack
from ss2sql.language.kinds import ANY, NOTHING, Type, is_supertype, type_of
from ss2sql.language.plan_traversal import list_plan_calls, walk
from ss2sql.lowering.sql_query import Sql
from ss2sql.results.result import OutlinedQuery, OutlinedStatement, Result, join_outlined_sql
from ss2sql.runtime.run.run_state import Places, Run, Stats
from ss2sql.session.compiled_query import OPTIONS, CompiledQuery, Engine, RunOptions, compile_expression
from ss2sql.session.variables import predict_variables

if TYPE_CHECKING:
    from ss2sql.lowering.sql_builder import Dialect
    from ss2sql.results.explain.explanation import Explanation
    from ss2sql.session.host import SessionHost


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
        self.facts_read: dict[str, Any] = {}  # values of variables that are of the types that the plan relies on
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
        return self.function(run)

    def is_outdated(self, run: Run, source: Callable[[str], Any], but: Container[str] = ()) -> bool:
        """Whether the plan relies on outdated columns or types, of other variables than those in `but`."""
        if self.generation != self.host.generation:
            return True
        own = self.host.names.values
        for name, kind in self.statement.reads:
            if kind == ANY or name in but:
                continue
            # Nobody changes the value of a script variable in place, so one that was looked at stays as it is. What is
            # attached, or given to this run, the user may have changed.
            kept = None if name in run.arguments else own.get(name)
            if kept is not None and kept is self.facts_read.get(name):
                continue
            if not is_supertype(kind, self._get_variable_type(source, name)):
                return True
            self.facts_read[name] = kept
        return any(self.host.has_table_changed(table, run) for table in self.statement.tables)

    def _get_variable_type(self, source: Callable[[str], Any], name: str) -> Type:
        """The type of a variable's present value; the unknown type if there is none any more."""
        try:
            return type_of(source(name))
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
        self.parameters = program.parameters
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

    def run(self, engine: Engine | None = None, timeout: float | None = None, maximum: int | None = None,
            workers: int = 1, max_rows: int | None = None, trace: int | None = None,
            **variables: Any) -> Result:  # fmt: skip
        """Runs the script; see `Session.run`. Raises ResolveError R009 for a parameter without a value."""
        options = RunOptions(engine, timeout, maximum, workers, max_rows, trace)
        return self._execute(lambda run, values: self, options, variables)

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
            raise ResolveError("R009", f"the script needs a value for {', '.join(missing)}", hints=hints)


def outline_compiled_script(
    statements: Iterable[CompiledStatement], run: Run | None = None
) -> tuple[OutlinedStatement, ...]:
    """The statements as they are compiled now, with the values that a run has bound."""
    return tuple(
        OutlinedStatement(
            statement.tree.span.text, tuple(_outline_compiled_query(query, run) for query in statement.queries)
        )
        for statement in statements
    )


def _outline_compiled_query(query: CompiledQuery, run: Run | None) -> OutlinedQuery:
    return OutlinedQuery(
        query.host,
        query.written,
        query.query,
        query.engine,
        query.get_shown_statement(run),
        query.levels,
        query.duck,
        query.reason,
        query.cures,
        query.rewrites,
        query.make_sql_reader(run),
        tuple(query.handed.values()),
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
        queries = [_translate_query(query, dialect) for query in statement.queries]
        texts.append("\n".join(queries) or outlined.sql)
    return Sql("\n\n".join(texts))


def _translate_query(query: CompiledQuery, dialect: Dialect) -> str:
    from ss2sql.lowering.portable.portable_flat import write_flat
    from ss2sql.runtime.external.level_query import LEVEL_STATEMENTS, plan_level_search

    if query.query.search is None:
        return f"{dialect.print_tree(write_flat(query.query, query.world.variable))};"
    if dialect.name not in LEVEL_STATEMENTS:
        reason = f"a search needs many statements, and nothing runs them in {dialect.name}"
        raise UnsupportedError("U001", reason, query.query.span, ("--dialect duckdb and --dialect spark print them",))
    return plan_level_search(query.query, dialect.name).sql

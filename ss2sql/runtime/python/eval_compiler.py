"""Texts given to `eval`: compiled when they are met, once per run, with what their place sees as parameters."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from ss2sql.errors import ExecutionError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import ANY, Type
from ss2sql.language.recursion_limit import deepen_stack
from ss2sql.language.values import format_value
from ss2sql.runtime.python.codegen_context import CodegenContext, PythonScope
from ss2sql.runtime.python.expression_facts import ExpressionAnalysis
from ss2sql.runtime.run.run_state import Run

MAX_EVAL_DEPTH = 30


@dataclass(frozen=True, slots=True)
class EvalScope:
    """What one `eval` sees.

    `scope` belongs to the resolver. `sources` are numbers of sources with the columns of tuples, the types of elements
    and the tables of worlds (see CodegenContext), `states` START WITH variables; texts take values in this order.
    """

    scope: Any
    sources: tuple[tuple[int, tuple[str, ...] | None, Type | None, Any], ...]
    states: tuple[tuple[int, str], ...]
    dispatch: Callable[[plan.Query], Callable[[Run], Any]] | None


class EvalCache(dict[str, Callable[..., Any]]):
    """The compiled texts of one `eval` in one run; asking for a new one compiles it."""

    def __init__(self, run: Run, name_scope: EvalScope) -> None:
        super().__init__()
        self.run = run
        self.name_scope = name_scope

    def __getitem__(self, text: Any) -> Callable[..., Any]:
        if type(text) is not str:  # a list could not even be looked up
            raise ExecutionError("X007", f"eval reads a text, not {format_value(text)}", hints=("put it into quotes",))
        return super().__getitem__(text)

    def __missing__(self, text: str) -> Callable[..., Any]:
        statements = self.run.host.resolve_text(text, self.name_scope.scope)
        function = self[text] = limit_eval_depth(self.run, compile_statements(statements, self.name_scope)(self.run))
        return function


def limit_eval_depth(run: Run, text: Callable[..., Any]) -> Callable[..., Any]:
    """A text that counts how deep it stands inside of others; one that reads itself would never end.

    So many levels fit into the stack, also where SQLite calls each of them.
    """

    def count_depth(*values: Any) -> Any:
        if run.texts == MAX_EVAL_DEPTH:
            hint = "let the text end: IF(condition; eval(text); value)"
            raise ExecutionError("X016", f"eval is nested more than {MAX_EVAL_DEPTH} deep", hints=(hint,))
        run.texts += 1
        try:
            with deepen_stack(run.texts):
                return text(*values)
        finally:
            run.texts -= 1

    return count_depth


def compile_statements(statements: tuple[plan.Expr, ...], name_scope: EvalScope) -> Callable[[Run], Callable[..., Any]]:
    """The function that binds a text to a run; the bound text gives the value of its last statement."""
    from ss2sql.runtime.python.python_expressions import write_expression
    from ss2sql.runtime.python.query_compiler import QueryCompiler

    analysis = ExpressionAnalysis(statements, open_world=True)
    with deepen_stack(analysis.levels):
        codegen = CodegenContext(statements[0].span, analysis)
        builder = QueryCompiler(codegen, name_scope.dispatch)
        body = PythonScope(codegen, codegen.new_name("text"), [], codegen.root)
        for source, columns, kind, table in name_scope.sources:
            name = codegen.names[source] = codegen.new_name("element")
            body.parameters.append(name)
            body.levels[source] = 0
            if columns is not None:
                codegen.tuples[source] = columns
            if table is not None:
                codegen.worlds[source] = table
            codegen.elements[source] = kind or ANY
        for state in name_scope.states:
            name = codegen.states[state] = codegen.new_name(state[1])
            body.parameters.append(name)
            body.states.add(state)
        for statement in statements[:-1]:
            build = codegen.build_at(statement.span)
            body.emit(build.run(write_expression(builder, statement, body)))
        build = codegen.build_at(statements[-1].span)
        body.emit(build.return_(write_expression(builder, statements[-1], body)))
        body.define_function()
        return codegen.compile_module(codegen.build_module(build.name(body.name)))


def make_eval_cache(run: Run, name_scope: EvalScope) -> EvalCache:
    return EvalCache(run, name_scope)

"""What the rest of ss2sql sees of the native executor: compiled queries and compiled statements."""

from __future__ import annotations

import ast
from collections.abc import Callable
from contextlib import nullcontext
from typing import TYPE_CHECKING, Any

from ss2sql.errors import Error
from ss2sql.language import plan
from ss2sql.language.cancellation import deepen_stack
from ss2sql.language.plan_traversal import may_run_foreign_code
from ss2sql.language.rows import Rows
from ss2sql.runtime.python.codegen_context import CodegenContext
from ss2sql.runtime.python.expression_facts import ExpressionAnalysis
from ss2sql.runtime.python.python_expressions import generate_expression
from ss2sql.runtime.python.query_compiler import Dispatch, QueryCompiler
from ss2sql.runtime.run.call_memo import report_memo_counts
from ss2sql.runtime.run.error_locations import locate_in_script
from ss2sql.runtime.run.run_state import Run

if TYPE_CHECKING:
    from ss2sql.language.values import FrozenShapes
    from ss2sql.runtime.search.search_run import FindPaths
    from ss2sql.runtime.search.step_contract import Expand


class NativeQuery:
    """A query that stands by itself, compiled to Python once, to be run many times.

    A search that is `watched` goes step by step, and `run.trace` hears of it. `find` finds its results in place of a
    loop. `levels` says how deeply its expressions are nested.
    """

    engine = "native"

    def __init__(self, query: plan.Query, find: FindPaths | None = None, watched: bool = False) -> None:
        self.query = query
        analysis = ExpressionAnalysis((query,))
        self.levels = analysis.levels
        self._runs_foreign_code = may_run_foreign_code(query)
        with deepen_stack(self.levels):
            codegen = CodegenContext(query.span, analysis)
            codegen.watched = query if watched else None
            codegen.level_searched_query, codegen.find = query, find
            nested = QueryCompiler(codegen).compile_query(query, codegen.root)
            self._module = codegen.build_module(codegen.build.name(nested.task))
            self._bound = codegen.compile_module(self._module)

    @property
    def generated_code(self) -> str:
        with deepen_stack(2 * self.levels):
            return ast.unparse(ast.fix_missing_locations(self._module))

    def compute_rows(self, run: Run, sink: Rows | None = None) -> Rows:
        """The answer of the query.

        Args:
            run: the run that it belongs to.
            sink: is filled while the query runs, so that what was found by then outlives an error; it is
                then also the result.

        Raises:
            Error: with the place in the script. Exceptions of the user's functions pass with a note.
        """
        return self._run_with_location(  # type: ignore[no-any-return]
            run, lambda: self._bound(run).compute_rows(sink=sink, outermost=True)
        )

    def compute_value(self, run: Run) -> Any:
        """The value that the query's representation makes of its answer; raises what `compute_rows` raises."""

        def compute_shaped() -> Any:
            task = self._bound(run)
            return task.shape_rows(task.compute_rows(outermost=True))

        return self._run_with_location(run, compute_shaped)

    def make_step_function(self, run: Run) -> tuple[Expand, FrozenShapes, Callable[[], None]]:
        """The step function of a search with `find`, how its values are frozen, and what updates `run.stats`."""
        with deepen_stack(self.levels):
            task = self._bound(run)
            _, expand, *_ = task.find()
        return expand, task.form.search.shapes, task.flush

    def _run_with_location(self, run: Run, work: Callable[[], Any]) -> Any:
        try:
            with deepen_stack(self.levels), nullcontext() if self._runs_foreign_code else run.pause_collector():
                return work()
        except Exception as error:
            other = locate_in_script(error)
            if isinstance(other, Error):
                other.with_span(self.query.span)
            if other is error:
                raise
            raise other from None
        finally:
            report_memo_counts(run)


def compile_statement(expr: plan.Expr, dispatch: Dispatch | None = None) -> Callable[[Run], Any]:
    """A statement as a function of the run.

    Args:
        expr: the statement's expression.
        dispatch: is called once for every query that is not inside of another one, and gives the function that
            runs it and has its value; without it queries run natively.

    Returns:
        The function; it raises as `NativeQuery.compute_rows` does.
    """
    if isinstance(expr, plan.Constant):
        return lambda run: expr.value
    analysis = ExpressionAnalysis((expr,), open_world=True, inside=False)
    with deepen_stack(analysis.levels):
        codegen = CodegenContext(expr.span, analysis)
        builder = QueryCompiler(codegen, dispatch or (lambda query: NativeQuery(query).compute_value))
        bound = codegen.compile_module(codegen.build_module(generate_expression(builder, expr, codegen.root)))

    def run_statement(run: Run) -> Any:
        try:
            with deepen_stack(analysis.levels):
                return bound(run)
        except Exception as error:
            other = locate_in_script(error)
            if other is error:
                raise
            raise other from None
        finally:
            report_memo_counts(run)

    return run_statement

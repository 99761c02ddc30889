"""What the rest of ss2sql sees of the native executor: compiled queries and compiled statements."""

from __future__ import annotations

import ast
from collections.abc import Callable, Iterator
from functools import cached_property
from typing import TYPE_CHECKING, Any

from ss2sql import plan
from ss2sql.errors import Error
from ss2sql.runtime.call_sites import takes_arrays
from ss2sql.runtime.native.builder import Builder, Dispatch
from ss2sql.runtime.native.calls import settle_calls
from ss2sql.runtime.native.deep import deep
from ss2sql.runtime.native.expressions import expression
from ss2sql.runtime.native.facts import Analysis
from ss2sql.runtime.native.locate import placed
from ss2sql.runtime.native.unit import Unit
from ss2sql.runtime.rows import Row, Rows
from ss2sql.runtime.run import Run

if TYPE_CHECKING:
    from ss2sql.runtime.frozen import Shapes
    from ss2sql.runtime.memorize.hunt import Find
    from ss2sql.runtime.scouts import Scouts
    from ss2sql.runtime.search.contract import Expand


class NativeQuery:
    """A query that stands by itself, compiled to Python once, to be run many times.

    The steps of a search are counted `by_level` on demand, see by_level.py; one that is `watched` goes step by step,
    and `run.trace` hears of it. `find` finds its results in the place of a loop. `levels` says how deeply its
    expressions are nested.
    """

    engine = "native"

    def __init__(
        self, query: plan.Query, by_level: bool = False, find: Find | None = None, watched: bool = False
    ) -> None:
        self.query = query
        self._takes_arrays = takes_arrays(query)
        analysis = Analysis((query,))
        self.levels = analysis.levels
        with deep(self.levels):
            unit = Unit(query.span, analysis)
            unit.by_level = query if by_level else None
            unit.watched = query if watched else None
            unit.searched, unit.find = query, find
            nested = Builder(unit).query(query, unit.root)
            self._module = unit.module(unit.pen.name(nested.task))
            self._bound = unit.compiled(self._module)

    @property
    def source_text(self) -> str:
        """The generated code as text."""
        with deep(2 * self.levels):
            return ast.unparse(ast.fix_missing_locations(self._module))

    def rows(self, run: Run, sink: Rows | None = None) -> Rows:
        """The answer of the query.

        Args:
            run: the run that it belongs to.
            sink: is filled while the query runs, so that what was found by then outlives an error; it is
                then also the result.

        Raises:
            Error: with the place in the script. Exceptions of the user's functions pass with a note.
        """
        work = self._looking_ahead(run, lambda: self._bound(run).rows(sink=sink, outermost=True))
        return self._placed(run, work)  # type: ignore[no-any-return]

    def value(self, run: Run) -> Any:
        """The value that the query's representation makes of its answer; raises what `rows` raises."""

        def value() -> Any:
            task = self._bound(run)
            return task.shaped(task.rows(outermost=True))

        return self._placed(run, self._looking_ahead(run, value))

    def stream(self, run: Run) -> Iterator[Row]:
        """The rows of a query, one by one where that is possible; errors have no place."""
        return self._bound(run).stream()  # type: ignore[no-any-return]

    def steps(self, run: Run) -> tuple[Expand, Shapes, Callable[[], None]]:
        """The step function of a search with `find`, how its values are frozen, and what brings `run.stats` up to
        date.
        """
        with deep(self.levels):
            task = self._bound(run)
            _, expand, *_ = task.find()
        return expand, task.form.search.shapes, task.flush

    def _looking_ahead(self, run: Run, work: Callable[[], Any]) -> Callable[[], Any]:
        """The work, for the time of which functions that take arrays know what is coming."""
        if not self._takes_arrays:
            return work

        def with_scouts() -> Any:
            run.ahead.append(self.scouts.of_run(run))
            try:
                return work()
            finally:
                run.ahead.pop().close()

        return with_scouts

    @cached_property
    def scouts(self) -> Scouts:
        from ss2sql.runtime.scouts import Scouts  # which run natively themselves

        return Scouts(self.query)

    def _placed(self, run: Run, work: Callable[[], Any]) -> Any:
        try:
            with deep(self.levels):
                return work()
        except Exception as error:
            other = placed(error)
            if isinstance(other, Error):
                other.located(self.query.span)
            if other is error:
                raise
            raise other from None
        finally:
            settle_calls(run)


def compile_statement(expr: plan.Expr, dispatch: Dispatch | None = None) -> Callable[[Run], Any]:
    """A statement as a function of the run.

    Args:
        expr: the statement's expression.
        dispatch: is asked once for every query that is not inside of another one, and gives the function that
            runs it and has its value; without it queries run natively.

    Returns:
        The function; it raises as `NativeQuery.rows` does.
    """
    if isinstance(expr, plan.Constant):
        return lambda run: expr.value
    analysis = Analysis((expr,), open_world=True, inside=False)
    with deep(analysis.levels):
        unit = Unit(expr.span, analysis)
        builder = Builder(unit, dispatch or (lambda query: NativeQuery(query).value))
        bound = unit.compiled(unit.module(expression(builder, expr, unit.root)))

    def statement(run: Run) -> Any:
        try:
            with deep(analysis.levels):
                return bound(run)
        except Exception as error:
            other = placed(error)
            if other is error:
                raise
            raise other from None
        finally:
            settle_calls(run)

    return statement

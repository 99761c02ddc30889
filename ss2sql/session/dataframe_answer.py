"""The paths of a search as a DataFrame of the database that finds them: which searches can, and its columns."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ss2sql.errors import UnsupportedError
from ss2sql.language import plan
from ss2sql.language.rows import Rows
from ss2sql.results.result import QueryAnswer, name_search_columns
from ss2sql.runtime.run.run_state import Run
from ss2sql.session.compiled_query import CompiledQuery

if TYPE_CHECKING:
    from ss2sql.runtime.external.level_query import LevelQuery


def build_dataframe_answer(expr: plan.Expr, queries: Sequence[CompiledQuery], run: Run) -> QueryAnswer:
    """The answer of a statement whose value is such a DataFrame. Raises UnsupportedError where it has none."""
    query = queries[-1] if isinstance(expr, plan.Subquery) else None
    if query is not None:
        query.refresh_if_outdated(run)
    found = _find_level_query(expr, None if query is None else query.levels)
    assert query is not None
    names, frame = found.make_dataframe(run, query.count_wanted_results(run))
    rows = Rows(names, paths=[])
    answer = run.answer = QueryAnswer(rows, None, query.engine, made=frame.toDF(*name_search_columns(names)))
    return answer


def _find_level_query(expr: plan.Expr, found: LevelQuery | None) -> LevelQuery:
    place, reason, cure = expr.span, "only a search has paths that are a DataFrame of Spark", "take run(...).df()"
    if isinstance(expr, plan.Subquery) and found is not None:
        query = expr.query
        stars = [output.expr.span for output in query.columns if output.star]
        if found.database.frame is None:
            reason = "only Spark has such frames"
        elif query.group:
            place, reason, cure = query.group[0].span, "GROUP BY makes no DataFrame", "take its groupBy"
        elif query.order:
            place, reason, cure = query.order[0].expr.span, "ORDER BY makes no DataFrame", "take its orderBy"
        elif stars:
            place, reason, cure = stars[0], "nobody knows these columns before the search runs", "name them in SELECT"
        else:
            return found
    raise UnsupportedError("U001", reason, place, (cure,))

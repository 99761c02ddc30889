"""Counts of a search level by level, from a second run.

A search counts all its steps together, because counting by level would cost time in its innermost loop. So a second,
native run of the same search counts them, where calling functions again has no effect.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ss2sql.language import plan
from ss2sql.language.plan_traversal import walk
from ss2sql.runtime.python import NativeQuery
from ss2sql.runtime.python.expression_facts import ExpressionAnalysis
from ss2sql.runtime.python.level_counts import LevelCount, LevelCounter

if TYPE_CHECKING:
    from ss2sql.results.result import Result
    from ss2sql.runtime.run.run_state import Run


def count_levels(result: Result) -> list[LevelCount] | str:
    """The steps of the result's search by level, or the reason why they cannot be counted."""
    query = result.outline[-1].queries[-1].query if result.outline and result.outline[-1].queries else None
    if result.answer is None or query is None or query.search is None:
        return "the result is not that of a search"
    reason = _find_obstacle(query)
    if reason is None and result.status not in ("complete", "maximum"):
        reason = "the search was broken off"
    if reason is not None or result.rerun is None:
        return reason or "the search cannot be run again"
    found: list[LevelCount] = result.rerun(lambda run: _count_again(query, run))
    return found


def _find_obstacle(query: plan.Query) -> str | None:
    if not ExpressionAnalysis((query,)).facts(query).steady:
        return "what it calls or assigns is not to be done twice"
    if any(isinstance(node, plan.WorldSource) for node in walk(query)):
        return "it reads a world"
    return None


def _count_again(query: plan.Query, run: Run) -> list[LevelCount]:
    run.by_level = LevelCounter(run.stats)
    NativeQuery(query, by_level=True).compute_rows(run)
    run.by_level.add_counts()
    levels: list[LevelCount] = run.by_level.levels
    return levels

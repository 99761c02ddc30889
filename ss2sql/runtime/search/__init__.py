"""The searches of the Python engine: one textbook loop per file over the step function of a query.

step_contract says what loops and step function owe each other, and evaluates the steps of a state once where that pays.
breadth_first, depth_first and best_first are the loops; trace notes events. MEMORIZE: search_run, memorize,
bidirectional; then its paths: paths_by_length, paths_by_weight.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from ss2sql.language import plan
from ss2sql.runtime.search.best_first import a_star, a_star_unique, greedy_best_first, uniform_cost_unique
from ss2sql.runtime.search.breadth_first import breadth_first, breadth_first_unique
from ss2sql.runtime.search.depth_first import depth_first
from ss2sql.runtime.search.step_contract import Found, Problem


def choose_search(search: plan.Search) -> Callable[[Problem], Iterator[Found]]:
    """The loop of a search; MEMORIZE has its own, memorize.py."""
    if search.order == "depth first":
        return depth_first
    if search.order == "breadth first":
        return breadth_first_unique if search.repeats == "unique" else breadth_first
    if search.order == "greedy":
        return greedy_best_first
    if search.repeats == "unique":
        return a_star_unique if search.heuristic is not None else uniform_cost_unique
    return a_star

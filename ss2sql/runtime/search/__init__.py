"""The searches of the Python engine: one textbook loop per file, over the step function of a query.

`contract.py` says what the loops and the step function owe each other.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from ss2sql import plan
from ss2sql.runtime.search.best_first import best_first, best_first_unique, greedy, guided, guided_unique
from ss2sql.runtime.search.breadth_first import breadth_first, breadth_first_unique
from ss2sql.runtime.search.contract import Found, Problem
from ss2sql.runtime.search.depth_first import depth_first


def search_of(search: plan.Search) -> Callable[[Problem], Iterator[Found]]:
    """The loop of a search; that of MEMORIZE is in runtime/memorize."""
    if search.order == "depth first":
        return depth_first
    if search.order == "breadth first":
        return breadth_first_unique if search.repeats == "unique" else breadth_first
    if search.order == "greedy":
        return greedy
    if search.repeats == "unique":
        return guided_unique if search.heuristic is not None else best_first_unique
    return guided if search.heuristic is not None else best_first

"""The orders of search: one file each, and the table of what combines with what.

`step.py` says what all share. Each order is a generator of results for a `Hunt`: depth_first.py,
breadth_first.py, best_first.py (COST, HEURISTIC, PROBABILITY). MEMORIZE has a room of its own, `runtime/memorize/`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from ss2sql import plan
from ss2sql.runtime.memorize.growing import memorize, memorize_weighted
from ss2sql.runtime.native.searches import best_first as best
from ss2sql.runtime.native.searches import breadth_first as breadth
from ss2sql.runtime.native.searches import depth_first as depth
from ss2sql.runtime.native.searches.step import Found as Found
from ss2sql.runtime.native.searches.step import Hunt as Hunt

SEARCHES: dict[tuple[plan.Order, plan.Repeats], Callable[[Hunt], Iterator[Found]]] = {
    ("depth first", "allowed"): depth.depth_first,
    ("depth first", "no cycle"): depth.depth_first_no_cycle,
    ("depth first", "unique"): depth.depth_first_unique,
    ("depth first", "memorize"): memorize,
    ("breadth first", "allowed"): breadth.breadth_first,
    ("breadth first", "no cycle"): breadth.breadth_first_no_cycle,
    ("breadth first", "unique"): breadth.breadth_first_unique,
    ("cost", "allowed"): best.best_first,
    ("cost", "no cycle"): best.best_first_no_cycle,
    ("cost", "unique"): best.best_first_unique,
    ("cost", "memorize"): memorize_weighted,
    ("probability", "allowed"): best.best_first,
    ("probability", "no cycle"): best.best_first_no_cycle,
    ("probability", "unique"): best.best_first_unique,
    ("probability", "memorize"): memorize_weighted,
}

"""The orders of search: one file each, and the table of what combines with what.

An order is a text in Python, the loop of the search with words for the clauses of the query, see native/loop_code.py.
MEMORIZE has a room of its own, `runtime/memorize/`; its text makes a level of the graph.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from ss2sql import plan
from ss2sql.runtime.memorize.growing import memorize
from ss2sql.runtime.memorize.hunt import Found, Hunt
from ss2sql.runtime.native.searches.best_first import BEST_FIRST, BEST_FIRST_UNIQUE
from ss2sql.runtime.native.searches.breadth_first import BREADTH_FIRST
from ss2sql.runtime.native.searches.depth_first import DEPTH_FIRST

SEARCHES: dict[tuple[plan.Order, plan.Repeats], str | Callable[[Hunt], Iterator[Found]]] = {
    ("depth first", "allowed"): DEPTH_FIRST,
    ("depth first", "no cycle"): DEPTH_FIRST,
    ("depth first", "unique"): DEPTH_FIRST,
    ("depth first", "memorize"): memorize,
    ("breadth first", "allowed"): BREADTH_FIRST,
    ("breadth first", "no cycle"): BREADTH_FIRST,
    ("breadth first", "unique"): BREADTH_FIRST,
    ("cost", "allowed"): BEST_FIRST,
    ("cost", "no cycle"): BEST_FIRST,
    ("cost", "unique"): BEST_FIRST_UNIQUE,
    ("cost", "memorize"): memorize,
    ("probability", "allowed"): BEST_FIRST,
    ("probability", "no cycle"): BEST_FIRST,
    ("probability", "unique"): BEST_FIRST_UNIQUE,
    ("probability", "memorize"): memorize,
}

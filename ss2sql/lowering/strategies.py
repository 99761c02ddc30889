"""Search strategies as data: which waiting step is next, and what becomes of a row that was reached before.

An `Order` sorts the frontier, a `RepeatRule` decides on repeated rows. A strategy is one of each. The lowering reads
them, and so does whoever lists or explains strategies.
"""

from __future__ import annotations

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan


@dataclass(frozen=True, slots=True)
class Order:
    """Which step is taken next from the queue of a recursive query."""

    name: str
    keyword: str
    queue: tuple[tuple[str, bool], ...]  # columns that sort the queue, True: descending; then the step's number
    promise: str  # what a user can rely on
    next_step: str  # which one is taken next, in words
    title: str  # its name in textbooks
    total: str | None = None  # the column with the total of the path, where steps have weights


@dataclass(frozen=True, slots=True)
class RepeatRule:
    """What happens to a step whose row was reached before, by functions of runtime/sqlite/search_functions.py."""

    name: str
    keyword: str
    repeat_test: str | None  # tells whether the row was reached; None: rows are not compared
    number: str  # numbers the step and notes its row
    lowered: bool  # False: only Python runs it
    promise: str


DEPTH_FIRST = Order(
    "depth first",
    "DEPTH FIRST",
    (("depth", True), ("step", False)),
    "Finds every path of a finite search; on an infinite one it may follow an endless path for ever.",
    "the deepest first",
    "depth first",
)
BREADTH_FIRST = Order(
    "breadth first",
    "BREADTH FIRST",
    (("step", False),),
    "Gives shorter paths before longer ones, and finds a path whenever there is one.",
    "the oldest first",
    "breadth first",
)
# Dijkstra 1959; with HEURISTIC, where a step waits at its cost plus the estimate, A* (Hart, Nilsson and Raphael 1968).
UNIFORM_COST = Order(
    "cost",
    "COST",
    (("cost", False), ("step", False)),
    "Gives cheaper paths before more expensive ones; a heuristic that is a lower bound never changes the costs found.",
    "the cheapest first",
    "uniform cost",
    "cost",
)
MOST_LIKELY_FIRST = Order(
    "probability",
    "PROBABILITY",
    (("likelihood", True), ("step", False)),
    "Gives likelier paths before less likely ones.",
    "the likeliest first",
    "most likely first",
    "likelihood",
)
GREEDY_BEST_FIRST = Order(
    "greedy",
    "HEURISTIC",
    (("rank", False), ("step", False)),
    "Goes on from the step with the smallest estimate; the paths that it finds need not be the cheapest.",
    "the one with the smallest estimate first",
    "greedy best-first",
)

TREE_SEARCH = RepeatRule("allowed", "", None, "enter", True, "Every path, cycles included.")
NO_CYCLE = RepeatRule("no cycle", "NO CYCLE", "on_path", "enter", True, "Every path without a repeated row.")
UNIQUE = RepeatRule(
    "unique", "UNIQUE", "reached", "enter_first", True, "One path to every row that can be reached at all."
)
# With weights, the least known total of the row guards the queue, and a step that is no longer the best is dropped
# when it is taken.
UNIQUE_BEST = RepeatRule("unique", "UNIQUE", "closed", "enter_best", True, UNIQUE.promise)
MEMORIZE = RepeatRule(
    "memorize", "MEMORIZE", None, "enter", False, "Every path without a repeated row up to the bound, shortest first."
)

ORDERS: dict[str, Order] = {
    order.name: order for order in (DEPTH_FIRST, BREADTH_FIRST, UNIFORM_COST, MOST_LIKELY_FIRST, GREEDY_BEST_FIRST)
}
REPEAT_RULES: dict[str, RepeatRule] = {rule.name: rule for rule in (TREE_SEARCH, NO_CYCLE, UNIQUE, MEMORIZE)}


def get_order(search: plan.Search) -> Order:
    return ORDERS[search.order]


def get_repeat_rule(search: plan.Search) -> RepeatRule:
    """The rule of a search; UNIQUE has another one if steps have weights."""
    best = search.repeats == "unique" and search.weight is not None
    return UNIQUE_BEST if best else REPEAT_RULES[search.repeats]

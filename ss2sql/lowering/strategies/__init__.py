"""Search strategies as data, one per file, read by the lowering and by whoever lists or explains them.

An order says which of the steps that wait is taken next, a guard what happens to a row that was met before.
Each file holds one order or guard; the registries below are all that the rest of the package looks at.
"""

from __future__ import annotations

from ss2sql import plan
from ss2sql.lowering.strategies import (
    allowed,
    breadth_first,
    cost,
    depth_first,
    greedy,
    memorize,
    no_cycle,
    probability,
    unique,
)
from ss2sql.lowering.strategies.base import Guard, Order

ORDERS: dict[str, Order] = {
    order.name: order for order in (depth_first.ORDER, breadth_first.ORDER, cost.ORDER, probability.ORDER, greedy.ORDER)
}
GUARDS: dict[str, Guard] = {
    guard.name: guard for guard in (allowed.GUARD, no_cycle.GUARD, unique.GUARD, memorize.GUARD)
}


def order_of(search: plan.Search) -> Order:
    return ORDERS[search.order]


def guard_of(search: plan.Search) -> Guard:
    """The guard of a search; UNIQUE has another one where steps have weights."""
    best = search.repeats == "unique" and search.weight is not None
    return unique.BEST if best else GUARDS[search.repeats]


__all__ = ["GUARDS", "ORDERS", "Guard", "Order", "guard_of", "order_of"]

"""Greedy best-first: the waiting step with the smallest estimate, which is fast where the estimate is good."""

from ss2sql.lowering.strategies.base import Order

ORDER = Order(
    "greedy",
    "HEURISTIC",
    (("rank", False), ("step", False)),
    "Goes on from the step with the smallest estimate; the paths that it finds need not be the cheapest.",
)

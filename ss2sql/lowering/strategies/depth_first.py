"""Depth first: the deepest waiting step, siblings in the order in which they were generated."""

from ss2sql.lowering.strategies.base import Order

ORDER = Order(
    "depth first",
    "DEPTH FIRST",
    (("depth", True), ("step", False)),
    "Finds every path of a finite search; on an infinite one it may follow an endless path for ever.",
)

"""Breadth first: the step that was generated first."""

from ss2sql.lowering.strategies.base import Order

ORDER = Order(
    "breadth first",
    "BREADTH FIRST",
    (("step", False),),
    "Gives shorter paths before longer ones, and finds a path whenever there is one.",
)

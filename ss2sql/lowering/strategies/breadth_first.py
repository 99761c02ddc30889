"""Breadth first: the step that has waited longest; steps are numbered as they are made, so this is level by level."""

from ss2sql.lowering.strategies.base import Order

ORDER = Order(
    "breadth first",
    "BREADTH FIRST",
    (("step", False),),
    "Gives shorter paths before longer ones, and finds a path whenever there is one.",
)

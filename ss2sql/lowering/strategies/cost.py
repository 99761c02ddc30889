"""Uniform cost, with HEURISTIC A*: the cheapest waiting step (Dijkstra 1959; Hart, Nilsson and Raphael 1968)."""

from ss2sql.lowering.strategies.base import Order

ORDER = Order(
    "cost",
    "COST",
    None,
    "Gives cheaper paths before dearer ones; a heuristic that is a lower bound never changes the costs found.",
)

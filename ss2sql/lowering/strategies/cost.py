"""Uniform cost, with HEURISTIC A*: the cheapest waiting step (Dijkstra 1959; Hart, Nilsson and Raphael 1968).

With HEURISTIC a step waits at its cost plus the estimate of what remains, see `lowering/on_entering.py`.
"""

from ss2sql.lowering.strategies.base import Order

ORDER = Order(
    "cost",
    "COST",
    (("cost", False), ("step", False)),
    "Gives cheaper paths before more expensive ones; a heuristic that is a lower bound never changes the costs found.",
    "cost",
)

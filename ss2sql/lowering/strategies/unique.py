"""UNIQUE: a row is reached once in the whole search.

It is marked when its step is taken from the queue, not when it enters: in depth-first order on the edges
S-B, S-C, B-C, C-D a mark on entering would lose S-B-C-D.
"""

from ss2sql.lowering.strategies.base import Guard

GUARD = Guard("unique", "UNIQUE", "reached", "reach", True, "One path to every row that can be reached at all.")

"""UNIQUE: a row is reached once in the whole search, by the first path to it, or by the best one.

In breadth-first order a row is marked when its step enters the queue, for nothing can come before it any
more. In depth-first order it is marked when its step is taken: on the edges S-B, S-C, B-C, C-D a mark on
entering would lose S-B-C-D. Where steps have weights, the best known total of the row guards the entry, and
a step that is no longer the best is neither given out nor expanded when it is taken.
"""

from ss2sql.lowering.strategies.base import Guard

PROMISE = "One path to every row that can be reached at all."
GUARD = Guard("unique", "UNIQUE", "reached", "enter_first", True, PROMISE)
BEST = Guard("unique", "UNIQUE", "closed", "enter_best", True, PROMISE)

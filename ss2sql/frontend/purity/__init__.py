"""Purity: how far a Python function can be relied on to repeat itself, and how many arguments it takes.

In order of control flow: `infer` opens the functions that a proof follows; `statements` and `expressions` walk a
function's body; `names` tells what its names stand for; `source` finds the body in its file; `tables` holds what is
known of Python's own functions.
"""

from ss2sql.frontend.purity.infer import Arity, Purity, Volatility, arity, infer

__all__ = ["Arity", "Purity", "Volatility", "arity", "infer"]

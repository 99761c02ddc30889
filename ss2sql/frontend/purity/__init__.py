"""Volatility of Python functions, proved from their source, and the number of their arguments.

In order of control flow: purity/infer.py opens the functions that a proof follows; purity/statements.py and
purity/expressions.py walk a function's body; purity/names.py finds what its names stand for, purity/source.py the
body in its file; purity/tables.py describes Python's own functions.
"""

from ss2sql.frontend.purity.infer import Arity, Purity, Volatility, arity, infer

__all__ = ["Arity", "Purity", "Volatility", "arity", "infer"]

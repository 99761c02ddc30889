"""Volatility: how far a Python function repeats itself, read from its source.

In order of control flow: inference opens what a proof follows and walks its body, function_names finds the body, says
what names in it stand for, and lists Python's own functions.
"""

from ss2sql.frontend.volatility.inference import Arity, Purity, Volatility, infer_arity, infer_purity, read_signature

__all__ = ["Arity", "Purity", "Volatility", "infer_arity", "infer_purity", "read_signature"]

"""Volatility: how far a Python function repeats itself, read from its source.

In order of control flow: inference opens what a proof follows, proof walks its body, name_bindings says what names
stand for and lists Python's own functions, function_source finds the body.
"""

from ss2sql.frontend.volatility.inference import Arity, Purity, Volatility, infer_arity, infer_purity

__all__ = ["Arity", "Purity", "Volatility", "infer_arity", "infer_purity"]

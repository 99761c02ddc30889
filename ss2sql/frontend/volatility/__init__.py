"""Volatility: how far a Python function repeats itself, read from its source.

In order of control flow: inference opens what a proof follows, statement_proof and
expression_proof walk its body, name_bindings says what names stand for, function_source finds the body, known_functions
lists Python's own.
"""

from ss2sql.frontend.volatility.inference import Arity, Purity, Volatility, infer_arity, infer_purity

__all__ = ["Arity", "Purity", "Volatility", "infer_arity", "infer_purity"]

"""Bodies of Python functions as expressions of the plan.

function_bodies reads a body, inliner replaces calls, substitution puts arguments in the place of parameters.
"""

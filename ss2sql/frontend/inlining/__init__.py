"""Bodies of Python functions as expressions of the language.

function_bodies reads a body, substitution puts it in the place of calls, with the arguments in the place of parameters.
"""

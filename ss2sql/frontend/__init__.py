"""From a script to its plan: `Source` in, `plan.Program` out.

`syntax/` makes the tree, `resolve/` binds its names and computes types, `volatility/` reads what Python functions may
do, `inlining.py` turns their bodies into expressions of the plan; user_functions registers them.
"""

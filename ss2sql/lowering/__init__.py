"""From plan to SQL, in the order of control flow:

- `rewrites/`: what makes a query cheaper before it is lowered or compiled, each with a name and an off switch
- `unsupported.py`: the table of what is not lowered and runs natively
- `lower.py`: one query of the plan becomes one `SqlQuery`
- `select.py`: flat queries; `sources.py`: FROM; `search.py`: WITH RECURSIVE, with `on_entering.py`;
  `strategies/`: searches as data
- `expressions.py`, `forms.py` and `operators.py`: expressions, by their types
- `parameters.py`: what a statement needs beside its text; `sql.py`: constructors for sqlglot trees
- `dialects.py`: how the tree is printed
"""

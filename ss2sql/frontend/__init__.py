"""From text to plan, in the order of control flow:

- text.py: tokens, and the limits on size and nesting; grammar.lark and table.py: the syntax, precomputed
- parser.py drives the table, builder.py and query_builder.py make the syntax tree of ast.py
- trouble.py, syntax_errors.py, sql_spellings.py, python_spellings.py: what to say where the text does not fit
- catalog.py: what exists; scope.py: what a name means; purity/: what a Python function may do
- resolve.py (expressions), queries.py, sources.py, options.py, groups.py: the plan of `ss2sql.plan`
"""

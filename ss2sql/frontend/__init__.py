"""From text to plan, in the order of control flow:

- frontend/text.py: tokens, and the limits on size and nesting; frontend/table.py: the precomputed LALR table
- frontend/parser.py runs the table, frontend/builder.py and frontend/query_builder.py make the tree of frontend/ast.py
- frontend/trouble.py, frontend/syntax_errors.py, frontend/sql_spellings.py, frontend/python_spellings.py: messages
- frontend/catalog.py: what exists; frontend/scope.py: what a name means
- frontend/resolve.py (expressions), frontend/queries.py, frontend/sources.py, frontend/options.py, frontend/groups.py
"""

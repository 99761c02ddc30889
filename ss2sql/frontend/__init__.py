"""From text to plan, in the order of control flow:

- frontend/text.py: tokens, and the limits on size and nesting; frontend/table.py: the precomputed LALR table
- frontend/parser.py runs the table, frontend/builder.py and frontend/query_builder.py make the tree of frontend/ast.py
- frontend/trouble.py, frontend/syntax_errors.py: the message for a script that does not fit the grammar
- frontend/catalog.py: what exists; frontend/scope.py: what a name means
- frontend/resolve.py (expressions), frontend/queries.py, frontend/sources.py, frontend/groups.py: the plan
"""

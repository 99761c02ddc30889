"""Queries and steps of searches in SQL that means the same in every database with typed columns.

In order of control flow: `sql_types.py` says which values have a type there, `portable_expressions.py` writes
expressions, `portable_equality.py` operators that have no form, `portable_from.py` what stands in FROM,
`portable_flat.py` queries, `pushdown.py` those for a database that runs them here, `search_steps.py` the steps of a
search. What cannot be written raises UnsupportedError: its meaning would depend on the database.
"""

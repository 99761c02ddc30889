"""Queries and steps of searches in SQL that means the same in every database with typed columns.

In order of control flow: `portable_expressions.py` says which values have a type there and writes expressions,
`portable_flat.py` queries with what stands in FROM, `pushdown.py` those for a database that runs them here,
`search_steps.py` the steps of a search. What cannot be written raises UnsupportedError: its meaning would depend on the
database.
"""

"""Queries and steps of searches in SQL that means the same in every database with typed columns.

In order of control flow: `types.py` says which values have a type there, `expressions.py` writes expressions,
`forms.py` and `functions.py` operators and functions, `sources.py` what stands in FROM, `flat.py` queries, `here.py`
those for a database that runs them here, `steps.py` the steps of a search. What cannot be written raises
UnsupportedError: its meaning would depend on the database.
"""

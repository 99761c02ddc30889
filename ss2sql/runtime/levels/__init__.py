"""Searches level by level, in tables: for state graphs that are larger than memory.

In order of control flow: `query.py` compiles a search for it, `search.py` goes from level to level, `trial.py` tries
steps, `level.py` has the statements of one level, `statements.py` how they are written, `tables.py` what runs them,
`duck.py` DuckDB, `watch.py` what ends a statement.
"""

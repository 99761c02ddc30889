"""Searches level by level, in tables: for state graphs that are larger than memory.

In order of control flow: `query.py` compiles a search for it, `search.py` goes from level to level, `statements.py` has
the SQL of one level, `tables.py` what runs it, `duck.py` DuckDB.
"""

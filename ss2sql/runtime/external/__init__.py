"""Searches level by level, in tables: for state graphs that are larger than memory.

In order of control flow: `level_query.py` compiles a search for it, with the statements of one level, printed by
`table_statements.py`. `level_steps.py` does the first levels in memory, and tells how steps are made.
`duckdb_search.py` goes from level to level in the tables of DuckDB.

`spark_session.py` is Spark, which goes its own way, and keeps the levels: `spark_search.py` goes from one to the next,
each a query with steps made in SQL or by its executors, which get the search as a `task_pickle.py`.
"""

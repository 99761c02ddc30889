"""Searches level by level, in tables: for state graphs that are larger than memory.

In order of control flow: `level_query.py` compiles a search for it, `level_statements.py` has the statements of one
level, printed by `table_statements.py`. `first_levels.py` does the first levels in memory; `level_steps.py` tells how
steps are made, in Python by `step_evaluation.py`. `level_search.py` goes from level to level in the tables of
`duckdb_store.py`; `statement_cancellation.py` ends a statement. `arrow_columns.py` makes columns.

`spark_session.py` is Spark, which goes its own way: `spark_search.py` from level to level, each a query with the steps
made by `spark_steps.py`, in SQL or by its executors (`spark_executor.py`), which get the search as a `task_pickle.py`
and call what `spark_tasks.py` makes. `spark_store.py` keeps the levels, `spark_dataframe.py` leaves the paths there,
and `spark_row_columns.py` makes columns of them.
"""

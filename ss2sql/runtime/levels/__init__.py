"""Searches level by level, in tables: for state graphs that are larger than memory.

In order of control flow: `query.py` compiles a search for it, `level.py` has the statements of one level, printed by
`statements.py`. `beginning.py` does the first levels in memory; `steps.py` tells how steps are made, in Python by
`trial.py`. `search.py` goes from level to level in the tables of `duck.py`; `watch.py` ends a statement. `arrow.py`
makes columns.

`spark.py` is Spark, which goes its own way: `spark_search.py` from level to level, each a query with the steps made by
`spark_steps.py`, in SQL or by its executors (`executor.py`), which get the search as a `parcel.py` and call what
`sending.py` makes. `spark_store.py` keeps the levels, `spark_frame.py` leaves the paths there, and `row_columns.py`
makes columns of them.
"""

"""Searches level by level, in tables: for state graphs that are larger than memory.

In order of control flow: `query.py` compiles a search for it, `kinds.py` knows what it is made of. `beginning.py`
does the first levels in memory, `search.py` goes on from level to level, `typed_search.py` where steps are SQL,
`by_cost.py` where they have a weight, `graph_search.py` where MEMORIZE makes a graph; `trial.py` tries steps.
`level.py`, `cost_level.py` and `graph_level.py` have the statements of one level, `statements.py` how they are
written, `tables.py` what runs them, `duck.py` DuckDB, `watch.py` what ends a statement. `arrow.py` makes columns.

`spark.py` is Spark, which goes its own way: `spark_search.py` from level to level, each a query (`spark_level.py`)
with the steps made by `spark_steps.py`, in SQL or by its executors (`executor.py`), which get the search as a
`parcel.py` and call what `sending.py` makes. `spark_store.py` keeps the levels, `spark_frame.py` leaves the paths
there, and `row_columns.py` makes columns of them. What is no breadth-first search has tables there, too:
`spark_tables.py`.
"""

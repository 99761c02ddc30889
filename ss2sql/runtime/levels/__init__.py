"""Searches level by level, in tables: for state graphs that are larger than memory.

In order of control flow: `query.py` compiles a search for it, `kinds.py` knows what it is made of. `search.py` goes
from level to level, `by_cost.py` where steps have a weight, `graph_search.py` where MEMORIZE makes a graph; `trial.py`
tries steps. `level.py`, `cost_level.py` and `graph_level.py` have the statements of one level, `statements.py` how they
are written, `tables.py` what runs them, `duck.py` DuckDB, `watch.py` what ends a statement. `spark.py` is Spark, whose
executors (`executor.py`) get the search as a `parcel.py`; its tables are in a `spark_store.py`. `arrow.py` makes
columns for both.
"""

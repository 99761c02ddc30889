"""What runs: engines, and what they share.

`run/` is one run: its state, limits, cancellation, the memory of calls. `sqlite/` runs a `SqlQuery`, `python/` compiles
a query to Python, `search/` holds the loops of searches, `external/` DuckDB and Spark, `parallel/` other
processes, `graph_cache/` graphs that outlive a run, `representations/` what AS makes of rows.
"""

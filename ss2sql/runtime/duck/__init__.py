"""Queries that are no searches in DuckDB, and its tables as sources of all queries.

In order of control flow: `tables.py` finds tables, views and Parquet files and reads them as data frames, `columns.py`
says what their columns are to scripts, `query.py` runs queries there, `loading.py` gives it the elements of values,
`exact.py` functions for sums of floats. `narrowing.py` chooses the rows that queries elsewhere read, `joining.py`
those of several tables that must equal each other.
"""

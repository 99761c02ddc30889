"""Virtual tables: Python's lists as tables of SQLite (`sequences.py`)."""

"""ss2sql: SelectScript, compiled to SQLite."""

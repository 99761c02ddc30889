"""The SQLite engine: a `SqlQuery` and a run in, rows out.

In order of control flow: executor, authorizer, interning (values as handles), function_callbacks, sql_functions,
search_functions. Tables: database_tables, column_types, file_locks, copied_databases. Virtual tables: list_elements,
virtual_table.
"""

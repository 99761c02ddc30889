"""The SQLite engine: a `SqlQuery` and a run in, rows out.

In order of control flow: connections, executor, interning (values as handles), sql_functions, search_functions. Tables:
database_tables. Virtual tables: list_elements, virtual_table.
"""

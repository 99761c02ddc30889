"""Running plans, in the order of control flow: session.py is what users see, host.py what it holds, compiled.py
decides query by query who runs it: database.py (SQLite) or native/ (Python). shaping.py and representations/
make of the rows what AS asks for, result.py is what comes back. values.py, border.py, ordering.py and pool.py
hold the value rules, functions.py the functions of the user; those of the language are rows of language/operations."""

"""Remembered graphs: what searches with MEMORIZE have found out, in tables of the session's file.

In order of control flow: `keeper.py` decides whether a graph is remembered, `keys.py` which one it is: `functions.py`
says what a Python function is made of, with `code.py` and `packages.py`, `sources.py` what data are made of. `steps.py`
gives a search the steps that are known and notes those that it evaluates; `graph.py` holds a part of the graph in
memory, `store.py` keeps all of it in tables, `texts.py` writes values as JSON. `listing.py` shows graphs to users.
"""

"""Remembered graphs: what searches with MEMORIZE have found out, in tables of the session's file.

In order of control flow: `steps.py` gives a search the steps that are known and notes those that it evaluates;
`keys.py` says which graph is whose, `functions.py` what a Python function is made of, `sources.py` what data are;
`texts.py` writes values as JSON; `store.py` keeps all of it in tables, which `listing.py` shows to users.
"""

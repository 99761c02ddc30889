"""Graphs of MEMORIZE that outlive a run, in tables of the session's file.

In order of control flow: cached_steps decides whether a graph is kept, gives a search the calls that are known and
notes new ones; fingerprint and function_fingerprint say which graph it is; graph_store keeps them in tables and shows
graphs to users.
"""

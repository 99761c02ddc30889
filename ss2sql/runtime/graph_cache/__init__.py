"""Graphs of MEMORIZE that outlive a run, in tables of the session's file.

In order of control flow: cache_policy decides whether a graph is kept, fingerprint which one it is. cached_steps gives
a search the steps that are known and notes new ones; graph_store keeps them in tables and shows graphs to users,
value_json writes values.
"""

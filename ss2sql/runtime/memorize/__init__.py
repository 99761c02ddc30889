"""MEMORIZE: a search that first makes the graph of rows and then enumerates its paths.

growing.py makes the graph of graph.py, with notes.py where steps are evaluated in parts, both_ends.py and
reverse.py where the goal is known; by_length.py with careful.py and by_weight.py with bounds.py enumerate the paths.
"""

"""Explanations of compiled scripts, as text and as data.

explained/outline.py keeps what can be explained. On request explained/collect.py finds the facts of explained/facts.py,
with plans in words (explained/sqlite_plan.py, explained/python_plan.py), whether a search ends (explained/endless.py)
and explained/levels.py; explained/text.py and explained/words.py write them, explained/explanation.py is the value.
"""

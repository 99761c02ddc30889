"""What became of a script, for people and as data.

`outline.py` keeps what there is to explain. Only when it is asked for, `collect.py` finds the facts (`facts.py`), with
SQLite's plan in words (`sqlite_plan.py`) and a look at whether a search ends (`endless.py`); `text.py` writes them down
with `words.py`, and `explanation.py` is what users get.
"""

"""Calls of the user's functions in other processes, for the levels of MEMORIZE.

`foretelling.py` finds the calls that a level needs, `timing.py` says whether other processes are worth it, `sending.py`
which functions they can have, `processes.py` runs them, `child.py` is what they do. `notes.py` says why not.
"""

IN_WORKER = "SS2SQL_WORKER"  # the environment variable that says so, in the other processes

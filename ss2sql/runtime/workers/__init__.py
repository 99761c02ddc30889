"""Calls of the user's functions in other processes, for the levels of MEMORIZE.

`foretelling.py` finds the calls that a level needs, `sending.py` says which functions other processes can have, and why
not, `processes.py` runs them, `child.py` is what they do.
"""

IN_WORKER = "SS2SQL_WORKER"  # the environment variable that says so, in the other processes

"""Calls of the user's functions in other processes, for the levels of MEMORIZE.

`block_calls.py` finds the calls that a level needs, `transferable_functions.py` says which functions other processes
can have, and why not, `process_pool.py` runs them, `worker_process.py` is what they do.
"""

IN_WORKER = "SS2SQL_WORKER"  # the environment variable that says so, in the other processes

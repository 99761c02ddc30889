"""Calls of the user's functions in other processes, for the levels of MEMORIZE.

`block_calls.py` finds the calls that a level needs, `process_pool.py` says which functions other processes can have,
and why not, and runs them; `worker_process.py` is what these do.
"""

IN_WORKER = "SS2SQL_WORKER"  # the environment variable that says so, in the other processes

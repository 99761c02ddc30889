"""Room on Python's stack for deeply nested plans.

Scripts may nest 200 levels deep, and late lists put one text inside another. Each level takes several
frames, in the compiler and where nested queries run, so Python's limit of 1,000 frames is raised for as long
as it is needed. Calls of Python functions from Python code take no C stack, so this is safe.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from threading import Lock
from typing import TypeVar

T = TypeVar("T")

FRAMES_PER_LEVEL = 30
MAX_LEVELS = 300  # levels of expressions, more than any script may have
MIN_LEVELS = 16  # levels that fit into any stack

_lock = Lock()
_users = 0
_usual_limit = 0


@contextmanager
def deepen_stack(levels: int) -> Iterator[None]:
    """Raises the recursion limit while its block runs, if there are many levels.

    Threads share the limit: the usual one comes back when the last block of all threads has ended.
    """
    global _users, _usual_limit
    if levels <= MIN_LEVELS:
        yield
        return
    with _lock:
        if not _users:
            _usual_limit = sys.getrecursionlimit()
        _users += 1
        sys.setrecursionlimit(max(sys.getrecursionlimit(), _usual_limit + levels * FRAMES_PER_LEVEL))
    try:
        yield
    finally:
        with _lock:
            _users -= 1
            if not _users:
                sys.setrecursionlimit(_usual_limit)


def retry_with_stack(work: Callable[[], T]) -> T:
    """What `work` gives, begun afresh with room where Python's usual stack is too small; it must allow that."""
    try:
        return work()
    except RecursionError:
        with deepen_stack(MAX_LEVELS):
            return work()

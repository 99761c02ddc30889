"""What ends the run of this thread within a built-in function, and room on its stack for deeply nested plans.

with checking(run.check):
    ...
        for value in watched(values):  # checks every few thousand values whether to go on

Scripts may nest 300 levels deep, and late lists put one text inside another. Each level takes several
frames, in the compiler and where nested queries run, so Python's limit of 1,000 frames is raised for as long
as it is needed. Calls of Python functions from Python code take no C stack, so this is safe.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cmp_to_key
from itertools import chain, islice
from threading import Lock
from typing import Any, TypeAlias, TypeVar

T = TypeVar("T")
Check: TypeAlias = Callable[[], None]  # raises what ends the work that calls it

ITEMS_PER_CHECK = 4096  # values, rows or cells between two checks: some 0.1 to 1 ms

_current_check: ContextVar[Check | None] = ContextVar("check", default=None)


@contextmanager
def install_cancellation_check(check: Check) -> Iterator[None]:
    """While the block runs, built-in functions that this thread calls ask the check."""
    token = _current_check.set(check)
    try:
        yield
    finally:
        _current_check.reset(token)


def iterate_checked(items: Iterable[T]) -> Iterable[T]:
    """The items, with the check of the run after every few thousand."""
    return iterate_with_check(items, _current_check.get())


def iterate_with_check(items: Iterable[T], check: Check | None) -> Iterable[T]:
    """The items, with this check after every few thousand, if there is one."""
    if check is None or (isinstance(items, (list, tuple)) and len(items) <= ITEMS_PER_CHECK):
        return items
    return chain.from_iterable(_iterate_with_check(iter(items), check))


def _iterate_with_check(items: Iterator[T], check: Check) -> Iterator[list[T]]:
    while portion := list(islice(items, ITEMS_PER_CHECK)):
        yield portion
        check()


def make_checked_order(compare: Callable[[Any, Any], int]) -> Callable[[Any], Any]:
    """The key of an order that calls the check of the run after every few thousand comparisons."""
    check = _current_check.get()
    if check is None:
        return cmp_to_key(compare)
    left = ITEMS_PER_CHECK

    def compare_counted(a: Any, b: Any) -> int:
        nonlocal left
        left -= 1
        if not left:
            left = ITEMS_PER_CHECK
            check()
        return compare(a, b)

    return cmp_to_key(compare_counted)


# --- room on Python's stack for deeply nested plans

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

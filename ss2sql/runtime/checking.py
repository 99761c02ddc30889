"""What ends the run of this thread while a built-in function works through a long list.

with checking(run.check):
    ...
        for value in watched(values):  # asks every few thousand values whether to go on
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cmp_to_key
from itertools import chain, islice
from typing import Any, TypeAlias, TypeVar

T = TypeVar("T")
Check: TypeAlias = Callable[[], None]  # raises what ends the work that asks it

AT_ONCE = 4096  # values, rows or cells between two checks: some 0.1 to 1 ms

_of_run: ContextVar[Check | None] = ContextVar("check", default=None)


@contextmanager
def checking(check: Check) -> Iterator[None]:
    """While the block runs, built-in functions that this thread calls ask the check."""
    token = _of_run.set(check)
    try:
        yield
    finally:
        _of_run.reset(token)


def watched(items: Iterable[T]) -> Iterable[T]:
    """The items, with the check of the run after every few thousand."""
    return checked(items, _of_run.get())


def checked(items: Iterable[T], check: Check | None) -> Iterable[T]:
    """The items, with this check after every few thousand, if there is one."""
    if check is None or (isinstance(items, (list, tuple)) and len(items) <= AT_ONCE):
        return items
    return chain.from_iterable(_portions(iter(items), check))


def _portions(items: Iterator[T], check: Check) -> Iterator[list[T]]:
    while portion := list(islice(items, AT_ONCE)):
        yield portion
        check()


def watched_order(compare: Callable[[Any, Any], int]) -> Callable[[Any], Any]:
    """The key of an order that asks the check of the run after every few thousand comparisons."""
    check = _of_run.get()
    if check is None:
        return cmp_to_key(compare)
    left = AT_ONCE

    def counted(a: Any, b: Any) -> int:
        nonlocal left
        left -= 1
        if not left:
            left = AT_ONCE
            check()
        return compare(a, b)

    return cmp_to_key(counted)

"""What ends the run of this thread while a built-in function works through a long list.

with checking(run.check):
    ...
        for value in watched(values):  # checks every few thousand values whether to go on
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from functools import cmp_to_key
from itertools import chain, islice
from typing import Any, TypeAlias, TypeVar

T = TypeVar("T")
Check: TypeAlias = Callable[[], None]  # raises what ends the work that calls it

ITEMS_PER_CHECK = 4096  # values, rows or cells between two checks: some 0.1 to 1 ms

_current_check: ContextVar[Check | None] = ContextVar("check", default=None)


@contextmanager
def install_check(check: Check) -> Iterator[None]:
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
    return chain.from_iterable(_iterate_portions(iter(items), check))


def _iterate_portions(items: Iterator[T], check: Check) -> Iterator[list[T]]:
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

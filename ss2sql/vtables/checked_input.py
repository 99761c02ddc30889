"""Checked input: keys and rows of adapters as lists. Adapters may give any iterable, even an endless one."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sized
from itertools import islice
from typing import Any

from ss2sql.language.value_messages import format_value
from ss2sql.vtables.schema import Schema, world_error

BLOCK = 1000  # elements between two checks of whether the run has to end


def check_adapter_rows(items: Iterable[Any], check: Callable[[], None]) -> list[Any]:
    """The elements as a list. `check` raises where the run has to end, since an iterator may be endless."""
    if isinstance(items, Sized):
        return list(items)
    found: list[Any] = []
    rest = iter(items)
    while block := list(islice(rest, BLOCK)):
        found += block
        check()
    return found


def check_adapter_keys(items: Iterable[Any], check: Callable[[], None], schema: Schema) -> list[Any]:
    """The keys as a list. Raises ExecutionError X011 for one that cannot be hashed, since caches use them.

    Putting a thousand numbers into a set takes 10 us, a hundredth of the time of a walk over them.
    """
    found = check_adapter_rows(items, check)
    try:
        if len(found) == 1:
            hash(found[0])
        else:
            set(found)
    except Exception as error:
        message = f"{schema.title} has a key that cannot be hashed and compared: {type(error).__name__}"
        bad = next((key for key in found if type(key).__hash__ is None), None)
        raise world_error(
            message if bad is None else f"{schema.title} has the key {format_value(bad)}, which cannot be hashed",
            "give numbers, texts, or tuples of these as keys",
        ) from error
    return found

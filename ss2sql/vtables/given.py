"""What adapters give as keys and rows, made lists: they may give whatever can be walked, even what never ends."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sized
from itertools import islice
from typing import Any

from ss2sql.runtime.messages import show
from ss2sql.vtables.schema import Schema, failure

BLOCK = 1000  # elements between two looks at whether the run has to end


def listed(given: Iterable[Any], check: Callable[[], None]) -> list[Any]:
    """The elements. `check` raises where the run has to end, for an iterator may have no end."""
    if isinstance(given, Sized):
        return list(given)
    found: list[Any] = []
    rest = iter(given)
    while block := list(islice(rest, BLOCK)):
        found += block
        check()
    return found


def listed_keys(given: Iterable[Any], check: Callable[[], None], schema: Schema) -> list[Any]:
    """The keys. Raises ExecutionError X011 for one that cannot be hashed, by which all that is read is found again.

    Putting a thousand numbers into a set takes 10 us, a hundredth of what it takes to walk over them.
    """
    found = listed(given, check)
    try:
        if len(found) == 1:
            hash(found[0])
        else:
            set(found)
    except Exception as error:
        message = f"{schema.title} has a key that cannot be hashed and compared: {type(error).__name__}"
        bad = next((key for key in found if type(key).__hash__ is None), None)
        raise failure(
            message if bad is None else f"{schema.title} has the key {show(bad)}, which cannot be hashed",
            "give numbers, texts, or tuples of these as keys",
        ) from error
    return found

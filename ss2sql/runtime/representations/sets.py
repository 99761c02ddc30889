"""`AS set`: the different values of all columns as a Python set, lists as tuples."""

from __future__ import annotations

from itertools import chain
from typing import Any

from ss2sql.errors import RepresentationError
from ss2sql.runtime.representations.base import Table
from ss2sql.runtime.values import show


def represent(table: Table) -> set[Any]:
    """The first of equal values stands for all of them. Raises RepresentationError for values without a hash."""
    found: set[Any] = set()
    for value in chain.from_iterable(table):
        found.add(_hashable(value))
    return found


def _hashable(value: Any) -> Any:
    if isinstance(value, list):
        return tuple(map(_hashable, value))
    try:
        hash(value)
    except TypeError:
        hint = "select its parts, or use AS list"
        raise RepresentationError("V001", f"{show(value)} cannot be an element of a set", hints=(hint,)) from None
    return value

"""The order of values, in which those that meet comparisons with a number or a text are looked up."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from types import NoneType
from typing import Any

MIN_LENGTH = 16  # fewer rows are tested one by one, unless they are wanted in order
_ORDERED = (frozenset({int, float}), frozenset({str}))  # what can be compared with one another
_LOWER_BOUNDS = frozenset({"gt", "ge"})
_AFTER_EQUAL = frozenset({"gt", "le"})  # the bound stands after the values that equal it


class KeyOrder:
    """The `places` of values of some `kinds` in their order; equal ones keep theirs. What is None has no place.

    `ascends`: they are in order already, as the times of a recording are.
    """

    __slots__ = ("ascends", "descending", "keys", "kinds", "places")

    def __init__(self, values: Sequence[Any], kinds: frozenset[type], descending: bool) -> None:
        known = [place for place, value in enumerate(values) if value is not None]
        self.kinds = kinds
        self.descending = descending
        self.places = sorted(known, key=values.__getitem__, reverse=descending)
        self.ascends = self.places == list(range(len(values)))
        self.keys = [values[place] for place in (reversed(self.places) if descending else self.places)]  # ascending

    def find_bounds(self, operators: Sequence[str], values: Sequence[Any]) -> tuple[int, int]:
        """The first place whose value may meet comparisons with these values, and the end of such places."""
        start, end = 0, len(self.keys)
        for operator, value in zip(operators, values, strict=True):
            if value is None:
                return 0, 0
            if type(value) in self.kinds:
                place = (bisect_right if operator in _AFTER_EQUAL else bisect_left)(self.keys, value)
                if operator in _LOWER_BOUNDS:
                    start = max(start, place)
                else:
                    end = min(end, place)
        return (len(self.keys) - end, len(self.keys) - start) if self.descending else (start, end)


def order_keys(values: Sequence[Any], descending: bool = False) -> KeyOrder | None:
    """Their order; None where they are neither all numbers nor all texts, those that are None apart."""
    found = {*map(type, values)} - {NoneType}
    return next((KeyOrder(values, kinds, descending) for kinds in _ORDERED if found <= kinds), None)


class RowOrder:
    """Whether the rows that a lookup gives are in the order that the query asks for."""

    __slots__ = ("kept",)

    def __init__(self) -> None:
        self.kept = False

"""The order of values, in which those that meet comparisons with a number are looked up."""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections.abc import Sequence
from types import NoneType
from typing import Any

NUMBERS = frozenset({int, float, NoneType})
MIN_LENGTH = 16  # fewer rows are tested one by one, unless they are wanted in order
_LOWER_BOUNDS = frozenset({"gt", "ge"})
_AFTER_EQUAL = frozenset({"gt", "le"})  # the bound stands after the values that equal it


class KeyOrder:
    """The `places` of numbers in their order; equal ones keep theirs. What is None has no place.

    `ascends`: they are in order already, as the times of a recording are.
    """

    __slots__ = ("ascends", "descending", "keys", "places")

    def __init__(self, values: Sequence[Any], descending: bool) -> None:
        known = [place for place, value in enumerate(values) if value is not None]
        self.descending = descending
        self.places = sorted(known, key=values.__getitem__, reverse=descending)
        self.ascends = self.places == list(range(len(values)))
        # `bisect` wants them to ascend.
        self.keys = [-values[place] if descending else values[place] for place in self.places]

    def find_bounds(self, operators: Sequence[str], values: Sequence[Any]) -> tuple[int, int]:
        """The first place whose number may meet comparisons with these values, and the end of such places."""
        start, end = 0, len(self.keys)
        for operator, value in zip(operators, values, strict=True):
            if value is None:
                return 0, 0
            if type(value) is int or type(value) is float:
                lower, after = operator in _LOWER_BOUNDS, operator in _AFTER_EQUAL
                if self.descending:
                    value, lower, after = -value, not lower, not after
                place = (bisect_right if after else bisect_left)(self.keys, value)
                start, end = (max(start, place), end) if lower else (start, min(end, place))
        return start, end


def order_numbers(values: Sequence[Any], descending: bool = False) -> KeyOrder | None:
    """Their order; None where there is something else among them."""
    return KeyOrder(values, descending) if NUMBERS.issuperset(map(type, values)) else None


class RowOrder:
    """Whether the rows that a lookup gives are in the order that the query asks for."""

    __slots__ = ("kept",)

    def __init__(self) -> None:
        self.kept = False

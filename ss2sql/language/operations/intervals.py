"""Bounds of numbers, by interval arithmetic.

They are computed separately for integers, which are exact, and for floats, which are rounded: rounding never swaps two
numbers, so the same float operation on the bounds of the operands gives the bounds of the result.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from typing import TypeAlias

from ss2sql.language.kinds import INT_MAX, INT_MIN, NOTHING, Kind, Type

Types: TypeAlias = Sequence[Type]
Operation: TypeAlias = Callable[[float, float], float]

INTEGER = Kind.BOOL | Kind.INT
MAX = sys.float_info.max


def bound_integers(t: Type) -> tuple[int, int] | None:
    """The least and the greatest integer that may be among the values; None if there can be none."""
    if not t.may_be(INTEGER):
        return None
    low, high = (INT_MIN, INT_MAX) if t.may_be(Kind.INT) else (0, 1)
    if t.low is not None:
        low = max(low, math.ceil(t.low))
    if t.high is not None:
        high = min(high, math.floor(t.high))
    return (low, high) if low <= high else None


def bound_floats(t: Type) -> tuple[float, float]:
    """The bounds of the numbers, each turned into a float as float arithmetic does it; there must be numbers."""
    if t.is_only(INTEGER):
        low, high = bound_integers(t) or (0, 0)
        return float(low), float(high)
    return -MAX if t.low is None else float(t.low), MAX if t.high is None else float(t.high)


def make_numbers(kinds: Kind, corners: Sequence[float]) -> Type:
    """The type of numbers between the least and the greatest corner; a bound beyond all values is dropped."""
    low, high = min(corners), max(corners)
    least, greatest = (-MAX, MAX) if kinds & Kind.FLOAT else (INT_MIN, INT_MAX)
    return Type(kinds, low if least < low <= greatest else None, high if least <= high < greatest else None)


def fits(kinds: Kind, corners: Sequence[float]) -> bool:
    """Whether all numbers between the corners are values."""
    least, greatest = (-MAX, MAX) if kinds & Kind.FLOAT else (INT_MIN, INT_MAX)
    return all(least <= corner <= greatest for corner in corners)


def is_nonnegative(t: Type) -> bool:
    """Whether no number among the values is negative."""
    return t.is_only(Kind.BOOL) if t.low is None else t.low >= 0


def keep_lists(t: Type) -> Type:
    """The lists among the values."""
    return Type(Kind.LIST, element=t.element, columns=t.columns) if t.may_be(Kind.LIST) else NOTHING


def make_text_type(types: Types) -> Type:
    """The type of text made of parts of the strings among the values."""
    if not all(t.may_be(Kind.STR) for t in types):
        return NOTHING
    odd = any(t.may_be(Kind.OBJECT) for t in types)
    return Type(Kind.STR | Kind.OBJECT if odd else Kind.STR)


def are_comparable(a: Type, b: Type) -> bool:
    """Whether any two values of both types can be ordered."""
    if any(a.is_only(kinds) and b.is_only(kinds) for kinds in (Kind.NUMBER, Kind.STR)):
        return True
    if not (a.is_only(Kind.LIST) and b.is_only(Kind.LIST)) or a.element is None or b.element is None:
        return False
    return are_comparable(a.element, b.element)


def apply_bounds(operation: Operation, types: Types) -> list[tuple[Kind, list[float]]]:
    """The kinds of results with their corners: of two integers, and of operands with a float.

    The operation must take its extremes over two intervals at their ends.
    """
    a, b = types
    found: list[tuple[Kind, list[float]]] = []
    if (first := bound_integers(a)) and (second := bound_integers(b)):
        found.append((Kind.INT, [operation(x, y) for x in first for y in second]))
    if a.may_be(Kind.NUMBER) and b.may_be(Kind.NUMBER) and (a.may_be(Kind.FLOAT) or b.may_be(Kind.FLOAT)):
        found.append((Kind.FLOAT, [operation(x, y) for x in bound_floats(a) for y in bound_floats(b)]))
    return found


def round_bounds(t: Type, operation: Callable[[float], int]) -> list[tuple[int, int]]:
    """The bounds of the integers, and of the floats made integers by `operation`, which keeps their order."""
    parts = []
    if known := bound_integers(t):
        parts.append(known)
    if t.may_be(Kind.FLOAT):
        low, high = bound_floats(t)
        parts.append((operation(low), operation(high)))
    return parts


def widen_number_type(kinds: Kind, low: float | None, high: float | None) -> Type:
    """The type of numbers between these, with powers of two as bounds, so that few changes of a table change it."""
    if low is None or high is None:  # no number is left where SQLite found one, as in a damaged file
        return Type(kinds)
    if math.isinf(low) or math.isinf(high):
        return Type(kinds | Kind.OBJECT)  # no float of the language
    least, greatest = (-MAX, MAX) if kinds & Kind.FLOAT else (INT_MIN, INT_MAX)
    below, above = -_round_bound_up(-low), _round_bound_up(high)
    return Type(kinds, below if least < below else None, above if above < greatest else None)


def _round_bound_up(value: float) -> int:
    """The least that is not below the value of 0, the powers of two from 1 on, and their negatives."""
    whole = math.ceil(value)
    if whole == 0:
        return 0
    return 1 << (whole - 1).bit_length() if whole > 0 else -1 << ((-whole).bit_length() - 1)

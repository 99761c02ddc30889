"""What the operators promise: the types of their results, and when they cannot fail.

Each function takes the types of the operands. A value that would make the operator fail contributes nothing
to the type of its result. Bounds of numbers come from interval arithmetic, separately for integers, which
are exact, and for floats, which are rounded: rounding never swaps two numbers, so the same float operation
on the bounds of the operands gives the bounds of the result.
"""

from __future__ import annotations

import math
import operator
import sys
from collections.abc import Callable, Sequence
from typing import TypeAlias

from ss2sql.kinds import ANY, BOOL, INT_MAX, INT_MIN, NOTHING, Kind, Type, union

Types: TypeAlias = Sequence[Type]
Operation: TypeAlias = Callable[[float, float], float]

INTEGER = Kind.BOOL | Kind.INT
MAX = sys.float_info.max


# --- intervals -----------------------------------------------------------------------------------------


def integers(t: Type) -> tuple[int, int] | None:
    """The least and the greatest integer that may be among the values; None if there can be none."""
    if not t.may(INTEGER):
        return None
    low, high = (INT_MIN, INT_MAX) if t.may(Kind.INT) else (0, 1)
    if t.low is not None:
        low = max(low, math.ceil(t.low))
    if t.high is not None:
        high = min(high, math.floor(t.high))
    return (low, high) if low <= high else None


def floats(t: Type) -> tuple[float, float]:
    """The bounds of the numbers, each turned into a float as float arithmetic does it; there must be numbers."""
    if t.only(INTEGER):
        low, high = integers(t) or (0, 0)
        return float(low), float(high)
    return -MAX if t.low is None else float(t.low), MAX if t.high is None else float(t.high)


def numbers(kinds: Kind, corners: Sequence[float]) -> Type:
    """The type of numbers between the least and the greatest corner; a bound beyond all values says nothing."""
    low, high = min(corners), max(corners)
    least, greatest = (-MAX, MAX) if kinds & Kind.FLOAT else (INT_MIN, INT_MAX)
    return Type(kinds, low if least < low <= greatest else None, high if least <= high < greatest else None)


def fits(kinds: Kind, corners: Sequence[float]) -> bool:
    """Whether all numbers between the corners are values."""
    least, greatest = (-MAX, MAX) if kinds & Kind.FLOAT else (INT_MIN, INT_MAX)
    return all(least <= corner <= greatest for corner in corners)


def is_nonnegative(t: Type) -> bool:
    """Whether no number among the values is negative."""
    return t.only(Kind.BOOL) if t.low is None else t.low >= 0


def as_list(t: Type) -> Type:
    """The lists among the values."""
    return Type(Kind.LIST, item=t.item, columns=t.columns) if t.may(Kind.LIST) else NOTHING


def as_text(types: Types) -> Type:
    """The type of text made of parts of the strings among the values."""
    if not all(t.may(Kind.STR) for t in types):
        return NOTHING
    odd = any(t.may(Kind.OBJECT) for t in types)
    return Type(Kind.STR | Kind.OBJECT if odd else Kind.STR)


def comparable(a: Type, b: Type) -> bool:
    """Whether all values of both types have an order among each other."""
    if any(a.only(kinds) and b.only(kinds) for kinds in (Kind.NUMBER, Kind.STR)):
        return True
    if not (a.only(Kind.LIST) and b.only(Kind.LIST)) or a.item is None or b.item is None:
        return False
    return comparable(a.item, b.item)


# --- arithmetic ----------------------------------------------------------------------------------------


def results(operation: Operation, types: Types) -> list[tuple[Kind, list[float]]]:
    """The kinds of numbers that the operation gives with their corners: of two integers, and where a float is in it.

    The operation must take its extremes over two intervals at their ends.
    """
    a, b = types
    found: list[tuple[Kind, list[float]]] = []
    if (first := integers(a)) and (second := integers(b)):
        found.append((Kind.INT, [operation(x, y) for x in first for y in second]))
    if a.may(Kind.NUMBER) and b.may(Kind.NUMBER) and (a.may(Kind.FLOAT) or b.may(Kind.FLOAT)):
        found.append((Kind.FLOAT, [operation(x, y) for x in floats(a) for y in floats(b)]))
    return found


def _arithmetic(operation: Operation) -> tuple[Callable[[Types], Type], Callable[[Types], bool]]:
    """The result of `+`, `-` or `*` on numbers, and whether it can fail."""

    def result(types: Types) -> Type:
        return union(numbers(kind, corners) for kind, corners in results(operation, types))

    def raises(types: Types) -> bool:
        found = results(operation, types)
        return not _are_numbers(types) or not all(fits(kind, corners) for kind, corners in found)

    return result, raises


def _are_numbers(types: Types) -> bool:
    return all(t.only(Kind.NUMBER) for t in types)


_sum, _sum_raises = _arithmetic(operator.add)
sub, sub_raises = _arithmetic(operator.sub)
mul, mul_raises = _arithmetic(operator.mul)


def add(types: Types) -> Type:
    a, b = types
    lists = union((as_list(a), as_list(b))) if a.may(Kind.LIST) and b.may(Kind.LIST) else NOTHING
    return union((_sum(types), as_text(types), lists))


def add_raises(types: Types) -> bool:
    if any(all(t.only(kind) for t in types) for kind in (Kind.STR, Kind.LIST)):
        return False
    return _sum_raises(types)


def _quotients(types: Types) -> list[float] | None:
    """The corners of `/`; None if the divisor may be zero."""
    a, b = types
    corners: list[float] = []
    if (first := integers(a)) and (second := integers(b)):
        if second[0] <= 0 <= second[1]:
            return None
        corners += [x / y for x in first for y in second]
    if a.may(Kind.FLOAT) or b.may(Kind.FLOAT):
        low, high = floats(b)
        if low <= 0 <= high:
            return None
        corners += [x / y for x in floats(a) for y in (low, high)]
    return corners


def div(types: Types) -> Type:
    if not all(t.may(Kind.NUMBER) for t in types):
        return NOTHING
    corners = _quotients(types)
    if corners:
        return numbers(Kind.FLOAT, corners)
    return Type(Kind.FLOAT, 0 if all(map(is_nonnegative, types)) else None)


def div_raises(types: Types) -> bool:
    corners = _quotients(types) if _are_numbers(types) else None
    return not corners or not fits(Kind.FLOAT, corners)


def mod(types: Types) -> Type:
    a, b = types
    parts = []
    if (first := integers(a)) and (second := integers(b)):
        parts.append(numbers(Kind.INT, _remainders(first, second, 1)))
    if a.may(Kind.NUMBER) and b.may(Kind.NUMBER) and (a.may(Kind.FLOAT) or b.may(Kind.FLOAT)):
        parts.append(numbers(Kind.FLOAT, _remainders(floats(a), floats(b), 0)))
    return union(parts)


def _remainders(a: tuple[float, float], b: tuple[float, float], gap: int) -> tuple[float, float]:
    """The bounds of `a % b`: the remainder stays `gap` away from the divisor and has its sign."""
    low = min(0, b[0] + gap) if b[0] < 0 else 0
    high = max(0, b[1] - gap) if b[1] > 0 else 0
    if a[0] >= 0 and b[0] >= 0:
        high = min(high, a[1])
    if a[1] <= 0 and b[1] <= 0:
        low = max(low, a[0])
    return low, high


def mod_raises(types: Types) -> bool:
    return not _are_numbers(types) or _quotients(types) is None


def power(types: Types) -> Type:
    base, exponent = types
    parts = []
    least: float | None = 0 if is_nonnegative(base) or _is_even(exponent) else None
    if integers(base) and (times := integers(exponent)):
        if times[1] >= 0:
            corners = _powers(types)
            parts.append(numbers(Kind.INT, corners) if corners else Type(Kind.INT, least))
        if times[0] < 0:
            parts.append(Type(Kind.FLOAT, -1 if least is None else 0, 1))
    if all(t.may(Kind.NUMBER) for t in types) and any(t.may(Kind.FLOAT) for t in types):
        bounds = _float_powers(types)
        parts.append(numbers(Kind.FLOAT, bounds) if bounds else Type(Kind.FLOAT, least))
    return union(parts)


def _is_even(exponent: Type) -> bool:
    """Whether the exponent is one even integer."""
    times = integers(exponent)
    return exponent.only(INTEGER) and times is not None and times[0] == times[1] and times[0] % 2 == 0


def _powers(types: Types) -> list[int] | None:
    """Bounds of integers raised to exponents that are not negative; None if they are beyond all values."""
    base, exponent = integers(types[0]), integers(types[1])
    if base is None or exponent is None or exponent[1] > 63:
        return None
    size, highest = max(abs(base[0]), abs(base[1])), exponent[1]
    if base[0] < 0 and exponent[0] == highest:
        middle = [0] if base[0] <= 0 <= base[1] and highest else []
        return [base[0] ** highest, base[1] ** highest, *middle]
    if base[0] < 0:
        return [-(size**highest), size**highest, -1, 1]
    return [base[0] ** max(exponent[0], 0), base[0] ** highest, base[1] ** highest, 1]


def _float_powers(types: Types) -> list[float] | None:
    """Bounds of floats raised to a known power: a whole one, or a root of what is not negative; else None.

    Python leaves powers to the C library, which rounds them nearly, not exactly.
    """
    base, exponent = types
    if not _are_numbers(types) or exponent.low is None or exponent.low != exponent.high:
        return None
    times, (low, high) = exponent.low, floats(base)
    is_whole = exponent.only(INTEGER) and times >= 0
    if not is_whole and not (low >= 0 and 0 <= times <= 1):
        return None
    try:
        size = max(abs(low), abs(high), 1.0) ** times * (1 + 2**-40)
    except OverflowError:
        return None
    return [0 if low >= 0 or _is_even(exponent) else -size, size]


def power_raises(types: Types) -> bool:
    if not _are_numbers(types):
        return True
    if all(t.may(INTEGER) for t in types):
        corners = _powers(types) if is_nonnegative(types[1]) else None
        if not corners or not fits(Kind.INT, corners):
            return True
    if any(t.may(Kind.FLOAT) for t in types):
        bounds = _float_powers(types)
        return not bounds or not fits(Kind.FLOAT, bounds)
    return False


def neg(types: Types) -> Type:
    return union(numbers(kind, (-low, -high)) for kind, low, high in _parts(types[0]))


def absolute(types: Types) -> Type:
    return union(numbers(kind, _sizes(low, high)) for kind, low, high in _parts(types[0]))


def _sizes(low: float, high: float) -> tuple[float, ...]:
    return (abs(low), abs(high)) if low > 0 or high < 0 else (0, abs(low), abs(high))


def sign_raises(types: Types) -> bool:
    """Whether unary minus or `abs` can fail: there is one integer more below zero than above."""
    return not _are_numbers(types) or any(kind is Kind.INT and low == INT_MIN for kind, low, _ in _parts(types[0]))


def _parts(t: Type) -> list[tuple[Kind, float, float]]:
    """The integers and the floats among the values with their bounds; bools count as integers."""
    parts: list[tuple[Kind, float, float]] = []
    if whole := integers(t):
        parts.append((Kind.INT, *whole))
    if t.may(Kind.FLOAT):
        parts.append((Kind.FLOAT, *floats(t)))
    return parts


# --- comparison, membership, elements ------------------------------------------------------------------


def boolean(types: Types) -> Type:
    return BOOL


def never(types: Types) -> bool:
    return False


def always(types: Types) -> bool:
    return True


def order_raises(types: Types) -> bool:
    return not comparable(*types)


def membership_raises(types: Types) -> bool:
    item, container = types
    return not container.only(Kind.LIST | Kind.DICT) and not (container.only(Kind.STR) and item.only(Kind.STR))


def item_of(types: Types) -> Type:
    container, index = types
    parts = []
    if container.may(Kind.LIST) and index.may(INTEGER):
        parts.append(_elements_at(container, index))
    if index.may(INTEGER):
        parts.append(as_text([container]))
    if container.may(Kind.DICT):
        parts.append(ANY)
    return union(parts)


def _elements_at(container: Type, index: Type) -> Type:
    """The elements of the lists among the values that an index may mean."""
    places = integers(index)
    if container.positions is None or places is None:
        return ANY if container.item is None else container.item
    length = len(container.positions)
    inside = range(max(places[0], -length), min(places[1], length - 1) + 1)
    return union(container.positions[place] for place in inside)


def item_raises(types: Types) -> bool:
    container, index = types
    places = integers(index)
    if not container.only(Kind.LIST) or container.size is None or not index.only(INTEGER) or places is None:
        return True
    return places[0] < -container.size or places[1] >= container.size


def slice_of(types: Types) -> Type:
    return union((as_list(types[0]), as_text(types[:1])))


def slice_raises(types: Types) -> bool:
    container, *bounds = types
    return not container.only(Kind.LIST | Kind.STR) or not all(t.only(INTEGER | Kind.NONE) for t in bounds)

"""What the built-in functions promise: the types of their results, and when they cannot fail (see operator_types)."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

from ss2sql.kinds import ANY, NONE, NOTHING, STR, UNENCODABLE, Kind, Type, list_of, union
from ss2sql.runtime.library import RANGE_LIMIT
from ss2sql.runtime.operator_types import (
    INTEGER,
    Types,
    as_list,
    as_text,
    comparable,
    fits,
    floats,
    integers,
    is_nonnegative,
    numbers,
)

LENGTH = 2**53  # no list and no string is longer: no machine's memory would hold it


# --- lists ---------------------------------------------------------------------------------------------


def length(types: Types) -> Type:
    known = types[0].size if types[0].only(Kind.LIST) else None
    return Type(Kind.INT, 0, LENGTH) if known is None else Type(Kind.INT, known, known)


def length_raises(types: Types) -> bool:
    return not types[0].only(Kind.STR | Kind.LIST | Kind.DICT)


def are_not_lists(types: Types) -> bool:
    """Whether a function that works on all lists can fail."""
    return not all(t.only(Kind.LIST) for t in types)


def _element(t: Type) -> Type:
    """The elements of the lists among the values."""
    if not t.may(Kind.LIST):
        return NOTHING
    return ANY if t.item is None else t.item


def total(types: Types) -> Type:
    element = _element(types[0])
    kinds = Kind.INT | (element.kinds & Kind.FLOAT)
    if (sums := _sums(types[0])) is not None:
        return numbers(kinds, sums)
    negative = element.may(Kind.NUMBER) and not is_nonnegative(element)
    positive = element.may(Kind.NUMBER) and (element.high is None or element.high > 0)
    return Type(kinds, None if negative else 0, None if positive else 0)


def _sums(t: Type) -> tuple[int, int] | None:
    """The bounds of the sums of lists whose elements are known one by one as integers."""
    limits = [integers(part) for part in t.positions or ()]
    if not limits or None in limits or not all(part.only(INTEGER) for part in t.positions or ()):
        return None
    known = [limit for limit in limits if limit is not None]
    return sum(low for low, _ in known), sum(high for _, high in known)


def total_raises(types: Types) -> bool:
    element = _element(types[0])
    if are_not_lists(types):
        return True
    if (sums := _sums(types[0])) is not None:
        return not fits(Kind.INT, sums)
    # So small that even the longest list stays within 64 bits.
    return not (element.only(INTEGER) and (element.bounded(512) or element == NOTHING))


def average(types: Types) -> Type:
    """A float, or None of an empty list."""
    return union((Type(Kind.FLOAT) if _element(types[0]).may(Kind.NUMBER) else NOTHING, NONE))


def least(types: Types) -> Type:
    return _extreme(types, smallest=True)


def greatest(types: Types) -> Type:
    return _extreme(types, smallest=False)


def _extreme(types: Types, smallest: bool) -> Type:
    """The result of `min` or `max`, of a list (None if it is empty) or of several arguments."""
    if len(types) == 1 and types[0].positions is None:
        return union((_element(types[0]), NONE))
    chosen = _candidates(types)
    if len(chosen) == 1:
        return chosen[0]
    lists = union(map(as_list, chosen)) if all(t.may(Kind.LIST) for t in chosen) else NOTHING
    return union((_extreme_number(chosen, smallest), as_text(chosen), lists))


def _candidates(types: Types) -> Types:
    """What `min` or `max` chooses from: several arguments, or the elements of a list, known one by one."""
    return types if len(types) > 1 else types[0].positions or types


def _extreme_number(types: Types, smallest: bool) -> Type:
    if not all(t.may(Kind.NUMBER) for t in types):
        return NOTHING
    kinds = union(types).kinds & Kind.NUMBER
    low, high = [t.low for t in types], [t.high for t in types]
    near, far, pick = (high, low, min) if smallest else (low, high, max)
    known = [bound for bound in near if bound is not None]
    # The least of several numbers is not above any one of their upper bounds.
    inner = pick(known) if known else None
    outer = None if None in far else pick(bound for bound in far if bound is not None)
    return Type(kinds, outer, inner) if smallest else Type(kinds, inner, outer)


def extreme_raises(types: Types) -> bool:
    if len(types) == 1 and (types[0].positions is None or not types[0].only(Kind.LIST)):
        return True
    chosen = _candidates(types)
    together = union(chosen)
    return len(chosen) > 1 and not comparable(together, together)


def same_list(types: Types) -> Type:
    """A list with elements of the first argument."""
    return as_list(types[0])


def sorting_raises(types: Types) -> bool:
    element = _element(types[0])
    return not types[0].only(Kind.LIST) or not comparable(element, element)


def zipped(types: Types) -> Type:
    return Type(Kind.LIST, item=list_of([_element(t) for t in types]), columns=())


def numbers_from(types: Types) -> Type:
    limits = [integers(t) for t in types]
    first, last = limits[0], limits[1] if len(limits) > 1 else limits[0]
    if first is None or last is None:
        return NOTHING
    if len(limits) == 1:
        bounds = (0, max(last[1] - 1, 0))
    elif len(limits) == 2:
        bounds = (first[0], max(last[1] - 1, first[0]))
    else:  # upwards or downwards
        bounds = (min(first[0], last[0] + 1), max(first[1], last[1] - 1))
    return Type(Kind.LIST, item=numbers(Kind.INT, bounds), columns=())


def range_raises(types: Types) -> bool:
    limits = [integers(t) for t in types]
    if not all(t.only(INTEGER) for t in types) or None in limits:
        return True
    (low, high), *others = [limit for limit in limits if limit is not None]
    if not others:
        return high > RANGE_LIMIT
    step = others[1] if len(others) > 1 else (1, 1)
    return others[0][1] - low > RANGE_LIMIT or high - others[0][0] > RANGE_LIMIT or step[0] <= 0 <= step[1]


# --- numbers -------------------------------------------------------------------------------------------


def _whole(t: Type, operation: Callable[[float], int]) -> list[tuple[int, int]]:
    """The bounds of the integers, and of the floats made integers by `operation`, which keeps their order."""
    parts = []
    if whole := integers(t):
        parts.append(whole)
    if t.may(Kind.FLOAT):
        low, high = floats(t)
        parts.append((operation(low), operation(high)))
    return parts


def rounded(types: Types) -> Type:
    value, *digits = types
    parts = []
    if not digits or digits[0].may(Kind.NONE):
        parts += [numbers(Kind.INT, bounds) for bounds in _whole(value, round)]
    if digits and digits[0].may(INTEGER):
        if whole := integers(value):
            parts.append(numbers(Kind.INT, whole) if is_nonnegative(digits[0]) else Type(Kind.INT))
        parts.append(Type(value.kinds & Kind.FLOAT))
    return union(parts)


def rounding_raises(types: Types) -> bool:
    value, *digits = types
    if not value.only(Kind.NUMBER):
        return True
    if digits:
        return not digits[0].only(INTEGER) or not is_nonnegative(digits[0])
    return not all(fits(Kind.INT, bounds) for bounds in _whole(value, round))


def square_root(types: Types) -> Type:
    low, high = floats(types[0])
    if not types[0].may(Kind.NUMBER) or high < 0:
        return NOTHING
    return Type(Kind.FLOAT, math.sqrt(max(low, 0)), math.sqrt(high))


def square_root_raises(types: Types) -> bool:
    return not types[0].only(Kind.NUMBER) or floats(types[0])[0] < 0


def size(types: Types) -> Type:
    """The result of `distance` and `norm`."""
    return Type(Kind.FLOAT, 0) if all(t.may(Kind.NUMBER | Kind.LIST) for t in types) else NOTHING


def size_raises(types: Types) -> bool:
    half = 8e307  # the difference of two such numbers is finite
    if all(t.only(Kind.LIST) and t.positions is not None for t in types):
        return _length_raises([t.positions or () for t in types])
    if not all(t.only(Kind.NUMBER) for t in types):
        return True
    return len(types) > 1 and not all(-half <= bound <= half for t in types for bound in floats(t))


def _length_raises(vectors: Sequence[tuple[Type, ...]]) -> bool:
    """Whether the length of a vector, or the distance of two, can fail: of 16 such numbers even the sum is finite."""
    parts = [part for vector in vectors for part in vector]
    small = 1e306
    if not all(part.only(Kind.NUMBER) for part in parts) or len(set(map(len, vectors))) > 1:
        return True
    return not all(-small <= bound <= small for part in parts for bound in floats(part))


# --- text ----------------------------------------------------------------------------------------------


def text(types: Types) -> Type:
    # What an object writes of itself may be anything.
    return STR if types[0].only(Kind.NONE | Kind.NUMBER | Kind.STR) else UNENCODABLE


def text_raises(types: Types) -> bool:
    return types[0].may(Kind.STRUCTURED)


def to_integer(types: Types) -> Type:
    parts = [numbers(Kind.INT, bounds) for bounds in _whole(types[0], int)]
    return union((*parts, Type(Kind.INT) if types[0].may(Kind.STR) else NOTHING))


def to_integer_raises(types: Types) -> bool:
    return not types[0].only(Kind.NUMBER) or not all(fits(Kind.INT, bounds) for bounds in _whole(types[0], int))


def to_float(types: Types) -> Type:
    number = numbers(Kind.FLOAT, floats(types[0])) if types[0].may(Kind.NUMBER) else NOTHING
    return union((number, Type(Kind.FLOAT) if types[0].may(Kind.STR) else NOTHING))


def are_not_numbers(types: Types) -> bool:
    """Whether a function that works on all numbers can fail."""
    return not all(t.only(Kind.NUMBER) for t in types)

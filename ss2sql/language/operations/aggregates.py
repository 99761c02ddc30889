"""Aggregates: functions of a list that GROUP BY applies to the values of a group, where None is skipped.

So are `min` and `max`, which stand in lists.py.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from ss2sql.kinds import FLOAT, NOTHING, Kind, Type
from ss2sql.language.operations.intervals import INTEGER, fits, integers, is_nonnegative, numbers
from ss2sql.language.operations.lists import LENGTH, are_not_lists, length_type
from ss2sql.language.operations.row import Check, Form, Operation, Types, When, aggregate, each, element, exactly
from ss2sql.runtime.checking import watched
from ss2sql.runtime.messages import CURES, check
from ss2sql.runtime.values import freeze

if TYPE_CHECKING:
    from fractions import Fraction

# --- sums ----------------------------------------------------------------------------------------------


def total(values: list[Any]) -> Any:
    """The sum: exact of integers, of floats rounded once, so that the order does not matter."""
    return total_of_floats(values) if any(type(value) is float for value in values) else total_of_integers(values)


def total_of_integers(values: list[int]) -> int:
    return int(check(sum(values), CURES["sum"]))


def total_of_floats(values: list[float]) -> float:
    """The sum of numbers among which are floats."""
    return float(check(_sum_of_floats(values)))


def _sum_of_floats(values: list[float]) -> float:
    try:
        return math.fsum(values)
    except OverflowError:  # on the way only, perhaps
        return _float(_exact_sum(values))


def _exact_sum(values: Iterable[float]) -> Fraction:
    from fractions import Fraction  # rarely needed, and slow to import

    return sum(map(Fraction, watched(values)), Fraction())


def _float(value: Fraction) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _sum_of_kind(kind: Type) -> Type:
    """Of a group, which has a value."""
    return FLOAT if kind.kinds == Kind.FLOAT else Type(Kind.INT | (kind.kinds & Kind.FLOAT))


def _small_integers(types: Types) -> bool:
    return types[0].kinds & ~Kind.NONE == Kind.INT and types[0].bounded(2**31)


def _items(kinds: Kind) -> When:
    """Lists with elements of these kinds, and not empty ones alone."""

    def when(types: Types) -> bool:
        item = types[0].item
        return types[0].only(Kind.LIST) and item is not None and item != NOTHING and item.only(kinds)

    return when


def _are_floats(types: Types) -> bool:
    """Of no floats the sum would be an integer."""
    return _items(Kind.FLOAT)(types) and bool(types[0].positions)


def _sum_of_list(types: Types) -> Type:
    item = element(types[0])
    kinds = Kind.INT | (item.kinds & Kind.FLOAT)
    if (sums := _known_sums(types[0])) is not None:
        return numbers(kinds, sums)
    negative = item.may(Kind.NUMBER) and not is_nonnegative(item)
    positive = item.may(Kind.NUMBER) and (item.high is None or item.high > 0)
    return Type(kinds, None if negative else 0, None if positive else 0)


def _sum_can_fail(types: Types) -> bool:
    item = element(types[0])
    if are_not_lists(types):
        return True
    if (sums := _known_sums(types[0])) is not None:
        return not fits(Kind.INT, sums)
    # So small that even the longest list stays within 64 bits.
    return not (item.only(INTEGER) and (item.bounded(512) or item == NOTHING))


def _known_sums(kind: Type) -> tuple[int, int] | None:
    """The bounds of the sums of lists whose elements are known one by one as integers."""
    limits = [integers(part) for part in kind.positions or ()]
    if not limits or None in limits or not all(part.only(INTEGER) for part in kind.positions or ()):
        return None
    known = [limit for limit in limits if limit is not None]
    return sum(low for low, _ in known), sum(high for _, high in known)


# --- means ---------------------------------------------------------------------------------------------


def mean(values: list[Any]) -> float:
    if not any(type(value) is float for value in values):
        return float(sum(values) / len(values))
    try:
        return math.fsum(values) / len(values)
    except OverflowError:
        return _float(_exact_sum(values) / len(values))


def _averaged(types: Types) -> bool:
    """Integers of which 2^32 add up to one that a float holds."""
    return types[0].kinds & ~Kind.NONE == Kind.INT and types[0].bounded(2**21)


# --- counts --------------------------------------------------------------------------------------------


def _different(values: list[Any]) -> int:
    return len({freeze(value) for value in watched(values)})


def _one_of(*kinds: Kind) -> When:
    """Values of one of these kinds, None among them perhaps."""
    return lambda types: types[0].kinds & ~Kind.NONE in kinds


OPERATIONS: tuple[Operation, ...] = (
    aggregate(
        "count", len, Type(Kind.INT, 0, LENGTH), nothing=0, about="the number of elements of a list",
        example="count([4, None, 5])", accepts=None, can_fail=lambda kind: False, in_sql=lambda kind: True,
        sqlite=(Form("count({0})"),), python=(Form(len),), portable=(Form("count({0})"),),
        of_list={"result": length_type, "python": (Form("len({0})", each(Kind.LIST)),)},
    ),
    aggregate(
        "count_distinct", _different, Type(Kind.INT, 0, LENGTH), nothing=0,
        about="the number of different elements of a list; of a group count(DISTINCT x)",
        example="SELECT count(DISTINCT this) FROM [4, 4.0, None, 5] AS value", accepts=None,
        can_fail=lambda kind: False, in_sql=lambda kind: True,
        sqlite=(Form("count(DISTINCT {0})", _one_of(Kind.INT, Kind.FLOAT, Kind.STR)),),
        portable=(Form("count(DISTINCT {0})", _one_of(Kind.INT, Kind.STR)),), of_list={"result": length_type},
    ),
    aggregate(
        "sum", total, _sum_of_kind, nothing=0, about="the sum of a list of numbers, 0 if it is empty",
        example="[sum([1, 2.5]), sum([])]", can_fail=lambda kind: True,
        python=(Form(total_of_floats, exactly(Kind.FLOAT)), Form(total_of_integers, each(INTEGER))),
        portable=(Form("coalesce(cast(sum({0}) AS BIGINT), 0)", _small_integers),),
        of_floats=lambda values, count: math.fsum(values),
        of_list={
            "result": _sum_of_list, "can_fail": _sum_can_fail,
            "python": (
                Form(total_of_integers, _items(INTEGER), Check.ITSELF),
                Form(total_of_floats, _are_floats, Check.ITSELF),
            ),
        },
    ),
    aggregate(
        "average", mean, FLOAT, about="the mean of a list of numbers", example="average([1, 2, 6])",
        portable=(Form("cast(sum({0}) AS DOUBLE) / count({0})", _averaged),),
        of_floats=lambda values, count: math.fsum(values) / count,
    ),
)  # fmt: skip

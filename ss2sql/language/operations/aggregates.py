"""Aggregates: functions of a list that GROUP BY applies to the values of a group, where None is skipped.

So are `min` and `max`, which stand in lists.py.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

from ss2sql.language.cancellation import iterate_checked
from ss2sql.language.conversion import CURES, check_arithmetic, format_value
from ss2sql.language.kinds import FLOAT, INTEGER, NONE, NOTHING, Kind, Type, Types, is_nonnegative, unite
from ss2sql.language.operations.lists import LENGTH, are_not_lists, infer_length
from ss2sql.language.operations.operation import (
    AggregateOperation,
    Check,
    Form,
    Operation,
    When,
    check_list,
    check_number,
    check_numbers,
    declare,
    declare_aggregate,
    each,
    element_type,
    exactly,
    misuse,
)
from ss2sql.language.values import make_hashable

if TYPE_CHECKING:
    from fractions import Fraction

# --- sums ----------------------------------------------------------------------------------------------


def compute_sum(values: list[Any]) -> Any:
    """The sum: exact of integers, of floats rounded once, so that the order does not matter."""
    return sum_floats(values) if any(type(value) is float for value in values) else sum_integers(values)


def sum_integers(values: list[int]) -> int:
    return int(check_arithmetic(sum(values), CURES["sum"]))


def sum_floats(values: list[float]) -> float:
    """The sum of numbers, some of them floats."""
    return float(check_arithmetic(_sum_of_floats(values)))


def _sum_of_floats(values: list[float]) -> float:
    try:
        return math.fsum(values)
    except OverflowError:  # perhaps of an intermediate sum only
        return _convert_to_float(_sum_exactly(values))


def _sum_exactly(values: Iterable[float]) -> Fraction:
    from fractions import Fraction  # rarely needed, and slow to import

    return sum(map(Fraction, iterate_checked(values)), Fraction())


def _convert_to_float(value: Fraction) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf


def _sum_of_kind(kind: Type) -> Type:
    """The type of the sum of a group, which is never empty."""
    return FLOAT if kind.kinds == Kind.FLOAT else Type(Kind.INT | (kind.kinds & Kind.FLOAT))


def _are_small_integer_types(types: Types) -> bool:
    return types[0].kinds & ~Kind.NONE == Kind.INT and types[0].is_bounded(2**31)


def _are_bounded_float_types(types: Types) -> bool:
    """Floats so small that every sum is finite; SQLite's own sum is compensated, too."""
    return types[0].kinds == Kind.FLOAT and types[0].is_bounded(1e280)


def _are_element_types(kinds: Kind) -> When:
    """Lists with elements of these kinds, at least one of them not empty."""

    def check_types(types: Types) -> bool:
        item = types[0].element
        return types[0].is_only(Kind.LIST) and item is not None and item != NOTHING and item.is_only(kinds)

    return check_types


def _are_float_sum_types(types: Types) -> bool:
    """Whether the values are floats: the sum of none is an integer."""
    return _are_element_types(Kind.FLOAT)(types) and bool(types[0].positions)


def _infer_list_sum(types: Types) -> Type:
    item = element_type(types[0])
    kinds = Kind.INT | (item.kinds & Kind.FLOAT)
    negative = item.may_be(Kind.NUMBER) and not is_nonnegative(item)
    positive = item.may_be(Kind.NUMBER) and (item.high is None or item.high > 0)
    return Type(kinds, None if negative else 0, None if positive else 0)


def _can_sum_fail(types: Types) -> bool:
    item = element_type(types[0])
    if are_not_lists(types):
        return True
    # So small that even the longest list stays within 64 bits.
    return not (item.is_only(INTEGER) and (item.is_bounded(512) or item == NOTHING))


# --- means ---------------------------------------------------------------------------------------------


def compute_mean(values: list[Any]) -> float:
    if not any(type(value) is float for value in values):
        return float(sum(values) / len(values))
    try:
        return math.fsum(values) / len(values)
    except OverflowError:
        return _convert_to_float(_sum_exactly(values) / len(values))


def _are_exact_average_types(types: Types) -> bool:
    """Integers so small that a float holds the sum of 2^32 of them."""
    return types[0].kinds & ~Kind.NONE == Kind.INT and types[0].is_bounded(2**21)


# --- counts --------------------------------------------------------------------------------------------


def _count_distinct(values: list[Any]) -> int:
    return len({make_hashable(value) for value in iterate_checked(values)})


def _accept_kinds(*kinds: Kind) -> When:
    """Tests whether all values are of one of these kinds, or None."""
    return lambda types: types[0].kinds & ~Kind.NONE in kinds


def _compute_variance(values: list[Any]) -> float | None:
    """The variance of a sample; None for fewer than two values."""
    if len(values) < 2:
        return None
    middle = compute_mean(values)
    squares = [(value - middle) * (value - middle) for value in values]
    return float(check_arithmetic(_sum_of_floats(squares) / (len(values) - 1)))


def _compute_deviation(values: list[Any]) -> float | None:
    found = _compute_variance(values)
    return None if found is None else math.sqrt(found)


def _compute_median(values: list[Any]) -> float:
    """The middle number, or the mean of the two in the middle."""
    ordered = sorted(values)
    half = len(ordered) // 2
    return float(ordered[half]) if len(ordered) % 2 else compute_mean(ordered[half - 1 : half + 1])


def _compute_percentile(values: Any, part: Any) -> float | None:
    """The number that has this part of the others below it, interpolated between two of them."""
    check_numbers("percentile", check_list("percentile", values))
    if not 0 <= check_number("percentile", part) <= 1:
        raise misuse(f"percentile of {format_value(part)}", "the part is a number from 0 to 1: percentile(x, 0.9)")
    if not values:
        return None
    ordered = sorted(values)
    place = part * (len(ordered) - 1)
    below = math.floor(place)
    low, high = ordered[below], ordered[min(below + 1, len(ordered) - 1)]
    return float(check_arithmetic(low * (1 - (place - below)) + high * (place - below)))


def _declare_end_aggregate(name: str, place: int, about: str, example: str) -> Operation:
    """The row of `first` or `last`: an end of a list, None of an empty one."""

    def take_end(values: Any) -> Any:
        return check_list(name, values)[place] if values or type(values) is not list else None

    take_end.__name__ = name
    return declare(
        name, 1, take_end, lambda types: unite((element_type(types[0]), NONE)), are_not_lists,
        call=f"{name}(list)", about=about, example=example, collects=True,
        python=(Form(f"{{0}}[{place}] if {{0}} else None", each(Kind.LIST)),),
    )  # fmt: skip


# The values of a group as a list, for functions that need their order or more arguments.
COLLECT = AggregateOperation(
    list, [], lambda kind: Type(Kind.LIST, element=kind, columns=kind.columns), lambda kind: False, lambda kind: False,
    python=(Form(list),),
)  # fmt: skip

OPERATIONS: tuple[Operation, ...] = (
    declare_aggregate(
        "count", len, Type(Kind.INT, 0, LENGTH), nothing=0, about="the number of elements of a list",
        example="count([4, None, 5])", accepts=None, can_fail=lambda kind: False, in_sql=lambda kind: True,
        sqlite=(Form("count({0})"),), python=(Form(len),), portable=(Form("count({0})"),),
        of_list={"result": infer_length, "python": (Form("len({0})", each(Kind.LIST)),)},
    ),
    declare_aggregate(
        "count_distinct", _count_distinct, Type(Kind.INT, 0, LENGTH), nothing=0,
        about="the number of different elements of a list; of a group count(DISTINCT x)",
        example="SELECT count(DISTINCT this) FROM [4, 4.0, None, 5] AS value", accepts=None,
        can_fail=lambda kind: False, in_sql=lambda kind: True,
        sqlite=(Form("count(DISTINCT {0})", _accept_kinds(Kind.INT, Kind.FLOAT, Kind.STR)),),
        portable=(Form("count(DISTINCT {0})", _accept_kinds(Kind.INT, Kind.STR)),), of_list={"result": infer_length},
    ),
    declare_aggregate(
        "sum", compute_sum, _sum_of_kind, nothing=0, about="the sum of a list of numbers, 0 if it is empty",
        example="[sum([1, 2.5]), sum([])]", can_fail=lambda kind: True,
        sqlite=(Form("coalesce(sum({0}), 0)", _are_bounded_float_types),),
        python=(Form(sum_floats, exactly(Kind.FLOAT)), Form(sum_integers, each(INTEGER))),
        portable=(Form("coalesce(cast(sum({0}) AS BIGINT), 0)", _are_small_integer_types),),
        of_list={
            "result": _infer_list_sum, "can_fail": _can_sum_fail,
            "python": (
                Form(sum_integers, _are_element_types(INTEGER), Check.ITSELF),
                Form(sum_floats, _are_float_sum_types, Check.ITSELF),
            ),
        },
    ),
    declare_aggregate(
        "average", compute_mean, FLOAT, about="the mean of a list of numbers", example="average([1, 2, 6])",
        portable=(Form("cast(sum({0}) AS DOUBLE) / count({0})", _are_exact_average_types),),
    ),
    declare_aggregate(
        "median", _compute_median, FLOAT, about="the middle of a list of numbers, a float",
        example="[median([5, 1, 3]), median([1, 2])]",
    ),
    declare_aggregate(
        "stddev", _compute_deviation, unite((FLOAT, NONE)), about="the standard deviation of a sample",
        example="stddev([2, 4, 4, 4, 5, 5, 7, 9])", can_fail=lambda kind: True,
    ),
    declare_aggregate(
        "variance", _compute_variance, unite((FLOAT, NONE)), about="the variance of a sample",
        example="variance([1, 2, 3, 4])",
        can_fail=lambda kind: True,
    ),
    declare(
        "percentile", 2, _compute_percentile, unite((FLOAT, NONE)), True, call="percentile(list, part)", collects=True,
        about="the number below which this part of the others lies", example="percentile([1, 2, 3, 4], 0.5)",
    ),
    _declare_end_aggregate("first", 0, "the first element of a list, None of an empty one", "first([3, 1, 2])"),
    _declare_end_aggregate("last", -1, "the last element of a list, None of an empty one", "last([3, 1, 2])"),
)  # fmt: skip

"""The built-in functions of section 3, by name: least and greatest number of arguments, and what they do."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Iterable
from fractions import Fraction
from typing import Any

from .values import Failure, checked, compare, equal, is_number

AGGREGATES = frozenset({"count", "sum", "min", "max", "average"})


def wrong(why: str) -> Failure:
    return Failure("X007", why)


def a_list(value: Any) -> list[Any]:
    if not isinstance(value, list):
        raise wrong(f"{value!r} is not a list")
    return value


def a_number(value: Any) -> Any:
    if not is_number(value):
        raise wrong(f"{value!r} is not a number")
    return value


def an_integer(value: Any) -> int:
    if not isinstance(value, int):
        raise wrong(f"{value!r} is not an integer")
    return value


def length(value: Any) -> int:
    if not isinstance(value, (list, str, dict)):
        raise wrong(f"{value!r} has no length")
    return len(value)


def total(values: Any) -> Any:
    """The sum: exact for integers, correctly rounded as soon as there is a float; of nothing 0."""
    numbers = [a_number(value) for value in a_list(values)]
    if any(isinstance(number, float) for number in numbers):
        return checked(mean_of_floats(numbers, 1))
    return checked(sum(numbers))


def average(values: Any) -> Any:
    """The sum over the number of values; of nothing None."""
    numbers = [a_number(value) for value in a_list(values)]
    if not numbers:
        return None
    if any(isinstance(number, float) for number in numbers):
        return mean_of_floats(numbers, len(numbers))
    return sum(numbers) / len(numbers)


def mean_of_floats(numbers: list[Any], divisor: int) -> float:
    """The sum of floats, rounded, over a number; where the sum is no float, the quotient may still be one."""
    try:
        return math.fsum(numbers) / divisor
    except OverflowError:
        pass
    try:
        return float(sum(map(Fraction, numbers)) / divisor)
    except OverflowError as error:
        raise Failure("X004", "sum") from error


def ordered(values: Any) -> list[Any]:
    return sorted(a_list(values), key=functools.cmp_to_key(compare))


def least(values: Any) -> Any:
    """The first of the least values; of nothing None."""
    return extreme(values, -1)


def greatest(values: Any) -> Any:
    """The first of the greatest values; of nothing None."""
    return extreme(values, 1)


def extreme(values: Any, sign: int) -> Any:
    best = None
    for number, value in enumerate(a_list(values)):
        try:
            if number == 0 or compare(value, best) == sign:
                best = value
        except Failure as error:
            raise error
    return best


def different(values: Any) -> list[Any]:
    """Every value once, in the order of first appearance."""
    found: list[Any] = []
    for value in a_list(values):
        if not any(equal(value, other) for other in found):
            found.append(value)
    return found


def zipped(*lists: Any) -> list[Any]:
    return [list(items) for items in zip(*(a_list(one) for one in lists), strict=False)]


def numbers_from(*bounds: Any) -> list[int]:
    numbers = [an_integer(bound) for bound in bounds]
    if len(numbers) == 3 and numbers[2] == 0:
        raise wrong("range with step 0")
    return list(range(*numbers))


def rounded(value: Any, digits: Any = None) -> Any:
    if digits is None:
        return checked(round(a_number(value)))
    return checked(round(a_number(value), an_integer(digits)))


def root(value: Any) -> float:
    if a_number(value) < 0:
        raise wrong(f"root of {value!r}")
    return math.sqrt(value)


def to_number(kind: type[int] | type[float], value: Any) -> Any:
    if not (is_number(value) or isinstance(value, str)):
        raise wrong(f"{value!r} is not a number")
    try:
        return checked(kind(value))
    except ValueError as error:
        raise wrong(f"{value!r} is not a number") from error


def vector(value: Any) -> list[Any]:
    return [a_number(part) for part in a_list(value)]


def distance(left: Any, right: Any) -> float:
    a, b = vector(left), vector(right)
    if len(a) != len(b):
        raise wrong("points of different dimensions")
    return math.dist(a, b)


def norm(value: Any) -> float:
    return math.hypot(*vector(value))


MANY = 1000

BUILTINS: dict[str, tuple[int, int, Callable[..., Any]]] = {
    "len": (1, 1, length),
    "count": (1, 1, lambda values: len(a_list(values))),
    "sum": (1, 1, total),
    "min": (1, 1, least),
    "max": (1, 1, greatest),
    "average": (1, 1, average),
    "uniq": (1, 1, different),
    "sorted": (1, 1, ordered),
    "zip": (1, MANY, zipped),
    "range": (1, 3, numbers_from),
    "abs": (1, 1, lambda value: checked(abs(a_number(value)))),
    "round": (1, 2, rounded),
    "sqrt": (1, 1, root),
    "str": (1, 1, lambda value: str(value)),
    "int": (1, 1, lambda value: to_number(int, value)),
    "float": (1, 1, lambda value: to_number(float, value)),
    "distance": (2, 2, distance),
    "norm": (1, 1, norm),
}


def aggregate(function: str, values: Iterable[Any]) -> Any:
    """An aggregate of the values of a group: None is skipped."""
    kept = [value for value in values if value is not None]
    return BUILTINS[function][2](kept)

"""The built-in functions of section 3, by name: least and greatest number of arguments, and what they do."""

from __future__ import annotations

import datetime
import functools
import math
from collections.abc import Callable, Iterable
from fractions import Fraction
from typing import Any

from .values import Failure, checked, compare, equal, is_number

AGGREGATES = frozenset(
    {"count", "sum", "min", "max", "average", "median", "stddev", "variance", "percentile", "first", "last"}
)


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


def of_numbers(function: Callable[..., Any]) -> Callable[..., Any]:
    """A function of the C library on numbers."""

    def compute(*numbers: Any) -> Any:
        try:
            return checked(function(*map(a_number, numbers)))
        except (ValueError, ZeroDivisionError) as error:
            raise wrong("no real number") from error
        except OverflowError as error:
            raise Failure("X004", "too large") from error

    return compute


def clamped(value: Any, low: Any, high: Any) -> Any:
    if compare(low, high) > 0:
        raise wrong("the bounds are the wrong way round")
    if compare(value, low) < 0:
        return low
    return high if compare(value, high) > 0 else value


def of_strings(function: Callable[..., Any]) -> Callable[..., Any]:
    def compute(*strings: Any) -> Any:
        if not all(isinstance(one, str) for one in strings):
            raise wrong("not a string")
        try:
            return function(*strings)
        except ValueError as error:
            raise wrong(str(error)) from error

    return compute


def replaced(value: str, old: str, new: str) -> str:
    if old == "":
        raise ValueError("nothing to replace")
    return new.join(value.split(old))


def joined(values: Any, separator: Any = "") -> str:
    if not isinstance(separator, str):
        raise wrong("not a string")
    return separator.join(str(value) for value in a_list(values))


def formatted(pattern: Any, *values: Any) -> str:
    if not isinstance(pattern, str):
        raise wrong("not a string")
    try:
        return pattern.format(*values)
    except (ValueError, IndexError, TypeError, KeyError, AttributeError) as error:
        raise wrong(pattern) from error


def backwards(value: Any) -> Any:
    return value[::-1] if isinstance(value, str) else list(reversed(a_list(value)))


def flat(values: Any) -> list[Any]:
    found: list[Any] = []
    for value in a_list(values):
        found += value if isinstance(value, list) else [value]
    return found


def index_of(values: Any, wanted: Any) -> int | None:
    return next((place for place, value in enumerate(a_list(values)) if equal(value, wanted)), None)


def difference(left: Any, right: Any) -> list[Any]:
    gone = a_list(right)
    return [value for value in a_list(left) if not any(equal(value, other) for other in gone)]


def middle(values: Any) -> Any:
    numbers = sorted(a_number(value) for value in a_list(values))
    half = len(numbers) // 2
    if not numbers:
        return None
    return float(numbers[half]) if len(numbers) % 2 else average(numbers[half - 1 : half + 1])


def variance(values: Any) -> Any:
    numbers = [a_number(value) for value in a_list(values)]
    if len(numbers) < 2:
        return None
    mean = average(numbers)
    return checked(mean_of_floats([(number - mean) * (number - mean) for number in numbers], len(numbers) - 1))


def deviation(values: Any) -> Any:
    found = variance(values)
    return None if found is None else math.sqrt(found)


def percentile(values: Any, part: Any) -> Any:
    numbers = sorted(a_number(value) for value in a_list(values))
    if not 0 <= a_number(part) <= 1:
        raise wrong("a part from 0 to 1")
    if not numbers:
        return None
    place = part * (len(numbers) - 1)
    below = int(place)
    above = min(below + 1, len(numbers) - 1)
    return float(numbers[below] * (1 - (place - below)) + numbers[above] * (place - below))


def end(place: int) -> Callable[..., Any]:
    return lambda values: (a_list(values) or [None])[place]


def type_name(value: Any) -> str:
    return "None" if value is None else type(value).__name__


def a_day(first: Any, *parts: Any) -> Any:
    return moment(datetime.date, first, parts, lambda day: day.date() if isinstance(day, datetime.datetime) else day)


def a_time(first: Any, *parts: Any) -> Any:
    midnight = datetime.time()

    def whole(day: Any) -> Any:
        return day if isinstance(day, datetime.datetime) else datetime.datetime.combine(day, midnight)

    return moment(datetime.datetime, first, parts, whole)


def moment(kind: Any, first: Any, parts: tuple[Any, ...], whole: Callable[[Any], Any]) -> Any:
    try:
        if isinstance(first, int):
            return kind(*map(an_integer, (first, *parts)))
        if not isinstance(first, str | datetime.date):
            raise wrong("no time")
        return kind.fromisoformat(first) if isinstance(first, str) else whole(first)
    except (ValueError, TypeError) as error:
        raise wrong("no time") from error


def span(days: Any, seconds: Any = 0) -> Any:
    return datetime.timedelta(a_number(days), a_number(seconds))


def part_of(name: str, kind: type) -> Callable[..., Any]:
    def compute(value: Any) -> Any:
        if not isinstance(value, kind):
            raise wrong(f"{value!r} has no {name}")
        found = getattr(value, name)
        return found() if callable(found) else found

    return compute


MANY = 1000

BUILTINS: dict[str, tuple[int, int, Callable[..., Any]]] = {
    "len": (1, 1, length), "count": (1, 1, lambda values: len(a_list(values))), "sum": (1, 1, total),
    "min": (1, 1, least), "max": (1, 1, greatest), "average": (1, 1, average), "uniq": (1, 1, different),
    "sorted": (1, 1, ordered), "zip": (1, MANY, zipped), "range": (1, 3, numbers_from),
    "abs": (1, 1, lambda value: checked(abs(a_number(value)))), "round": (1, 2, rounded), "sqrt": (1, 1, root),
    "str": (1, 1, lambda value: str(value)), "int": (1, 1, lambda value: to_number(int, value)),
    "float": (1, 1, lambda value: to_number(float, value)), "distance": (2, 2, distance), "norm": (1, 1, norm),
    "floor": (1, 1, of_numbers(math.floor)), "ceil": (1, 1, of_numbers(math.ceil)),
    **{name: (1, 1, of_numbers(getattr(math, name))) for name in ("sin", "cos", "tan", "asin", "acos", "exp")},
    "atan2": (2, 2, of_numbers(math.atan2)), "log": (1, 2, of_numbers(math.log)), "pi": (0, 0, lambda: math.pi),
    "clamp": (3, 3, clamped), "upper": (1, 1, of_strings(str.upper)), "lower": (1, 1, of_strings(str.lower)),
    "strip": (1, 2, of_strings(str.strip)), "split": (1, 2, of_strings(str.split)), "join": (1, 2, joined),
    "replace": (3, 3, of_strings(replaced)), "starts": (2, 2, of_strings(str.startswith)),
    "ends": (2, 2, of_strings(str.endswith)), "find": (2, 2, of_strings(str.find)), "format": (1, MANY, formatted),
    "coalesce": (1, MANY, lambda *values: next((value for value in values if value is not None), None)),
    "any": (1, 1, lambda values: any(map(bool, a_list(values)))),
    "all": (1, 1, lambda values: all(map(bool, a_list(values)))), "type": (1, 1, type_name),
    "reverse": (1, 1, backwards), "flat": (1, 1, flat), "index": (2, 2, index_of), "difference": (2, 2, difference),
    "median": (1, 1, middle), "stddev": (1, 1, deviation), "variance": (1, 1, variance),
    "percentile": (2, 2, percentile), "first": (1, 1, end(0)), "last": (1, 1, end(-1)), "date": (1, 3, a_day),
    "datetime": (1, 6, a_time), "timedelta": (1, 2, span), "now": (0, 0, datetime.datetime.now),
    **{name: (1, 1, part_of(name, datetime.date)) for name in ("year", "month", "day", "weekday")},
    **{name: (1, 1, part_of(name, datetime.datetime)) for name in ("hour", "minute", "second")},
}  # fmt: skip


def aggregate(function: str, values: Iterable[Any], *others: Any) -> Any:
    """An aggregate of the values of a group: None is skipped."""
    kept = [value for value in values if value is not None]
    return BUILTINS[function][2](kept, *others)

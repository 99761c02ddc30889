"""The built-in functions of values: of lists, numbers and text."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from ss2sql.errors import ExecutionError
from ss2sql.runtime.checking import AT_ONCE, watched
from ss2sql.runtime.messages import CURES, check, float_overflow, show
from ss2sql.runtime.ordering import NUMBERS, compare, sorted_values
from ss2sql.runtime.values import freeze, truth

if TYPE_CHECKING:
    from fractions import Fraction

RANGE_LIMIT = 10_000_000


_MISFITS = {
    type(None): "leave None out with WHERE",
    str: "int(...) and float(...) make numbers of text",
    dict: "the rows of a query are dicts; SELECT one column, and end the query with AS list",
    list: "give the numbers themselves, as one flat list",
}


def _wrong(message: str, hint: str) -> ExecutionError:
    return ExecutionError("X007", message, hints=(hint,))


def _list(function: str, value: Any) -> list[Any]:
    """The argument, if it is a list."""
    if type(value) is list:
        return value
    hint = f"collect the values in a list first: {function}(SELECT ... AS list)"
    raise _wrong(f"{function} works on a list, not on {show(value)}", hint)


def _numbers(function: str, values: Sequence[Any]) -> set[type]:
    """The types of the values, which have to be numbers."""
    kinds = set(map(type, values))
    if kinds <= NUMBERS:
        return kinds
    wrong = next(value for value in values if type(value) not in NUMBERS)
    hint = _MISFITS.get(type(wrong), f"{function} works on numbers alone")
    raise _wrong(f"{function} works on numbers, not on {show(wrong)}", hint)


def _number(function: str, value: Any) -> Any:
    _numbers(function, (value,))
    return value


def _integer(function: str, value: Any) -> int:
    """The argument, if it is an integer; True counts as 1."""
    if type(value) is int or type(value) is bool:
        return int(value)
    raise _wrong(f"{function} works on integers, not on {show(value)}", "int(...) makes an integer")


# --- lists ---------------------------------------------------------------------------------------------


def length(value: Any) -> int:
    """The number of elements of a list, keys of a dict, characters of a string."""
    if type(value) in (list, dict, str):
        return len(value)
    raise _wrong(f"{show(value)} has no length", "len works on lists, dicts and strings")


def count(values: Any) -> int:
    """The number of elements of a list."""
    return len(_list("count", values))


def total(values: Any) -> Any:
    """The sum: exact of integers, of floats rounded once, so that the order does not matter; of nothing 0."""
    kinds = _numbers("sum", _list("sum", values))
    return total_of_integers(values) if float not in kinds else total_of_floats(values)


def unchecked_total(values: list[Any]) -> int | float:
    """The sum of numbers, which may be no value: an integer beyond 64 bits, an infinite float."""
    return _sum_of_floats(values) if any(type(value) is float for value in values) else int(sum(values))


def total_of_integers(values: list[int]) -> int:
    """The sum of integers."""
    return int(check(sum(values), CURES["sum"]))


def total_of_floats(values: list[float]) -> float:
    """The sum of numbers among which are floats."""
    return float(check(_sum_of_floats(values)))


def _sum_of_floats(values: list[float]) -> float:
    try:
        return math.fsum(values)
    except OverflowError:  # on the way only, perhaps
        return _float(_exact_sum(values))


def average(values: Any) -> float | None:
    """The arithmetic mean, a float."""
    kinds = _numbers("average", _list("average", values))
    if not values:
        return None
    if float not in kinds:
        return float(sum(values) / len(values))
    try:
        return math.fsum(values) / len(values)
    except OverflowError:
        return _float(_exact_sum(values) / len(values))


def _exact_sum(values: Iterable[float]) -> Fraction:
    from fractions import Fraction  # rarely needed, and slow to import

    return sum(map(Fraction, watched(values)), Fraction())


def _float(value: Fraction) -> float:
    try:
        return float(value)
    except OverflowError:
        return math.inf


def least(first: Any, *others: Any) -> Any:
    """The least element of a list, or the least of several arguments; the first of equal ones, None of no elements."""
    return _extreme("min", -1, first, others)


def greatest(first: Any, *others: Any) -> Any:
    """The greatest element of a list, or the greatest of several arguments; the first of equal ones, None of none."""
    return _extreme("max", 1, first, others)


def _extreme(function: str, sign: int, first: Any, others: tuple[Any, ...]) -> Any:
    values = (first, *others) if others else _list(function, first)
    if not values:
        return None
    kinds = set(map(type, values))
    if kinds <= NUMBERS or kinds == {str}:
        return min(values) if sign < 0 else max(values)
    best = values[0]
    for value in watched(values[1:]):
        if compare(value, best) == sign:
            best = value
    return best


def unique(values: Any) -> list[Any]:
    """The different elements of a list, the first of equal ones, in their order."""
    found: dict[Any, Any] = {}
    for value in watched(_list("uniq", values)):
        found.setdefault(freeze(value), value)
    return list(found.values())


def in_order(values: Any, descending: Any = False) -> list[Any]:
    """The elements of a list in their order, equal ones as they came."""
    return sorted_values(_list("sorted", values), truth(descending))


def zipped(*lists: Any) -> list[list[Any]]:
    """Lists of the first elements, of the second ones, and so on, as far as the shortest list goes."""
    rows = zip(*(_list("zip", values) for values in lists), strict=False)
    return list(map(list, rows if len(lists[0]) <= AT_ONCE else watched(rows)))


def numbers_from(*bounds: Any) -> list[int]:
    """The integers from 0 up to, not including, a stop; from a start to a stop; the same in steps."""
    limits = [_integer("range", bound) for bound in bounds]
    if len(limits) == 3 and limits[2] == 0:
        raise _wrong("the step of range is 0", "give a positive or a negative step")
    numbers = range(*limits)
    if numbers[RANGE_LIMIT:]:
        message = f"range({', '.join(map(str, limits))}) has too many elements"
        raise _wrong(message, f"a list made by range has at most {RANGE_LIMIT} elements")
    return list(numbers)


# --- numbers -------------------------------------------------------------------------------------------


def absolute(value: Any) -> Any:
    """The number without its sign."""
    return check(abs(_number("abs", value)), CURES["abs"])


def rounded(value: Any, digits: Any = None) -> Any:
    """The nearest integer, or the nearest number with so many decimal places; halves go to the even neighbour."""
    _number("round", value)
    try:
        if digits is None:
            return check(round(value))
        if type(digits) is not int and type(digits) is not bool:
            message = f"round takes a whole number of decimal places, not {show(digits)}"
            raise _wrong(message, "round(x, 2) keeps two of them")
        places = int(digits)
        if type(value) is float:
            return check(round(value, places))
    except OverflowError:
        raise float_overflow() from None
    # Beyond 20 digits before the point nothing is left of 64 bits; Python would compute the power of 10.
    return check(round(int(value), places)) if places >= -20 else 0


def square_root(value: Any) -> float:
    """The square root of a number that is not negative."""
    if _number("sqrt", value) < 0:
        raise _wrong(f"sqrt of the negative number {show(value)}", "sqrt(abs(x)) takes the number without its sign")
    return math.sqrt(value)


def distance(left: Any, right: Any) -> float:
    """The Euclidean distance of two numbers, or of two equally long lists of numbers."""
    if type(left) is not list and type(right) is not list:
        _numbers("distance", (left, right))
        return float(check(float(abs(left - right))))
    for point in (left, right):
        if type(point) is not list:
            raise _wrong(f"distance of {show(left)} and {show(right)}", "give two numbers, or two lists of numbers")
        _numbers("distance", point)
    if len(left) != len(right):
        message = f"distance of lists of {len(left)} and {len(right)} numbers"
        raise _wrong(message, "both points need the same number of coordinates")
    return float(check(math.dist(left, right)))


def norm(value: Any) -> float:
    """The Euclidean length of a list of numbers; of a number its size."""
    parts = value if type(value) is list else [value]
    _numbers("norm", parts)
    return float(check(math.hypot(*parts)))


# --- text ----------------------------------------------------------------------------------------------


def text(value: Any) -> str:
    """The value as text, as Python's `str` writes it."""
    return str(value)


def to_integer(value: Any) -> int:
    """The integer that a text stands for; of a number, its whole part."""
    if type(value) in NUMBERS:
        return int(check(int(value), CURES["int"]))
    try:
        return int(check(int(_text("int", value)), CURES["int"]))
    except ValueError:
        raise _wrong(
            f"int cannot read {show(value)}", "int reads digits; int(float(...)) also reads fractions"
        ) from None


def to_float(value: Any) -> float:
    """The float that a text stands for, or that is nearest to a number."""
    if type(value) in NUMBERS:
        return float(value)
    try:
        number = float(_text("float", value))
    except ValueError:
        raise _wrong(
            f"float cannot read {show(value)}", "float reads numbers with a point, such as '1.5' or '2e3'"
        ) from None
    if not math.isfinite(number):
        message = f"{show(value)} is not a finite number"
        raise ExecutionError("X004", message, hints=("floats have to be finite; None can say that there is no value",))
    return number


def _text(function: str, value: Any) -> str:
    if type(value) is str:
        return value
    hint = (
        "leave None out, or write IF(x == None; ...; ...)"
        if value is None
        else "the elements of a list are converted one by one"
    )
    raise _wrong(f"{function} works on numbers and strings, not on {show(value)}", hint)

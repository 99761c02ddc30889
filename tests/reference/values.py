"""The values of the language and their rules: equality, order, truth, arithmetic, what may enter.

Every function here is written to be compared with the section "Values" and "Expressions" of the language page.
Nothing changes a value in place, and everything that goes to a function of the user is a deep copy.
"""

from __future__ import annotations

import datetime
import math
from collections.abc import Callable, Hashable, Sequence
from typing import Any

import numpy as np

from ss2sql.errors import CODES

INT_MIN, INT_MAX = -(2**63), 2**63 - 1


class Failure(Exception):  # noqa: N818 - it stands for the error that a script must fail with
    """The script fails with this code of `ss2sql.errors.CODES`."""

    def __init__(self, code: str, why: str = "") -> None:
        assert code in CODES, code
        super().__init__(f"{code} {why}".strip())
        self.code = code


MOST, DEEPEST = 10**9, 500  # of a value that a script makes: its size, and how deep it is nested


def sized(value: Any) -> Any:
    """A value that the script made, unless it is too large or too deep."""
    if isinstance(value, str):
        if len(value.encode("utf-8", "surrogatepass")) > MOST:
            raise Failure("X014", "a text")
    elif isinstance(value, (list, dict)):
        size, depth = measure(value)
        if size > MOST and count(value) > 16:
            raise Failure("X014", "a list or dict")
        if depth > DEEPEST:
            raise Failure("X004", "nested too deeply")
    return value


def measure(value: Any) -> tuple[int, int]:
    """The size and the depth of a list or dict: 8 for each value inside, 1 for each character of a text inside."""
    size = depth = 0
    for item in value if isinstance(value, list) else [*value, *value.values()]:
        size += 8
        if isinstance(item, str):
            size += len(item)
        elif isinstance(item, (list, dict)):
            more, below = measure(item)
            size, depth = size + more, max(depth, below)
    return size, depth + 1


def count(value: Any) -> int:
    """The number of values in a list or dict, at any depth."""
    items = value if isinstance(value, list) else [*value, *value.values()]
    return len(items) + sum(count(item) for item in items if isinstance(item, (list, dict)))


def fresh(value: Any) -> Any:
    """A deep copy; opaque objects are never copied."""
    if isinstance(value, list):
        return [fresh(item) for item in value]
    if isinstance(value, dict):
        return {key: fresh(item) for key, item in value.items()}
    return value


def incoming(value: Any) -> Any:
    """A value that comes from Python, as a value of the language.

    Tuples, sets (sorted) and NumPy arrays become lists, NumPy scalars become numbers; values that the
    language does not have fail with X004. What is already a value of the language is copied.
    """
    if isinstance(value, (np.ndarray, np.generic)):
        return incoming(value.tolist())
    if isinstance(value, (list, tuple)):
        return [incoming(item) for item in value]
    if isinstance(value, (set, frozenset)):
        return in_order([incoming(item) for item in value])
    if isinstance(value, dict):
        return {key: incoming(item) for key, item in value.items()}
    return checked(value)


def in_order(items: list[Any]) -> list[Any]:
    """The members of a set, sorted; members that have no order among each other by their kinds and their texts."""
    try:
        return sorted(items)
    except TypeError:
        return sorted(items, key=lambda item: (type(item).__name__, repr(item)))


def checked(value: Any) -> Any:
    """The value itself, unless it is a number that the language does not have."""
    if isinstance(value, float) and not math.isfinite(value):
        raise Failure("X004", "not a finite number")
    if isinstance(value, complex):
        raise Failure("X004", "a complex number")
    if isinstance(value, int) and not INT_MIN <= value <= INT_MAX:
        raise Failure("X004", "an integer beyond 64 bits")
    return value


def is_number(value: Any) -> bool:
    return isinstance(value, (int, float))


# Equality


def equal(left: Any, right: Any) -> bool:
    """Python's equality, down into lists and dicts; opaque objects by `==` where hashable, else by identity."""
    if isinstance(left, list) or isinstance(right, list):
        if not (isinstance(left, list) and isinstance(right, list)) or len(left) != len(right):
            return False
        return all(equal(a, b) for a, b in zip(left, right, strict=True))
    if isinstance(left, dict) or isinstance(right, dict):
        if not (isinstance(left, dict) and isinstance(right, dict)) or left.keys() != right.keys():
            return False
        return all(equal(left[key], right[key]) for key in left)
    if is_hashable(left) and is_hashable(right):
        return bool(left == right)
    return left is right


def is_hashable(value: Any) -> bool:
    try:
        hash(value)
    except TypeError:
        return False
    return True


def frozen(value: Any) -> Hashable:
    """A hashable stand-in: two values are equal in the language exactly when their stand-ins are equal in Python."""
    if isinstance(value, list):
        return tuple(frozen(item) for item in value)
    if isinstance(value, dict):
        return frozenset((key, frozen(item)) for key, item in value.items())
    if is_hashable(value):
        return value  # type: ignore[no-any-return]
    return ("object", id(value))


# Order


def compare(left: Any, right: Any) -> int:
    """-1, 0 or 1 within numbers, within strings and within lists; anything else fails with X001."""
    same_kind = (is_number(left) and is_number(right)) or (isinstance(left, str) and isinstance(right, str))
    if same_kind:
        return int(left > right) - int(left < right)
    if isinstance(left, list) and isinstance(right, list):
        for a, b in zip(left, right, strict=False):
            if not equal(a, b):
                return compare(a, b)
        return compare(len(left), len(right))
    if are_times(left, right):
        return int(left > right) - int(left < right)
    raise Failure("X001", f"no order between {left!r} and {right!r}")


def are_times(left: Any, right: Any) -> bool:
    """Two days, two times of day, or two spans of time."""
    return type(left) is type(right) and isinstance(left, (datetime.date, datetime.timedelta))


def compare_keys(left: Any, right: Any) -> int:
    """The order of ORDER BY: None is least, everything else as `compare`."""
    if left is None or right is None:
        return (left is not None) - (right is not None)
    return compare(left, right)


# Operators


def add(left: Any, right: Any) -> Any:
    if isinstance(left, str) and isinstance(right, str):
        return left + right
    if isinstance(left, list) and isinstance(right, list):
        return left + right
    return arithmetic(lambda a, b: a + b, left, right)


def arithmetic(operation: Callable[[Any, Any], Any], left: Any, right: Any) -> Any:
    """Python's arithmetic on numbers, with the errors of the language."""
    times = (datetime.date, datetime.timedelta)
    if isinstance(left, times) and isinstance(right, times):
        try:
            return operation(left, right)
        except TypeError as error:
            raise Failure("X001") from error
    if not (is_number(left) and is_number(right)):
        raise Failure("X001", f"no arithmetic on {left!r} and {right!r}")
    try:
        return checked(operation(left, right))
    except ZeroDivisionError as error:
        raise Failure("X002") from error
    except OverflowError as error:
        raise Failure("X004") from error


def power(left: Any, right: Any) -> Any:
    huge = isinstance(left, int) and isinstance(right, int) and abs(left) >= 2 and right > 64
    if huge:
        raise Failure("X004", "an integer beyond 64 bits")
    return arithmetic(lambda a, b: a**b, left, right)


def negative(value: Any) -> Any:
    if not is_number(value):
        raise Failure("X001", f"no negative of {value!r}")
    return checked(-value)


def contains(item: Any, container: Any) -> bool:
    """`item IN container`: members of a list, keys of a dict, parts of a string."""
    if isinstance(container, (list, dict)):
        return any(equal(item, member) for member in container)
    if isinstance(container, str) and isinstance(item, str):
        return item in container
    raise Failure("X001", f"{item!r} cannot be in {container!r}")


def like(text: Any, pattern: Any) -> bool:
    """LIKE, one character after the other; `reached` holds how much of the text may be used up by then."""
    if not isinstance(text, str) or not isinstance(pattern, str):
        raise Failure("X001", "LIKE compares strings")
    reached = {0}
    for char in pattern:
        if char == "%":
            reached = set(range(min(reached), len(text) + 1)) if reached else set()
        else:
            reached = {at + 1 for at in reached if at < len(text) and char in ("_", text[at])}
    return len(text) in reached


OPERATORS: dict[str, Callable[..., Any]] = {
    "add": add, "sub": lambda a, b: arithmetic(lambda x, y: x - y, a, b),
    "mul": lambda a, b: arithmetic(lambda x, y: x * y, a, b), "div": lambda a, b: arithmetic(lambda x, y: x / y, a, b),
    "mod": lambda a, b: arithmetic(lambda x, y: x % y, a, b), "pow": power, "neg": negative,
    "lt": lambda a, b: compare(a, b) < 0, "le": lambda a, b: compare(a, b) <= 0, "eq": equal,
    "ne": lambda a, b: not equal(a, b), "ge": lambda a, b: compare(a, b) >= 0, "gt": lambda a, b: compare(a, b) > 0,
    "in": contains, "like": like,
}  # fmt: skip


def item_at(value: Any, index: Any) -> Any:
    """`value[index]` of a list, a string or a dict."""
    if isinstance(value, dict):
        for key, item in value.items():
            if equal(key, index):
                return item
        raise Failure("X003", f"no key {index!r}")
    if not isinstance(value, (list, str)) or not isinstance(index, int):
        raise Failure("X001", f"{value!r} has no item {index!r}")
    if not -len(value) <= index < len(value):
        raise Failure("X003", f"no item {index}")
    return value[index]


def slice_of(value: Any, lower: Any, upper: Any) -> Any:
    """`value[lower:upper]` of a list or a string; a bound that is not written is None."""
    bounds_fit = all(bound is None or isinstance(bound, int) for bound in (lower, upper))
    if not isinstance(value, (list, str)) or not bounds_fit:
        raise Failure("X001", f"no slice of {value!r}")
    return value[lower:upper]


# Representations


def hashable(value: Any) -> Any:
    """The value as a member of a Python set or a key of a dict: lists, also inner ones, become tuples."""
    if isinstance(value, list):
        return tuple(hashable(item) for item in value)
    if isinstance(value, dict):
        return tuple((key, hashable(item)) for key, item in value.items())
    return value


def member(value: Any) -> Any:
    """The value as a member of a Python set; neither a dict nor an object without a hash can be one."""
    if isinstance(value, list):
        return tuple(member(item) for item in value)
    try:
        hash(value)
    except TypeError as error:
        raise Failure("V001", repr(value)) from error
    return value


Row = list[tuple[str, Any]]  # the columns of one row by name, in the order of SELECT


def shape(representation: str, rows: Sequence[Row]) -> Any:
    """The rows in the representation that AS asks for."""
    match representation:
        case "dict":
            return [dict(row) for row in rows]
        case "list":
            return [value for row in rows for _, value in row]
        case "rows":
            return [tuple(value for _, value in row) for row in rows]
        case "value" | "val":
            return rows[0][0][1] if rows else None
        case "set":
            return {member(value) for row in rows for _, value in row}
        case "void":
            return None
        case _:
            raise Failure("R006", representation)

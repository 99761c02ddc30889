"""The values of the language: truth, copies, equality as hash keys, and their order.

A value is None, a bool, an int of 64 bits, a finite float, a string, a list, a dict, or an opaque object.
Python's `==` on values is the language's equality: whatever `==` would not answer is wrapped as `Opaque`.
Nobody changes a value in place. `convert_value` (conversion.py) makes values of what Python gives, `copy_deep` copies
values that Python code may still change, `copy_for_python` makes copies that Python code may change.

A frozen value is hashable, and equal to another one where the language says that the values are equal; `thaw_value`
gives the value back as it was. A list is a tuple of frozen values, a scalar and an object are themselves, a dict is
wrapped. The garbage collector soon leaves tuples of scalars alone, where it would walk through lists for ever.

    >>> freeze_any([[3, 2.0], [], "x"])
    ((3, 2.0), (), 'x')
    >>> thaw_value(freeze_any([[3, 2.0], [], "x"]))
    [[3, 2.0], [], 'x']

A value that comes back with every step has a `Shape`, guessed from what START WITH gives: `flat` is a list of scalars,
`nested` a list of such lists. A value of that shape is frozen and thawed without a call in Python. Every other value of
its place is wrapped, so a tuple there is proof of the shape.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Sequence
from datetime import date, datetime, timedelta
from heapq import nlargest, nsmallest
from marshal import dumps, loads
from types import NoneType
from typing import Any, Literal, TypeAlias, TypeVar

from ss2sql.errors import ExecutionError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.cancellation import deepen_stack, iterate_checked, make_checked_order
from ss2sql.language.conversion import DEPTH_LIMIT, UnreadableText
from ss2sql.language.conversion import SCALARS as SCALARS
from ss2sql.language.conversion import build_depth_error as build_depth_error
from ss2sql.language.conversion import check_arithmetic as check_arithmetic
from ss2sql.language.conversion import convert_value as convert_value
from ss2sql.language.conversion import format_value as format_value
from ss2sql.language.kinds import INT_MIN, SCALAR, Kind, Type
from ss2sql.language.kinds import Opaque as Opaque

# --- the values of the language: truth, copies, equality as hash keys, and how searches in Python freeze them
WRAPPED_TYPES = frozenset({Opaque, UnreadableText})


def get_truth(value: Any) -> bool:
    """Python's truth; an opaque object that refuses to tell its own, as a data frame does, counts as true."""
    try:
        return bool(value)
    except Exception:
        return True


# --- copies --------------------------------------------------------------------------------------------


def copy_for_python(value: Any) -> Any:
    """A deep copy that Python code may keep and change; opaque objects are the same objects, unwrapped.

    There may be tuples in it, which are rows. A round trip through marshal takes 0.28 us for [[3, 2, 1], [], []], a
    recursive copy 0.89 us.
    """
    kind = type(value)
    if kind is list or kind is dict:
        try:
            return loads(dumps(value, 2))
        except ValueError:  # there are objects inside
            return _unwrap_object_values(value)
    return value.object if kind in WRAPPED_TYPES else value


def copy_deep(value: Any) -> Any:
    """A deep copy of a value of the language for as long as it is needed, whatever becomes of the original.

    What the original shares the copy shares, too, so it takes no more memory: `l = [l, l]`, forty times. There may be
    tuples in it, which are rows.
    """
    kind = type(value)
    if kind is not list and kind is not dict:
        return value
    try:
        return loads(dumps(value, 4))
    except ValueError:  # there are objects inside
        return _copy_nested(value, {})


def _copy_nested(value: Any, known: dict[int, Any]) -> Any:
    kind = type(value)
    if kind not in (list, dict, tuple):
        return value
    if id(value) not in known:
        parts = [_copy_nested(part, known) for part in (value.values() if kind is dict else value)]
        known[id(value)] = dict(zip(value, parts, strict=True)) if kind is dict else kind(parts)
    return known[id(value)]


def _unwrap_object_values(value: Any) -> Any:
    kind = type(value)
    if kind is list or kind is tuple:
        return kind(map(_unwrap_object_values, value))
    if kind is dict:
        return dict(zip(map(_unwrap_object_values, value), map(_unwrap_object_values, value.values()), strict=True))
    return value.object if kind in WRAPPED_TYPES else value


def make_dict_key(value: Any) -> Any:
    """A value as a key of a dict, where a list is a tuple."""
    return tuple(map(make_dict_key, value)) if type(value) is list else value


def has_dict_key(container: dict[Any, Any], key: Any) -> bool:
    try:
        return key in container
    except TypeError:  # a dict is no key
        return False


# --- equality as hash keys -----------------------------------------------------------------------------

TOO_LARGE = float(-INT_MIN)  # for an integer of the language

# Finds the letters that marshal writes before a float, True, False and a dict: where there are none, only
# equal values have equal bytes. They also occur by chance, inside of numbers and text: that costs time only.
find_several_forms = re.compile(rb"[gTF{]").search


def make_hashable(value: Any) -> Hashable:
    """A hashable stand-in: equal values have equal ones, different values different ones.

    Lists without dicts and objects become bytes, because bytes are quick to make and to hash; other lists
    become tuples, dicts frozensets.
    """
    kind = type(value)
    if kind in SCALARS:
        return value  # type: ignore[no-any-return]
    if kind is list:
        try:
            return _retry_with_stack(_encode_value_list, value)  # type: ignore[no-any-return]
        except ValueError:
            return list, *map(make_hashable, value)
        except RecursionError:
            raise build_depth_error("cannot compare") from None
    if kind is dict:
        return frozenset(zip(value, map(make_hashable, value.values()), strict=True))
    if kind is bytes:
        return bytes, value
    return value  # type: ignore[no-any-return]


def _encode_value_list(value: list[Any]) -> bytes:
    """The bytes of a list, the same for equal lists. ValueError: there are dicts or objects inside."""
    marshalled = dumps(value, 2)
    return dumps(_unify_numbers(value), 2) if find_several_forms(marshalled) else marshalled


def _unify_numbers(value: Any) -> Any:
    """The value with equal numbers in one form, integers where possible. ValueError: it is more than a list."""
    kind = type(value)
    if kind is float:
        return int(value) if value.is_integer() and -TOO_LARGE <= value < TOO_LARGE else value
    if kind is bool:
        return int(value)
    if kind is list:
        # A call for each part would take three times as long.
        return [
            part
            if type(part) is int
            else (int(part) if part.is_integer() and -TOO_LARGE <= part < TOO_LARGE else part)
            if type(part) is float
            else _unify_numbers(part)
            for part in iterate_checked(value)
        ]
    if kind in SCALARS or kind is bytes:
        return value
    raise ValueError


# --- frozen values: what the states and rows of a search in Python are made of
Shape: TypeAlias = Literal["scalar", "flat", "nested", "any"]
State: TypeAlias = tuple[Any, ...]  # of the frozen values of the START WITH variables, or of the values
FrozenRow: TypeAlias = tuple[Any, ...]
Row: TypeAlias = tuple[Any, ...]
Thaw: TypeAlias = Callable[[Sequence[FrozenRow]], tuple[Row, ...]]

UNSET = object()  # in place of a value that is not evaluated yet


class Frozen:
    """A frozen value that is no tuple: a dict, or a list that has not the shape of its place."""

    __slots__ = ("key", "value")

    def __init__(self, value: Any, key: Hashable) -> None:
        self.value, self.key = value, key

    def __hash__(self) -> int:
        return hash(self.key)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Frozen) and bool(self.key == other.key)


def freeze_any(value: Any) -> Any:
    """The frozen value of any shape."""
    return _retry_with_stack(_freeze_deep, value)


def _freeze_deep(value: Any) -> Any:
    kind = type(value)
    if kind is list:
        return tuple([item if type(item) in SCALARS else _freeze_deep(item) for item in value])
    if kind is dict:
        return Frozen(value, frozenset(zip(value, map(_freeze_deep, value.values()), strict=True)))
    return value


def thaw_value(value: Any) -> Any:
    """The value that was frozen."""
    return _retry_with_stack(_thaw_deep, value)


def _thaw_deep(value: Any) -> Any:
    kind = type(value)
    if kind is tuple:
        return [item if type(item) in SCALARS else _thaw_deep(item) for item in value]
    return value.value if kind is Frozen else value


def _retry_with_stack(work: Callable[[Any], Any], value: Any) -> Any:
    """The work on a value, begun afresh with room where it is nested too deeply for Python's usual stack."""
    try:
        return work(value)
    except RecursionError:
        with deepen_stack(DEPTH_LIMIT // 10):  # two frames for a level
            return work(value)


def freeze_flat(value: Any) -> Any:
    """The frozen value of a place whose shape is `flat`."""
    if type(value) is list:
        return tuple(value) if SCALARS.issuperset(map(type, value)) else Frozen(value, freeze_any(value))
    return freeze_any(value)


def freeze_nested(value: Any) -> Any:
    """The frozen value of a place whose shape is `nested`."""
    if type(value) is not list:
        return freeze_any(value)
    if all(type(part) is list and SCALARS.issuperset(map(type, part)) for part in value):
        return tuple(map(tuple, value))
    return Frozen(value, freeze_any(value))


def thaw_nested(value: Any) -> Any:
    """The value of a place whose shape is `nested`: in a quarter of the time."""
    return list(map(list, value)) if type(value) is tuple else thaw_value(value)


THAWERS: dict[Shape, Callable[[Any], Any]] = {
    "scalar": thaw_value,
    "any": thaw_value,
    "flat": thaw_value,
    "nested": thaw_nested,
}
FREEZERS: dict[Shape, Callable[[Any], Any]] = {
    "scalar": freeze_any,
    "any": freeze_any,
    "flat": freeze_flat,
    "nested": freeze_nested,
}


def choose_frozen_shape(known: Type) -> Shape:
    """The shape that values of this type have, or most of them."""
    if known.is_only(SCALAR):
        return "scalar"
    if is_flat_list_type(known):
        return "flat"
    return (
        "nested"
        if known.is_only(Kind.LIST) and known.element is not None and is_flat_list_type(known.element)
        else "any"
    )


def is_flat_list_type(known: Type) -> bool:
    """Whether values of this type are lists of scalars."""
    return known.is_only(Kind.LIST) and known.element is not None and known.element.is_only(SCALAR)


def convert_and_freeze(value: Any, giver: str, freezer: Callable[[Any], Any]) -> tuple[Any, Any]:
    """The value of the language for what a function gave, and its frozen value."""
    value = convert_value(value, f"the function '{giver}'")
    return value, freezer(value)


@dataclass(frozen=True, slots=True)
class FrozenShapes:
    """How the START WITH variables of a search are frozen, and the columns of its rows."""

    states: tuple[Shape, ...]
    columns: tuple[Shape, ...]

    def freeze_state(self, state: State) -> State:
        """The frozen state."""
        return tuple([FREEZERS[shape](value) for shape, value in zip(self.states, state, strict=True)])

    def thaw_state(self, state: State) -> State:
        """The values of a frozen state."""
        return tuple(map(thaw_value, state))

    def make_row_thaw(self) -> Thaw | None:
        """What makes the rows of paths of frozen ones; None where they are the same."""
        return None if all(shape == "scalar" for shape in self.columns) else _thaw_rows


def _thaw_rows(path: Sequence[FrozenRow]) -> tuple[Row, ...]:
    return _retry_with_stack(_thaw_rows_deep, path)  # type: ignore[no-any-return]


def _thaw_rows_deep(path: Sequence[FrozenRow]) -> tuple[Row, ...]:
    return tuple([tuple([value if type(value) in SCALARS else _thaw_deep(value) for value in row]) for row in path])


# --- the order of values: Python's within numbers, strings, lists, and times; anything else is an error
NUMBERS = frozenset({int, float, bool})

_Row = TypeVar("_Row")


def compare_values(left: Any, right: Any, symbol: str = "and") -> int:
    """-1, 0 or 1 as `left` stands before, with or after `right`.

    Args:
        symbol: what the error writes between the values: an operator, or `and`.

    Raises:
        ExecutionError: X001 where the values have no order.
    """
    left, right = find_ordering_pair(left, right, symbol)
    return int(left > right) - int(left < right)


def find_ordering_pair(left: Any, right: Any, symbol: str) -> tuple[Any, Any]:
    """Two numbers or two strings that are ordered as the values are: of lists, the first elements that differ."""
    first, second = left, right
    while True:
        kind, other = type(first), type(second)
        if (kind in NUMBERS and other in NUMBERS) or (kind is str and other is str):
            return first, second
        if _are_times(first, second):
            return first, second
        if kind is not list or other is not list:
            raise _build_order_error(left, right, first, second, symbol)
        for a, b in zip(first, second, strict=False):
            if a is not b and a != b:
                first, second = a, b
                break
        else:
            return len(first), len(second)


def _are_times(first: Any, second: Any) -> bool:
    """Two days, two times, both with or without a zone, or two spans of time."""
    if isinstance(first, datetime) and isinstance(second, datetime):
        return (first.utcoffset() is None) == (second.utcoffset() is None)
    days = isinstance(first, date) and isinstance(second, date)
    plain = not isinstance(first, datetime) and not isinstance(second, datetime)
    return (days and plain) or (isinstance(first, timedelta) and isinstance(second, timedelta))


def _build_order_error(left: Any, right: Any, first: Any, second: Any, symbol: str) -> ExecutionError:
    """The error for `first` and `second`, which decide the order of `left` and `right`."""
    verb = "order" if symbol == "and" else "compare"
    message = f"cannot {verb} {format_value(left)} {symbol} {format_value(right)}"
    if first is not left:
        message += f", because of {format_value(first)} and {format_value(second)}"
    kinds = {type(first), type(second)}
    if NoneType in kinds:
        hint = _suggest_none_cure(first, second, symbol)
    elif str in kinds and kinds & NUMBERS:
        hint = "make both of one kind with int(...), float(...) or str(...)"
    elif timedelta in kinds and kinds & NUMBERS:
        duration = first if type(first) is timedelta else second
        hint = f"durations in data are numbers of seconds: write {duration.total_seconds()} for this timedelta"
    elif any(issubclass(kind, date) for kind in kinds):
        hint = "date('2024-05-31') makes a date of a text, datetime('2024-05-31') a time; date(x) is the day of a time"
    elif kinds == {dict} or are_rows(left) or are_rows(right):
        hint = (
            "rows have no order of their own: write ORDER BY, or SELECT ... AS list for a column, AS value for a value"
        )
    else:
        hint = "numbers have an order among themselves, and so have strings and lists; == and != work on everything"
    return ExecutionError("X001", message, hints=(hint,))


def are_rows(value: Any) -> bool:
    """Whether it is a list of dicts, as a query without AS gives it."""
    return type(value) is list and bool(value) and type(value[0]) is dict


NONE_HINT = "None has no order: ask for it first, as in"


def _suggest_none_cure(left: Any, right: Any, symbol: str) -> str:
    """What to write so that None is not compared."""
    if symbol == "and":
        return "None has no order: leave it out, for example with WHERE x != None"
    sides = [name if value is None else format_value(value, 20) for value, name in ((left, "x"), (right, "y"))]
    return f"{NONE_HINT} {'x' if left is None else 'y'} != None AND {sides[0]} {symbol} {sides[1]}"


def sort_values(values: Sequence[Any], descending: bool = False) -> list[Any]:
    """The values in their order, equal ones in the order in which they came, also when `descending`.

    Raises:
        ExecutionError: X001 where two of them have no order, None included.
    """
    key = None if _can_python_order_types(set(map(type, values))) else make_checked_order(compare_values)
    return sorted(values, key=key, reverse=descending)


def order_rows(rows: Sequence[_Row], keys: Sequence[Sequence[Any]], descending: Sequence[bool]) -> list[_Row]:
    """The rows sorted by their keys, as ORDER BY does it; rows with equal keys stay in their order.

    Args:
        rows: what is to be sorted.
        keys: for each row the values of its keys, the first counts most.
        descending: for each key whether its greatest value comes first.

    Returns:
        A new list. None is the least of all values.

    Raises:
        ExecutionError: X001 where two values that decide have no order.
    """
    columns = [[key[position] for key in keys] for position in range(len(descending))]
    return [rows[index] for index in order_positions(len(rows), columns, descending)]


def order_positions(
    count: int, columns: Sequence[Sequence[Any]], descending: Sequence[bool], limit: int | None = None
) -> list[int]:
    """The places of `count` rows in the order of `order_rows`, given the columns of their keys.

    With a `limit` there may be fewer, but not less than that: the first of 10,000 takes a quarter of the time of all.
    """
    if (
        limit is not None
        and len(columns) == 1
        and 0 < limit * 8 <= count
        and _can_python_order_types(set(map(type, columns[0])))
    ):
        if limit == 1:
            return [columns[0].index((max if descending[0] else min)(columns[0]))]
        return (nlargest if descending[0] else nsmallest)(limit, range(count), columns[0].__getitem__)
    order = list(range(count))
    if not all(_can_python_order_types(set(map(type, column)) - {NoneType}) for column in columns):
        order.sort(key=make_checked_order(_compare_sort_values(columns, descending)))
        return order
    for column, reverse in zip(reversed(columns), reversed(descending), strict=True):
        values = [(value is not None, value) for value in column] if None in column else column
        order.sort(key=values.__getitem__, reverse=reverse)
    return order


def _compare_sort_values(columns: Sequence[Sequence[Any]], descending: Sequence[bool]) -> Callable[[int, int], int]:
    """What compares two rows, given by their places. A key is compared only where those before it are equal."""

    def compare_keys(one: int, other: int) -> int:
        for column, reverse in zip(columns, descending, strict=True):
            left, right = column[one], column[other]
            if left is None or right is None:
                sign = int(left is not None) - int(right is not None)
            else:
                sign = compare_values(left, right)
            if sign:
                return -sign if reverse else sign
        return 0

    return compare_keys


def _can_python_order_types(kinds: set[type]) -> bool:
    """Whether Python's own order of values of these types is the language's."""
    return kinds <= NUMBERS or kinds == {str}


def is_overestimate(guess: Any, total: Any) -> bool:
    """Whether A* expected more of a path than it costs, by more than sums are rounded."""
    return bool(guess > total + 1e-9 * max(1, abs(total)))

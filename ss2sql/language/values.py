"""The values of the language: truth, copies, equality as hash keys.

A value is None, a bool, an int of 64 bits, a finite float, a string, a list, a dict, or an opaque object.
Python's `==` on values is the language's equality: whatever `==` would not answer is wrapped as `Opaque`.
Nobody changes a value in place. `convert_value` (conversion.py) makes values of what Python gives, `copy_deep` copies
values that Python code may still change, `copy_for_python` makes copies that Python code may change.
"""

from __future__ import annotations

import re
from collections.abc import Hashable, Sequence
from marshal import dumps, loads
from typing import Any

from ss2sql.language.cancellation import iterate_checked
from ss2sql.language.conversion import SCALARS as SCALARS
from ss2sql.language.conversion import convert_value as convert_value
from ss2sql.language.kinds import INT_MIN
from ss2sql.language.kinds import Opaque as Opaque
from ss2sql.language.ordering import NUMBERS as NUMBERS
from ss2sql.language.ordering import compare_values as compare_values
from ss2sql.language.ordering import sort_positions as sort_positions
from ss2sql.language.ordering import sort_rows as sort_rows
from ss2sql.language.value_messages import DEPTH_LIMIT, UnreadableText
from ss2sql.language.value_messages import build_depth_error as build_depth_error
from ss2sql.language.value_messages import check_arithmetic as check_arithmetic
from ss2sql.language.value_messages import format_value as format_value

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

    A round trip through marshal takes 0.28 us for [[3, 2, 1], [], []], a recursive copy 0.89 us.
    """
    kind = type(value)
    if kind is list or kind is dict:
        try:
            return loads(dumps(value, 2))
        except ValueError:  # there are objects inside
            return _unwrap_objects(value)
    return value.object if kind in WRAPPED_TYPES else value


def copy_rows_for_python(rows: Sequence[Sequence[Any]]) -> list[tuple[Any, ...]]:
    """Such copies of all values of some rows: together, for nine rows of a list that takes 3 us, one by one 7."""
    try:
        return loads(dumps(list(map(tuple, rows)), 2))  # type: ignore[no-any-return]
    except ValueError:  # there are objects inside
        return [tuple(map(copy_for_python, row)) for row in rows]


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


def _unwrap_objects(value: Any) -> Any:
    kind = type(value)
    if kind is list:
        return list(map(_unwrap_objects, value))
    if kind is dict:
        return dict(zip(map(_unwrap_objects, value), map(_unwrap_objects, value.values()), strict=True))
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
            return _encode_list(value)
        except ValueError:
            return list, *map(make_hashable, value)
        except RecursionError:
            return _encode_deep_list(value)
    if kind is dict:
        return frozenset(zip(value, map(make_hashable, value.values()), strict=True))
    if kind is bytes:
        return bytes, value
    return value  # type: ignore[no-any-return]


class ListForm(bytes):
    """The bytes of a list which was written in another form than its own, with 1 in place of 1.0."""

    __slots__ = ()


def encode_list_form(value: list[Any]) -> ListForm:
    """What `make_hashable` gives for a list of numbers, text, None, and lists of such."""
    return ListForm(dumps(_unify_numbers(value), 2))


def _encode_deep_list(value: list[Any]) -> bytes:
    """The same of a list that is nested too deeply for Python's usual stack."""
    from ss2sql.language.recursion_limit import deepen_stack  # rarely needed, and the package imports this module

    try:
        with deepen_stack(DEPTH_LIMIT // 20):  # two frames for a level, most of which the usual stack has
            return _encode_list(value)
    except RecursionError:
        raise build_depth_error("cannot compare") from None


def _encode_list(value: list[Any]) -> bytes:
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

"""The values of the language: truth, copies, equality as hash keys. Their border and order have files of their own.

A value is None, a bool, an int of 64 bits, a finite float, a string, a list, a dict, or an opaque object.
Python's `==` on values is the language's equality: whatever `==` would not answer is wrapped as `Opaque`.
Nobody changes a value in place. `normalise` makes values of what Python hands over, `kept` makes copies of those that
Python code may still change, `fresh` makes copies that Python code may change.
"""

from __future__ import annotations

import re
from collections.abc import Hashable, Sequence
from marshal import dumps, loads
from typing import Any

from ss2sql.kinds import INT_MIN
from ss2sql.kinds import Opaque as Opaque
from ss2sql.runtime.border import SCALARS as SCALARS
from ss2sql.runtime.border import normalise as normalise
from ss2sql.runtime.checking import watched
from ss2sql.runtime.messages import DEPTH_LIMIT
from ss2sql.runtime.messages import check as check
from ss2sql.runtime.messages import show as show
from ss2sql.runtime.messages import too_deep as too_deep
from ss2sql.runtime.ordering import NUMBERS as NUMBERS
from ss2sql.runtime.ordering import compare as compare
from ss2sql.runtime.ordering import places_in_order as places_in_order
from ss2sql.runtime.ordering import sort_rows as sort_rows
from ss2sql.runtime.unreadable import UnreadableText

WRAPPED = frozenset({Opaque, UnreadableText})


def truth(value: Any) -> bool:
    """Python's truth; an opaque object that refuses to tell its own, as a data frame does, counts as true."""
    try:
        return bool(value)
    except Exception:
        return True


# --- copies --------------------------------------------------------------------------------------------


def fresh(value: Any) -> Any:
    """A deep copy that Python code may keep and change; opaque objects are the same objects, unwrapped.

    A round trip through marshal takes 0.28 us for [[3, 2, 1], [], []], a recursive copy 0.89 us.
    """
    kind = type(value)
    if kind is list or kind is dict:
        try:
            return loads(dumps(value, 2))
        except ValueError:  # there are objects inside
            return _unwrapped(value)
    return value.object if kind in WRAPPED else value


def fresh_rows(rows: Sequence[Sequence[Any]]) -> list[tuple[Any, ...]]:
    """Such copies of all values of some rows: together, for nine rows of a list that takes 3 us, one by one 7."""
    try:
        return loads(dumps(list(map(tuple, rows)), 2))  # type: ignore[no-any-return]
    except ValueError:  # there are objects inside
        return [tuple(map(fresh, row)) for row in rows]


def kept(value: Any) -> Any:
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
        return _duplicate(value, {})


def _duplicate(value: Any, known: dict[int, Any]) -> Any:
    kind = type(value)
    if kind not in (list, dict, tuple):
        return value
    if id(value) not in known:
        parts = [_duplicate(part, known) for part in (value.values() if kind is dict else value)]
        known[id(value)] = dict(zip(value, parts, strict=True)) if kind is dict else kind(parts)
    return known[id(value)]


def _unwrapped(value: Any) -> Any:
    kind = type(value)
    if kind is list:
        return list(map(_unwrapped, value))
    if kind is dict:
        return dict(zip(map(_unwrapped, value), map(_unwrapped, value.values()), strict=True))
    return value.object if kind in WRAPPED else value


def as_key(value: Any) -> Any:
    """A value as a key of a dict, where a list is a tuple."""
    return tuple(map(as_key, value)) if type(value) is list else value


def is_key(container: dict[Any, Any], key: Any) -> bool:
    try:
        return key in container
    except TypeError:  # a dict is no key
        return False


# --- equality as hash keys -----------------------------------------------------------------------------

TOO_LARGE = float(-INT_MIN)  # for an integer of the language

# Finds the letters that marshal writes before a float, True, False and a dict: where there are none, only
# equal values have equal bytes. They also occur by chance, inside of numbers and text: that costs time only.
several_forms = re.compile(rb"[gTF{]").search


def freeze(value: Any) -> Hashable:
    """A hashable stand-in: equal values have equal ones, different values different ones.

    Lists without dicts and objects become bytes, because bytes are quick to make and to hash; other lists
    become tuples, dicts frozensets.
    """
    kind = type(value)
    if kind in SCALARS:
        return value  # type: ignore[no-any-return]
    if kind is list:
        try:
            return _list_bytes(value)
        except ValueError:
            return list, *map(freeze, value)
        except RecursionError:
            return _deep_list_bytes(value)
    if kind is dict:
        return frozenset(zip(value, map(freeze, value.values()), strict=True))
    if kind is bytes:
        return bytes, value
    return value  # type: ignore[no-any-return]


class Form(bytes):
    """The bytes of a list which was written in another form than its own, with 1 in place of 1.0."""

    __slots__ = ()


def form_of(value: list[Any]) -> Form:
    """What `freeze` gives for a list of numbers, text, None, and lists of such."""
    return Form(dumps(_one_form(value), 2))


def _deep_list_bytes(value: list[Any]) -> bytes:
    """The same of a list that is nested too deeply for Python's usual stack."""
    from ss2sql.runtime.native.deep import deep  # rarely needed, and the package imports this module

    try:
        with deep(DEPTH_LIMIT // 20):  # two frames for a level, most of which the usual stack has
            return _list_bytes(value)
    except RecursionError:
        raise too_deep("cannot compare") from None


def _list_bytes(value: list[Any]) -> bytes:
    """The bytes of a list, the same for equal lists. ValueError: there are dicts or objects inside."""
    marshalled = dumps(value, 2)
    return dumps(_one_form(value), 2) if several_forms(marshalled) else marshalled


def _one_form(value: Any) -> Any:
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
            else _one_form(part)
            for part in watched(value)
        ]
    if kind in SCALARS or kind is bytes:
        return value
    raise ValueError

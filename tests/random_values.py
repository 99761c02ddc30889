"""Values of the language, random and chosen ones, and what it means that two values are exactly the same."""

from __future__ import annotations

import enum
import math
import types
from array import array
from collections import Counter, OrderedDict, defaultdict, deque, namedtuple
from decimal import Decimal
from typing import Any

import numpy as np
from hypothesis import strategies as st

from ss2sql.language.kinds import INT_MAX, INT_MIN, Opaque
from ss2sql.language.values import format_value

INTEGERS = st.one_of(
    st.integers(-3, 12),
    st.sampled_from(
        [INT_MIN, INT_MIN + 1, -(2**53) - 1, 2**31, 2**53 - 1, 2**53, 2**53 + 1, 2**53 + 3, INT_MAX - 1, INT_MAX]
    ),
    st.sampled_from([70, 71, 84, 103, 108, 115, 123, 40]),  # letters that marshal uses
    st.integers(INT_MIN, INT_MAX),
)
FLOATS = st.one_of(
    st.sampled_from([0.0, -0.0, 0.1, 0.5, -0.5, 1.0, 2.0, 2.5, -8.0, 1e15, 2.0**53, 2.0**63, -(2.0**63)]),
    st.sampled_from([5e-324, -5e-324, 1e-308, 1e300, -1e300, 1.7976931348623157e308, -1.7976931348623157e308]),
    st.integers(-5, 5).map(float),
    st.floats(allow_nan=False, allow_infinity=False),
)
NUMBERS = st.one_of(st.booleans(), INTEGERS, FLOATS)
TEXTS = st.one_of(st.sampled_from(["", "a", "b", "gTF{ls(", "7", "1.5", "nan", "\ud800", "ä\0"]), st.text(max_size=4))
SCALARS = st.one_of(st.none(), NUMBERS, TEXTS)


def label(value: Any) -> str:
    """The name of a test case: equal in every process, so without addresses and without the order of a set."""
    if isinstance(value, set | frozenset):
        return f"{type(value).__name__} of {', '.join(sorted(map(label, value)))}"
    return format_value(value, 30).partition(" at 0x")[0]


class Thing:
    """An opaque object without anything of its own."""

    def __repr__(self) -> str:
        return "Thing"


class Unhashable:
    """An object that says it equals everything, and cannot be hashed."""

    __hash__ = None  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        return True


ONE, TENTH = (Opaque(number, key=number) for number in (Decimal(1), Decimal("0.1")))
THINGS = [Thing(), Thing(), ONE, TENTH, Opaque(Unhashable()), Opaque(Unhashable()), b"a", b"gs("]
OBJECTS = st.sampled_from(THINGS)
KEYS = st.one_of(st.sampled_from(["a", "b", "c"]), st.integers(0, 2), st.just((1, "a")), st.just(1.0), st.just(True))


def values(leaves: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    """Lists and dicts, three levels deep, of the given leaves."""
    return st.recursive(
        leaves,
        lambda inner: st.one_of(st.lists(inner, max_size=3), st.dictionaries(KEYS, inner, max_size=3)),
        max_leaves=8,
    )


def lists(leaves: st.SearchStrategy[Any]) -> st.SearchStrategy[Any]:
    """Lists, also nested ones, of the given leaves."""
    return st.lists(st.recursive(leaves, lambda inner: st.lists(inner, max_size=3), max_leaves=8), max_size=4)


VALUES = values(st.one_of(SCALARS, OBJECTS))
# Few different values, so that equal ones meet.
EQUAL_ONES = [None, 0, 1, 2, 0.0, -0.0, 1.0, 2.0, True, False, "a", "1", ONE, b"a", THINGS[4]]
ALIKE = values(st.sampled_from([*EQUAL_ONES, "\ud800", "\ud801", "gTF{\ud800"]))


def same(left: Any, right: Any) -> bool:
    """Whether two values are alike in type, sign of zero and order of keys, and their objects identical."""
    if type(left) is not type(right):
        return False
    if isinstance(left, (list, tuple)):
        return len(left) == len(right) and all(map(same, left, right))
    if isinstance(left, dict):
        return same(list(left.items()), list(right.items()))
    if isinstance(left, float):
        return left == right and math.copysign(1, left) == math.copysign(1, right)
    if isinstance(left, Opaque):
        return left.object is right.object
    if isinstance(left, (int, str, bytes)) or left is None:
        return bool(left == right)
    return left is right


# --- what Python hands over ----------------------------------------------------------------------------


class Level(enum.IntEnum):
    LOW = 3


class Name(enum.StrEnum):
    ANN = "ann"


class Text(str):
    def __str__(self) -> str:
        return "something else"


Point = namedtuple("Point", "x y")


def python_values() -> list[tuple[Any, Any]]:
    """Values of Python, each with the value of the language that it becomes."""
    return [
        ((1, (2, 3)), [1, [2, 3]]), ([(1, 2), (3, 4)], [[1, 2], [3, 4]]), ([1, (2, "a")], [1, [2, "a"]]),
        (Point(1, 2.0), [1, 2.0]), ({3, 1, 2}, [1, 2, 3]), (frozenset({"b", "a"}), ["a", "b"]),
        ({(2, 1), (1, 5)}, [[1, 5], [2, 1]]), ({frozenset({2, 1}), frozenset({0})}, [[0], [1, 2]]),
        ({1, "a", None}, [None, 1, "a"]), (range(3), [0, 1, 2]), ((i * i for i in range(3)), [0, 1, 4]),
        (deque([1, 2]), [1, 2]), (array("d", [1, 2]), [1.0, 2.0]), ({"a": 1}.keys(), ["a"]), ({"a": 1}.values(), [1]),
        ({"a": 1}.items(), [["a", 1]]), (np.array([[1, 2], [3, 4]]), [[1, 2], [3, 4]]),
        (np.array([1.5, 2]), [1.5, 2.0]), (np.array([True, False]), [True, False]),
        (np.array(["a", "bc"]), ["a", "bc"]), (np.array(7), 7), (np.array([], dtype=float), []),
        (np.array([(1, 2)], dtype=object), [[1, 2]]), (np.ma.masked_array([1, 2], mask=[True, False]), [None, 2]),
        ([np.float64(1.5), np.int8(-3)], [1.5, -3]), (np.float64(0.5), 0.5), (np.float32(0.5), 0.5),
        (np.longdouble(0.5), 0.5), (np.int64(7), 7), (np.uint8(255), 255), (np.bool_(True), True), (np.str_("a"), "a"),
        (Level.LOW, 3), (Name.ANN, "ann"), (Text("a"), "a"), (OrderedDict(b=1, a=2), {"b": 1, "a": 2}),
        (defaultdict(list, a=[(1,)]), {"a": [[1]]}), (Counter("aa"), {"a": 2}),
        (types.MappingProxyType({"a": {1}}), {"a": [1]}), ({np.int64(1): 2}, {1: 2}),
        ({(1, np.int64(2)): (3,)}, {(1, 2): [3]}), ({frozenset({2, 1}): 0}, {(1, 2): 0}),
        ({1: 1, "a": None}, {1: 1, "a": None}),
    ]  # fmt: skip


# Values that the language does not have, with what the message says behind "returned".
REFUSED: list[tuple[Any, str]] = [
    (float("nan"), "NaN"), ([[1, 2], [0, 1, float("nan")]], "NaN at [1][2]"), ([1, float("inf")], "inf at [1]"),
    ((float("-inf"),), "-inf at [0]"), (np.array([[0.5, np.nan]]), "NaN at [0][1]"), (np.float32("nan"), "NaN"),
    (np.longdouble("inf"), "inf"), ({"a": [float("nan")]}, "NaN at ['a'][0]"),
    ([{"a": 1}, {"b": {float("nan")}}], "NaN at [1]['b']"), (1j, "the complex number 1j"),
    ([np.complex64(1)], "the complex number (1+0j) at [0]"), (np.clongdouble(1), "the complex number (1+0j)"),
    (np.array([1j]), "the complex number 1j at [0]"), (np.array([np.inf]), "inf at [0]"),
    (np.array([2**63]), "9223372036854775808 at [0], which does not fit into 64 bits"),
    (2**63, "9223372036854775808, which does not fit into 64 bits"),
    ([-(2**63) - 1], "-9223372036854775809 at [0], which does not fit into 64 bits"),
    ([[2**63]], "9223372036854775808 at [0][0], which does not fit into 64 bits"),
    (np.uint64(2**63), "9223372036854775808, which does not fit into 64 bits"),
    (10**6000, "<integer of 19932 bits>, which does not fit into 64 bits"), ({float("nan"): 1}, "NaN at [nan]"),
]  # fmt: skip

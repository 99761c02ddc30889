"""What Python hands over becomes values of the language, or is refused."""

from __future__ import annotations

import datetime
import enum
import pathlib
import subprocess
import sys
import types
from array import array
from collections import Counter, OrderedDict, UserList, defaultdict, deque, namedtuple
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_values import PLAIN_VALUES, SCALARS, VALUES, Thing, Unhashable, label, same

from ss2sql.errors import ExecutionError
from ss2sql.runtime.values import Opaque, compare, freeze, fresh, normalise, show, truth

GIVER = "the function 'f'"


class Colour(enum.Enum):
    RED = 1


class Level(enum.IntEnum):
    LOW = 3


class Name(enum.StrEnum):
    ANN = "ann"


class Text(str):
    def __str__(self) -> str:
        return "something else"


Point = namedtuple("Point", "x y")


def failure(call: Any, *arguments: Any) -> ExecutionError:
    with pytest.raises(ExecutionError) as caught:
        call(*arguments)
    assert caught.value.hints
    assert all(caught.value.hints)
    return caught.value


@pytest.mark.parametrize(
    ("given_value", "expected"),
    [
        ((1, (2, 3)), [1, [2, 3]]),
        ([(1, 2), (3, 4)], [[1, 2], [3, 4]]),
        ([1, (2, "a")], [1, [2, "a"]]),
        (Point(1, 2.0), [1, 2.0]),
        ({3, 1, 2}, [1, 2, 3]),
        (frozenset({"b", "a"}), ["a", "b"]),
        ({(2, 1), (1, 5)}, [[1, 5], [2, 1]]),
        ({frozenset({2, 1}), frozenset({0})}, [[0], [1, 2]]),
        ({1, "a", None}, [None, 1, "a"]),
        (range(3), [0, 1, 2]),
        ((i * i for i in range(3)), [0, 1, 4]),
        (deque([1, 2]), [1, 2]),
        (array("d", [1, 2]), [1.0, 2.0]),
        ({"a": 1}.keys(), ["a"]),
        ({"a": 1}.values(), [1]),
        ({"a": 1}.items(), [["a", 1]]),
        (np.array([[1, 2], [3, 4]]), [[1, 2], [3, 4]]),
        (np.array([1.5, 2]), [1.5, 2.0]),
        (np.array([True, False]), [True, False]),
        (np.array(["a", "bc"]), ["a", "bc"]),
        (np.array(7), 7),
        (np.array([], dtype=float), []),
        (np.array([(1, 2)], dtype=object), [[1, 2]]),
        (np.ma.masked_array([1, 2], mask=[True, False]), [None, 2]),
        ([np.float64(1.5), np.int8(-3)], [1.5, -3]),
        (np.float64(0.5), 0.5),
        (np.float32(0.5), 0.5),
        (np.longdouble(0.5), 0.5),
        (np.int64(7), 7),
        (np.uint8(255), 255),
        (np.bool_(True), True),
        (np.str_("a"), "a"),
        (Level.LOW, 3),
        (Name.ANN, "ann"),
        (Text("a"), "a"),
        (OrderedDict(b=1, a=2), {"b": 1, "a": 2}),
        (defaultdict(list, a=[(1,)]), {"a": [[1]]}),
        (Counter("aa"), {"a": 2}),
        (types.MappingProxyType({"a": {1}}), {"a": [1]}),
        ({np.int64(1): 2}, {1: 2}),
        ({(1, np.int64(2)): (3,)}, {(1, 2): [3]}),
        ({frozenset({2, 1}): 0}, {(1, 2): 0}),
        ({1: 1, "a": None}, {1: 1, "a": None}),
    ],
    ids=label,
)
def test_python_values_become_plain_values(given_value: Any, expected: Any) -> None:
    value = normalise(given_value, GIVER)
    assert same(value, expected)


@given(PLAIN_VALUES)
def test_clean_values_are_returned_as_they_are(value: Any) -> None:
    if not _has_odd_keys(value):
        assert normalise(value, GIVER) is value


def _has_odd_keys(value: Any) -> bool:
    if isinstance(value, dict):
        return any(type(key) is not str for key in value) or any(map(_has_odd_keys, value.values()))
    return isinstance(value, list) and any(map(_has_odd_keys, value))


@given(VALUES)
def test_normalising_changes_no_value(value: Any) -> None:
    assert same(normalise(value, GIVER), value)


@given(st.lists(st.tuples(SCALARS, SCALARS)))
def test_tuples_of_anything_become_lists(pairs: list[tuple[Any, Any]]) -> None:
    assert same(normalise(pairs, GIVER), [list(pair) for pair in pairs])
    assert same(normalise((1, pairs), GIVER), [1, [list(pair) for pair in pairs]])


@pytest.mark.parametrize(
    "thing",
    [
        b"bytes",
        Decimal("1.5"),
        Fraction(1, 3),
        datetime.datetime(2020, 1, 1),
        pathlib.PurePath("a"),
        Colour.RED,
        Thing(),
        len,
        Thing,
        Ellipsis,
    ],
    ids=label,
)
def test_hashable_objects_stay_themselves(thing: Any) -> None:
    value = normalise(thing, GIVER)
    assert truth(value) is True
    assert fresh(value) is thing or thing == b"bytes"
    assert fresh(normalise([thing], GIVER))[0] is thing or thing == b"bytes"


def test_only_what_python_cannot_compare_is_wrapped() -> None:
    path = pathlib.PurePath("a")
    assert normalise(path, GIVER) is path
    assert normalise([path], GIVER) == [pathlib.PurePath("a")]
    odd = Unhashable()
    value = normalise([odd, odd, Unhashable()], GIVER)
    assert value[0] == value[1]
    assert value[0] != value[2]
    assert value[0] != 1
    assert [fresh(item) is odd for item in value] == [True, True, False]
    assert isinstance(normalise(bytearray(b"a"), GIVER), Opaque)
    assert normalise(value, GIVER) == value


def test_objects_that_do_not_equal_themselves_compare_by_identity() -> None:
    missing = np.datetime64("NaT")
    value = normalise([missing, missing], GIVER)
    assert value == value[:]
    assert value[0] == value[1]
    assert value[0].object is missing
    assert normalise(Decimal("NaN"), GIVER) != normalise(Decimal("NaN"), GIVER)

    class Vague(Thing):
        def __eq__(self, other: object) -> bool:
            raise ValueError("more than one element")

        __hash__ = Thing.__hash__

    vague = Vague()
    assert normalise([vague], GIVER) == normalise([vague], GIVER)
    assert normalise([vague], GIVER) != normalise([Vague()], GIVER)


def test_numpy_dates_are_objects_with_their_own_equality() -> None:
    day = np.datetime64("2020-01-01")
    value = normalise(np.array(["2020-01-01", "2020-01-02"], dtype="datetime64[D]"), GIVER)
    assert value == normalise([day, np.datetime64("2020-01-02")], GIVER)
    assert value[0] != value[1]
    assert fresh(value)[0] == day
    assert isinstance(fresh(value)[0], np.datetime64)
    assert normalise(np.array(day), GIVER) == value[0]
    assert normalise(np.timedelta64(5, "s"), GIVER) != 5


def test_user_classes_that_look_like_containers_stay_objects() -> None:
    inner = UserList([1])
    assert fresh(normalise([inner], GIVER))[0] is inner


def test_buffers_and_code_are_not_copied() -> None:
    for thing in (memoryview(b"abc"), (lambda: 0).__code__, np.datetime64(1, "s")):
        value = normalise([thing], GIVER)
        assert fresh(value)[0] is thing
        assert value == normalise([thing], GIVER)


@pytest.mark.parametrize(
    ("given_value", "message"),
    [
        (float("nan"), "the function 'f' returned NaN"),
        ([[1, 2], [0, 1, float("nan")]], "the function 'f' returned NaN at [1][2]"),
        ([1, float("inf")], "the function 'f' returned inf at [1]"),
        ((float("-inf"),), "the function 'f' returned -inf at [0]"),
        (np.array([[0.5, np.nan]]), "the function 'f' returned NaN at [0][1]"),
        (np.float32("nan"), "the function 'f' returned NaN"),
        (np.longdouble("inf"), "the function 'f' returned inf"),
        ({"a": [float("nan")]}, "the function 'f' returned NaN at ['a'][0]"),
        ([{"a": 1}, {"b": {float("nan")}}], "the function 'f' returned NaN at [1]['b']"),
        (1j, "the function 'f' returned the complex number 1j"),
        ([np.complex64(1)], "the function 'f' returned the complex number (1+0j) at [0]"),
        (np.clongdouble(1), "the function 'f' returned the complex number (1+0j)"),
        (2**63, "the function 'f' returned 9223372036854775808, which does not fit into 64 bits"),
        ([-(2**63) - 1], "the function 'f' returned -9223372036854775809 at [0], which does not fit into 64 bits"),
        ([[2**63]], "the function 'f' returned 9223372036854775808 at [0][0], which does not fit into 64 bits"),
        (np.uint64(2**63), "the function 'f' returned 9223372036854775808, which does not fit into 64 bits"),
        (10**6000, "the function 'f' returned <integer of 19932 bits>, which does not fit into 64 bits"),
        ({float("nan"): 1}, "the function 'f' returned NaN at [nan]"),
    ],
    ids=label,
)
def test_values_that_the_language_does_not_have(given_value: Any, message: str) -> None:
    error = failure(normalise, given_value, GIVER)
    assert (error.code, error.message) == ("X004", message)


def test_the_giver_of_a_bad_value_is_named() -> None:
    assert failure(normalise, [float("nan")], "the variable 'x'").message == "the variable 'x' holds NaN at [0]"


@pytest.mark.parametrize("inside", [True, 7, 1.5, "a", None, (1,), b"a"])
def test_limits_hold_beside_any_neighbour(inside: Any) -> None:
    for bad in (2**63, -(2**63) - 1, float("nan"), float("inf")):
        for value in ([bad, inside], [inside, bad], [[inside], [bad]], [[[bad]], inside], {"a": bad, "b": inside}):
            assert failure(normalise, value, GIVER).code == "X004"
    for good in (2**63 - 1, -(2**63), 1.7976931348623157e308):
        assert fresh(normalise([good, inside], GIVER))[0] == good


def nested(depth: int, leaf: Any = 1) -> Any:
    for _ in range(depth):
        leaf = [leaf]
    return leaf


def test_lists_that_contain_themselves() -> None:
    once: list[Any] = []
    once.append(once)
    twice: list[Any] = []
    twice += [twice, twice]
    parent: dict[str, Any] = {}
    parent["children"] = [{"parent": parent}, {"parent": parent}]
    for value in (once, [1, once], (once,), twice, [[twice, 1.0]], parent, [parent], {"a": twice}):
        error = failure(normalise, value, GIVER)
        assert error.code == "X004"
        assert error.message == "the function 'f' returned a value nested deeper than 500 levels"


def test_deep_lists_work_or_are_refused() -> None:
    deep = nested(500)
    for value in (deep, nested(500, b"bytes"), nested(499, (1,))):
        clean = normalise(value, GIVER)
        assert fresh(clean) == clean
        assert freeze(clean) == freeze(fresh(clean))
        assert show(clean) == "[" * 57 + "..."
        assert compare(clean, fresh(clean)) == 0
    record: Any = 1
    for _ in range(250):
        record = {"a": [record, Decimal(1)]}
    assert freeze(normalise(record, GIVER)) == freeze(fresh(record))
    for depth in (501, 502, 1001, 3000, 100_000):
        for value in (nested(depth), nested(depth, float("nan")), nested(depth, (1,))):
            assert failure(normalise, value, GIVER).code == "X004"
            while value and isinstance(value, list):  # Python would free it recursively
                value = value.pop()


def test_sets_have_the_same_order_under_every_hash_seed() -> None:
    script = (
        "from ss2sql.runtime.values import normalise; from pathlib import PurePath; from decimal import Decimal\n"
        "print(normalise([{'b', 'a', 'c', 'd'}, {1, 'x', None, (2, 'y'), 2.5}, {PurePath('b'), PurePath('a'), 'c'},\n"
        "    {(1, 'a'), (1, 2), 'q'}, {Decimal(2), Decimal(1), 3}, {frozenset({1}), (1.0,)}], 'x'))"
    )
    outputs = set()
    for seed in ("0", "1", "2", "3"):
        run = subprocess.run(
            [sys.executable, "-c", script], env={"PYTHONHASHSEED": seed}, capture_output=True, text=True, check=True
        )
        outputs.add(run.stdout)
    assert len(outputs) == 1
    assert outputs.pop().startswith("[['a', 'b', 'c', 'd'], [None, 2.5, 1, [2, 'y'], 'x'],")

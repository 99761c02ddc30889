"""The value rules: copies, truth, equality as keys, order, messages."""

from __future__ import annotations

import datetime
import itertools
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_values import ALIKE, NUMBERS, VALUES, Thing, Unhashable, label, lists, same, values

from ss2sql.errors import ExecutionError
from ss2sql.runtime.values import (
    Opaque,
    check,
    compare,
    freeze,
    fresh,
    ge,
    gt,
    le,
    lt,
    normalise,
    show,
    sort_rows,
    truth,
)

GIVER = "the function 'f'"


def failure(call: Any, *arguments: Any) -> ExecutionError:
    with pytest.raises(ExecutionError) as caught:
        call(*arguments)
    assert caught.value.hints
    assert all(caught.value.hints)
    return caught.value


# --- copies and truth ----------------------------------------------------------------------------------


@given(VALUES)
def test_fresh_copies_are_the_same_and_independent(value: Any) -> None:
    copy = fresh(value)
    assert same(normalise(copy, GIVER), value)
    assert not _shares_structure(copy, value)


def _shares_structure(left: Any, right: Any) -> bool:
    if isinstance(left, list):
        return left is right or any(map(_shares_structure, left, right))
    if isinstance(left, dict):
        return left is right or any(map(_shares_structure, left.values(), right.values()))
    return False


def test_parts_that_were_shared_are_copied_apart() -> None:
    part = [1]
    first, second = fresh([part, part])
    first.append(2)
    assert second == [1]
    first, second, _ = fresh([part, part, Thing()])
    first.append(2)
    assert second == [1]


@pytest.mark.parametrize("value", [None, 0, 0.0, -0.0, False, "", [], {}, b""], ids=label)
def test_nothing_zero_and_empty_are_false(value: Any) -> None:
    assert truth(value) is False


@pytest.mark.parametrize("value", [True, -1, 0.5, "0", [[]], [0], {"a": 0}, b"0"], ids=label)
def test_everything_else_is_true(value: Any) -> None:
    assert truth(value) is True


def test_truth_of_objects() -> None:
    class Empty(Unhashable):
        def __len__(self) -> int:
            return 0

    class Refusing(Unhashable):
        def __bool__(self) -> bool:
            raise ValueError("ambiguous")

    assert truth(normalise(Empty(), GIVER)) is False
    assert truth(normalise(Refusing(), GIVER)) is True
    assert truth(Refusing()) is True


# --- equality as keys ----------------------------------------------------------------------------------


@given(ALIKE, ALIKE)
def test_keys_are_equal_exactly_where_values_are(left: Any, right: Any) -> None:
    assert (freeze(left) == freeze(right)) is (left == right)
    if left == right:
        assert hash(freeze(left)) == hash(freeze(right))


@given(VALUES, VALUES)
def test_keys_of_any_values(left: Any, right: Any) -> None:
    assert (freeze(left) == freeze(right)) is (left == right)
    assert freeze(left) == freeze(normalise(fresh(left), GIVER))


def test_keys_of_chosen_values() -> None:
    equal = [
        (1, 1.0),
        (1, True),
        ([10, 9], [10.0, 9.0]),
        ([[0.0]], [[-0.0]]),
        ([True], [1]),
        ({"a": 1, "b": [1.0]}, {"b": [True], "a": 1}),
        ([Decimal(2)], [2]),
        (Fraction(1, 2), 0.5),
        ([b"a", 1.0], [b"a", 1]),
        (2**53, 2.0**53),
    ]
    for left, right in equal:
        assert left == right
        assert freeze(left) == freeze(right)
    different = [
        [],
        [[]],
        {},
        [{}],
        "",
        "[]",
        0,
        "0",
        None,
        [None],
        "1",
        1,
        b"",
        b"1",
        [b"1"],
        ["1"],
        [1],
        [[1]],
        [1, 1],
        {"a": 1},
        {"a": "1"},
        [["a", 1]],
        2**53 + 1,
        2.0**53,
        [2**53 + 1],
        [2.0**53],
        2.0**63,
        [Decimal("0.1")],
        [0.1],
        freeze([1]),
    ]
    for left, right in itertools.combinations(different, 2):
        assert freeze(left) != freeze(right), (left, right)


def test_values_that_a_script_nested_too_deeply_have_no_key() -> None:
    value: Any = 0.5
    for _ in range(1500):
        value = [value]
    assert failure(freeze, value).message == "cannot compare a value nested deeper than 500 levels"


# --- order ---------------------------------------------------------------------------------------------

ORDERED = st.one_of(
    st.tuples(NUMBERS, NUMBERS),
    st.tuples(st.text(), st.text()),
    st.tuples(lists(NUMBERS), lists(NUMBERS)).filter(lambda pair: _depths(pair[0]) == _depths(pair[1])),
    st.tuples(st.lists(st.lists(st.text(max_size=1))), st.lists(st.lists(st.text(max_size=1)))),
)


def _depths(value: Any) -> Any:
    return [_depths(item) for item in value] if isinstance(value, list) else 0


@given(ORDERED)
def test_order_is_pythons(pair: tuple[Any, Any]) -> None:
    left, right = pair
    assert lt(left, right) is (left < right)
    assert le(left, right) is (left <= right)
    assert gt(left, right) is (left > right)
    assert ge(left, right) is (left >= right)
    assert compare(left, right) == (left > right) - (left < right)


@pytest.mark.parametrize("left", [1, True, 0.5, "a", None, [1], {"a": 1}, b"a", Decimal(1), Opaque([])], ids=label)
@pytest.mark.parametrize("right", [2, 1.5, "b", None, ["a"], {}, b"b", datetime.date(2020, 1, 1)], ids=label)
def test_other_kinds_have_no_order(left: Any, right: Any) -> None:
    numbers = (int, float)
    if (isinstance(left, numbers) and isinstance(right, numbers)) or (isinstance(left, str) and isinstance(right, str)):
        assert lt(left, right)
        return
    for function, symbol in ((lt, "<"), (le, "<="), (gt, ">"), (ge, ">=")):
        error = failure(function, left, right)
        assert error.code == "X001"
        assert error.message.startswith(f"cannot compare {show(left)} {symbol} {show(right)}")


def test_lists_are_compared_as_far_as_python_looks() -> None:
    assert lt([1, "a"], [2, 3])
    assert lt([1], [1, None])
    assert not lt([None, {"a": 1}], [None, {"a": 1.0}])
    assert le([None], [None])
    assert lt([[1, "x"], 5], [[1, "x"], 6.0])
    error = failure(lt, [1, ["a"]], [1.0, [2]])
    assert error.message == "cannot compare [1, ['a']] < [1.0, [2]], because of 'a' and 2"
    assert failure(lt, 1, "a").message == "cannot compare 1 < 'a'"
    assert "None" in failure(ge, None, 1).hints[0]


def test_integers_and_floats_compare_exactly() -> None:
    assert lt(2.0**53, 2**53 + 1)
    assert not le(2**53 + 1, 2.0**53)
    assert lt(2**63 - 1, 2.0**63)


def test_rows_are_sorted_by_several_keys() -> None:
    keys = [(1, "a"), (None, "b"), (2.5, "c"), (True, "d"), (None, "a"), (-1, "e")]
    rows = ["a", "b", "c", "d", "e", "f"]
    assert sort_rows(rows, keys, (False, False)) == ["e", "b", "f", "a", "d", "c"]
    assert sort_rows(rows, keys, (True, False)) == ["c", "a", "d", "f", "e", "b"]
    assert sort_rows(rows, keys, (False, True)) == ["b", "e", "f", "d", "a", "c"]
    assert sort_rows(rows, keys, ()) == rows
    assert sort_rows([], [], (False,)) == []


@pytest.mark.parametrize("descending", [False, True])
def test_sorting_is_stable_and_puts_none_first(descending: bool) -> None:
    column = [[1, 2], None, [1], [1.0], [], None, [True, 3]]
    ascending = [1, 5, 4, 2, 3, 0, 6]
    falling = [6, 0, 2, 3, 4, 1, 5]
    order = sort_rows(range(7), [(value,) for value in column], (descending,))
    assert order == (falling if descending else ascending)


@given(st.lists(st.one_of(st.none(), NUMBERS), max_size=12), st.booleans())
def test_sorting_numbers_as_python_does(column: list[Any], descending: bool) -> None:
    expected = sorted(
        range(len(column)), key=lambda i: (column[i] is not None, column[i] or 0), reverse=descending
    )  # fmt: skip
    assert sort_rows(range(len(column)), [(value,) for value in column], [descending]) == expected


@pytest.mark.parametrize("column", [[1, "a"], [[1], 1], [{"a": 1}, {"a": 2}], [None, 1, b"a"], [["a"], [1]]], ids=label)
def test_mixed_kinds_cannot_be_sorted(column: list[Any]) -> None:
    error = failure(sort_rows, column, [(value,) for value in column], (False,))
    assert error.code == "X001"
    assert error.message.startswith("cannot order ")
    assert " and " in error.message


# --- messages ------------------------------------------------------------------------------------------


@given(values(st.one_of(st.none(), NUMBERS, st.text(max_size=9))))
def test_short_values_are_shown_whole(value: Any) -> None:
    assert show(value, 10_000) == repr(value)
    shown = show(value, 20)
    assert shown == repr(value) if len(repr(value)) <= 20 else shown.endswith("...") and len(shown) == 20


def test_values_in_messages() -> None:
    class Silent(Thing):
        def __repr__(self) -> str:
            raise ValueError

    assert show([[3, 2, 1], []]) == "[[3, 2, 1], []]"
    assert show("it's") == '"it\'s"'
    assert show([None, True, 1.0]) == "[None, True, 1.0]"
    assert show([Opaque(Thing()), Silent()]) == "[Thing, <Silent>]"
    assert show(np.zeros((2, 2))) == "array([[0., 0.], [0., 0.]])"
    assert len(show(list(range(10**6)))) == 60
    assert len(show("x" * 10**6)) == 60
    assert show(-(10**5000)) == "<integer of 16610 bits>"


# --- results of arithmetic -----------------------------------------------------------------------------


def test_check_passes_values_and_refuses_the_rest() -> None:
    for value in (2**63 - 1, -(2**63), 1.7e308, -0.0, True):
        assert check(value) is value
    assert failure(check, 2**63).message == "integer overflow: 9223372036854775808 does not fit into 64 bits"
    for value in (float("inf"), float("nan"), 1j, -(2**63) - 1, 10**10000):
        assert failure(check, value).code == "X004"

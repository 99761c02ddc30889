"""The built-in functions: what they give, how they fail, and what their types promise."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_values import NUMBERS, PLAIN_VALUES, VALUES, same

from ss2sql.errors import ExecutionError
from ss2sql.kinds import ANY, INT_MAX, INT_MIN, Type
from ss2sql.runtime.builtins import BUILTINS

OPERATORS = ["add", "sub", "mul", "div", "mod", "pow", "neg", "lt", "le", "eq", "ne", "ge", "gt", "in", "not_in"]
FUNCTIONS = (
    "len count sum min max average uniq sorted zip range abs round sqrt str int float distance norm".split()  # noqa: SIM905
)
OF_SESSION = ["print", "help", "var", "clear", "getTime", "eval", "to"]


def call(name: str, *arguments: Any) -> Any:
    python = BUILTINS[name].python
    assert python is not None
    return python(*arguments)


def failure(name: str, *arguments: Any) -> ExecutionError:
    with pytest.raises(ExecutionError) as caught:
        call(name, *arguments)
    assert caught.value.hints
    assert all(caught.value.hints)
    return caught.value


def attempt(name: str, *arguments: Any) -> tuple[Any, ExecutionError | None]:
    """The result, or the error."""
    try:
        return call(name, *arguments), None
    except ExecutionError as error:
        return None, error


# --- errors --------------------------------------------------------------------------------------------

# Values, and the codes of errors, are in cases/expressions/built-in-functions.sheet.
MESSAGES: list[tuple[Any, ...]] = [
    ("add", [1], 1, "X001 cannot compute [1] + 1"),
    ("sub", "a", "a", "X001 cannot compute 'a' - 'a'"),
    ("mul", "a", 10**9, "X001 cannot compute 'a' * 1000000000"),
    ("div", {}, 1, "X001 cannot compute {} / 1"),
    ("div", 1.5, -0.0, "X002 division by zero: 1.5 / -0.0"),
    ("mod", 1.0, 0.0, "X002 division by zero: 1.0 % 0.0"),
    ("mod", "%s", 1, "X001 cannot compute '%s' % 1"),
    ("pow", 0, -1, "X002 division by zero: 0 ^ -1"),
    ("pow", 10, 10**10, "X004 integer overflow: 10 ^ 10000000000 does not fit into 64 bits"),
    ("pow", "a", 2, "X001 cannot compute 'a' ^ 2"),
    ("neg", INT_MIN, "X004 integer overflow: 9223372036854775808"),
    ("neg", "a", "X001 cannot compute -'a'"),
    ("in", 1, "abc", "X001 cannot look for 1 in 'abc'"),
    ("not_in", 1, None, "X001 cannot look for 1 in None"),
    ("item", "", 0, "X003 index 0 is out of range: '' has 0 characters"),
    ("item", {}, 1, "X003 {} has no key 1"),
    ("item", {"a": 1}, {"a": 1}, "X003 {'a': 1} has no key {'a': 1}"),
    ("item", [1], 0.0, "X001 cannot use 0.0 as an index of [1]"),
    ("item", None, 0, "X001 cannot take an element of None"),
    ("slice", 5, 0, 1, "X001 cannot take a slice of 5"),
    ("slice", [1], 0.5, None, "X001 cannot use 0.5 as the bound of a slice"),
    *((name, "abc", f"X007 {name} works on a list, not on 'abc'") for name in ("count", "sum", "uniq")),
    *((name, 5, f"X007 {name} works on a list, not on 5") for name in ("max", "sum")),
    ("sorted", {"a": 1}, "X007 sorted works on a list"),
    ("zip", [1], "ab", "X007 zip works on a list, not on 'ab'"),
    *((name, ["a"], f"X007 {name} works on numbers, not on 'a'") for name in ("sum", "average", "norm")),
    *((name, "4", f"X007 {name} works on numbers, not on '4'") for name in ("abs", "sqrt", "round", "norm")),
    ("distance", "a", "b", "X007 distance works on numbers, not on 'a'"),
    ("distance", [1], [1, 2], "X007 distance of lists of 1 and 2 numbers"),
    ("distance", [1], 2, "X007 distance of [1] and 2"),
    ("range", 10**12, "X007 range(1000000000000) has too many elements"),
    ("range", 1.0, "X007 range works on integers, not on 1.0"),
    ("range", 1, 5, 0, "X007 the step of range is 0"),
    ("round", 1.5, 0.5, "X007 round takes a whole number of decimal places, not 0.5"),
    ("round", INT_MAX, -19, "X004 integer overflow: 10000000000000000000"),
    ("int", "9" * 5000, "X007 int cannot read"),
    ("int", [1], "X007 int works on numbers and strings, not on [1]"),
    ("float", None, "X007 float works on numbers and strings, not on None"),
    ("float", "x", "X007 float cannot read 'x'"),
    ("float", "nan", "X004 'nan' is not a finite number"),
    ("float", "1e999", "X004 '1e999' is not a finite number"),
]


@pytest.mark.parametrize("row", MESSAGES, ids=lambda row: f"{row[0]}{row[1:-1]!r}"[:60])
def test_messages(row: tuple[Any, ...]) -> None:
    name, *arguments, code_and_message = row
    error = failure(name, *arguments)
    assert f"{error.code} {error.message}".startswith(code_and_message)


def test_hints_name_the_cure() -> None:
    assert "max(SELECT ... AS list)" in failure("max", 5).hints[0]
    assert "str(...)" in failure("add", 1, "a").hints[0]
    assert "did you mean 'name'?" in failure("item", {"name": 1, "other": 2}, "nam").hints
    assert "-1" in failure("item", [1, 2], 5).hints[0]
    assert "None" in failure("mul", None, 2).hints[0]
    assert "WHERE" in failure("sum", [None]).hints[0]


# --- laws ----------------------------------------------------------------------------------------------


@given(st.lists(NUMBERS, max_size=6), st.randoms())
def test_the_order_of_a_sum_does_not_matter(numbers: list[Any], random: Any) -> None:
    shuffled = random.sample(numbers, len(numbers))
    for name in ("sum", "average"):
        expected, error = attempt(name, numbers)
        result, other = attempt(name, shuffled)
        assert same(result, expected) or result == expected == 0
        assert (error is None) is (other is None)
        assert error is None or other is None or error.code == other.code


@given(st.lists(VALUES, max_size=6))
def test_uniq_keeps_the_first_of_equal_values(values: list[Any]) -> None:
    expected: list[Any] = []
    for value in values:
        if value not in expected:
            expected.append(value)
    assert same(call("uniq", values), expected)


@given(st.lists(NUMBERS, min_size=1, max_size=6))
def test_extremes_are_the_ends_of_the_sorted_list(numbers: list[Any]) -> None:
    ordered = call("sorted", numbers)
    assert call("min", numbers) is ordered[0] or same(call("min", numbers), ordered[0])
    assert call("max", numbers) == ordered[-1]
    assert same(call("min", *numbers) if len(numbers) > 1 else ordered[0], ordered[0])
    assert same(call("max", numbers), call("sorted", numbers, True)[0])


@given(PLAIN_VALUES, PLAIN_VALUES)
def test_no_operator_changes_its_operands(left: Any, right: Any) -> None:
    before = [repr(left), repr(right)]
    for name in ("add", "in", "eq", "item", "zip", "distance"):
        _, error = attempt(name, left, right)
        assert error is None or error.code in ("X001", "X003", "X004", "X007")
    assert [repr(left), repr(right)] == before


# --- the table -----------------------------------------------------------------------------------------


def test_the_table_is_complete() -> None:
    assert sorted(BUILTINS) == sorted([*OPERATORS, *FUNCTIONS, "item", "slice", *OF_SESSION])
    for name, entry in BUILTINS.items():
        assert entry.name == name
        assert entry.text
        assert "\n" not in entry.text
        assert entry.minimum <= (entry.minimum if entry.maximum is None else entry.maximum)
        assert (entry.python is None) is (name in OF_SESSION)
        assert entry.volatility == ("volatile" if name in OF_SESSION else "immutable")
        types = (ANY,) * entry.minimum
        assert isinstance(entry.result(types), Type)
        assert entry.raises(types) is (name not in ("eq", "ne"))

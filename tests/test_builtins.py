"""The built-in functions: what they give, how they fail, and what their types promise."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from random_values import NUMBERS, PLAIN_VALUES, VALUES, Thing, same

from ss2sql.errors import ExecutionError
from ss2sql.kinds import ANY, INT_MAX, INT_MIN, Type
from ss2sql.runtime.builtins import AGGREGATES, BUILTINS

HUGE = 1.7976931348623157e308
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


def case(*parts: Any) -> Any:
    return pytest.param(parts[0], parts[1:-1], parts[-1], id=f"{parts[0]}{parts[1:-1]!r}"[:60])


# --- results -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "arguments", "expected"),
    [
        case("add", 1, 2, 3),
        case("add", 1, 2.0, 3.0),
        case("add", True, 1, 2),
        case("add", True, True, 2),
        case("add", "a", "b", "ab"),
        case("add", [1], [[2]], [1, [2]]),
        case("add", -0.0, -0.0, -0.0),
        case("add", INT_MAX, 0, INT_MAX),
        case("add", 2**53 + 1, 0.0, 2.0**53),
        case("sub", 5, True, 4),
        case("sub", INT_MIN, -1, INT_MIN + 1),
        case("mul", 3, -2.5, -7.5),
        case("mul", 2**31, 2**31, 2**62),
        case("div", 1, 2, 0.5),
        case("div", 4, 2, 2.0),
        case("div", INT_MIN, -1, 2.0**63),
        case("div", 2**53 + 1, 1, 2.0**53),
        case("mod", -7, 3, 2),
        case("mod", 7, -3, -2),
        case("mod", -7.5, 2, 0.5),
        case("mod", -1e-20, 3.0, 3.0),
        case("mod", True, 2, 1),
        case("pow", 2, 10, 1024),
        case("pow", 2, -1, 0.5),
        case("pow", -2, 63, INT_MIN),
        case("pow", 4, 0.5, 2.0),
        case("pow", 0, 0, 1),
        case("pow", -1, 2**62 + 1, -1),
        case("pow", 1, INT_MAX, 1),
        case("pow", 0, INT_MAX, 0),
        case("pow", 2.5, 2, 6.25),
        case("pow", -8, 3.0, -512.0),
        case("pow", 10, -400, 0.0),
        case("neg", 5, -5),
        case("neg", True, -1),
        case("neg", 0.0, -0.0),
        case("eq", 1, 1.0, True),
        case("eq", [10, 9], [10.0, 9.0], True),
        case("eq", [], [[]], False),
        case("eq", "1", 1, False),
        case("eq", None, None, True),
        case("ne", True, 1, False),
        case("ne", {"a": 1, "b": 2}, {"b": 2, "a": 1}, False),
        case("ne", "a", 1, True),
        case("lt", 1, 2.5, True),
        case("le", "a", "a", True),
        case("gt", [2], [1, 5], True),
        case("ge", False, True, False),
        case("in", 1.0, [[], 1], True),
        case("in", [1.0], [[1]], True),
        case("in", "b", "abc", True),
        case("in", "", "", True),
        case("in", "a", {"a": 1}, True),
        case("in", 1, {"a": 1}, False),
        case("in", [1, 2], {(1, 2): 0}, True),
        case("in", {"a": 1}, {"a": 1}, False),
        case("not_in", 3, [1, 2], True),
        case("not_in", "a", "abc", False),
        case("item", [1, 2, 3], 0, 1),
        case("item", [1, 2, 3], -1, 3),
        case("item", "abc", 1, "b"),
        case("item", [5, 6], True, 6),
        case("item", {"a": 1}, "a", 1),
        case("item", {1: "x"}, 1.0, "x"),
        case("item", {(1, 2): "x"}, [1, 2], "x"),
        case("slice", [1, 2, 3], 1, 9, [2, 3]),
        case("slice", "abc", -2, None, "bc"),
        case("slice", [1, 2, 3], None, None, [1, 2, 3]),
        case("len", "abc", 3),
        case("len", [], 0),
        case("len", {"a": 1}, 1),
        case("count", [None, 1], 2),
        case("sum", [], 0),
        case("sum", [1, True], 2),
        case("sum", [0.1] * 10, 1.0),
        case("sum", [1e308, 1e308, -1e308], 1e308),
        case("sum", [1, 2.5], 3.5),
        case("sum", [INT_MAX, 1, -1], INT_MAX),
        case("min", [3, 1.0, 1], 1.0),
        case("min", 3, 1, 2, 1),
        case("min", [["b"], ["a", "c"]], ["a", "c"]),
        case("min", [{"a": 1}], {"a": 1}),
        case("max", [1, True, 1.0], 1),
        case("max", "a", "b", "b"),
        case("max", [1], [2], [2]),
        case("max", ["a", "B"], "a"),
        case("average", [1, 2], 1.5),
        case("average", [1e308, 1e308], 1e308),
        case("average", [INT_MAX, INT_MAX], float(INT_MAX)),
        case("average", [True], 1.0),
        case("average", [], None),
        case("min", [], None),
        case("max", [], None),
        case("uniq", [1, 1.0, True, "1", [1], [1.0], None, {}, None], [1, "1", [1], None, {}]),
        case("sorted", [3, 1.5, True], [True, 1.5, 3]),
        case("sorted", [1, 2, 1.0], True, [2, 1, 1.0]),
        case("sorted", [[2], [1, "a"]], [[1, "a"], [2]]),
        case("sorted", [], []),
        case("zip", [1, 2], ["a", "b", "c"], [[1, "a"], [2, "b"]]),
        case("zip", [1, 2], [[1], [2]]),
        case("range", 3, [0, 1, 2]),
        case("range", -3, []),
        case("range", 1, 3, [1, 2]),
        case("range", 5, 0, -2, [5, 3, 1]),
        case("range", True, [0]),
        case("abs", -3, 3),
        case("abs", True, 1),
        case("abs", -0.0, 0.0),
        case("round", 2.5, 2),
        case("round", 3.5, 4),
        case("round", True, 1),
        case("round", 2.675, 2, 2.67),
        case("round", 1234, -2, 1200),
        case("round", INT_MAX, -20, 0),
        case("round", 5, -(10**12), 0),
        case("round", 1.5, 10**12, 1.5),
        case("round", 7, 3, 7),
        case("round", True, 0, 1),
        case("sqrt", 9, 3.0),
        case("sqrt", 0.25, 0.5),
        case("str", "a", "a"),
        case("str", 1.0, "1.0"),
        case("str", [1, "a", None], "[1, 'a', None]"),
        case("str", None, "None"),
        case("int", "7", 7),
        case("int", " -7 ", -7),
        case("int", -2.9, -2),
        case("int", True, 1),
        case("float", "1.5", 1.5),
        case("float", 2**53 + 1, 2.0**53),
        case("float", False, 0.0),
        case("distance", 1, 3.5, 2.5),
        case("distance", [0, 0], [3, 4], 5.0),
        case("distance", [], [], 0.0),
        case("distance", INT_MIN, INT_MAX, 2.0**64),
        case("norm", [3, 4.0], 5.0),
        case("norm", -2, 2.0),
        case("norm", [], 0.0),
    ],
)
def test_results(name: str, arguments: tuple[Any, ...], expected: Any) -> None:
    assert same(call(name, *arguments), expected)


# --- errors --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "arguments", "code_and_message"),
    [
        case("add", 1, "a", "X001 cannot compute 1 + 'a'"),
        case("add", None, 1, "X001 cannot compute None + 1"),
        case("add", [1], 1, "X001 cannot compute [1] + 1"),
        case("add", INT_MAX, 1, "X004 integer overflow: 9223372036854775808 does not fit into 64 bits"),
        case("add", HUGE, HUGE, "X004 float overflow"),
        case("sub", "a", "a", "X001 cannot compute 'a' - 'a'"),
        case("sub", INT_MIN, 1, "X004 integer overflow"),
        case("mul", "a", 10**9, "X001 cannot compute 'a' * 1000000000"),
        case("mul", [1], 2, "X001 cannot compute [1] * 2"),
        case("mul", 2**32, 2**31, "X004 integer overflow: 9223372036854775808"),
        case("div", 1, 0, "X002 division by zero: 1 / 0"),
        case("div", 1.5, -0.0, "X002 division by zero: 1.5 / -0.0"),
        case("div", 1, False, "X002 division by zero: 1 / False"),
        case("div", 1e308, 1e-308, "X004 float overflow"),
        case("div", {}, 1, "X001 cannot compute {} / 1"),
        case("mod", 1, 0, "X002 division by zero: 1 % 0"),
        case("mod", 1.0, 0.0, "X002 division by zero: 1.0 % 0.0"),
        case("mod", "%s", 1, "X001 cannot compute '%s' % 1"),
        case("pow", 0, -1, "X002 division by zero: 0 ^ -1"),
        case("pow", -8, 0.5, "X004 -8 ^ 0.5 is a complex number"),
        case("pow", 2, 63, "X004 integer overflow: 9223372036854775808 does not fit into 64 bits"),
        case("pow", 10, 10**10, "X004 integer overflow: 10 ^ 10000000000 does not fit into 64 bits"),
        case("pow", -3, INT_MAX, "X004 integer overflow"),
        case("pow", 10.0, 400, "X004 float overflow"),
        case("pow", "a", 2, "X001 cannot compute 'a' ^ 2"),
        case("neg", INT_MIN, "X004 integer overflow: 9223372036854775808"),
        case("neg", "a", "X001 cannot compute -'a'"),
        case("lt", 1, "a", "X001 cannot compare 1 < 'a'"),
        case("ge", None, None, "X001 cannot compare None >= None"),
        case("in", 1, "abc", "X001 cannot look for 1 in 'abc'"),
        case("in", 1, 5, "X001 cannot look for 1 in 5"),
        case("not_in", 1, None, "X001 cannot look for 1 in None"),
        case("item", [1, 2], 2, "X003 index 2 is out of range: [1, 2] has 2 elements"),
        case("item", [1], -2, "X003 index -2 is out of range: [1] has 1 element"),
        case("item", "", 0, "X003 index 0 is out of range: '' has 0 characters"),
        case("item", {"name": 1}, "nam", "X003 {'name': 1} has no key 'nam'"),
        case("item", {}, 1, "X003 {} has no key 1"),
        case("item", {"a": 1}, {"a": 1}, "X003 {'a': 1} has no key {'a': 1}"),
        case("item", [1], 0.0, "X001 cannot use 0.0 as an index of [1]"),
        case("item", [1], "a", "X001 cannot use 'a' as an index of [1]"),
        case("item", 5, 0, "X001 cannot take an element of 5"),
        case("item", None, 0, "X001 cannot take an element of None"),
        case("slice", 5, 0, 1, "X001 cannot take a slice of 5"),
        case("slice", [1], 0.5, None, "X001 cannot use 0.5 as the bound of a slice"),
        case("len", 5, "X007 5 has no length"),
        case("len", Thing(), "X007 Thing has no length"),
        case("count", "abc", "X007 count works on a list, not on 'abc'"),
        case("sum", 5, "X007 sum works on a list, not on 5"),
        case("sum", [1, "a"], "X007 sum works on numbers, not on 'a'"),
        case("sum", [1, None], "X007 sum works on numbers, not on None"),
        case("sum", [INT_MAX, 1], "X004 integer overflow"),
        case("sum", [HUGE, HUGE], "X004 float overflow"),
        case("max", 5, "X007 max works on a list, not on 5"),
        case("max", [1, "a"], "X001 cannot order 'a' and 1"),
        case("min", 1, None, "X001 cannot order None and 1"),
        case("average", ["a"], "X007 average works on numbers, not on 'a'"),
        case("uniq", "aa", "X007 uniq works on a list, not on 'aa'"),
        case("sorted", [None, 1], "X001 cannot order"),
        case("sorted", {"a": 1}, "X007 sorted works on a list"),
        case("zip", [1], "ab", "X007 zip works on a list, not on 'ab'"),
        case("range", 10**12, "X007 range(1000000000000) has too many elements"),
        case("range", INT_MIN, INT_MAX, "X007 range("),
        case("range", 1.0, "X007 range works on integers, not on 1.0"),
        case("range", 1, 5, 0, "X007 the step of range is 0"),
        case("range", 1, None, "X007 range works on integers, not on None"),
        case("abs", INT_MIN, "X004 integer overflow"),
        case("abs", "a", "X007 abs works on numbers, not on 'a'"),
        case("round", 1e300, "X004 integer overflow"),
        case("round", HUGE, -308, "X004 float overflow"),
        case("round", INT_MAX, -19, "X004 integer overflow: 10000000000000000000"),
        case("round", 1.5, 0.5, "X007 round takes a whole number of decimal places, not 0.5"),
        case("round", None, "X007 round works on numbers, not on None"),
        case("sqrt", -1, "X007 sqrt of the negative number -1"),
        case("sqrt", "4", "X007 sqrt works on numbers, not on '4'"),
        case("int", "7.5", "X007 int cannot read '7.5'"),
        case("int", "9" * 5000, "X007 int cannot read"),
        case("int", "9" * 19, "X004 integer overflow"),
        case("int", 1e300, "X004 integer overflow"),
        case("int", [1], "X007 int works on numbers and strings, not on [1]"),
        case("float", "x", "X007 float cannot read 'x'"),
        case("float", "nan", "X004 'nan' is not a finite number"),
        case("float", "1e999", "X004 '1e999' is not a finite number"),
        case("float", None, "X007 float works on numbers and strings, not on None"),
        case("distance", [1], [1, 2], "X007 distance of lists of 1 and 2 numbers"),
        case("distance", [1], 2, "X007 distance of [1] and 2"),
        case("distance", "a", "b", "X007 distance works on numbers, not on 'a'"),
        case("distance", [HUGE], [-HUGE], "X004 float overflow"),
        case("distance", HUGE, -HUGE, "X004 float overflow"),
        case("norm", ["a"], "X007 norm works on numbers, not on 'a'"),
        case("norm", [HUGE, HUGE], "X004 float overflow"),
    ],
)
def test_errors(name: str, arguments: tuple[Any, ...], code_and_message: str) -> None:
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


# --- aggregates ----------------------------------------------------------------------------------------


@pytest.mark.parametrize("nothing", [[], [None], iter([None, None])], ids=["empty", "None", "iterator"])
def test_aggregates_of_nothing(nothing: Any) -> None:
    nothing = list(nothing)
    results = {name: aggregate(nothing) for name, aggregate in AGGREGATES.items()}
    assert results == {"count": 0, "sum": 0, "min": None, "max": None, "average": None}


def test_aggregates_skip_none() -> None:
    values = [3, None, 1, 2.0]
    results = {name: aggregate(iter(values)) for name, aggregate in AGGREGATES.items()}
    assert results == {"count": 3, "sum": 6.0, "min": 1, "max": 3, "average": 2.0}
    assert AGGREGATES["max"](["a", None, "b"]) == "b"
    with pytest.raises(ExecutionError, match="sum works on numbers, not on 'a'"):
        AGGREGATES["sum"](["a"])
    with pytest.raises(ExecutionError, match="cannot order"):
        AGGREGATES["min"]([1, "a"])


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

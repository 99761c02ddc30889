"""Built-in functions that generated code writes as Python's own operators: values, errors and order stay the same."""

from __future__ import annotations

import re
from functools import cache
from itertools import product
from typing import Any

import pytest
from native_host import FakeHost

from ss2sql import plan
from ss2sql.errors import Error, Source, Span
from ss2sql.kinds import ANY, INT, INT_MAX, INT_MIN, Kind, Type, type_of, union
from ss2sql.language.operations import OPERATIONS
from ss2sql.runtime.native import compile_statement

WHOLE = [0, 1, -1, 3, 7, -8, 2**30 - 1, 2**30, 3037000499, 3037000500, -(2**53) - 1, INT_MAX, INT_MIN]
BROKEN = [0.0, -0.0, 0.5, -2.5, 2.0, 1e18, 9.5e18, -1e300, 1.7e308]
OTHERS = [True, False, None, "a", "b", [], [1, 2], [0.5], {"a": 1}, "abc"]
TWO = ["add", "sub", "mul", "div", "mod", "lt", "le", "gt", "ge", "eq", "ne", "min", "max", "in", "not_in", "item"]
ONE = ["neg", "abs", "int", "float", "sqrt", "len", "count", "str"]


def promises(values: list[Any]) -> list[tuple[Type, ...]]:
    """Types that may be known of the values: exactly these, others of their kinds, anything."""
    exact = [type_of(value) for value in values]
    wide = [Type(kind.kinds, item=kind.item, columns=kind.columns, length=kind.length) for kind in exact]
    mixed = [union((kind, INT, Type(Kind.FLOAT))) for kind in wide]
    return [tuple(exact), tuple(wide), tuple(mixed), tuple([ANY] * len(values))]


HERE = Span(Source("a call"), 0, 6)


@cache
def statement(name: str, types: tuple[Type, ...], constants: tuple[tuple[int, str, Any], ...]) -> Any:
    """The call as generated code; `constants` are the places, kinds and values of arguments that are known."""
    arguments: list[plan.Expr] = [plan.Variable(f"v{at}", kind, span=HERE) for at, kind in enumerate(types)]
    for at, _, value in constants:
        arguments[at] = plan.Constant(value, type_of(value), span=HERE)
    known = OPERATIONS[name]
    seen = [argument.type for argument in arguments]
    function = plan.Function(name, *known.arity, known.volatility, raises=known.can_fail(seen))
    return compile_statement(plan.Call(function, tuple(arguments), known.result(seen), span=HERE, place=HERE))


def outcome(work: Any) -> tuple[Any, ...]:
    try:
        value = work()
    except Error as error:
        return ("error", error.code, error.message)
    return ("value", type(value), repr(value))


def compare(name: str, values: list[Any], constants: tuple[int, ...] = ()) -> None:
    """Runs the call with the values as variables, or as constants at some places, for all that may be known of them."""
    python = OPERATIONS[name].value
    assert python is not None
    expected = outcome(lambda: python(*values))
    host = FakeHost(**{f"v{at}": value for at, value in enumerate(values)})
    known = tuple((at, type(values[at]).__name__, values[at]) for at in constants)
    for types in promises(values):
        found = outcome(lambda types=types: statement(name, types, known)(host.start()))
        assert found == expected, (name, values, types)


@pytest.mark.parametrize("name", TWO)
def test_two_numbers(name: str) -> None:
    for pair in product([*WHOLE, *BROKEN, True], repeat=2):
        compare(name, list(pair))


@pytest.mark.parametrize("name", TWO)
def test_two_values_of_any_kind(name: str) -> None:
    for pair in product([2, 0.5, *OTHERS], repeat=2):
        compare(name, list(pair))


@pytest.mark.parametrize("name", ONE)
def test_one_value(name: str) -> None:
    for value in [*WHOLE, *BROKEN, *OTHERS]:
        compare(name, [value])


@pytest.mark.parametrize("exponent", [0, 1, 2, 3, 8, 9, 63, 64, -1, 0.5, 2.0, True])
def test_powers(exponent: Any) -> None:
    for base in [*WHOLE, *BROKEN, 233, 234, -235, 46341, True]:
        compare("pow", [base, exponent], constants=(1,))
        compare("pow", [base, exponent])


@pytest.mark.parametrize("index", [0, 1, 2, -1, -2, -3, True])
def test_elements_at_known_places(index: Any) -> None:
    for container in ([], [5], [5, 6], "", "ab", {"a": 1}, None, 4):
        compare("item", [container, index], constants=(1,))


LISTS = [
    [],
    [1],
    [2, 1],
    [True, 0],
    [1, 2.5],
    [0.5, 0.1],
    [1e308, 1e308],
    ["b", "a"],
    [None, 1],
    [INT_MAX, 1],
    [[1], [2]],
]


@pytest.mark.parametrize("name", ["min", "max", "sum"])
def test_of_lists(name: str) -> None:
    for items in LISTS:
        compare(name, [items])


def test_distances() -> None:
    points = [*LISTS, [0.0], [3, 4], [-1e308, -1e308], 1, -2.5, 1e308, -1.7e308]
    for pair in product(points, repeat=2):
        compare("distance", list(pair))


@pytest.mark.parametrize("name", ["min", "max"])
def test_extremes_of_several(name: str) -> None:
    for values in product([1, 1.0, True, -2, "a"], repeat=3):
        compare(name, list(values))


@pytest.mark.parametrize(
    "script",
    [
        "f(3) + f(4)",
        "f(3) - f(4) * f(5)",
        "f(3) < f(4)",
        "min(f(3), f(4))",
        "max([f(3), f(4)])",
        "f(8) % f(3)",
        "f(8) / f(3)",
        "f(8) / f(0)",
        "f([3, 4])[f(1)]",
        "f([3, 4])[f(2)]",
        "int(f(3)) / int(f(4))",
        "float(f(3)) / float(f(4))",
        "int(f(3)) % int(f(0))",
        "min(int(f(3)), float(f(4)))",
        "int(f(3)) + int(f(4))",
        "float(f(3)) * f(4)",
        "2 + f(4)",
        "f(1) + 'a'",
        "f('a') + f('b')",
        "f([1])[int(f(0))]",
    ],
)
def test_operands_are_evaluated_once_and_in_order(script: str) -> None:
    log: list[Any] = []

    def f(value: Any) -> Any:
        log.append(value)
        return value

    outcome(lambda: FakeHost({"f": f}, {"f": "volatile"}).run(script))
    assert [repr(value) for value in log] == re.findall(r"f\(([^()]*)\)", script)

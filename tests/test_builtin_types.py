"""What the types of the built-in functions promise: kinds, bounds, and calls that cannot fail."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from random_values import FLOATS, INTEGERS, NUMBERS, SCALARS, TEXTS, VALUES, lists, same

from ss2sql.errors import ExecutionError
from ss2sql.kinds import ANY, INT, INT_MIN, Kind, Type, covers, list_of, type_of, union
from ss2sql.runtime.builtins import BUILTINS
from ss2sql.runtime.values import normalise


def bounded(low: float, high: float, kinds: Kind = Kind.INT) -> Type:
    return Type(kinds, low, high)


POINT = list_of([bounded(-2, 0), bounded(1, 5)])


def test_bounds_are_computed() -> None:
    small, one = bounded(0, 5), bounded(1, 1)
    half = bounded(-0.5, 0.5, Kind.FLOAT)
    cases: list[tuple[str, Sequence[Type], Type]] = [
        ("add", (small, one), bounded(1, 6)),
        ("add", (small, half), bounded(-0.5, 5.5, Kind.FLOAT)),
        ("add", (bounded(0, 1, Kind.BOOL), one), bounded(1, 2)),
        ("sub", (small, one), bounded(-1, 4)),
        ("mul", (small, bounded(-2, 3)), bounded(-10, 15)),
        ("mul", (INT, bounded(0, 0)), bounded(0, 0)),
        ("div", (small, bounded(2, 4)), bounded(0, 2.5, Kind.FLOAT)),
        ("mod", (INT, bounded(10, 10)), bounded(0, 9)),
        ("mod", (small, bounded(10, 10)), small),
        ("mod", (INT, bounded(-3, 4)), bounded(-2, 3)),
        ("pow", (bounded(-3, 2), bounded(2, 2)), bounded(0, 9)),
        ("pow", (bounded(-3, -2), bounded(2, 2)), bounded(4, 9)),
        ("pow", (bounded(-3, 2), bounded(3, 3)), bounded(-27, 8)),
        ("pow", (bounded(-3, 2), bounded(0, 0)), bounded(1, 1)),
        ("pow", (bounded(-3, 2), bounded(1, 2)), bounded(-9, 9)),
        ("pow", (INT, bounded(2, 2)), Type(Kind.INT, 0)),
        ("pow", (bounded(2, 3), bounded(1, 2)), bounded(1, 9)),
        ("neg", (small,), bounded(-5, 0)),
        ("abs", (bounded(-7, 5),), bounded(0, 7)),
        ("round", (bounded(-0.7, 2.5, Kind.FLOAT),), bounded(-1, 2)),
        ("sqrt", (bounded(4, 9),), bounded(2, 3, Kind.FLOAT)),
        ("int", (bounded(-0.7, 2.9, Kind.FLOAT),), bounded(0, 2)),
        ("float", (small,), bounded(0, 5, Kind.FLOAT)),
        ("min", (small, bounded(2, 3)), bounded(0, 3)),
        ("max", (small, bounded(2, 3)), bounded(2, 5)),
        ("max", (POINT,), bounded(1, 5)),
        ("min", (POINT,), bounded(-2, 0)),
        ("min", (list_of([bounded(3, 4)]),), bounded(3, 4)),
        ("sum", (POINT,), bounded(-1, 5)),
        ("len", (POINT,), bounded(2, 2)),
        ("item", (POINT, bounded(0, 0)), bounded(-2, 0)),
        ("item", (POINT, bounded(-1, -1)), bounded(1, 5)),
        ("item", (POINT, bounded(0, 1)), bounded(-2, 5)),
        ("item", (POINT, bounded(1, 7)), bounded(1, 5)),
        ("item", (list_of([Type(Kind.STR), one]), bounded(0, 1, Kind.BOOL)), bounded(1, 1, Kind.STR | Kind.INT)),
        (
            "zip",
            (POINT, list_of([Type(Kind.STR)])),
            Type(Kind.LIST, item=list_of([bounded(-2, 5), Type(Kind.STR)]), columns=()),
        ),
        ("range", (bounded(0, 9),), Type(Kind.LIST, item=bounded(0, 8), columns=())),
        ("range", (bounded(1, 3), bounded(5, 9)), Type(Kind.LIST, item=bounded(1, 8), columns=())),
        ("range", (bounded(7, 9), bounded(1, 3), INT), Type(Kind.LIST, item=bounded(2, 9), columns=())),
    ]
    for name, types, expected in cases:
        assert BUILTINS[name].result(types) == expected, name


def test_what_cannot_fail_and_what_can() -> None:
    text, floats, one = Type(Kind.STR), Type(Kind.FLOAT), bounded(1, 1)
    numbers = Type(Kind.LIST, item=Type(Kind.INT))
    safe = [
        ("lt", (INT, floats)),
        ("lt", (text, text)),
        ("ge", (numbers, numbers)),
        ("eq", (ANY, ANY)),
        ("add", (text, text)),
        ("add", (numbers, numbers)),
        ("mod", (INT, bounded(1, 9))),
        ("mod", (floats, bounded(0.5, 9, Kind.FLOAT))),
        ("neg", (floats,)),
        ("abs", (bounded(INT_MIN + 1, 0),)),
        ("in", (ANY, numbers)),
        ("in", (text, text)),
        ("slice", (text, INT, Type(Kind.NONE))),
        ("len", (Type(Kind.STR | Kind.LIST),)),
        ("str", (Type(Kind.NUMBER | Kind.STR),)),
        ("sorted", (numbers,)),
        ("uniq", (Type(Kind.LIST),)),
        ("zip", (numbers, Type(Kind.LIST))),
        ("min", (INT, floats)),
        ("sqrt", (bounded(0, 5),)),
        ("float", (INT,)),
        ("distance", (INT, bounded(-5, 5, Kind.FLOAT))),
        ("pow", (bounded(0, 10), bounded(0, 18))),
        ("round", (floats, bounded(0, 3))),
        ("item", (POINT, bounded(-2, 1))),
        ("item", (POINT, bounded(0, 1, Kind.BOOL))),
        ("min", (POINT,)),
        ("max", (list_of([text, text]),)),
        ("max", (list_of([Type(Kind.NONE)]),)),
        ("sum", (POINT,)),
        ("norm", (POINT,)),
        ("distance", (POINT, POINT)),
    ]
    unsafe = [
        ("lt", (INT, Type(Kind.INT | Kind.NONE))),
        ("lt", (INT, text)),
        ("lt", (Type(Kind.LIST), Type(Kind.LIST))),
        ("add", (INT, bounded(0, 1))),
        ("add", (floats, floats)),
        ("add", (Type(Kind.INT | Kind.STR), text)),
        ("sub", (bounded(INT_MIN, 0), bounded(1, 1))),
        ("mul", (bounded(0, 2**32), bounded(0, 2**31))),
        ("mul", (floats, floats)),
        ("div", (INT, bounded(0, 1))),
        ("div", (INT, bounded(-1, 1))),
        ("div", (floats, bounded(0.5, 1, Kind.FLOAT))),
        ("mod", (INT, INT)),
        ("neg", (INT,)),
        ("abs", (bounded(INT_MIN, 0),)),
        ("in", (INT, text)),
        ("item", (numbers, bounded(0, 0))),
        ("len", (ANY,)),
        ("str", (ANY,)),
        ("sorted", (Type(Kind.LIST, item=Type(Kind.INT | Kind.NONE)),)),
        ("min", (numbers,)),
        ("sum", (numbers,)),
        ("average", (numbers,)),
        ("range", (INT,)),
        ("range", (bounded(0, 5), bounded(0, 5), bounded(0, 1))),
        ("sqrt", (bounded(-1, 5),)),
        ("round", (floats,)),
        ("round", (INT, bounded(-1, 1))),
        ("int", (floats,)),
        ("float", (text,)),
        ("distance", (floats, floats)),
        ("pow", (bounded(0, 10), bounded(0, 19))),
        ("pow", (bounded(0, 10), bounded(-1, 2))),
        ("pow", (floats, bounded(0, 2))),
        ("item", (POINT, bounded(0, 2))),
        ("item", (POINT, bounded(-3, 0))),
        ("item", (POINT, Type(Kind.INT | Kind.STR, 0, 1))),
        ("item", (union([POINT, text]), bounded(0, 1))),
        ("max", (list_of([one, text]),)),
        ("max", (union([POINT, Type(Kind.NONE)]),)),
        ("sum", (list_of([INT, INT]),)),
        ("distance", (POINT, list_of([INT]))),
        ("norm", (list_of([floats]),)),
    ]
    for name, types in safe:
        assert BUILTINS[name].raises(types) is False, (name, types)
    for name, types in unsafe:
        assert BUILTINS[name].raises(types) is True, (name, types)


@st.composite
def typed(draw: st.DrawFn, values: st.SearchStrategy[Any]) -> tuple[Any, Type]:
    """A value and a type that it belongs to, as wide or as narrow as chance wants it."""
    value = draw(values)
    others = draw(st.lists(values, max_size=2))
    kind = union(map(type_of, (value, *others)))
    if draw(st.booleans()):
        low = kind.low if draw(st.booleans()) else None
        high = kind.high if draw(st.booleans()) else None
        kind = Type(kind.kinds, low, high, kind.item, kind.columns, kind.positions)
    if draw(st.integers(0, 9)) == 0:
        kind = Type(kind.kinds | draw(st.sampled_from(list(Kind))), columns=None)
    return value, kind


SMALL = st.integers(-2, 12)
PARTS = st.one_of(SMALL, st.integers(-20, 20).map(lambda n: n / 4), st.booleans())
OPERANDS = st.one_of(
    typed(SMALL),
    typed(PARTS),
    typed(INTEGERS),
    typed(FLOATS),
    typed(NUMBERS),
    typed(TEXTS),
    typed(SCALARS),
    typed(st.lists(NUMBERS, max_size=3)),
    typed(st.lists(PARTS, max_size=3)),
    typed(st.lists(TEXTS, max_size=3)),
    typed(st.lists(PARTS, min_size=2, max_size=2)),
    typed(lists(SCALARS)),
    typed(VALUES),
)
NUMERIC = st.one_of(typed(SMALL), typed(PARTS), typed(INTEGERS), typed(FLOATS), typed(NUMBERS))
ARITHMETIC = ["add", "sub", "mul", "div", "mod", "pow", "neg", "abs", "round", "sqrt", "int", "float", "min", "max"]


def keeps_promise(name: str, operands: list[tuple[Any, Type]]) -> None:
    arguments, types = [value for value, _ in operands], tuple(kind for _, kind in operands)
    for value, kind in operands:
        assert covers(kind, type_of(value))
    entry = BUILTINS[name]
    assert entry.python is not None
    error = None
    try:
        result = entry.python(*arguments)
    except ExecutionError as raised:
        error = raised
    if error is not None:
        assert error.code in ("X001", "X002", "X003", "X004", "X007")
        assert entry.raises(types), (name, arguments, types, error.message)
        return
    assert same(normalise(result, "the test"), result)
    assert covers(entry.result(types), type_of(result)), (name, arguments, types, result, entry.result(types))


PROMISING = sorted(name for name, entry in BUILTINS.items() if entry.python is not None)


@pytest.mark.parametrize("name", PROMISING)
@settings(max_examples=150, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_types_keep_their_promise(name: str, data: st.DataObject) -> None:
    entry = BUILTINS[name]
    count = data.draw(st.integers(entry.minimum, 3 if entry.maximum is None else entry.maximum))
    keeps_promise(name, data.draw(st.lists(OPERANDS, min_size=count, max_size=count)))


@pytest.mark.parametrize("name", ARITHMETIC)
@settings(max_examples=400, suppress_health_check=[HealthCheck.too_slow])
@given(data=st.data())
def test_arithmetic_keeps_its_promise(name: str, data: st.DataObject) -> None:
    entry = BUILTINS[name]
    count = data.draw(st.integers(max(entry.minimum, 2 if name in ("min", "max") else 1), entry.maximum or 3))
    keeps_promise(name, data.draw(st.lists(NUMERIC, min_size=count, max_size=count)))


def test_rounding_is_part_of_the_bounds() -> None:
    odd = bounded(0, 2**53 + 3)
    assert 2**53 + 3 + 0.0 == 2**53 + 4
    high = BUILTINS["add"].result((odd, bounded(0, 0, Kind.FLOAT))).high
    assert high is not None
    assert high >= 2**53 + 4
    assert math.isfinite(high)


@pytest.mark.parametrize(
    ("name", "others"),
    [("add", ("a",)), ("item", (0,)), ("slice", (0, 1)), ("min", ("\udfff",)), ("str", ())],
)
def test_text_made_of_surrogates_is_not_promised_to_fit_into_sqlite(name: str, others: tuple[Any, ...]) -> None:
    arguments = ("\ud800", *others)
    keeps_promise(name, [(value, type_of(value)) for value in arguments])
    assert BUILTINS[name].result([Type(Kind.STR), *map(type_of, others)]).may(Kind.STR)

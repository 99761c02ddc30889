"""The built-in functions: how much their types say.

Values, errors and hints are in cases/expressions/built-in-functions.sheet and cases/errors/values.errors.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from ss2sql.language.kinds import ANY, INT, INT_MIN, Kind, Type, make_list_type, unite
from ss2sql.language.operations import OPERATIONS


def bounded(low: float, high: float, kinds: Kind = Kind.INT) -> Type:
    return Type(kinds, low, high)


POINT = make_list_type([bounded(-2, 0), bounded(1, 5)])


def test_bounds_are_computed() -> None:
    small, one = bounded(0, 5), bounded(1, 1)
    half = bounded(-0.5, 0.5, Kind.FLOAT)
    cases: list[tuple[str, Sequence[Type], Type]] = [
        ("add", (small, one), bounded(1, 6)), ("add", (small, half), bounded(-0.5, 5.5, Kind.FLOAT)),
        ("mul", (small, bounded(-2, 3)), bounded(-10, 15)), ("mul", (INT, bounded(0, 0)), bounded(0, 0)),
        ("div", (small, bounded(2, 4)), Type(Kind.FLOAT, 0)), ("mod", (INT, bounded(10, 10)), bounded(0, 9)),
        ("mod", (small, bounded(10, 10)), small), ("mod", (INT, bounded(-3, 4)), bounded(-2, 3)),
        ("pow", (bounded(-3, 2), bounded(2, 2)), bounded(0, 9)),
        ("pow", (INT, bounded(2, 2)), Type(Kind.INT, 0)),
        ("neg", (small,), bounded(-5, 0)),
        ("abs", (bounded(-7, 5),), bounded(0, 7)), ("round", (bounded(-0.7, 2.5, Kind.FLOAT),), bounded(-1, 2)),
        ("sqrt", (bounded(4, 9),), bounded(2, 3, Kind.FLOAT)),
        ("int", (bounded(-0.7, 2.9, Kind.FLOAT),), bounded(0, 2)), ("float", (small,), bounded(0, 5, Kind.FLOAT)),
        ("min", (small, bounded(2, 3)), bounded(0, 3)), ("max", (small, bounded(2, 3)), bounded(2, 5)),
        ("max", (POINT,), bounded(1, 5)), ("min", (POINT,), bounded(-2, 0)),
        ("min", (make_list_type([bounded(3, 4)]),), bounded(3, 4)), ("sum", (POINT,), INT),
        ("len", (POINT,), bounded(2, 2)), ("item", (POINT, bounded(0, 0)), bounded(-2, 0)),
        ("item", (POINT, bounded(-1, -1)), bounded(1, 5)), ("item", (POINT, bounded(0, 1)), bounded(-2, 5)),
        ("item", (make_list_type([Type(Kind.STR), one]), bounded(0, 1, Kind.BOOL)), bounded(1, 1, Kind.STR | Kind.INT)),
        ("zip", (POINT, make_list_type([Type(Kind.STR)])),
         Type(Kind.LIST, element=make_list_type([bounded(-2, 5), Type(Kind.STR)]), columns=())),
        ("range", (bounded(0, 9),), Type(Kind.LIST, element=bounded(0, 8), columns=())),
    ]  # fmt: skip
    for name, types, expected in cases:
        assert OPERATIONS[name].result(types) == expected, name


def test_what_cannot_fail_and_what_can() -> None:
    text, floats, one = Type(Kind.STR), Type(Kind.FLOAT), bounded(1, 1)
    numbers = Type(Kind.LIST, element=Type(Kind.INT))
    safe = [
        ("lt", (INT, floats)), ("lt", (text, text)), ("ge", (numbers, numbers)), ("eq", (ANY, ANY)),
        ("add", (text, text)), ("add", (numbers, numbers)), ("mod", (INT, bounded(1, 9))),
        ("mod", (floats, bounded(1, 9, Kind.FLOAT))), ("neg", (floats,)), ("abs", (bounded(INT_MIN + 1, 0),)),
        ("in", (ANY, numbers)), ("in", (text, text)), ("slice", (text, INT, Type(Kind.NONE))),
        ("len", (Type(Kind.STR | Kind.LIST),)), ("str", (Type(Kind.NUMBER | Kind.STR),)), ("sorted", (numbers,)),
        ("uniq", (Type(Kind.LIST),)), ("zip", (numbers, Type(Kind.LIST))), ("min", (INT, floats)),
        ("sqrt", (bounded(0, 5),)), ("float", (INT,)), ("distance", (INT, bounded(-5, 5, Kind.FLOAT))),
        ("pow", (bounded(0, 10), bounded(18, 18))), ("round", (floats, bounded(0, 3))),
        ("item", (POINT, bounded(-2, 1))), ("item", (POINT, bounded(0, 1, Kind.BOOL))), ("min", (POINT,)),
        ("max", (make_list_type([text, text]),)), ("max", (make_list_type([Type(Kind.NONE)]),)), ("sum", (POINT,)),
        ("norm", (POINT,)), ("distance", (POINT, POINT)), ("min", (numbers,)), ("average", (numbers,)),
    ]  # fmt: skip
    unsafe = [
        ("lt", (INT, Type(Kind.INT | Kind.NONE))), ("add", (INT, bounded(0, 1))), ("add", (floats, floats)),
        ("sub", (bounded(INT_MIN, 0), bounded(1, 1))), ("mul", (bounded(0, 2**32), bounded(0, 2**31))),
        ("mul", (floats, floats)), ("div", (INT, bounded(-1, 1))), ("div", (floats, bounded(0.5, 1, Kind.FLOAT))),
        ("mod", (INT, INT)), ("neg", (INT,)), ("abs", (bounded(INT_MIN, 0),)), ("item", (numbers, bounded(0, 0))),
        ("sorted", (Type(Kind.LIST, element=Type(Kind.INT | Kind.NONE)),)), ("sum", (numbers,)),
        ("range", (bounded(0, 5), bounded(0, 5), bounded(0, 1))), ("sqrt", (bounded(-1, 5),)),
        ("round", (INT, bounded(-1, 1))), ("int", (floats,)), ("distance", (floats, floats)),
        ("pow", (bounded(0, 10), bounded(0, 19))), ("pow", (bounded(0, 10), bounded(-1, 2))),
        ("pow", (floats, bounded(0, 2))), ("item", (POINT, bounded(0, 2))), ("item", (POINT, bounded(-3, 0))),
        ("item", (unite([POINT, text]), bounded(0, 1))), ("max", (make_list_type([one, text]),)),
        ("max", (unite([POINT, Type(Kind.NONE)]),)), ("sum", (make_list_type([INT, INT]),)),
        ("distance", (POINT, make_list_type([INT]))), ("norm", (make_list_type([floats]),)),
    ]  # fmt: skip
    for raises, calls in ((False, safe), (True, unsafe)):
        for name, types in calls:
            assert OPERATIONS[name].can_fail(types) is raises, (name, types)


def test_rounding_is_part_of_the_bounds() -> None:
    high = OPERATIONS["add"].result((bounded(0, 2**53 + 3), bounded(0, 0, Kind.FLOAT))).high
    assert high is not None
    assert 2**53 + 3 + 0.0 == 2**53 + 4 <= high < math.inf

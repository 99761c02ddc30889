"""Functions of numbers, angles and points."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from itertools import chain
from typing import Any

from ss2sql.errors import ExecutionError
from ss2sql.language.conversion import CURES, build_overflow_error, check_arithmetic, format_value
from ss2sql.language.kinds import (
    INTEGER,
    NOTHING,
    Kind,
    Type,
    Types,
    bound_floats,
    fits_bounds,
    is_nonnegative,
    make_numbers,
    round_bounds,
    unite,
)
from ss2sql.language.operations.operation import (
    INTEGERS,
    Check,
    Form,
    Operation,
    are_integers,
    are_numbers,
    are_numeric,
    are_orderable,
    check_number,
    check_numbers,
    declare,
    exactly,
    find_sql_class,
    misuse,
)
from ss2sql.language.operations.operators import FINITE, are_reals, are_sql_number_types, can_sign_fail, split_type
from ss2sql.language.values import NUMBERS, compare_values

HALF = 8e307  # the difference of two such numbers is finite
SMALL = 1e306  # of 16 such numbers even the sum is finite
SAFE = 2**62


def _compute_absolute(value: Any) -> Any:
    return check_arithmetic(abs(check_number("abs", value)), CURES["abs"])


def _infer_absolute(types: Types) -> Type:
    return unite(make_numbers(kind, _bound_absolute(low, high)) for kind, low, high in split_type(types[0]))


def _bound_absolute(low: float, high: float) -> tuple[float, ...]:
    return (abs(low), abs(high)) if low > 0 or high < 0 else (0, abs(low), abs(high))


# --- rounding ------------------------------------------------------------------------------------------


def _round_number(value: Any, digits: Any = None) -> Any:
    """The nearest integer, or the nearest number with so many decimal places; halves go to the even neighbour."""
    check_number("round", value)
    try:
        if digits is None:
            return check_arithmetic(round(value))
        if type(digits) not in INTEGERS:
            message = f"round takes a whole number of decimal places, not {format_value(digits)}"
            raise misuse(message, "round(x, 2) keeps two of them")
        places = int(digits)
        if type(value) is float:
            return check_arithmetic(round(value, places))
    except OverflowError:
        raise build_overflow_error() from None
    # Rounding to more than 20 digits before the point gives 0; Python would compute the power of 10.
    return check_arithmetic(round(int(value), places)) if places >= -20 else 0


def _infer_rounded(types: Types) -> Type:
    value, *digits = types
    whole = infer_whole(value, round)
    if not digits:
        return whole
    integers = Kind.INT if value.may_be(INTEGER) else Kind(0)
    return unite((whole if digits[0].may_be(Kind.NONE) else NOTHING, Type(value.kinds & Kind.FLOAT | integers)))


def _can_rounding_fail(types: Types) -> bool:
    value, *digits = types
    if digits:
        return not are_numeric([value]) or not digits[0].is_only(INTEGER) or not is_nonnegative(digits[0])
    return can_whole_fail(value, round)


def infer_whole(kind: Type, compute: Callable[[float], int]) -> Type:
    """The type of the numbers made integers by a function that keeps their order."""
    return unite(make_numbers(Kind.INT, bounds) for bounds in round_bounds(kind, compute))


def can_whole_fail(kind: Type, compute: Callable[[float], int]) -> bool:
    return not are_numeric([kind]) or not all(fits_bounds(Kind.INT, bounds) for bounds in round_bounds(kind, compute))


# --- roots, points -------------------------------------------------------------------------------------


def _compute_root(value: Any) -> float:
    if check_number("sqrt", value) < 0:
        raise misuse(
            f"sqrt of the negative number {format_value(value)}", "sqrt(abs(x)) takes the number without its sign"
        )
    return math.sqrt(value)


def _infer_root(types: Types) -> Type:
    low, high = bound_floats(types[0])
    if not types[0].may_be(Kind.NUMBER) or high < 0:
        return NOTHING
    return Type(Kind.FLOAT, math.sqrt(max(low, 0)), math.sqrt(high))


def _measure_distance(*points: Any) -> float:
    """The Euclidean distance of two numbers, or of two equally long lists of numbers."""
    if len(points) > 2:
        check_numbers("distance", points)
        half = len(points) // 2
        return float(check_arithmetic(math.dist(points[:half], points[half:])))
    left, right = points
    if type(left) is not list and type(right) is not list:
        check_numbers("distance", (left, right))
        return float(check_arithmetic(float(abs(left - right))))
    for point in (left, right):
        if type(point) is not list:
            raise misuse(
                f"distance of {format_value(left)} and {format_value(right)}",
                "give two numbers, or two lists of numbers",
            )
        check_numbers("distance", point)
    if len(left) != len(right):
        message = f"distance of lists of {len(left)} and {len(right)} numbers"
        raise misuse(message, "both points need the same number of coordinates")
    return float(check_arithmetic(math.dist(left, right)))


def _measure_norm(*values: Any) -> float:
    """The Euclidean length of a list of numbers; the absolute value of a number."""
    coordinates = values[0] if len(values) == 1 and type(values[0]) is list else values
    check_numbers("norm", coordinates)
    return float(check_arithmetic(math.hypot(*coordinates)))


def _infer_size(types: Types) -> Type:
    return Type(Kind.FLOAT, 0) if all(kind.may_be(Kind.NUMBER | Kind.LIST) for kind in types) else NOTHING


def _can_size_fail(types: Types) -> bool:
    if all(kind.is_only(Kind.LIST) and kind.positions is not None for kind in types):
        return _can_vector_size_fail([kind.positions or () for kind in types])
    if not are_numeric(types):
        return True
    return len(types) > 1 and not all(-HALF <= bound <= HALF for kind in types for bound in bound_floats(kind))


def _can_vector_size_fail(vectors: Sequence[tuple[Type, ...]]) -> bool:
    coordinates = list(chain.from_iterable(vectors))
    if not are_numeric(coordinates) or len(set(map(len, vectors))) > 1:
        return True
    return not all(-SMALL <= bound <= SMALL for part in coordinates for bound in bound_floats(part))


def _are_points(types: Types) -> bool:
    vectors = [kind.positions or () for kind in types if kind.is_only(Kind.LIST)]
    if len(vectors) < len(types) or len(set(map(len, vectors))) != 1:
        return False
    return bool(vectors[0]) and are_numeric(list(chain.from_iterable(vectors)))


# --- functions of one number ---------------------------------------------------------------------------


def _make_round(name: str, compute: Callable[[float], int], about: str, example: str) -> Operation:
    """The row of `floor` or `ceil`, which give an integer."""

    def round_number(number: Any) -> int:
        return int(check_arithmetic(compute(check_number(name, number)), CURES["int"]))

    round_number.__name__ = name
    return declare(
        name, 1, round_number, lambda types: infer_whole(types[0], compute),
        lambda types: can_whole_fail(types[0], compute), call=f"{name}(x)", about=about, example=example,
        sqlite=(
            Form("{0}", lambda types: find_sql_class(types[0]) is not None and are_integers(types)),
            Form(f"cast({name}({{0}}) AS INTEGER)", are_numbers, f"{{0}} BETWEEN {-SAFE} AND {SAFE}"),
        ),
        python=(Form(compute, are_numeric, Check.SIZE),),
        portable=(
            Form("{0}", lambda types: are_sql_number_types(types) and exactly(Kind.INT)(types)),
            Form(f"cast({name}({{0}}) AS BIGINT)", exactly(Kind.FLOAT)),
        ),
    )  # fmt: skip


def _make_angle(
    name: str, compute: Callable[..., float], bounds: tuple[float | None, float | None], about: str, example: str
) -> Operation:
    """The row of a function of the C library. Engines round it differently, so Python always computes it."""

    def compute_angle(*numbers: Any) -> float:
        for number in numbers:
            check_number(name, number)
        try:
            return float(check_arithmetic(compute(*numbers)))
        except ValueError:
            raise misuse(
                f"{name} of {' and '.join(map(format_value, numbers))} is no real number", _DOMAINS.get(name, "")
            ) from None
        except OverflowError:
            raise build_overflow_error() from None

    known = {"atan2": (2, 2), "log": (1, 2)}.get(name, (1, 1))
    call = {"atan2": "atan2(y, x)", "log": "log(x) or log(x, base)"}.get(name, f"{name}(x)")
    safe = name in ("sin", "cos", "tan", "atan2")
    compute_angle.__name__ = name
    return declare(
        name, known, compute_angle,
        lambda types: Type(Kind.FLOAT, *bounds) if all(kind.may_be(Kind.NUMBER) for kind in types) else NOTHING,
        lambda types: not are_numeric(types) or not safe, call=call, about=about, example=example,
        python=(Form(compute, are_numeric),),
    )  # fmt: skip


def _compute_log(value: float, base: float = math.e) -> float:
    if base == math.e:
        return math.log(value)
    try:
        return math.log(value, base)
    except ZeroDivisionError:  # to base 1
        raise ValueError from None


_DOMAINS = {
    "asin": "it takes a number from -1 to 1", "acos": "it takes a number from -1 to 1",
    "log": "it takes a number above 0, and a base above 0 other than 1",
}  # fmt: skip


def _clamp_value(value: Any, low: Any, high: Any) -> Any:
    if compare_values(low, high) > 0:
        raise misuse(
            f"clamp between {format_value(low)} and {format_value(high)}",
            "clamp(x, low, high): the lower bound stands first",
        )
    return low if compare_values(value, low) < 0 else high if compare_values(value, high) > 0 else value


# --- conversions ---------------------------------------------------------------------------------------


def _convert_to_integer(value: Any) -> int:
    """The integer that a string represents; of a number, its whole part."""
    if type(value) in NUMBERS:
        return int(check_arithmetic(int(value), CURES["int"]))
    try:
        return int(check_arithmetic(int(_check_number_or_string("int", value)), CURES["int"]))
    except ValueError:
        hint = "int reads digits; int(float(...)) also reads fractions"
        raise misuse(f"int cannot read {format_value(value)}", hint) from None


def _convert_to_float(value: Any) -> float:
    """The float that a string represents, or that is nearest to a number."""
    if type(value) in NUMBERS:
        return float(value)
    try:
        found = float(_check_number_or_string("float", value))
    except ValueError:
        hint = "float reads numbers with a point, such as '1.5' or '2e3'"
        raise misuse(f"float cannot read {format_value(value)}", hint) from None
    if not math.isfinite(found):
        message = f"{format_value(value)} is not a finite number"
        raise ExecutionError("X004", message, hints=("floats have to be finite; None can say that there is no value",))
    return found


def _check_number_or_string(function: str, value: Any) -> str:
    if type(value) is str:
        return value
    hint = (
        "leave None out, or write IF(x == None; ...; ...)"
        if value is None
        else "the elements of a list are converted one by one"
    )
    raise misuse(f"{function} works on numbers and strings, not on {format_value(value)}", hint)


def _infer_integer(types: Types) -> Type:
    return unite((infer_whole(types[0], int), Type(Kind.INT) if types[0].may_be(Kind.STR) else NOTHING))


def _infer_float(types: Types) -> Type:
    found = make_numbers(Kind.FLOAT, bound_floats(types[0])) if types[0].may_be(Kind.NUMBER) else NOTHING
    return unite((found, Type(Kind.FLOAT) if types[0].may_be(Kind.STR) else NOTHING))


OPERATIONS = (
    declare(
        "abs", 1, _compute_absolute, _infer_absolute, can_sign_fail,
        call="abs(x)", about="the number without its sign", example="abs(-3)",
        # SQLite's abs(-0.0) is -0.0; adding 0 makes it 0.0 and changes nothing else.
        sqlite=(
            Form("abs({0})", lambda types: find_sql_class(types[0]) is not None and are_integers(types)),
            Form("abs({0}) + 0", are_numbers, "{0} >= -9223372036854775807"),
        ),
        python=(Form("abs({0})", are_numeric, Check.SIZE),),
        portable=(Form("abs({0})", lambda types: are_sql_number_types(types) or exactly(Kind.FLOAT)(types)),),
    ),
    declare(  # no form in SQL: databases round the last place by other rules
        "round", (1, 2), _round_number, _infer_rounded, _can_rounding_fail, call="round(x) or round(x, digits)",
        about="the nearest number of so many digits", example="[round(2.567), round(2.567, 1)]",
    ),
    declare(  # IEEE 754 demands the nearest float of a root, so all roots are the same
        "sqrt", 1, _compute_root, _infer_root, lambda types: not are_numeric(types) or bound_floats(types[0])[0] < 0,
        call="sqrt(x)", about="the square root", example="sqrt(2.25)",
        sqlite=(Form("sqrt({0})", are_numbers, "{0} >= 0"),), python=(Form(math.sqrt, are_numeric, "{0} >= 0"),),
        portable=(Form("sqrt({0})", are_reals),),
    ),
    declare(
        "int", 1, _convert_to_integer, _infer_integer, lambda types: can_whole_fail(types[0], int),
        call="int(x)", about="text or a number as an integer", example="[int('12'), int(3.9)]",
        sqlite=(
            Form("{0}", lambda types: find_sql_class(types[0]) is not None and are_integers(types)),
            Form("cast({0} AS INTEGER)", are_numbers, f"{{0}} BETWEEN {-SAFE} AND {SAFE}"),
        ),
        python=(Form("int({0})", are_numeric, Check.SIZE),),
    ),
    declare(
        "float", 1, _convert_to_float, _infer_float, lambda types: not are_numeric(types),
        call="float(x)", about="text or a number as a float", example="[float('1e3'), float(2)]",
        sqlite=(Form("{0}", exactly(Kind.FLOAT)), Form("cast({0} AS REAL)", are_numbers)),
        python=(Form("float({0})", are_numeric),),
    ),
    declare(
        "distance", 2, _measure_distance, _infer_size, _can_size_fail, call="distance(a, b)",
        about="the distance of two numbers or points", example="[distance([0, 0], [3, 4]), distance(1, 5)]",
        python=(Form(math.dist, _are_points, FINITE.partition(" <= ")[2]),), takes_items=True,
    ),
    declare(
        "norm", 1, _measure_norm, _infer_size, _can_size_fail,
        call="norm(list)", about="the length of a list of numbers", example="norm([3, 4])", takes_items=True,
    ),
    _make_round("floor", math.floor, "the greatest integer that is not above the number", "[floor(2.5), floor(-2.5)]"),
    _make_round("ceil", math.ceil, "the least integer that is not below the number", "[ceil(2.5), ceil(-2.5)]"),
    declare(
        "clamp", 3, _clamp_value, unite, True, call="clamp(x, low, high)",
        about="x, or the bound that it lies beyond", example="[clamp(7, 0, 5), clamp(3, 0, 5)]",
        sqlite=(Form("max({1}, min({0}, {2}))", exactly(Kind.INT), "{1} <= {2}"),),
        python=(Form("{1} if {0} < {1} else {2} if {0} > {2} else {0}", are_orderable, "{1} <= {2}"),),
    ),
    _make_angle("sin", math.sin, (-1, 1), "the sine of an angle in radians", "sin(pi() / 2)"),
    _make_angle("cos", math.cos, (-1, 1), "the cosine of an angle in radians", "cos(0)"),
    _make_angle("tan", math.tan, (None, None), "the tangent of an angle in radians", "tan(0)"),
    _make_angle("asin", math.asin, (-2, 2), "the angle with this sine, from -pi() / 2 to pi() / 2", "asin(0)"),
    _make_angle("acos", math.acos, (0, 4), "the angle with this cosine, from 0 to pi()", "acos(1)"),
    _make_angle("atan2", math.atan2, (-4, 4), "the angle of the point (x, y), from -pi() to pi()", "atan2(0, 1)"),
    _make_angle("exp", math.exp, (0, None), "e to the power of x", "exp(0)"),
    _make_angle("log", _compute_log, (None, None), "the natural logarithm, or that to a base", "[log(1), log(8, 2)]"),
    declare(
        "pi", 0, lambda: math.pi, Type(Kind.FLOAT, math.pi, math.pi), False, call="pi()",
        about="the ratio of a circle's circumference to its diameter", example="pi()",
    ),
)  # fmt: skip

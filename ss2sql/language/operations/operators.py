"""`+ - * / % ^` and unary minus, of numbers, where `+` joins strings and lists, too; comparisons and membership."""

from __future__ import annotations

import operator
import sys
from collections.abc import Callable
from dataclasses import replace
from datetime import date, timedelta
from typing import Any

from ss2sql.errors import ExecutionError
from ss2sql.language.conversion import build_complex_error, build_overflow_error, check_arithmetic, format_value
from ss2sql.language.kinds import (
    BOOL,
    INT_MIN,
    INTEGER,
    NOTHING,
    Kind,
    NumberOperation,
    Type,
    Types,
    apply_bounds,
    are_comparable,
    bound_floats,
    bound_integers,
    fits_bounds,
    is_nonnegative,
    keep_lists,
    make_numbers,
    make_text_type,
    unite,
)
from ss2sql.language.operations.operation import (
    INTEGERS,
    Check,
    Form,
    Operation,
    When,
    are_integers,
    are_numbers,
    are_numeric,
    are_orderable,
    declare,
    each,
    exactly,
    have_one_sql_class,
)
from ss2sql.language.values import NUMBERS, are_rows, find_ordering_pair, has_dict_key, make_dict_key

TIMES = (date, timedelta)
EXACT = 2**53  # integers up to here are exact as floats
MOST_FACTORS = 4  # of a product that stands for a power in SQL
SMALL = 2**30 - 1  # Python compares integers up to here in half the time
FINITE = f"-{sys.float_info.max!r} <= {{value}} <= {sys.float_info.max!r}"


def make_operand_error(left: Any, symbol: str, right: Any) -> ExecutionError:
    """The error for operands that `symbol` does not work on."""
    message = f"cannot compute {format_value(left)} {symbol} {format_value(right)}"
    if left is None or right is None:
        hint = "None is not a number: test for it first, for example IF(x == None; ...; ...)"
    elif are_rows(left) or are_rows(right):
        hint = "a query without AS is a list of rows; SELECT ... AS value gives the value of one"
    elif symbol == "+" and (type(left) is list or type(right) is list):
        hint = "+ joins lists with lists: write [x] for a list of one"
    elif symbol == "-" and isinstance(left, date) and type(right) is str:
        hint = f"write {type(left).__name__}({format_value(right)}) for a text"
    elif symbol == "+" and (type(left) is str or type(right) is str):
        hint = "+ joins strings with str(...), or adds numbers made with int(...) or float(...)"
    elif symbol in "+-" and (isinstance(left, TIMES) or isinstance(right, TIMES)):
        hint = "write timedelta(1) for a day, timedelta(0, 1) for a second; date(x), datetime(x) make two of one kind"
    elif type(left) is list and type(right) is list:
        hint = f"{symbol} works on numbers: write [a[0] {symbol} b[0], a[1] {symbol} b[1]], or distance(a, b) of points"
    else:
        hint = f"{symbol} works on numbers"
    return ExecutionError("X001", message, hints=(hint,))


def compute_with_times(left: Any, symbol: str, right: Any, compute: Callable[[Any, Any], Any]) -> Any:
    """The sum, difference or ratio of times and timedeltas. Raises the error for operands that do not fit."""
    if not isinstance(left, TIMES) or not isinstance(right, TIMES) or symbol not in "+-/":
        raise make_operand_error(left, symbol, right)
    try:
        return compute(left, right)
    except TypeError:
        raise make_operand_error(left, symbol, right) from None
    except ZeroDivisionError:
        raise _make_zero_division_error(left, symbol, right) from None
    except OverflowError:
        message = f"{format_value(left)} {symbol} {format_value(right)} is beyond the years 1 to 9999"
        raise ExecutionError("X004", message, hints=("dates have a year from 1 to 9999",)) from None


def _make_zero_division_error(left: Any, symbol: str, right: Any) -> ExecutionError:
    hint = "test the divisor first, for example IF(x != 0; ...; ...)"
    return ExecutionError(
        "X002", f"division by zero: {format_value(left)} {symbol} {format_value(right)}", hints=(hint,)
    )


def _declare_number_operator(name: str, symbol: str, compute: Callable[[Any, Any], Any]) -> Callable[[Any, Any], Any]:
    """The value of an operator on two numbers."""

    def apply_operator(left: Any, right: Any) -> Any:
        if type(left) in NUMBERS and type(right) in NUMBERS:
            try:
                return check_arithmetic(compute(left, right))
            except ZeroDivisionError:
                raise _make_zero_division_error(left, symbol, right) from None
        return compute_with_times(left, symbol, right, compute)

    apply_operator.__name__ = name  # in tracebacks and in generated code
    return apply_operator


def are_sql_integers(types: Types) -> bool:
    """Integers within 64 bits: BIGINT."""
    return all(kind.kinds == Kind.INT and kind.is_bounded(2**63 - 1) for kind in types)


def are_reals(types: Types) -> bool:
    """Numbers that are equal as floats, integers or not: DOUBLE."""
    return all(kind.kinds == Kind.FLOAT or (kind.kinds == Kind.INT and kind.is_bounded(EXACT)) for kind in types)


def are_sql_number_types(types: Types) -> bool:
    return are_sql_integers(types) or are_reals(types)


def can_be_numbers(types: Types) -> bool:
    return all(kind.may_be(Kind.INT | Kind.FLOAT) for kind in types)


# --- sums and products ---------------------------------------------------------------------------------


def _make_operator(name: str, symbol: str, compute: NumberOperation, about: str, example: str) -> Operation:
    """The row of an operator that is monotonic, so that its extremes lie at the ends of the intervals."""

    def infer_type(types: Types) -> Type:
        times = Type(Kind.OBJECT) if name != "mul" and all(kind.may_be(Kind.OBJECT) for kind in types) else NOTHING
        return unite((times, *(make_numbers(kind, corners) for kind, corners in apply_bounds(compute, types))))

    def can_fail(types: Types) -> bool:
        return not are_numeric(types) or not all(
            fits_bounds(kind, corners) for kind, corners in apply_bounds(compute, types)
        )

    text = f"{{0}} {symbol} {{1}}"
    return declare(
        name, 2, _declare_number_operator(name, symbol, compute), infer_type, can_fail,
        symbol=symbol, call=f"a {symbol} b", about=about, example=example, cheap=True,
        sqlite=(Form(text, are_numbers, Check.SIZE),),
        python=(Form(text, are_numeric, Check.SIZE), Form(text, can_be_numbers, Check.NUMBERS)),
        portable=(Form(text, are_sql_number_types),),
    )  # fmt: skip


def add_values(left: Any, right: Any) -> Any:
    """The sum of numbers; the concatenation of strings or lists."""
    kind, other = type(left), type(right)
    if kind in NUMBERS and other in NUMBERS:
        return check_arithmetic(left + right)
    if kind is other and (kind is str or kind is list):
        return left + right
    return compute_with_times(left, "+", right, operator.add)


def _declare_addition() -> Operation:
    row = _make_operator("add", "+", operator.add, "a + b: the sum; joins strings and lists",
                      "[2 + 3, 'ab' + 'c', [1] + [2]]")  # fmt: skip
    strings, lists = exactly(Kind.STR), exactly(Kind.LIST)

    def infer_type(types: Types) -> Type:
        a, b = types
        joined = unite((keep_lists(a), keep_lists(b))) if a.may_be(Kind.LIST) and b.may_be(Kind.LIST) else NOTHING
        return unite((row.result(types), make_text_type(types), joined))

    def can_fail(types: Types) -> bool:
        return not any(each(kind)(types) for kind in (Kind.STR, Kind.LIST)) and row.can_fail(types)

    text = "{0} + {1}"
    return replace(
        row, value=add_values, result=infer_type, can_fail=can_fail, grows=True,
        sqlite=(Form("{0} || {1}", strings), *row.sqlite),
        python=(Form(text, strings, Check.ROOM), Form(text, lists, Check.ROOM), *row.python),
        portable=(Form("{0} || {1}", strings), Form("list_concat({0}, {1})", lists), *row.portable),
    )  # fmt: skip


def _negate_number(value: Any) -> Any:
    if type(value) in NUMBERS:
        return check_arithmetic(-value)
    raise ExecutionError("X001", f"cannot compute -{format_value(value)}", hints=("- works on numbers",))


def _infer_negated(types: Types) -> Type:
    return unite(make_numbers(kind, (-low, -high)) for kind, low, high in split_type(types[0]))


def can_sign_fail(types: Types) -> bool:
    """Whether unary minus or `abs` can fail: there is one integer more below zero than above."""
    return not are_numeric(types) or any(kind is Kind.INT and low == INT_MIN for kind, low, _ in split_type(types[0]))


def split_type(t: Type) -> list[tuple[Kind, float, float]]:
    """The integers and the floats among the values with their bounds; bools count as integers."""
    found: list[tuple[Kind, float, float]] = []
    if bounds := bound_integers(t):
        found.append((Kind.INT, *bounds))
    if t.may_be(Kind.FLOAT):
        found.append((Kind.FLOAT, *bound_floats(t)))
    return found


# --- quotients -----------------------------------------------------------------------------------------


def _keeps_from_zero(kind: Type) -> bool:
    """Whether the numbers among the values are at least 1, or at most -1: dividing by them never fails."""
    low, high = bound_floats(kind)
    return low >= 1 or high <= -1


def _infer_quotient(types: Types) -> Type:
    if all(t.may_be(Kind.OBJECT) for t in types):  # the ratio of two timedeltas
        return Type(Kind.FLOAT)
    if not all(t.may_be(Kind.NUMBER) for t in types):
        return NOTHING
    return Type(Kind.FLOAT, 0 if all(map(is_nonnegative, types)) else None)


def _can_division_fail(types: Types) -> bool:
    return not are_numeric(types) or not _keeps_from_zero(types[1])


def _infer_remainder(types: Types) -> Type:
    a, b = types
    found = []
    if (first := bound_integers(a)) and (second := bound_integers(b)):
        found.append(make_numbers(Kind.INT, _bound_remainders(first, second, 1)))
    if a.may_be(Kind.NUMBER) and b.may_be(Kind.NUMBER) and (a.may_be(Kind.FLOAT) or b.may_be(Kind.FLOAT)):
        found.append(make_numbers(Kind.FLOAT, _bound_remainders(bound_floats(a), bound_floats(b), 0)))
    return unite(found)


def _bound_remainders(a: tuple[float, float], b: tuple[float, float], gap: int) -> tuple[float, float]:
    """The bounds of `a % b`: the remainder stays `gap` away from the divisor and has its sign."""
    low = min(0, b[0] + gap) if b[0] < 0 else 0
    high = max(0, b[1] - gap) if b[1] > 0 else 0
    if a[0] >= 0 and b[0] >= 0:
        high = min(high, a[1])
    if a[1] <= 0 and b[1] <= 0:
        low = max(low, a[0])
    return low, high


def _are_exact(types: Types) -> bool:
    """Tests that floats hold the operands exactly; otherwise SQLite would round twice."""
    return are_numbers(types) and all(kind.is_bounded(EXACT) or not kind.may_be(Kind.INT) for kind in types)


def _are_nonnegative_types(types: Types) -> bool:
    return are_integers(types) and types[0].is_at_least(0) and types[1].is_at_least(1)


# --- powers --------------------------------------------------------------------------------------------


def _compute_power(base: Any, exponent: Any) -> Any:
    """An integer for integers and an exponent of at least 0, else a float."""
    if type(base) not in NUMBERS or type(exponent) not in NUMBERS:
        raise make_operand_error(base, "^", exponent)
    if type(base) in INTEGERS and type(exponent) in INTEGERS and exponent > 63 and not -1 <= base <= 1:
        # Certainly too large, and Python would compute it slowly.
        message = f"integer overflow: {base} ^ {exponent} does not fit into 64 bits"
        raise ExecutionError("X004", message, hints=("make the base a float, for example with float(...)",))
    try:
        result = base**exponent
    except ZeroDivisionError:
        raise _make_zero_division_error(base, "^", exponent) from None
    except OverflowError:
        raise build_overflow_error() from None
    if type(result) is complex:
        raise build_complex_error(f"{format_value(base)} ^ {format_value(exponent)}")
    return check_arithmetic(result)


def _infer_power(types: Types) -> Type:
    base, exponent = types
    if not all(kind.may_be(Kind.NUMBER) for kind in types):
        return NOTHING
    bounds = _bound_powers(types)
    if bounds is not None:
        return unite(make_numbers(kind, corners) for kind, corners in bounds)
    whole = Kind.INT if base.may_be(INTEGER) and exponent.may_be(INTEGER) else Kind(0)
    broken = Kind(0) if _WHOLE(types) and is_nonnegative(exponent) else Kind.FLOAT
    return Type(whole | broken, 0 if is_nonnegative(base) else None)


def _bound_powers(types: Types) -> list[tuple[Kind, list[float]]] | None:
    """The corners for a known exponent that is whole, or a root of numbers from 0; None for any other.

    Python leaves powers of floats to the C library, which rounds them nearly, not exactly.
    """
    base, exponent = types
    times = exponent.low
    if not exponent.is_only(Kind.NUMBER) or times is None or times != exponent.high or not 0 <= times <= 63:
        return None
    whole = exponent.is_only(INTEGER)
    found: list[tuple[Kind, list[float]]] = []
    for kind, low, high in split_type(base):
        if not whole and (low < 0 or times > 1):
            return None
        if kind is Kind.INT and whole:
            corners = [low**times, high**times, *([0] if low <= 0 <= high and times else [])]
        else:
            try:
                size = max(abs(low), abs(high), 1.0) ** times * (1 + 2**-40)
            except OverflowError:
                return None
            corners = [0 if low >= 0 or times % 2 == 0 else -size, size]
        found.append((kind if whole else Kind.FLOAT, corners))
    return found


def _can_power_fail(types: Types) -> bool:
    bounds = _bound_powers(types) if are_numeric(types) else None
    return bounds is None or not all(fits_bounds(kind, corners) for kind, corners in bounds)


def _match_power(count: int, base: When) -> When:
    """Tests for this integer as exponent, and for such a base."""
    known = Type(Kind.INT, count, count)
    return lambda types: types[1] == known and base(types[:1])


_WHOLE = each(INTEGER)


def _write_product(count: int) -> str:
    return " * ".join(["{0}"] * count)


ARITHMETIC = (
    _declare_addition(),
    _make_operator("sub", "-", operator.sub, "a - b: the difference", "5 - 7"),
    _make_operator("mul", "*", operator.mul, "a * b: the product", "1.5 * 4"),
    declare(
        "div", 2, _declare_number_operator("div", "/", operator.truediv), _infer_quotient, _can_division_fail,
        symbol="/", call="a / b", about="a / b: the quotient, a float", example="7 / 2", cheap=True,
        sqlite=(
            Form("cast({0} AS REAL) / {1}", lambda types: _are_exact(types) and types[1].is_only(INTEGER | Kind.NONE),
                 Check.NOT_NULL),  # a divisor of 1 or more
            Form("cast({0} AS REAL) / {1}", _are_exact, "{value} BETWEEN -1e+308 AND 1e+308"),
        ),
        python=(
            Form("{0} / {1}", _WHOLE, "{1}"),  # a quotient of integers is finite
            Form("{0} / {1}", are_numeric, f"{{1}} and {FINITE}"),
        ),
        portable=(Form("cast({0} AS DOUBLE) / {1}", are_reals),),
    ),
    declare(
        "mod", 2, _declare_number_operator("mod", "%", operator.mod), _infer_remainder, _can_division_fail,
        symbol="%", call="a % b", about="a % b: the remainder, with the sign of b", example="[-7 % 3, 7 % -3]",
        cheap=True,
        sqlite=(
            # SQL's remainder has the sign of the dividend.
            Form("{0} % {1}", _are_nonnegative_types),
            Form("({0} % {1} + {1}) % {1}", lambda types: are_integers(types) and types[1].is_bounded(2**62)),
            Form("({0} % {1} + {1}) % {1}", are_integers,
                 only="{1} BETWEEN 1 AND 4611686018427387904 AND {0} IS NOT NULL"),
        ),
        python=(Form("{0} % {1}", are_numeric, "{1}"),),
        portable=(
            Form("{0} % {1}", lambda types: are_sql_integers(types) and _are_nonnegative_types(types)),
            Form("({0} % {1} + {1}) % {1}", lambda types: are_sql_integers(types) and types[1].is_bounded(2**61)),
        ),
    ),
    declare(
        "pow", 2, _compute_power, _infer_power, _can_power_fail,
        symbol="^", call="a ^ b", about="a ^ b: a to the power of b", example="[2 ^ 10, 2 ^ -1]",
        sqlite=(
            *(Form(_write_product(n), _match_power(n, are_integers), Check.SIZE) for n in range(1, MOST_FACTORS + 1)),
            # Of floats the function of C that Python calls, too: a product may round otherwise.
            *(Form("pow({0}, {1})", _match_power(n, each(Kind.FLOAT)), Check.SIZE) for n in range(2, MOST_FACTORS + 1)),
        ),
        python=(
            Form("{0} * {0}", _match_power(2, _WHOLE), f"{-SMALL} < {{0}} < {SMALL}"),  # a third of the time
            Form("{0} ** {1}", are_numeric),
        ),
        portable=tuple(Form(_write_product(n), _match_power(n, are_sql_integers)) for n in range(1, MOST_FACTORS + 1)),
    ),
    declare(
        "neg", 1, _negate_number, _infer_negated, can_sign_fail,
        call="neg(a)", about="-a: the number with the other sign", example="-(3)", cheap=True,
        # Subtracting from 0 gives 0.0 for 0.0 in place of -0.0; a product has the right sign.
        sqlite=(
            Form("-{0}", lambda types: are_integers(types) and not types[0].may_be(Kind.NONE)),
            Form("{0} * -1", are_numbers, Check.SIZE),
        ),
        python=(Form("-{0}", are_numeric, Check.SIZE),),
        portable=(Form("-{0}", are_sql_integers), Form("{0} * cast(-1 AS DOUBLE)", exactly(Kind.FLOAT))),
    ),
)  # fmt: skip


# --- comparisons and membership: `== != < <= > >= IN NOT IN`; all give a bool
def _declare_equality(name: str, symbol: str, negated: str, about: str, example: str) -> Operation:
    """The row of `==` or `!=`, for any two values; the SQL compiler has code of its own for handles and worlds."""
    values: dict[str, Callable[[Any, Any], bool]] = {
        "eq": lambda left, right: bool(left == right),
        "ne": lambda left, right: not left == right,  # noqa: SIM201 - an object may have no !=
    }
    return declare(
        name, 2, values[name], BOOL, False,
        symbol=symbol, call=f"a {symbol} b", about=about, example=example, cheap=True, negated=negated,
        python=(Form(f"{{0}} {symbol} {{1}}"),), by_hand=frozenset({"sqlite", "portable"}),
    )  # fmt: skip


def _make_order(name: str, symbol: str, compute: Callable[[Any, Any], bool], negated: str, example: str) -> Operation:
    """The row of `< <= > >=`, within numbers, within strings and within lists."""

    def compare_order(left: Any, right: Any) -> bool:
        return compute(*find_ordering_pair(left, right, symbol))

    compare_order.__name__ = name
    text = f"{{0}} {symbol} {{1}}"
    return declare(
        name, 2, compare_order, BOOL, lambda types: not are_comparable(*types),
        symbol=symbol, call=f"a {symbol} b", about=f"a {symbol} b", example=example, cheap=True,
        negated=negated,
        sqlite=(Form(text, have_one_sql_class, Check.NOT_NULL),),  # None has no order
        python=(Form(text, are_orderable), Form(text, can_be_numbers, Check.NUMBERS)),
        portable=(Form(text, _are_ordered_types),),
    )  # fmt: skip


def _are_ordered_types(types: Types) -> bool:
    return any(exactly(kind)(types) for kind in (Kind.STR, Kind.INT, Kind.FLOAT)) or are_sql_number_types(types)


def contains_element(item: Any, container: Any) -> bool:
    """An element of a list, a key of a dict, a part of a string."""
    kind = type(container)
    if kind is list:
        return item in container
    if kind is dict:
        return has_dict_key(container, make_dict_key(item))
    if kind is str and type(item) is str:
        return item in container
    hint = "IN looks for a string in a string, an element in a list or a key in a dict"
    raise ExecutionError("X001", f"cannot look for {format_value(item)} in {format_value(container)}", hints=(hint,))


def _compute_not_in(item: Any, container: Any) -> bool:
    return not contains_element(item, container)


def _declare_membership(
    name: str, symbol: str, value: Callable[..., bool], negated: str, text: str, **others: str
) -> Operation:
    return declare(
        name, 2, value, BOOL, lambda types: not types[1].is_only(Kind.LIST | Kind.DICT) and not each(Kind.STR)(types),
        symbol=symbol, call=f"a {symbol} b", negated=negated,
        python=(Form(text, lambda types: types[1].is_only(Kind.LIST) or each(Kind.STR)(types)),),
        by_hand=frozenset({"sqlite", "portable"}),  # lists are written out, walked or packed
        **others,
    )  # fmt: skip


COMPARISONS = (
    _make_order("lt", "<", operator.lt, "ge", "[1 < 2, 'a' < 'B', [1, 2] < [1, 3]]"),
    _make_order("le", "<=", operator.le, "gt", "2 <= 2"),
    _declare_equality("eq", "==", "ne", "a == b: whether the values are equal", "[1 == 1.0, [1] == [1.0], '1' == 1]"),
    _declare_equality("ne", "!=", "eq", "a != b: whether the values differ", "None != 0"),
    _make_order("ge", ">=", operator.ge, "lt", "1 >= 2"),
    _make_order("gt", ">", operator.gt, "le", "'b' > 'a'"),
    _declare_membership(
        "in", "IN", contains_element, "not_in", "{0} in {1}",
        about="a IN b: b is a list, a dict or a string", example="[2 IN [1, 2], 'b' IN 'abc']",
    ),
    _declare_membership(
        "not_in", "NOT IN", _compute_not_in, "in", "{0} not in {1}", about="a NOT IN b", example="3 NOT IN [1, 2]"
    ),
)  # fmt: skip

OPERATIONS = (*ARITHMETIC, *COMPARISONS)

"""Comparisons and membership: `== != < <= > >= IN NOT IN`. All give a bool."""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from ss2sql.errors import ExecutionError
from ss2sql.language.conversion import format_value
from ss2sql.language.kinds import BOOL, Kind
from ss2sql.language.operations.arithmetic import are_sql_number_types, can_be_numbers
from ss2sql.language.operations.intervals import are_comparable
from ss2sql.language.operations.operation import (
    Check,
    Form,
    Operation,
    Types,
    are_orderable,
    declare,
    each,
    exactly,
    have_one_sql_class,
)
from ss2sql.language.values import find_ordering_pair, has_dict_key, make_dict_key


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


OPERATIONS = (
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

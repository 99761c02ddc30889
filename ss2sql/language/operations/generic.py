"""Functions of any value."""

from __future__ import annotations

from typing import Any

from ss2sql.language.cancellation import iterate_checked
from ss2sql.language.kinds import BOOL, NONE, STR, Kind, Opaque, Type, unite
from ss2sql.language.operations.lists import are_not_lists
from ss2sql.language.operations.operation import Form, Types, check_list, declare, have_one_sql_class, remove_none_kind
from ss2sql.language.values import get_truth


def _compute_coalesce(*values: Any) -> Any:
    return next((value for value in values if value is not None), None)


def _infer_coalesce(types: Types) -> Type:
    """The type of `coalesce`: arguments after one that is never None are ignored."""
    found: list[Type] = []
    for kind in types:
        found.append(remove_none_kind(kind) if kind.may_be(Kind.NONE) else kind)
        if not kind.may_be(Kind.NONE):
            return unite(found)
    return unite((*found, NONE))


def _in_sql(types: Types) -> bool:
    """Whether all arguments are of one class in SQL; a bool is none: a flag alone, a handle beside None."""
    return have_one_sql_class(types) and not any(kind.may_be(Kind.BOOL) for kind in types)


def _any_true(values: Any) -> bool:
    return any(map(get_truth, iterate_checked(check_list("any", values))))


def _all_true(values: Any) -> bool:
    return all(map(get_truth, iterate_checked(check_list("all", values))))


def _compute_type_name(value: Any) -> str:
    value = value.object if isinstance(value, Opaque) else value
    return "None" if value is None else type(value).__name__


OPERATIONS = (
    declare(
        "coalesce", (1, None), _compute_coalesce, _infer_coalesce, False, call="coalesce(a, b, ...)",
        about="the first argument that is not None", example="coalesce(None, 0, 1)",
        sqlite=(Form("coalesce({0}, {1})", lambda types: len(types) == 2 and _in_sql(types)),),
        python=(
            Form("{0}", lambda types: not types[0].may_be(Kind.NONE)),
            Form("{0} if {0} is not None else {1}", lambda types: len(types) == 2),
        ),
    ),
    declare(
        "any", 1, _any_true, BOOL, are_not_lists, call="any(list)", about="whether an element of the list is true",
        example="[any([0, 2]), any([])]",
    ),
    declare(
        "all", 1, _all_true, BOOL, are_not_lists, call="all(list)", about="whether all elements of the list are true",
        example="[all([0, 2]), all([])]",
    ),
    declare(
        "type", 1, _compute_type_name, STR, False, call="type(x)", about="the name of a value's type",
        example="[type(1.5), type('a'), type(None)]",
    ),
)  # fmt: skip

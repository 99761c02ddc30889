"""Equality and membership, which have no forms, each under the types for which its meaning is the same.

Every entry gives the SQL of a call that cannot fail, or None where the types do not promise enough. Numbers are BIGINT
and DOUBLE: integers beside floats only as far as floats hold them. Texts are compared by code point.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias

from sqlglot import exp

from ss2sql.language import plan
from ss2sql.language.kinds import NOTHING, Kind, Type
from ss2sql.language.operations import OPERATIONS
from ss2sql.lowering import sql_builder
from ss2sql.lowering.portable.sql_types import get_column_type, is_exact_as_float, is_nullable

if TYPE_CHECKING:
    from ss2sql.lowering.portable.portable_expressions import PortableExpressions, PortableScope

Node: TypeAlias = exp.Expr
WriteFunction: TypeAlias = "Callable[[PortableExpressions, plan.Call, PortableScope], Node | None]"


def _are_comparable(left: Type, right: Type) -> bool:
    """Whether both have one type in SQL, or are numbers that compare exactly."""
    one, other = (Type(kind.kinds & ~Kind.NONE, kind.low, kind.high, kind.item) for kind in (left, right))
    return get_column_type(one) == get_column_type(other) is not None or (
        is_exact_as_float(one) and is_exact_as_float(other)
    )


def _write_equality(of: PortableExpressions, call: plan.Call, scope: PortableScope) -> Node | None:
    equal = call.function.name == "eq"
    nodes = [of.lower_value(argument, scope) for argument in call.arguments]
    for known, other in (nodes, reversed(nodes)):
        if isinstance(known, exp.Null):
            test: Node = exp.Is(this=sql_builder.wrap_operand(other), expression=exp.Null())
            return test if equal else exp.Not(this=test)
    left, right = (argument.type for argument in call.arguments)
    if not _are_comparable(left, right):
        return None
    if is_nullable(left) or is_nullable(right):
        return sql_builder.binary(exp.NullSafeEQ if equal else exp.NullSafeNEQ, *nodes)
    return sql_builder.binary(exp.EQ if equal else exp.NEQ, *nodes)


def _write_membership(of: PortableExpressions, call: plan.Call, scope: PortableScope) -> Node | None:
    item, container = call.arguments
    test: Node
    if item.type.kinds == Kind.STR == container.type.kinds:
        text, part = of.lower_value(container, scope), of.lower_value(item, scope)
        test = exp.Contains(this=text, expression=part)
    else:
        inner = container.type.item or NOTHING
        if not _are_comparable(item.type, inner) or is_nullable(item.type):
            return None
        if get_column_type(item.type) != get_column_type(inner) and not isinstance(container, plan.Constant):
            return None
        if isinstance(container, plan.Subquery):
            if is_nullable(inner):
                return None
            rows = exp.Subquery(this=of.write_rows(container.query))
            test = exp.In(this=sql_builder.wrap_operand(of.lower_value(item, scope)), query=rows)
        elif isinstance(values := of.lower_value(container, scope), exp.Array):
            test = exp.In(this=sql_builder.wrap_operand(of.lower_value(item, scope)), expressions=values.expressions)
        else:
            test = exp.ArrayContains(this=values, expression=of.lower_value(item, scope))
    return test if call.function.name == "in" else exp.Not(this=sql_builder.wrap_operand(test))


def _write_like(of: PortableExpressions, call: plan.Call, scope: PortableScope) -> Node | None:
    """LIKE; what a backslash means in its pattern is not the same everywhere."""
    pattern = call.arguments[1]
    if not isinstance(pattern, plan.Constant) or "\\" in pattern.value:
        return None
    text, known = (of.lower_value(argument, scope) for argument in call.arguments)
    test = exp.Like(this=sql_builder.wrap_operand(text), expression=known)
    return test if call.function.name == "like" else exp.Not(this=sql_builder.wrap_operand(test))


SPECIAL_OPERATIONS: dict[str, WriteFunction] = {
    "eq": _write_equality,
    "ne": _write_equality,
    "in": _write_membership,
    "not_in": _write_membership,
    "like": _write_like,
    "not_like": _write_like,
}

assert SPECIAL_OPERATIONS.keys() == {name for name, row in OPERATIONS.items() if "portable" in row.by_hand}

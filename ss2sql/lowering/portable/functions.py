"""Equality and membership, for which forms.py has no texts, each under the types for which its meaning is the same.

Every entry gives the SQL of a call that cannot fail, or None where the types do not promise enough. Numbers are BIGINT
and DOUBLE: integers beside floats only as far as floats hold them. Texts are compared by code point.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias

from sqlglot import exp

from ss2sql import plan
from ss2sql.kinds import NOTHING, Kind, Type
from ss2sql.language.operations import OPERATIONS
from ss2sql.lowering import sql
from ss2sql.lowering.portable.types import column_type, is_nullable, is_real

if TYPE_CHECKING:
    from ss2sql.lowering.portable.expressions import Portable, Sight

Node: TypeAlias = exp.Expr
Written: TypeAlias = "Callable[[Portable, plan.Call, Sight], Node | None]"


def _operands(of: Portable, call: plan.Call, sight: Sight) -> list[Node]:
    return [of.value(argument, sight) for argument in call.arguments]


def _types(call: plan.Call) -> list[Type]:
    return [argument.type for argument in call.arguments]


def _comparable(left: Type, right: Type) -> bool:
    """Whether both have one type in SQL, or are numbers that compare exactly."""
    one, other = (Type(kind.kinds & ~Kind.NONE, kind.low, kind.high, kind.item) for kind in (left, right))
    return column_type(one) == column_type(other) is not None or (is_real(one) and is_real(other))


def equality(equal: bool) -> Written:
    def write(of: Portable, call: plan.Call, sight: Sight) -> Node | None:
        nodes = _operands(of, call, sight)
        for known, other in (nodes, reversed(nodes)):
            if isinstance(known, exp.Null):
                test: Node = exp.Is(this=sql.operand(other), expression=exp.Null())
                return test if equal else exp.Not(this=test)
        types = _types(call)
        if not _comparable(*types):
            return None
        if any(map(is_nullable, types)):
            return sql.binary(exp.NullSafeEQ if equal else exp.NullSafeNEQ, *nodes)
        return sql.binary(exp.EQ if equal else exp.NEQ, *nodes)

    return write


def membership(found: bool) -> Written:
    def write(of: Portable, call: plan.Call, sight: Sight) -> Node | None:
        item, container = call.arguments
        test: Node
        if item.type.kinds == Kind.STR == container.type.kinds:
            text, part = of.value(container, sight), of.value(item, sight)
            test = exp.Contains(this=text, expression=part)
        else:
            inner = container.type.item or NOTHING
            if not _comparable(item.type, inner) or is_nullable(item.type):
                return None
            if column_type(item.type) != column_type(inner) and not isinstance(container, plan.Constant):
                return None
            if isinstance(container, plan.Subquery):
                if is_nullable(inner):
                    return None
                rows = exp.Subquery(this=of.rows_of(container.query))
                test = exp.In(this=sql.operand(of.value(item, sight)), query=rows)
                return test if found else exp.Not(this=test)
            values = of.value(container, sight)
            if isinstance(values, exp.Array):
                test = exp.In(this=sql.operand(of.value(item, sight)), expressions=values.expressions)
            else:
                test = exp.ArrayContains(this=values, expression=of.value(item, sight))
        return test if found else exp.Not(this=sql.operand(test))

    return write


def likeness(found: bool) -> Written:
    """LIKE; what a backslash means in its pattern is not the same everywhere."""

    def write(of: Portable, call: plan.Call, sight: Sight) -> Node | None:
        pattern = call.arguments[1]
        if not isinstance(pattern, plan.Constant) or "\\" in pattern.value:
            return None
        text, known = (of.value(argument, sight) for argument in call.arguments)
        test = exp.Like(this=sql.operand(text), expression=known)
        return test if found else exp.Not(this=sql.operand(test))

    return write


BY_HAND: dict[str, Written] = {
    "eq": equality(True),
    "ne": equality(False),
    "in": membership(True),
    "not_in": membership(False),
    "like": likeness(True),
    "not_like": likeness(False),
}

assert BY_HAND.keys() == {name for name, row in OPERATIONS.items() if "portable" in row.by_hand}

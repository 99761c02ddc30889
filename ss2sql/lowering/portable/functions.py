"""The built-in functions whose meaning SQL has everywhere, each under the types for which that holds.

Every entry gives the SQL of a call that cannot fail, or None where the types do not promise enough. Numbers are BIGINT
and DOUBLE: integers beside floats only as far as floats hold them. Texts are compared by code point.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from typing import TYPE_CHECKING, TypeAlias

from sqlglot import exp

from ss2sql import plan
from ss2sql.kinds import NOTHING, Kind, Type, union
from ss2sql.lowering import sql
from ss2sql.lowering.portable.types import cast, column_type, is_integer, is_nullable, is_real, typed
from ss2sql.walk import choices

if TYPE_CHECKING:
    from ss2sql.lowering.portable.expressions import Portable, Sight

Node: TypeAlias = exp.Expr
Written: TypeAlias = "Callable[[Portable, plan.Call, Sight], Node | None]"

MOST_FACTORS = 4


def _operands(of: Portable, call: plan.Call, sight: Sight) -> list[Node]:
    return [of.value(argument, sight) for argument in call.arguments]


def _types(call: plan.Call) -> list[Type]:
    return [argument.type for argument in call.arguments]


def arithmetic(kind: type[exp.Binary]) -> Written:
    def write(of: Portable, call: plan.Call, sight: Sight) -> Node | None:
        types = _types(call)
        if all(map(is_integer, types)) and is_integer(call.type):
            left, right = _operands(of, call, sight)
            return sql.binary(kind, left if right.find(exp.Column) else typed(left, "BIGINT"), right)
        if all(map(is_real, types)) and call.type.kinds == Kind.FLOAT:
            return sql.binary(kind, *_operands(of, call, sight))
        return None

    return write


def add(of: Portable, call: plan.Call, sight: Sight) -> Node | None:
    """The sum, or texts and lists one behind the other."""
    types = _types(call)
    if all(kind.kinds == Kind.STR for kind in types):
        return sql.binary(exp.DPipe, *_operands(of, call, sight))
    if all(kind.kinds == Kind.LIST for kind in types):
        first, second = _operands(of, call, sight)
        return exp.ArrayConcat(this=first, expressions=[second])
    return arithmetic(exp.Add)(of, call, sight)


def quotient(of: Portable, call: plan.Call, sight: Sight) -> Node | None:
    if not all(map(is_real, _types(call))):
        return None
    left, right = _operands(of, call, sight)
    if call.arguments[0].type.kinds == Kind.INT:
        left = cast(left, "DOUBLE")
    return exp.Div(this=sql.operand(left), expression=sql.operand(right), typed=True)


def modulo(of: Portable, call: plan.Call, sight: Sight) -> Node | None:
    """The remainder has the sign of the divisor; in SQL it has that of the dividend."""
    if not all(map(is_integer, _types(call))):
        return None
    left, right = _operands(of, call, sight)
    dividend, divisor = _types(call)
    remainder = sql.binary(exp.Mod, typed(left, "BIGINT"), right)
    if dividend.at_least(0) and divisor.at_least(1):
        return remainder
    if not divisor.bounded(2**61):
        return None
    return sql.binary(exp.Mod, sql.binary(exp.Add, remainder, right.copy()), right.copy())


def power(of: Portable, call: plan.Call, sight: Sight) -> Node | None:
    base, exponent = call.arguments
    times = exponent.value if isinstance(exponent, plan.Constant) else None
    if type(times) is not int or not 1 <= times <= MOST_FACTORS or not is_integer(base.type):
        return None
    node = of.value(base, sight)
    factors = [typed(node, "BIGINT"), *(node.copy() for _ in range(times - 1))]
    return reduce(lambda product, factor: sql.binary(exp.Mul, product, factor), factors)


def negation(of: Portable, call: plan.Call, sight: Sight) -> Node | None:
    (kind,) = _types(call)
    (node,) = _operands(of, call, sight)
    if is_integer(kind):
        return exp.Neg(this=sql.operand(node))
    # A product keeps the sign of zero.
    return sql.binary(exp.Mul, node, cast(sql.number(-1), "DOUBLE")) if kind.kinds == Kind.FLOAT else None


def absolute(of: Portable, call: plan.Call, sight: Sight) -> Node | None:
    (kind,) = _types(call)
    if not is_integer(kind) and kind.kinds != Kind.FLOAT:
        return None
    return exp.Abs(this=of.value(call.arguments[0], sight))


def root(of: Portable, call: plan.Call, sight: Sight) -> Node | None:
    return exp.Sqrt(this=of.value(call.arguments[0], sight)) if is_real(_types(call)[0]) else None


def extreme(name: str) -> Written:
    def write(of: Portable, call: plan.Call, sight: Sight) -> Node | None:
        chosen = choices(call)
        kind = union(argument.type for argument in chosen).kinds
        # Of 0.0 and -0.0 it would matter which.
        if not chosen or kind not in (Kind.INT, Kind.STR):
            return None
        nodes = [of.value(argument, sight) for argument in chosen]
        return nodes[0] if len(nodes) == 1 else exp.Anonymous(this=name, expressions=nodes)

    return write


# --- comparisons ---------------------------------------------------------------------------------------


def _comparable(left: Type, right: Type) -> bool:
    """Whether both have one type in SQL, or are numbers that compare exactly."""
    one, other = (Type(kind.kinds & ~Kind.NONE, kind.low, kind.high, kind.item) for kind in (left, right))
    return column_type(one) == column_type(other) is not None or (is_real(one) and is_real(other))


def order(kind: type[exp.Binary]) -> Written:
    def write(of: Portable, call: plan.Call, sight: Sight) -> Node | None:
        types = _types(call)
        ordered = all(one.kinds in (Kind.INT, Kind.FLOAT, Kind.STR) for one in types)
        return sql.binary(kind, *_operands(of, call, sight)) if ordered and _comparable(*types) else None

    return write


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
            values = of.value(container, sight)
            if isinstance(values, exp.Array):
                test = exp.In(this=sql.operand(of.value(item, sight)), expressions=values.expressions)
            else:
                test = exp.ArrayContains(this=values, expression=of.value(item, sight))
        return test if found else exp.Not(this=sql.operand(test))

    return write


# --- texts and lists -----------------------------------------------------------------------------------


def length(of: Portable, call: plan.Call, sight: Sight) -> Node | None:
    (kind,) = _types(call)
    if kind.kinds not in (Kind.STR, Kind.LIST):
        return None
    node = of.value(call.arguments[0], sight)
    counted = exp.Length(this=node) if kind.kinds == Kind.STR else exp.ArraySize(this=node)
    return cast(counted, "BIGINT")


def part_of(of: Portable, call: plan.Call, sight: Sight) -> Node | None:
    """`text[i:j]` with indexes that do not count from the end."""
    kind, low, high = _types(call)
    if kind.kinds != Kind.STR or not all(is_integer(end) and end.at_least(0) for end in (low, high)):
        return None
    text, start, end = _operands(of, call, sight)
    first = _shifted(start)
    size = _difference(call.arguments[1], call.arguments[2])
    if size is not None:
        return exp.Substring(this=text, start=first, length=sql.number(size))
    count = end if _is(start, 0) else sql.binary(exp.Sub, end, start.copy())
    if not (low.high is not None and high.low is not None and high.low >= low.high):
        count = exp.Anonymous(this="GREATEST", expressions=[count, sql.number(0)])
    return exp.Substring(this=text, start=first, length=count)


def _difference(start: plan.Expr, end: plan.Expr) -> int | None:
    """How much further the end is, where it is written as the start and a number: `text[i:i+1]`."""
    match end:
        case plan.Call(function=plan.Function(name="add", builtin=True), arguments=(base, plan.Constant(value=int(n)))):
            return n if base == start and n >= 0 else None
    return None


def _shifted(index: Node) -> Node:
    """An index counted from 1."""
    match index:
        case exp.Literal():
            return sql.number(int(index.this) + 1)
        case exp.Add(this=base, expression=exp.Literal(is_string=False) as number):
            return sql.binary(exp.Add, base, sql.number(int(number.this) + 1))
    return sql.binary(exp.Add, index, sql.number(1))


def _is(node: Node, number: int) -> bool:
    return isinstance(node, exp.Literal) and node.this == str(number)


def item(of: Portable, call: plan.Call, sight: Sight) -> Node | None:
    """`list[i]`, where the types promise that there is one."""
    kind, index = _types(call)
    if kind.kinds != Kind.LIST or not is_integer(index) or not index.at_least(0):
        return None
    values, place = _operands(of, call, sight)
    return exp.Anonymous(this="LIST_EXTRACT", expressions=[values, _shifted(place)])


FUNCTIONS: dict[str, Written] = {
    "add": add,
    "sub": arithmetic(exp.Sub),
    "mul": arithmetic(exp.Mul),
    "div": quotient,
    "mod": modulo,
    "pow": power,
    "neg": negation,
    "abs": absolute,
    "sqrt": root,
    "min": extreme("LEAST"),
    "max": extreme("GREATEST"),
    "lt": order(exp.LT),
    "le": order(exp.LTE),
    "ge": order(exp.GTE),
    "gt": order(exp.GT),
    "eq": equality(True),
    "ne": equality(False),
    "in": membership(True),
    "not_in": membership(False),
    "len": length,
    "slice": part_of,
    "item": item,
}

"""Built-in functions, and operators that SQLite has no sign for, as SQLite's own functions; see operators.py.

Each form gives exactly what Python's gives, the sign of zero and which of two equal numbers comes out included.
What is rounded in the last place by another rule (`round`, powers of floats, distances of points) is not here.
"""

from __future__ import annotations

from functools import reduce
from typing import TYPE_CHECKING

from sqlglot import exp

from ss2sql import plan
from ss2sql.kinds import Kind, union
from ss2sql.lowering import sql
from ss2sql.lowering.classes import MOST_FACTORS, WHOLE, class_of, is_number, may_repeat
from ss2sql.lowering.names import SQLITE_FUNCTIONS
from ss2sql.lowering.sql import Node
from ss2sql.walk import choices

if TYPE_CHECKING:
    from ss2sql.lowering.expressions import Env, Expressions
    from ss2sql.lowering.operators import Native


def _number(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    """The only argument, where it is a number for which the function cannot fail."""
    if call.function.raises or len(call.arguments) != 1 or not is_number(call.arguments[0].type):
        return None
    return lowering.lower(call.arguments[0], env)


def _cast(node: Node, kind: str) -> Node:
    return exp.Cast(this=node, to=exp.DataType.build(kind, dialect="sqlite"))


def _plus(node: Node, number: float) -> Node:
    return sql.binary(exp.Add, node, sql.number(number))


def absolute(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    """SQLite's abs(-0.0) is -0.0; adding 0 makes it 0.0 and changes nothing else."""
    node = _number(lowering, call, env)
    if node is None:
        return None
    size = sql.call("abs", node)
    return _plus(size, 0) if call.arguments[0].type.may(Kind.FLOAT) else size


def square_root(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    """IEEE 754 demands the nearest float of a root, so all roots are the same."""
    node = _number(lowering, call, env) if "sqrt" in SQLITE_FUNCTIONS else None
    return None if node is None else sql.call("sqrt", node)


def to_integer(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    """A cast cuts the fraction off, too; floats beyond 64 bits would fail."""
    node = _number(lowering, call, env)
    return node if node is None or call.arguments[0].type.only(WHOLE) else _cast(node, "INTEGER")


def to_float(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    node = _number(lowering, call, env)
    return node if node is None or call.arguments[0].type.only(Kind.FLOAT) else _cast(node, "REAL")


def text(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    """Integers look the same everywhere; Python's floats, bools and None do not."""
    kind = call.arguments[0].type
    if kind.kinds not in (Kind.INT, Kind.STR):
        return None
    node = lowering.lower(call.arguments[0], env)
    return _cast(node, "TEXT") if kind.kinds == Kind.INT else node


def distance(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    """Of two numbers; adding 0.0 makes a float of an integer."""
    kinds = [argument.type for argument in call.arguments]
    if call.function.raises or not all(map(is_number, kinds)):
        return None
    if any(kind.may(Kind.INT) and not kind.bounded(2**61) for kind in kinds):
        return None  # the difference has to be an exact integer
    left, right = (lowering.lower(argument, env) for argument in call.arguments)
    return _plus(sql.call("abs", sql.binary(exp.Sub, left, right)), 0.0)


def length(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    """SQLite counts characters up to the first NUL only, so a text with one in it is left to Python."""
    if call.arguments[0].type.kinds != Kind.STR:
        return None
    node = lowering.lower(call.arguments[0], env)
    if not may_repeat(node):
        return None
    nul = sql.call("instr", node, sql.call("char", sql.number(0)))
    return sql.case([(nul, lowering.python(call, [node.copy()]))], sql.call("length", node.copy()))


def extreme(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    """`min` and `max` of numbers, or of strings: of several arguments, or of a list literal.

    Of equal ones Python takes the first. So does SQLite's max, but its min takes the last.
    """
    arguments = choices(call)
    if call.function.raises or not arguments or class_of(union(a.type for a in arguments)) is None:
        return None
    nodes = [lowering.lower(argument, env) for argument in arguments]
    if call.function.name == "min" and any(argument.type.may(Kind.FLOAT) for argument in arguments):
        nodes.reverse()
    return nodes[0] if len(nodes) == 1 else sql.call(call.function.name, *nodes)


def modulo(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    """Python's remainder has the sign of the divisor, SQLite's that of the dividend."""
    left, right = (argument.type for argument in call.arguments)
    if call.function.raises or not all(kind.only(WHOLE) and is_number(kind) for kind in (left, right)):
        return None
    dividend, divisor = (lowering.lower(argument, env) for argument in call.arguments)
    remainder = sql.binary(exp.Mod, dividend, divisor)
    if left.at_least(0) and right.at_least(1):
        return remainder
    if not right.bounded(2**62) or not may_repeat(divisor):
        return None
    return sql.binary(exp.Mod, sql.binary(exp.Add, remainder, divisor.copy()), divisor.copy())


def power(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    """Of integers with a small constant exponent, as a product."""
    base, exponent = call.arguments
    times = exponent.value if isinstance(exponent, plan.Constant) else None
    if call.function.raises or type(times) is not int or not 1 <= times <= MOST_FACTORS:
        return None
    if not base.type.only(WHOLE) or not is_number(base.type):
        return None
    node = lowering.lower(base, env)
    if times > 1 and not may_repeat(node):
        return None
    return reduce(lambda product, factor: sql.binary(exp.Mul, product, factor), [node.copy() for _ in range(times)])


def negation(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    """SQLite subtracts from 0, which gives 0.0 for 0.0 in place of -0.0; a product has the right sign."""
    node = _number(lowering, call, env)
    if node is None:
        return None
    if call.arguments[0].type.may(Kind.FLOAT):
        return sql.binary(exp.Mul, node, sql.number(-1))
    return exp.Neg(this=sql.operand(node))


FUNCTIONS: dict[str, Native] = {
    "abs": absolute,
    "distance": distance,
    "float": to_float,
    "int": to_integer,
    "len": length,
    "max": extreme,
    "min": extreme,
    "mod": modulo,
    "neg": negation,
    "pow": power,
    "sqrt": square_root,
    "str": text,
}

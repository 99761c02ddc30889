"""Arithmetic and comparisons that may fail: SQLite computes them, and leaves to Python what could come out otherwise.

    a + b         CASE WHEN a + b BETWEEN -4611686018427387904 AND 4611686018427387904
                  THEN a + b ELSE "add"(a, b, '1:8') END
    a < b         coalesce(a < b, lt(a, b, '1:8'))

So it is where the types promise numbers, but not their size, or not that none of them is None: in columns of
tables, and in sums that grow. A sum of a million rows takes 0.06 s so and 0.5 s in Python.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import reduce
from typing import TYPE_CHECKING, TypeAlias

from sqlglot import exp

from ss2sql import plan
from ss2sql.kinds import Kind, Type
from ss2sql.lowering import sql
from ss2sql.lowering.classes import EXACT, MOST_FACTORS, WHOLE, class_of, may_repeat
from ss2sql.lowering.names import SQLITE_FUNCTIONS
from ss2sql.lowering.sql import Node
from ss2sql.walk import is_volatile

if TYPE_CHECKING:
    from ss2sql.lowering.expressions import Env, Expressions

Guarded: TypeAlias = "Callable[[Expressions, plan.Call, Env], Node | None]"

SAFE = 2**62  # an operation on integers that leaves 64 bits gives a float beyond
SAFE_FLOAT = 1e308
MOST_NODES = 60  # of an expression that is written twice: the distance of two points takes 45

_SIGNS: dict[str, type[exp.Binary]] = {"add": exp.Add, "sub": exp.Sub, "mul": exp.Mul}
_COMPARISONS: dict[str, type[exp.Binary]] = {"lt": exp.LT, "le": exp.LTE, "gt": exp.GT, "ge": exp.GTE}


def guarded(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    """The call with its guard; None where the types do not even promise numbers and None."""
    lower = GUARDED.get(call.function.name)
    return None if lower is None or is_volatile(call) else lower(lowering, call, env)


def _is_number(kind: Type) -> bool:
    return class_of(kind, none=True) == "number"


def _operands(lowering: Expressions, call: plan.Call, env: Env) -> list[Node] | None:
    """The operands, if they are numbers or None, and short enough to be written twice."""
    if not all(_is_number(argument.type) for argument in call.arguments):
        return None
    nodes = [lowering.lower(argument, env) for argument in call.arguments]
    return nodes if all(map(may_repeat, nodes)) else None


def _python(lowering: Expressions, call: plan.Call, env: Env) -> Node:
    return sql.rare(lowering.python(call, [lowering.value(argument, env) for argument in call.arguments]))


def _between(node: Node, low: float, high: float) -> Node:
    return exp.Between(this=sql.operand(node.copy()), low=sql.number(low), high=sql.number(high))


# --- sums and products ---------------------------------------------------------------------------------


def _arithmetic(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    """Sums and products, with one guard for a whole expression: a float stays one, and infinity stays beyond."""
    whole = call.type.kinds == Kind.INT
    if not (whole or call.type.kinds == Kind.FLOAT) or not _is_inner(call, call.type.kinds):
        return None
    node = _tree(lowering, call, env, call.type.kinds)
    if node is None or not may_repeat(node, MOST_NODES):
        return None
    otherwise = sql.rare(_calls(lowering, call, env))
    if not whole:
        return sql.case([(_between(node, -SAFE_FLOAT, SAFE_FLOAT), node)], otherwise)
    if not any(_is_inner(argument, Kind.INT) for argument in call.arguments):
        return sql.case([(_between(node, -SAFE, SAFE), node)], otherwise)
    is_whole = sql.binary(exp.EQ, sql.call("typeof", node.copy()), sql.string("integer"))
    return sql.case([(is_whole, node)], otherwise)


def _is_inner(expr: plan.Expr, kinds: Kind) -> bool:
    """Whether an operand is computed under the guard of the whole expression."""
    if not isinstance(expr, plan.Call) or not expr.function.builtin or not expr.function.raises:
        return False
    name = expr.function.name
    return expr.type.kinds == kinds and (name in _SIGNS or name == "neg" or (name == "pow" and _factors(expr) > 0))


def _factors(power: plan.Call) -> int:
    """How many factors stand for a power of integers; 0 where its exponent is no small constant."""
    base, exponent = power.arguments
    times = exponent.value if isinstance(exponent, plan.Constant) else None
    return times if type(times) is int and 1 <= times <= MOST_FACTORS and base.type.only(WHOLE | Kind.NONE) else 0


def _calls(lowering: Expressions, expr: plan.Expr, env: Env) -> Node:
    """The same with a Python call for every operator."""
    if not isinstance(expr, plan.Call) or not _is_inner(expr, expr.type.kinds):
        return lowering.value(expr, env)
    return lowering.python(expr, [_calls(lowering, argument, env) for argument in expr.arguments])


def _tree(lowering: Expressions, expr: plan.Expr, env: Env, kinds: Kind) -> Node | None:
    stands_in_column = any(known == expr for known, _ in env.known)
    if not isinstance(expr, plan.Call) or not _is_inner(expr, kinds) or stands_in_column:
        return lowering.lower(expr, env) if _is_number(expr.type) else None
    if expr.function.name == "pow":
        base = _tree(lowering, expr.arguments[0], env, kinds)
        if base is None or not may_repeat(base):
            return None
        return reduce(lambda product, _: sql.binary(exp.Mul, product, base.copy()), range(_factors(expr) - 1), base)
    operands = [_tree(lowering, argument, env, kinds) for argument in expr.arguments]
    match operands:
        case [exp.Expr() as left, exp.Expr() as right]:
            return sql.binary(_SIGNS[expr.function.name], left, right)
        case [exp.Expr() as single]:
            # SQLite's own minus makes 0.0 of 0.0.
            return sql.binary(exp.Mul, single, sql.number(-1))
        case _:
            return None


# --- the others ----------------------------------------------------------------------------------------


def _comparison(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    """Of numbers, or of strings, with None among them, which has no order."""
    classes = {class_of(argument.type, none=True) for argument in call.arguments}
    if len(classes) > 1 or None in classes:
        return None
    nodes = [lowering.lower(argument, env) for argument in call.arguments]
    if not all(map(may_repeat, nodes)):
        return None
    return sql.call("coalesce", sql.binary(_COMPARISONS[call.function.name], *nodes), _python(lowering, call, env))


def _division(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    """Division by zero gives NULL in SQLite, which lies between no bounds."""
    nodes = _operands(lowering, call, env)
    if nodes is None:
        return None
    left, right = nodes
    quotient = sql.quotient(left, right)
    python = _python(lowering, call, env)
    exact = [argument.type.bounded(EXACT) or not argument.type.may(Kind.INT) for argument in call.arguments]
    if all(exact) and not call.arguments[1].type.may(Kind.FLOAT):
        return sql.call("coalesce", quotient, python)  # what is divided by 1 or more stays finite
    tests = [_between(quotient, -SAFE_FLOAT, SAFE_FLOAT)]
    tests += [_between(node, -EXACT, EXACT) for node, is_exact in zip(nodes, exact, strict=True) if not is_exact]
    condition = sql.conjunction(tests)
    assert condition is not None
    return sql.case([(condition, quotient)], python)


def _modulo(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    nodes = _operands(lowering, call, env)
    if nodes is None or not all(a.type.only(Kind.BOOL | Kind.INT | Kind.NONE) for a in call.arguments):
        return None
    left, right = nodes
    remainder = sql.binary(exp.Mod, left, right)
    found = sql.binary(exp.Mod, exp.Paren(this=sql.binary(exp.Add, remainder, right.copy())), right.copy())
    known = exp.And(
        this=_between(right, 1, SAFE),
        expression=exp.Not(this=exp.Is(this=sql.operand(left.copy()), expression=sql.null())),
    )
    return sql.case([(known, found)], _python(lowering, call, env))


def _root(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    nodes = _operands(lowering, call, env) if "sqrt" in SQLITE_FUNCTIONS else None
    if nodes is None:
        return None
    known = sql.binary(exp.GTE, nodes[0], sql.number(0))
    return sql.case([(known, sql.call("sqrt", nodes[0].copy()))], _python(lowering, call, env))


def _size(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    """`abs`; there is one integer more below zero than above. Adding 0 makes 0.0 of -0.0."""
    nodes = _operands(lowering, call, env)
    if nodes is None:
        return None
    known = sql.binary(exp.GTE, nodes[0], sql.number(-(2**63) + 1))
    size = sql.binary(exp.Add, sql.call("abs", nodes[0].copy()), sql.number(0))
    return sql.case([(known, size)], _python(lowering, call, env))


def _to_integer(lowering: Expressions, call: plan.Call, env: Env) -> Node | None:
    nodes = _operands(lowering, call, env)
    if nodes is None:
        return None
    cast = exp.Cast(this=nodes[0].copy(), to=exp.DataType.build("INTEGER", dialect="sqlite"))
    return sql.case([(_between(nodes[0], -SAFE, SAFE), cast)], _python(lowering, call, env))


GUARDED: dict[str, Guarded] = {
    "add": _arithmetic,
    "sub": _arithmetic,
    "mul": _arithmetic,
    "neg": _arithmetic,
    "pow": _arithmetic,
    **dict.fromkeys(_COMPARISONS, _comparison),
    "div": _division,
    "mod": _modulo,
    "sqrt": _root,
    "abs": _size,
    "int": _to_integer,
}

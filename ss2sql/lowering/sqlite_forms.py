"""The forms of operations in SQLite, and what they are checked by.

    Form("{0} + {1}", check=SIZE)          CASE WHEN a + b BETWEEN -4611686018427387904 AND 4611686018427387904
                                           THEN a + b ELSE "add"(a, b, '1:8') END
    Form("{0} < {1}", check=NOT_NULL)      coalesce(a < b, lt(a, b, '1:8'))
    Form("sqrt({0})", check="{0} >= 0")    CASE WHEN a >= 0 THEN sqrt(a) ELSE sqrt_of(a, '1:8') END

So it is where the types promise numbers, but not their size, or not that none of them is None: in columns of tables,
and in sums that grow. A sum of a million rows takes 0.06 s so and 0.5 s in Python. What stands in the text more than
once is written more than once, so it has to be short; see `may_repeat`.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING

from sqlglot import exp

from ss2sql.language import plan
from ss2sql.language.kinds import Kind
from ss2sql.language.operations import GROUPS, OPERATIONS, Check, Form
from ss2sql.language.operations.operation import find_sql_class
from ss2sql.language.plan_traversal import is_volatile, list_choices
from ss2sql.lowering import sql_builder
from ss2sql.lowering.operation_forms import fill_operands
from ss2sql.lowering.sql_builder import Node
from ss2sql.lowering.sql_names import SQLITE_FUNCTIONS
from ss2sql.lowering.storage_class import can_repeat

if TYPE_CHECKING:
    from ss2sql.lowering.sqlite_expressions import ExpressionLowering, SqlScope

MAX_SAFE_INTEGER = 2**62  # an operation on integers that leaves 64 bits gives a float beyond
MAX_SAFE_FLOAT = 1e308
MAX_CHECKED_NODES = 60  # of an expression that is written twice: the distance of two points takes 45


# --- calls ---------------------------------------------------------------------------------------------


def lower_unchecked(lowering: ExpressionLowering, call: plan.Call, env: SqlScope) -> Node | None:
    """A call by a form that needs no check."""
    form = _choose_form(call)
    return None if form is None or _get_check(form, call) else _write_form(form, call, lowering, env)


def lower_checked(lowering: ExpressionLowering, call: plan.Call, env: SqlScope) -> Node | None:
    """A call by a form with a check; where that does not hold, Python is called."""
    form = _choose_form(call)
    test = form and _get_check(form, call)
    if form is None or not test or is_volatile(call):
        return None
    if test is Check.SIZE:
        return lower_size_checked(lowering, call, env)
    operands = [lowering.lower_expr(argument, env) for argument in call.arguments]
    if not all(map(can_repeat, operands)):
        return None
    value = fill_operands(str(form.text), operands)
    otherwise = sql_builder.mark_as_rare(
        lowering.call_python(call, [lowering.lower_value(argument, env) for argument in call.arguments])
    )
    if test is Check.NOT_NULL:
        return sql_builder.call("coalesce", value, otherwise)
    assert isinstance(test, str), f"SQL has no {test}"
    return sql_builder.case([(fill_operands(test, operands, value), value)], otherwise)


def _choose_form(call: plan.Call) -> Form | None:
    """The first form that fits; one without a check where the call cannot fail."""
    for form in OPERATIONS[call.function.name].sqlite:
        operands = _get_operands(form, call)
        fits = operands and form.when([argument.type for argument in operands])
        if fits and (_get_check(form, call) or not call.function.raises) and _find_functions(form) <= SQLITE_FUNCTIONS:
            return form
    return None


def _get_check(form: Form, call: plan.Call) -> str | Check | None:
    return form.only or (form.check if call.function.raises else None)


def _get_operands(form: Form, call: plan.Call) -> Sequence[plan.Expr]:
    return list_choices(call) if form.spread else call.arguments


def _write_form(form: Form, call: plan.Call, lowering: ExpressionLowering, env: SqlScope) -> Node | None:
    operands = [lowering.lower_expr(argument, env) for argument in _get_operands(form, call)]
    text = str(form.text)
    often = [operand for index, operand in enumerate(operands) if text.count(f"{{{index}}}") > 1]
    return fill_operands(text, operands) if all(map(can_repeat, often)) else None


@cache
def _find_functions(form: Form) -> frozenset[str]:
    texts = [text for text in (form.text, form.check, form.only) if isinstance(text, str)]
    return frozenset(name for text in texts for name in re.findall(r'\b([a-z_0-9]+)"?\(', text)) - {"cast"}


# --- sums and products ---------------------------------------------------------------------------------


def lower_size_checked(lowering: ExpressionLowering, call: plan.Call, env: SqlScope) -> Node | None:
    """Sums and products, with one check for a whole expression: a float stays one, and infinity stays beyond."""
    whole = call.type.kinds == Kind.INT
    if not (whole or call.type.kinds == Kind.FLOAT):
        return None
    node = _lower_chain(lowering, call, env, call.type.kinds)
    if node is None or not can_repeat(node, MAX_CHECKED_NODES):
        return None
    otherwise = sql_builder.mark_as_rare(_call_python_operators(lowering, call, env))
    if not whole:
        return sql_builder.case([(_build_between(node, MAX_SAFE_FLOAT), node)], otherwise)
    if not any(_choose_inner_form(argument, Kind.INT, env) for argument in call.arguments):
        return sql_builder.case([(_build_between(node, MAX_SAFE_INTEGER), node)], otherwise)
    is_whole = sql_builder.binary(exp.EQ, sql_builder.call("typeof", node.copy()), sql_builder.string("integer"))
    return sql_builder.case([(is_whole, node)], otherwise)


def _build_between(node: Node, limit: float) -> Node:
    return exp.Between(
        this=sql_builder.wrap_operand(node.copy()), low=sql_builder.number(-limit), high=sql_builder.number(limit)
    )


def _choose_inner_form(expr: plan.Expr, kinds: Kind, env: SqlScope) -> Form | None:
    """The form of an operand that is computed under the check of the whole expression, and is not known already."""
    if not isinstance(expr, plan.Call) or not expr.function.builtin or not expr.function.raises:
        return None
    if any(known == expr for known, _ in env.known):
        return None
    form = _choose_form(expr) if expr.type.kinds == kinds else None
    return form if form is not None and form.check is Check.SIZE else None


def _call_python_operators(lowering: ExpressionLowering, expr: plan.Expr, env: SqlScope) -> Node:
    """The same with a Python call for every operator."""
    if not isinstance(expr, plan.Call) or _choose_inner_form(expr, expr.type.kinds, env) is None:
        return lowering.lower_value(expr, env)
    return lowering.call_python(expr, [_call_python_operators(lowering, argument, env) for argument in expr.arguments])


def _lower_chain(lowering: ExpressionLowering, expr: plan.Expr, env: SqlScope, kinds: Kind) -> Node | None:
    form = _choose_inner_form(expr, kinds, env)
    if not isinstance(expr, plan.Call) or form is None:
        return lowering.lower_expr(expr, env) if find_sql_class(expr.type, none=True) == "number" else None
    text, operands = str(form.text), list[Node]()
    for index, argument in enumerate(expr.arguments):
        operand = _lower_chain(lowering, argument, env, kinds) if f"{{{index}}}" in text else sql_builder.null()
        if operand is None or (text.count(f"{{{index}}}") > 1 and not can_repeat(operand)):
            return None
        operands.append(operand)
    return fill_operands(text, operands)


# --- aggregates ----------------------------------------------------------------------------------------


def lower_aggregate(aggregate: plan.Aggregate, argument: Node) -> Node | None:
    """An aggregate that SQLite computes itself."""
    assert aggregate.argument is not None
    types = [aggregate.argument.type]
    form = next((form for form in GROUPS[aggregate.function].sqlite if form.when(types)), None)
    return None if form is None else fill_operands(str(form.text), [argument], dialect="sqlite groups")


def list_form_functions() -> frozenset[str]:
    """The functions of SQLite that forms call, so that statements may call them."""
    forms = [form for row in OPERATIONS.values() for form in (*row.sqlite, *(row.group.sqlite if row.group else ()))]
    return frozenset().union(*map(_find_functions, forms))

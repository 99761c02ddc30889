"""Equality, membership and elements: operators that sqlite_forms.py has no texts for.

Every entry takes the lowering, the call and the environment, and gives the SQL or None where the types do
not promise enough. Numbers compare exactly across int and float in SQLite, text compares by code point as
in Python; beyond that nothing is taken for granted: a table's column may carry an affinity, so operands of
different classes are never compared natively.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, TypeAlias

from sqlglot import exp

from ss2sql.language import plan
from ss2sql.language.kinds import Kind, Type
from ss2sql.language.operations import OPERATIONS
from ss2sql.language.plan_traversal import can_fail, is_column_query, is_exists
from ss2sql.lowering import sql_builder
from ss2sql.lowering.blob_encoding import EqualValueEncoding
from ss2sql.lowering.blob_index import lower_item, lower_membership
from ss2sql.lowering.sql_builder import Node
from ss2sql.lowering.storage_class import REAL_NUMBER, can_repeat, have_same_storage_class

if TYPE_CHECKING:
    from ss2sql.lowering.sqlite_expressions import ExpressionLowering, SqlScope

MAX_WRITTEN_MEMBERS = 30  # of a list that is written into the text

LowerFunction: TypeAlias = "Callable[[ExpressionLowering, plan.Call, SqlScope], Node | None]"


def _lower_operands(lowering: ExpressionLowering, call: plan.Call, scope: SqlScope) -> list[Node]:
    return [lowering.lower_expr(argument, scope) for argument in call.arguments]


def _has_one_form(kind: Type) -> bool:
    """Whether these are lists of which equal ones are the same: of integers, strings, None and such lists."""
    if kind.kinds != Kind.LIST or kind.item is None:
        return False
    return kind.item.is_only(Kind.INT | Kind.STR | Kind.NONE) or _has_one_form(kind.item)


def _is_bound_beforehand(expr: plan.Expr) -> bool:
    """Whether the value is bound before the statement runs."""
    from ss2sql.lowering.sqlite_expressions import is_run_constant

    return isinstance(expr, (plan.Constant, plan.Variable)) or (is_run_constant(expr) and not can_fail(expr))


def _compare_handles(lowering: ExpressionLowering, call: plan.Call, scope: SqlScope) -> Node | None:
    """Structured values that are compared by their handles, which saves a Python call of 0.4 us.

    Of one that is known beforehand, it is taken for granted that no value that equals it has another form; the
    interning notices when one turns up ([3.0] beside [3]), and the query runs again by one that compares values.
    """
    first, second = call.arguments
    nodes: list[Node] | None = None
    if _has_one_form(first.type) and _has_one_form(second.type):
        nodes = [lowering.lower_value(argument, scope) for argument in call.arguments]
    elif not lowering.needs.by_value:
        for known, other in ((first, second), (second, first)):
            if _is_bound_beforehand(known) and _has_one_form(known.type):
                nodes = [lowering.lower_value(other, scope), lowering.needs.bind_plain(known)]
                break
    if nodes is None:
        return None
    return sql_builder.binary(exp.NullSafeEQ if call.function.name == "eq" else exp.NullSafeNEQ, *nodes)


def _compare_with_equal_value(lowering: ExpressionLowering, call: plan.Call, scope: SqlScope) -> Node | None:
    """A number or a string that is compared with a variable of unknown kind: with the one that this equals.

    Then SQLite compares by itself, uses indexes, and passes the comparison on to worlds.
    """
    first, second = call.arguments
    for known, other in ((first, second), (second, first)):
        text = known.type.kinds == Kind.STR
        plain = text or known.type.is_only(REAL_NUMBER)
        if plain and isinstance(other, plan.Variable) and not isinstance(known, plan.Variable):
            bound = lowering.needs.bind_value(other, other.name, False, EqualValueEncoding(text))
            kind = exp.NullSafeEQ if call.function.name == "eq" else exp.NullSafeNEQ
            return sql_builder.binary(kind, lowering.lower_expr(known, scope), bound)
    return None


def _lower_equality(lowering: ExpressionLowering, call: plan.Call, scope: SqlScope) -> Node | None:
    left, right = (argument.type for argument in call.arguments)
    equal = call.function.name == "eq"
    for index, argument in enumerate(call.arguments):
        if isinstance(argument, plan.Constant) and argument.value is None:
            # None equals nothing but None, whatever the other side is.
            question = call.arguments[1 - index]
            if isinstance(question, plan.Subquery) and is_exists(question.query):
                found = lowering.lower_exists(question, scope)
                return exp.Not(this=found) if equal else found
            other = sql_builder.wrap_operand(lowering.lower_value(call.arguments[1 - index], scope))
            none = sql_builder.null()
            return exp.Is(this=other, expression=none if equal else exp.Not(this=none))
    if not have_same_storage_class(left, right, none=True):
        return _compare_with_equal_value(lowering, call, scope) or _compare_handles(lowering, call, scope)
    a, b = _lower_operands(lowering, call, scope)
    if left.may_be(Kind.NONE) or right.may_be(Kind.NONE):
        return sql_builder.binary(exp.NullSafeEQ if equal else exp.NullSafeNEQ, a, b)
    return sql_builder.binary(exp.EQ if equal else exp.NEQ, a, b)


def _lower_membership(lowering: ExpressionLowering, call: plan.Call, scope: SqlScope) -> Node | None:
    """`x IN [1, 2, 3]`, a list of the class of x: written out where it is short, else walked once by SQLite.

    The list of a query is one of SQL: `x IN (SELECT e.b FROM ...)`.
    """
    item, items = call.arguments
    known = items.type.item if items.type.kinds == Kind.LIST else None
    if known is None or not have_same_storage_class(item.type, known) or known.may_be(Kind.BOOL):
        return lower_membership(lowering, call, scope)
    listed = items.query.columns[0].expr if isinstance(items, plan.Subquery) and is_column_query(items.query) else None
    if listed is None and not isinstance(items, (plan.Constant, plan.Variable)):
        return None  # before the item is lowered: who comes next would lower it again, and all within it
    this = sql_builder.wrap_operand(lowering.lower_expr(item, scope))
    if listed is not None:
        assert isinstance(items, plan.Subquery)
        found = lowering.lower_unordered(items, scope, lambda inner: lowering.lower_expr(listed, inner))
        test = exp.In(this=this, query=sql_builder.scalar(found))
    elif isinstance(items, plan.Constant) and len(items.value) <= MAX_WRITTEN_MEMBERS:
        written = [lowering.lower_constant(plan.Constant(value, known, span=items.span)) for value in items.value]
        test = exp.In(this=this, expressions=written)
    else:
        label = lowering.needs.choose_label("members")
        members = lowering.lower_expr(items, scope)
        walked = sql_builder.table_function(lowering.needs.name_elements_table(()), [members], label)
        test = exp.In(
            this=this, query=sql_builder.scalar(sql_builder.select([sql_builder.column("this", label)], [walked]))
        )
    return test if call.function.name == "in" else exp.Not(this=exp.Paren(this=test))


def _lower_like(lowering: ExpressionLowering, call: plan.Call, scope: SqlScope) -> Node | None:
    """A pattern that is written out. SQLite's GLOB ends at a NUL, so some texts with one in them are left to Python."""
    value, pattern = call.arguments
    if call.function.raises or not isinstance(pattern, plan.Constant) or pattern.value.count("%") > 2:
        return None  # SQLite's GLOB tries every place of each *
    text, node, negated = pattern.value, lowering.lower_expr(value, scope), call.function.name == "not_like"
    part = text.strip("%")
    plain = "_" not in part and "%" not in part
    if plain and text == part:
        return sql_builder.binary(exp.NEQ if negated else exp.EQ, node, lowering.lower_constant(pattern))
    if plain and part and text == f"%{part}%":
        found = sql_builder.call("instr", node, sql_builder.string(part))
        return sql_builder.binary(exp.EQ if negated else exp.GT, found, sql_builder.number(0))
    glob = "".join({"%": "*", "_": "?"}.get(char) or (f"[{char}]" if char in "*?[" else char) for char in text)
    test: Node = exp.Glob(this=sql_builder.wrap_operand(node), expression=sql_builder.string(glob))
    test = exp.Not(this=sql_builder.wrap_operand(test)) if negated else test
    if plain and text == f"{part}%":
        return test
    if not can_repeat(node):
        return None
    nul = sql_builder.call("instr", node.copy(), sql_builder.call("char", sql_builder.number(0)))
    return sql_builder.case([(nul, lowering.call_python(call, [node.copy(), lowering.lower_constant(pattern)]))], test)


SPECIAL_OPERATIONS: dict[str, LowerFunction] = {
    "eq": _lower_equality,
    "ne": _lower_equality,
    "item": lower_item,
    "in": _lower_membership,
    "not_in": _lower_membership,
    "like": _lower_like,
    "not_like": _lower_like,
}

assert SPECIAL_OPERATIONS.keys() == {name for name, row in OPERATIONS.items() if "sqlite" in row.by_hand}

"""Going through a plan and making new nodes: what the rewrites share.

A rewrite makes calls of built-in operators. Where the user has replaced one, its name belongs to the user's
function, so none is made then.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, TypeVar

from ss2sql.errors import Span
from ss2sql.language import plan
from ss2sql.language.kinds import BOOL, Kind, is_flag, type_of
from ss2sql.language.operations import OPERATIONS
from ss2sql.language.plan_traversal import rebuild_node
from ss2sql.language.values import get_truth

Node = TypeVar("Node")

NEGATED_COMPARISONS = {name: row.negated for name, row in OPERATIONS.items() if row.negated}
COMPARISONS = frozenset(NEGATED_COMPARISONS)


def rewrite_bottom_up(node: Node, change: Callable[[Any], Any]) -> Node:
    """The node with `change` applied to every node below it, innermost first, and then to itself.

    Columns of queries in FROM, and group values, keep to a type that is bool alone, or is not: those who read them
    go by their type, and a bool travels in another form through SQL.
    """
    new: Any = rebuild_node(node, lambda part: rewrite_bottom_up(part, change))
    if new is not node and isinstance(new, plan.QuerySource) and isinstance(node, plan.QuerySource):
        pairs = zip(node.query.columns, new.query.columns, strict=True)
        columns = tuple(after if _has_same_form(before.expr, after.expr) else before for before, after in pairs)
        new = replace(new, query=replace(new.query, columns=columns))
    if new is not node and isinstance(new, plan.Query) and isinstance(node, plan.Query) and new.group:
        groups = zip(node.group, new.group, strict=True)
        new = replace(new, group=tuple(after if _has_same_form(before, after) else before for before, after in groups))
    changed: Node = change(new)
    return changed


def _has_same_form(one: plan.Expr, other: plan.Expr) -> bool:
    return is_flag(one.type) == is_flag(other.type)


def make_constant(value: Any, span: Span) -> plan.Constant:
    return plan.Constant(value, type_of(value), span=span)


def is_true(node: plan.Constant) -> bool:
    return get_truth(node.value)


def make_bool(expr: plan.Expr) -> plan.Expr:
    if expr.type.is_only(Kind.BOOL):
        return expr
    return plan.Not(plan.Not(expr, BOOL, span=expr.span), BOOL, span=expr.span)


def make_conjunction(parts: list[plan.Expr], span: Span) -> plan.Expr:
    """The conjunction of expressions; of none: True."""
    if not parts:
        return make_constant(True, span)
    return make_bool(parts[0]) if len(parts) == 1 else plan.And(tuple(parts), span=span)


def make_disjunction(parts: list[plan.Expr], span: Span) -> plan.Expr:
    """The disjunction of expressions; of none: False."""
    if not parts:
        return make_constant(False, span)
    return make_bool(parts[0]) if len(parts) == 1 else plan.Or(tuple(parts), span=span)


def make_call(name: str, *arguments: plan.Expr, span: Span) -> plan.Call:
    row, types = OPERATIONS[name], tuple(argument.type for argument in arguments)
    return plan.Call(row.make_function(types), arguments, row.result(types), span=span, place=span)


def negate_expression(expr: plan.Expr) -> plan.Expr:
    """An expression that is true where the other is false; whatever fails in the one fails in the other.

    The caller makes sure that the comparisons are not replaced.
    """
    match expr:
        case plan.Constant():
            return make_constant(not is_true(expr), expr.span)
        case plan.Not(operand=operand):
            return operand
        case plan.And(parts=parts):
            return plan.Or(tuple(map(negate_expression, parts)), span=expr.span)
        case plan.Or(parts=parts):
            return plan.And(tuple(map(negate_expression, parts)), span=expr.span)
        case plan.Call(function=function) if (
            function.builtin and function.name in NEGATED_COMPARISONS and not function.raises
        ):
            return replace(expr, function=replace(function, name=NEGATED_COMPARISONS[function.name]))
        case _:
            return plan.Not(expr, span=expr.span)

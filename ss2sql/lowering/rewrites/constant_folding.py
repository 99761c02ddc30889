"""`fold`: what is made of constants alone is computed when the query is compiled.

    WHERE this > 60 * 60 AND True          becomes          WHERE this > 3600

A call of a built-in function is computed if that does not fail; one that fails stays and fails when the query
runs. Functions of the user are not run. In AND, OR and IF a constant decides or goes away; what stood to its
left and may fail stays, what would not have been evaluated goes. Aggregates are: they are fed before anything is
evaluated of their group, so those that may fail hold the constant.

Only a text of one expression that cannot fail and has no effect is read early; every other one is read when
it runs, and what is wrong in it is said then, with its place and that of the `eval`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ss2sql.errors import Error, Span
from ss2sql.frontend.resolve.scope import list_scopes
from ss2sql.language import plan
from ss2sql.language.kinds import is_supertype
from ss2sql.language.operations import OPERATIONS
from ss2sql.language.plan_traversal import is_volatile, rebuild_node, walk
from ss2sql.language.values import get_truth
from ss2sql.lowering.guards import is_free
from ss2sql.lowering.rewrites.rewrite_context import (
    MAX_ELEMENTS,
    RewriteContext,
    is_foldable_value,
    make_constant,
    retype_call,
    rewrite_bottom_up,
    rewrite_to_bool,
)


def fold_constants(query: plan.Query, world: RewriteContext) -> plan.Query:
    return rewrite_bottom_up(query, fold_node)


def fold_node(node: Any) -> Any:
    """The node, whose parts are folded already, as a constant or a simpler node, if it is one."""
    match node:
        case plan.Call(function=plan.Function(builtin=True)):
            return _fold_call(node)
        case plan.And() | plan.Or():
            return _fold_connective(node)
        case plan.Not(operand=plan.Constant() as known):
            return make_constant(not get_truth(known.value), node.span)
        case plan.If(condition=plan.Constant() as known):
            branch = node.then if get_truth(known.value) else node.otherwise
            return node if any(map(is_volatile, branch[:-1])) else branch[-1]
        case plan.MakeList(items=items) if all(isinstance(item, plan.Constant) for item in items):
            return _make_small_constant([item.value for item in items if isinstance(item, plan.Constant)], node)
        case plan.Query(where=plan.Constant() as known, search=None) if get_truth(known.value):
            return replace(node, where=None)  # of a search it would make goals of all steps that do not stop
        case _:
            return node


def _fold_call(call: plan.Call) -> plan.Expr:
    """The call's value, or the call with the types of its present arguments."""
    row = OPERATIONS[call.function.name]
    if row.value is None or row.volatility != "immutable":
        return call
    match call.function.name, call.arguments:
        case "item", (plan.MakeList(items=items), plan.Constant(value=int(index))) if -len(items) <= index < len(items):
            rest = (item for position, item in enumerate(items) if position != index % len(items))
            return call if any(map(is_volatile, rest)) else items[index]
        case "len" | "count", (plan.MakeList(items=items),) if not any(map(is_volatile, items)):
            return make_constant(len(items), call.span)
    if all(isinstance(argument, plan.Constant) for argument in call.arguments):
        values = [argument.value for argument in call.arguments if isinstance(argument, plan.Constant)]
        if call.function.name != "range" or _is_short_range(values):
            try:
                return _make_small_constant(row.value(*values), call)
            except Error:
                return call
    known = retype_call(call)
    return call if known.function == call.function and is_supertype(known.type, call.type) else known


def _is_short_range(bounds: list[Any]) -> bool:
    return all(type(bound) is int for bound in bounds) and max(map(abs, bounds)) <= MAX_ELEMENTS


def _make_small_constant(value: Any, node: plan.Expr) -> plan.Expr:
    """The value as a constant; a large one stays as it is written."""
    return (
        make_constant(value, node.span) if is_foldable_value(value) and _count_folded(value) <= MAX_ELEMENTS else node
    )


def _count_folded(value: Any) -> int:
    return 1 + sum(map(_count_folded, value)) if type(value) is list else 1


def _fold_connective(node: plan.And | plan.Or) -> plan.Expr:
    deciding = isinstance(node, plan.Or)
    parts: list[plan.Expr] = []
    decided = False
    for part in node.parts:
        if not isinstance(part, plan.Constant):
            parts.append(part)
        elif get_truth(part.value) is deciding:
            decided = True
            break
    if decided or not parts:
        value = make_constant(deciding is decided, node.span)
        kept = parts if any(map(is_volatile, parts)) else []
        return replace(node, parts=(*kept, value)) if kept else value
    if len(parts) == 1:
        return rewrite_to_bool(parts[0])
    return node if len(parts) == len(node.parts) else replace(node, parts=tuple(parts))


# --- texts given to `eval` that are known when the query is compiled: they become part of the plan
_OF_GROUPS = (plan.Aggregate, plan.GroupKey)


def fold_constant_string(node: plan.Eval, world: RewriteContext) -> plan.Expr | None:
    """What a constant text stands for; None where that has to wait."""
    if not isinstance(node.text, plan.Constant) or not isinstance(node.text.value, str):
        return None
    if node.scope is None or any(level.grouped for level in list_scopes(node.scope)):
        return None
    expr = world.read(node.text.value, node.scope)
    if expr is None or not is_free(expr):
        return None
    parts = list(walk(expr))
    if any(isinstance(part, (plan.Temporal, *_OF_GROUPS)) for part in parts):
        return None
    types = {part.name: part.type for part in parts if isinstance(part, plan.Variable)}
    if types and not world.fixed:
        return None
    world.types.update(types)
    here: plan.Expr = move_folded_node(expr, node.span)
    return here


def move_folded_node(node: Any, span: Span) -> Any:
    """The node with everything in it at one place of the script, where its text stands."""
    return replace(rebuild_node(node, lambda part: move_folded_node(part, span)), span=span)

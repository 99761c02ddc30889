"""Texts given to `eval` that are known when the query is compiled: they become part of the plan.

Only a text of one expression that cannot fail and has no effect is read early; every other one is read when
it runs, and what is wrong in it is said then, with its place and that of the `eval`.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ss2sql.errors import Span
from ss2sql.language import plan
from ss2sql.language.plan_traversal import can_fail, rebuild_node, walk
from ss2sql.lowering.rewrites.rewrite_context import RewriteContext

_OF_GROUPS = (plan.Aggregate, plan.GroupKey)


def resolve_constant_string(node: plan.Eval, world: RewriteContext) -> plan.Expr | None:
    """What a constant text stands for; None where that has to wait."""
    if not isinstance(node.text, plan.Constant) or not isinstance(node.text.value, str):
        return None
    if node.scope is None or any(level.grouped for level in node.scope.list_outwards()):
        return None
    expr = world.read(node.text.value, node.scope)
    if expr is None or can_fail(expr):
        return None
    parts = list(walk(expr))
    if any(isinstance(part, (plan.Temporal, *_OF_GROUPS)) for part in parts):
        return None
    types = {part.name: part.type for part in parts if isinstance(part, plan.Variable)}
    if types and not world.fixed:
        return None
    world.types.update(types)
    here: plan.Expr = move_to_span(expr, node.span)
    return here


def move_to_span(node: Any, span: Span) -> Any:
    """The node with everything in it at one place of the script, where its text stands."""
    node = rebuild_node(node, lambda part: move_to_span(part, span))
    return replace(node, span=span, place=span) if isinstance(node, plan.Call) else replace(node, span=span)

"""`split`: WHERE, STOP WITH and every other condition as flat conjunctions and disjunctions of simple parts.

    WHERE NOT (a.this == b.this OR a.this == c.this)    becomes    a.this != b.this AND a.this != c.this

so that later stages see parts: each is evaluated as soon as its sources are bound, looked up, or compared with a
part of another clause. Parts keep their order. A part that stands there a second time goes, for it was true
(in a conjunction) or false when it was evaluated first.

    (boss == None AND parent == None) OR parent == boss    becomes    parent == boss

for two values that equal one constant equal each other: what is left is an equality, by which rows are looked up.

    [x, y] == [px + 1, py]    becomes    x == px + 1 AND y == py

so that rows are looked up by x and y, and no list is made. `[x, y] IN [[px + 1, py], [px, py + 1]]` becomes OR of such.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, TypeGuard

from ss2sql.language import plan
from ss2sql.language.plan_traversal import is_volatile, list_sources, list_states, walk
from ss2sql.language.values import SCALARS
from ss2sql.lowering.guards import is_free
from ss2sql.lowering.rewrites.rewrite_context import (
    COMPARISONS,
    PLAIN_READS,
    RewriteContext,
    list_items,
    make_call,
    make_connective,
    negate_expression,
    rewrite_bottom_up,
    rewrite_to_bool,
)

_QUICK = {*COMPARISONS, "add", "sub", "mul", "neg"}


def normalize_conditions(query: plan.Query, world: RewriteContext) -> plan.Query:
    return query if not COMPARISONS.isdisjoint(world.replaced) else rewrite_bottom_up(query, _rewrite_node)


def _rewrite_node(node: Any) -> Any:
    match node:
        case plan.And() | plan.Or():
            return _flatten_connective(node)
        case plan.Not(operand=operand):
            return _push_negation(node, operand)
        case plan.If(condition=condition):
            return _replace_condition(node, "condition", condition)
        case plan.Query(where=where, having=having):
            node = node if where is None else _replace_condition(node, "where", where)
            node = node if node.search is not None else _test_plain_parts_first(node)
            return node if having is None else _replace_condition(node, "having", having)
        case plan.Search(stop=stop) if stop is not None:
            return _replace_condition(node, "stop", stop)
        case plan.Call(function=plan.Function(name="eq" | "in" as name, builtin=True), arguments=(left, right)):
            split = _split_list_equality(left, right) if name == "eq" else _split_list_membership(left, right)
            return node if split is None else replace(split, span=node.span)
        case _:
            return node


def _split_list_equality(left: plan.Expr, right: plan.Expr) -> plan.Expr | None:
    """`x == a AND y == b` for two lists of as many expressions, where one of these can be looked up."""
    ours, others = list_items(left), list_items(right)
    if len(ours) != len(others) or not any(map(_can_look_up, (*ours, *others))):
        return None
    parts = [
        _split_list_equality(one, other) or make_call("eq", one, other, span=left.span)
        for one, other in zip(ours, others, strict=True)
    ]
    flat = [part for one in parts for part in (one.parts if isinstance(one, plan.And) else (one,))]
    return make_connective(plan.And, flat, left.span)


def _split_list_membership(left: plan.Expr, right: plan.Expr) -> plan.Expr | None:
    """That a list of what costs nothing to read again equals one of some lists of expressions."""
    if not (isinstance(left, plan.MakeList) and isinstance(right, plan.MakeList)):
        return None
    if not all(isinstance(item, PLAIN_READS) for item in left.items):
        return None
    parts = [_split_list_equality(left, item) for item in right.items]
    known = [part for part in parts if part is not None]
    return make_connective(plan.Or, known, left.span) if known and len(known) == len(parts) else None


def _can_look_up(item: plan.Expr) -> bool:
    """Whether an expression, or an item of a list, reads a source and no state."""
    return any(map(_can_look_up, list_items(item))) or bool(list_sources(item) and not list_states(item))


def _test_plain_parts_first(query: plan.Query) -> plan.Query:
    """The query with comparisons that cannot fail before parts of WHERE that make lists of the same sources.

    Of 10^6 rows for which `len(uniq([a, b, c])) == 3 AND a + b + c == 5` is tested, 21 need a list.
    """
    if not isinstance(query.where, plan.And):
        return query
    parts: list[plan.Expr] = []
    for part in query.where.parts:
        place = len(parts)
        if _is_quick(part) and is_free(part):
            while place and _makes_list_of(parts[place - 1], list_sources(part)):
                place -= 1
        parts.insert(place, part)
    return replace(query, where=replace(query.where, parts=tuple(parts)))


def _makes_list_of(part: plan.Expr, sources: frozenset[int]) -> bool:
    """Whether a part makes a list of these sources, perhaps of more, and nobody but the language is called for it."""
    own = all(isinstance(node, (*PLAIN_READS, plan.MakeList)) or _is_built_in(node) for node in walk(part))
    return own and any(isinstance(node, plan.MakeList) for node in walk(part)) and list_sources(part) >= sources


def _is_quick(part: plan.Expr) -> bool:
    return all(
        isinstance(node, PLAIN_READS) or (_is_built_in(node) and node.function.name in _QUICK) for node in walk(part)
    )


def _is_built_in(node: Any) -> TypeGuard[plan.Call]:
    return isinstance(node, plan.Call) and node.function.builtin and not is_volatile(node)


def _replace_condition(node: Any, name: str, condition: plan.Expr) -> Any:
    bare = _rewrite_bool_call(condition)
    return node if bare is condition else replace(node, **{name: bare})


def _rewrite_bool_call(expr: plan.Expr) -> plan.Expr:
    """The expression of whose value only the truth counts, without what only makes a bool of it."""
    while isinstance(expr, plan.Not) and isinstance(expr.operand, plan.Not):
        expr = expr.operand.operand
    return expr


def _push_negation(node: plan.Not, operand: plan.Expr) -> plan.Expr:
    turned: plan.Expr
    match operand:
        case plan.And() | plan.Or():
            turned = negate_expression(operand)
            return node if isinstance(turned, plan.Not) else _flatten_connective(turned)
        case plan.Call():
            turned = negate_expression(operand)
            return node if isinstance(turned, plan.Not) else turned
        case _:
            return node


def _flatten_connective(node: Any) -> Any:
    """A conjunction or disjunction, whose parts are split already."""
    assert isinstance(node, (plan.And, plan.Or))
    steady = not is_volatile(node)  # else a part may be another one when it is evaluated again
    flat = [
        one
        for part in map(_rewrite_bool_call, node.parts)
        for one in (part.parts if type(part) is type(node) else (part,))
    ]
    parts = _drop_implied_parts(list(dict.fromkeys(flat)), isinstance(node, plan.Or)) if steady else flat
    if len(parts) == 1:
        return rewrite_to_bool(parts[0])
    same = len(parts) == len(node.parts) and all(a is b for a, b in zip(parts, node.parts, strict=True))
    return node if same else replace(node, parts=tuple(parts))


def _drop_implied_parts(parts: list[plan.Expr], is_or: bool) -> list[plan.Expr]:
    """The parts of OR without those that imply another one, `a == b`: both equal one constant. Of AND the opposite."""
    operator, inner = ("eq", plan.And) if is_or else ("ne", plan.Or)
    pairs = [frozenset(part.arguments) for part in parts if _is_call(part, operator)]
    if not pairs:
        return parts

    def is_implied(part: plan.Expr) -> bool:
        if not isinstance(part, inner) or is_volatile(part):
            return False
        same: dict[plan.Constant, set[plan.Expr]] = {}
        for one in part.parts:
            if _is_call(one, operator):
                for constant, other in (one.arguments, one.arguments[::-1]):
                    if isinstance(constant, plan.Constant) and type(constant.value) in SCALARS:
                        same.setdefault(constant, {constant}).add(other)
        return any(pair <= equal for equal in same.values() for pair in pairs)

    return [part for part in parts if not is_implied(part)]


def _is_call(expr: plan.Expr, name: str) -> TypeGuard[plan.Call]:
    return isinstance(expr, plan.Call) and expr.function.builtin and expr.function.name == name

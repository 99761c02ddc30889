"""`lookup`: what a step of a search must equal lest it leaves no trace is looked up, not found by going through all.

    SELECT name FROM staff START WITH boss = 1 CONNECT BY boss = id STOP WITH manager != boss
    SELECT name FROM staff WHERE manager == boss AND pay > 5 ... STOP WITH manager != boss OR level == 3

STOP WITH holds the negation of an equality. Without a WHERE, or where WHERE demands the equality, a step that does
not meet it stops without being a goal. So the equality becomes a condition of the join, for which SQLite uses
an index: a hierarchy of a million rows then costs its size, not its square.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from ss2sql.language import plan
from ss2sql.language.plan_traversal import can_fail
from ss2sql.lowering.rewrites.plan_nodes import make_conjunction, make_disjunction


def find_step_equalities(query: plan.Query) -> list[plan.Expr]:
    """The equalities of a search that every step must meet; none of them can fail."""
    search = query.search
    if search is None or search.stop is None:
        return []
    wanted = None if query.where is None else _find_infallible_parts(query.where, plan.And)
    found: list[plan.Expr] = []
    for part in _find_infallible_parts(search.stop, plan.Or):
        equality = _get_denied_equality(part)
        if equality is not None and (wanted is None or any(equality == other for other in wanted)):
            found.append(equality)
    return found


def simplify_by_equalities(query: plan.Query, known: list[plan.Expr]) -> plan.Query:
    """The query for steps that meet these equalities: WHERE and STOP WITH without what is known of such a step."""
    search = query.search
    if search is None or search.stop is None or not known:
        return query
    stop = _remove_known_parts(search.stop, plan.Or, lambda part: _get_denied_equality(part) in known)
    where = None if query.where is None else _remove_known_parts(query.where, plan.And, known.__contains__)
    if where is None and stop is not None:
        where = query.where  # without it a step that stops would be no goal
    return replace(query, where=where, search=replace(search, stop=stop))


def _remove_known_parts(
    clause: plan.Expr, kind: type[plan.And] | type[plan.Or], is_known: Callable[[plan.Expr], bool]
) -> plan.Expr | None:
    """A clause without the parts that are known; None where nothing is left of it."""
    parts = clause.parts if isinstance(clause, kind) else (clause,)
    left = [part for part in parts if not is_known(part)]
    if len(left) == len(parts):
        return clause
    return (
        make_conjunction(left, clause.span)
        if kind is plan.And and left
        else make_disjunction(left, clause.span)
        if left
        else None
    )


def _find_infallible_parts(clause: plan.Expr, kind: type[plan.And] | type[plan.Or]) -> list[plan.Expr]:
    """The parts of a clause that cannot fail: they may be evaluated before the others."""
    return [part for part in (clause.parts if isinstance(clause, kind) else (clause,)) if not can_fail(part)]


def _get_denied_equality(part: plan.Expr) -> plan.Expr | None:
    """The equality that a part of STOP WITH denies."""
    match part:
        case plan.Call(function=plan.Function(name="ne", builtin=True) as function):
            return replace(part, function=replace(function, name="eq"))
        case _:
            return None

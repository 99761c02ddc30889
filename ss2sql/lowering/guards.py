"""Guards: what SQL may evaluate where the written order would not reach it.

    WHERE d != 0 AND n / d > 1          `d != 0` guards the division

AND and IF guard what stands to their right, the condition of CONNECT BY all else of its step, STOP WITH the weight and
the state after the step, WHERE what is shown. What is *free* needs no guard: it may be evaluated at any time, for any
row, any number of times. All else waits for its guards.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ss2sql.language import plan
from ss2sql.language.plan_traversal import can_fail, list_parts, walk


def is_free(*nodes: object) -> bool:
    """Whether these may be evaluated anywhere: nothing in them fails or has an effect. None is a missing clause."""
    return not any(node is not None and can_fail(node) for node in nodes)


def is_in_order(parts: Sequence[plan.Expr]) -> bool:
    """Whether the parts of a conjunction guard one another, so that they have to be evaluated from left to right."""
    return not is_free(*parts[1:])


def is_free_by_itself(node: object) -> bool:
    """Whether a node is free where its parts are."""
    match node:
        case plan.Call(function=function):
            return not function.raises and function.volatility != "volatile"
        case plan.Column(declared=declared):
            return declared
        case _:
            return not isinstance(node, plan.Subquery)


def is_sql_constant(expr: plan.Expr) -> bool:
    """Whether an expression has one value per run: it reads only constants and script variables."""
    return all(isinstance(part, (plan.Constant, plan.Variable, plan.Call, plan.MakeList)) for part in walk(expr))


def can_be_parameter(expr: plan.Expr) -> bool:
    """Whether the value may be computed before the statement runs."""
    return is_sql_constant(expr) and is_free(expr)


def is_costly(node: object) -> bool:
    """Whether evaluating it is worth to be saved: it calls a function of the user, or evaluates a query."""
    return any(
        isinstance(part, plan.Subquery) or (isinstance(part, plan.Call) and not part.function.builtin)
        for part in walk(node)
    )


def list_free_parts(clause: plan.Expr | None, kind: type[plan.And | plan.Or]) -> list[plan.Expr]:
    """The parts of a conjunction or disjunction that may be evaluated before the others."""
    parts = clause.parts if isinstance(clause, kind) else (clause,)
    return [part for part in parts if part is not None and is_free(part)]


def iterate_certain_parts(expr: plan.Expr | None) -> Iterator[plan.Expr]:
    """The parts right inside an expression that are evaluated whenever it is: all that nothing guards."""
    match expr:
        case plan.And(parts=(first, *_)) | plan.Or(parts=(first, *_)) | plan.If(condition=first):
            yield first
        case plan.Subquery() | None:
            return
        case _:
            yield from list_parts(expr)


def find_certain_parts(*clauses: plan.Expr | None) -> Iterator[plan.Expr]:
    """These clauses, and all in them that is evaluated whenever they are."""
    for clause in clauses:
        if clause is not None:
            yield clause
            yield from find_certain_parts(*iterate_certain_parts(clause))


def is_evaluated_by(expr: plan.Expr, *clauses: plan.Expr | None) -> bool:
    """Whether all in an expression that is not free is evaluated with these clauses anyway."""
    known = list(find_certain_parts(*clauses))
    return all(part in known for part in walk(expr) if not is_free_by_itself(part))

"""The types of START WITH variables, valid in the first state and in every one that CONNECT BY makes.

They are a fixpoint: CONNECT BY is resolved with assumed types, which grow until its values stay within them, or lose
their bounds. In `x = x + dx` a number grows with every step, by a bounded amount, so its size follows from the number
of steps; types alone could not prove it, for each step would widen the bounds of the last one.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from ss2sql.frontend.resolve.from_clause import resolve_sources
from ss2sql.frontend.resolve.scope import Scope
from ss2sql.frontend.syntax import ast
from ss2sql.language import plan
from ss2sql.language.kinds import ANY, Kind, Type, drop_bounds, is_covering, unite

if TYPE_CHECKING:
    from ss2sql.frontend.resolve.resolver import Resolver

# A round resolves FROM and CONNECT BY once more, and in nested queries the rounds multiply.
_ROUNDS = {1: 6, 2: 3}

# No path has more steps: each keeps its row until the search ends, at 100 bytes or more, so 2^36 of them take
# 6 TB (and at 0.3 us a step, which nothing here reaches, 6 hours).
STEPS = 2**36
# How far a number may grow. Integers of this size can be added without leaving 64 bits.
_LIMITS: dict[Kind, float] = {Kind.INT: 2**62, Kind.FLOAT: 1e300}


def infer_state_types(resolver: Resolver, tree: ast.Query, scope: Scope, start: Mapping[str, plan.Expr]) -> None:
    """Sets the types of the START WITH variables in `scope` that hold throughout the search."""
    first = {name: value.type for name, value in start.items()}
    scope.states.update(_find_fixpoint(resolver, tree, scope, first) or dict.fromkeys(first, ANY))


def _find_fixpoint(
    resolver: Resolver, tree: ast.Query, scope: Scope, first: Mapping[str, Type]
) -> dict[str, Type] | None:
    """Types that CONNECT BY stays within; None where some still change in the last round."""
    types, counted = dict(first), set[str]()
    assigned = [assign.name for assign in tree.connect]
    bounded = {name for name, kind in first.items() if kind.kinds in _LIMITS and kind.is_bounded(_LIMITS[kind.kinds])}
    candidates = {name for name in bounded if assigned.count(name) == 1}
    rounds = _ROUNDS.get(scope.depth, 0)
    for number in range(rounds):
        limits = {name: _LIMITS[first[name].kinds] for name in counted}
        assumed = types | {name: Type(first[name].kinds, -limit, limit) for name, limit in limits.items()}
        proved, settled = dict[str, Type](), True
        for name, value in _resolve_connect(resolver, tree, scope, assumed):
            if name not in types or (name not in counted and is_covering(types[name], value.type)):
                continue
            total = _sum_up(value, scope.query, name, first[name]) if name in candidates else None
            if name in counted and total is not None:
                proved[name] = total
                continue
            settled = False
            if total is not None:
                counted.add(name)
                continue
            candidates.discard(name)
            grown = unite((types[name], value.type))
            types[name] = grown if number < rounds // 3 and name not in counted else drop_bounds(grown)
            counted.discard(name)
        if settled:
            return assumed | proved
    return None


def _resolve_connect(
    resolver: Resolver, tree: ast.Query, scope: Scope, types: Mapping[str, Type]
) -> list[tuple[str, plan.Expr]]:
    """CONNECT BY with these types of variables. What else the resolver finds is forgotten."""
    attempt = scope.copy_scopes()
    attempt.states.update(types)
    errors = len(resolver.errors)
    stable = (dict(resolver.parameters), dict(resolver.tables), resolver.tentative, resolver.numbers)
    resolve_sources(resolver, tree, attempt)
    before = attempt.enter_clause("CONNECT BY")
    values = [(a.name, resolver.record_errors(resolver.resolve_expr, a.value, attempt)) for a in tree.connect]
    # A proof sees through the user's functions.
    connect = [(name, resolver.inliner.inline_calls(value)) for name, value in values]
    attempt.enter_clause(before)
    del resolver.errors[errors:]
    resolver.parameters, resolver.tables, resolver.tentative, resolver.numbers = stable
    return connect


def _sum_up(value: plan.Expr, query: int, name: str, first: Type) -> Type | None:
    """The type of a number to which every step adds, or from which it subtracts, a bounded amount; else None."""
    match value:
        case plan.Call(function=plan.Function(name="add" | "sub" as operator, builtin=True), arguments=(left, right)):
            sign = 1 if operator == "add" else -1
        case _:
            return None
    for own, other in ((left, right), (right, left))[: 1 if sign < 0 else 2]:
        low, high = other.type.low, other.type.high
        state = isinstance(own, plan.State) and (own.query, own.name) == (query, name)
        if state and value.type.is_only(first.kinds) and low is not None and high is not None:
            # Rounding changes a sum of floats by at most what was added.
            steps = sign * STEPS * (4 if first.kinds == Kind.FLOAT else 1)
            least, most = sorted((low * steps, high * steps))
            found = Type(first.kinds, (first.low or 0) + min(least, 0), (first.high or 0) + max(most, 0))
            return found if found.is_bounded(_LIMITS[first.kinds]) else None
    return None

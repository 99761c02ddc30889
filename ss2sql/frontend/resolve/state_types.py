"""The types of START WITH variables, valid in the first state and in every one that CONNECT BY makes.

Types are found by a fixpoint: CONNECT BY is resolved with assumed types and has to stay within them. Bounds of numbers
that change with every step are proved in frontend/resolve/widening.py. The types are then narrowed: a state is the
first one, or the result of a step that did not stop.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.resolve.from_clause import resolve_sources
from ss2sql.frontend.resolve.scope import Scope
from ss2sql.frontend.resolve.widening import NUMBER, Slot, get_slots, is_slot, set_slots, widen_number
from ss2sql.frontend.syntax import ast
from ss2sql.language import plan
from ss2sql.language.implied_bounds import (
    Comparison,
    collect_comparisons,
    narrow_type,
    restrict_by_order,
    restrict_to_interval,
)
from ss2sql.language.kinds import ANY, NOTHING, Kind, Type, drop_bounds, is_covering, make_list_type, unite
from ss2sql.language.plan_traversal import list_states

if TYPE_CHECKING:
    from ss2sql.frontend.resolve.resolver import Resolver

Types: TypeAlias = Mapping[str, Type]

# A round resolves FROM and CONNECT BY once more, and in nested queries the rounds multiply.
_ROUNDS = {1: 6, 2: 3}
_SETTLING = 3  # further rounds for numbers without bounds


def infer_state_types(resolver: Resolver, tree: ast.Query, scope: Scope, start: Mapping[str, plan.Expr]) -> None:
    """Sets the types of the START WITH variables in `scope` that hold throughout the search."""
    first = {name: value.type for name, value in start.items()}
    if scope.depth not in _ROUNDS:
        scope.states.update(dict.fromkeys(first, ANY))
        return
    types = _settle_bounds(resolver, tree, scope, first, _prove_types(resolver, tree, scope, first))
    for _ in range(min(len(first), 2)):  # twice, for a variable may take the value of another
        closer = _narrow_types(resolver, tree, scope, first, types)
        types = {name: _intersect_types(closer[name], kind) for name, kind in types.items()}
    scope.states.update(types)


@dataclass(frozen=True, slots=True)
class _Attempt:
    """CONNECT BY, resolved with the types of variables in `scope`."""

    scope: Scope
    connect: tuple[tuple[str, plan.Expr], ...]

    def list_assigned(self, name: str) -> list[plan.Expr]:
        """The expression that is assigned to a variable."""
        return [value for assigned, value in self.connect if assigned == name]


@contextmanager
def _discard_findings(resolver: Resolver) -> Iterator[None]:
    """Discards all findings of the block: errors, names and numbers of sources."""
    errors = len(resolver.errors)
    stable = (dict(resolver.parameters), dict(resolver.tables), resolver.tentative, resolver.numbers)
    yield
    del resolver.errors[errors:]
    resolver.parameters, resolver.tables, resolver.tentative, resolver.numbers = stable


def _resolve_attempt(resolver: Resolver, tree: ast.Query, scope: Scope, types: Types) -> _Attempt:
    attempt = scope.copy_scopes()
    attempt.states.update(types)
    with _discard_findings(resolver):
        resolve_sources(resolver, tree, attempt)
        before = attempt.enter_clause("CONNECT BY")
        values = ((a.name, resolver.record_errors(resolver.resolve_expr, a.value, attempt)) for a in tree.connect)
        # A proof sees through the user's functions.
        connect = tuple((name, resolver.inliner.inline_calls(value)) for name, value in values)
        attempt.enter_clause(before)
    return _Attempt(attempt, connect)


def _prove_types(resolver: Resolver, tree: ast.Query, scope: Scope, first: Types) -> dict[str, Type]:
    """Types that CONNECT BY stays within.

    A type that grows first loses its bounds; one that still changes in the last round is unknown.
    """
    assigned = [assign.name for assign in tree.connect]
    slots = [s for name, kind in first.items() if assigned.count(name) == 1 for s in get_slots(scope.query, name, kind)]
    types = dict(first)
    for _ in range(_ROUNDS[scope.depth]):
        assumed = {name: set_slots(kind, _assume_slot_type(slots, name)) for name, kind in types.items()}
        attempt = _resolve_attempt(resolver, tree, scope, assumed)
        stable, bounds = _keep_bounded(slots, first, attempt)
        settled = stable == slots
        for name, kind in assumed.items():
            for value in attempt.list_assigned(name):
                # The numbers in slots have a proof of their own.
                grown = set_slots(value.type, _assume_slot_type(slots, name))
                if not is_covering(kind, grown):
                    types[name] = drop_bounds(unite((types[name], value.type)))
                    settled = False
        if settled:
            return {name: set_slots(kind, [b for b in bounds if b[0].name == name]) for name, kind in assumed.items()}
        slots = [slot for slot in stable if slot.find_part(types[slot.name]) is not None]
    return dict.fromkeys(first, ANY)


def _assume_slot_type(slots: Sequence[Slot], name: str) -> list[tuple[Slot, Type]]:
    return [(slot, slot.assumed_type) for slot in slots if slot.name == name]


def _keep_bounded(slots: Sequence[Slot], first: Types, attempt: _Attempt) -> tuple[list[Slot], list[tuple[Slot, Type]]]:
    """The slots that stay numbers, with all their kinds, and the types of those with proved bounds."""
    stable: list[Slot] = []
    bounds: list[tuple[Slot, Type]] = []
    for slot in slots:
        (value,) = attempt.list_assigned(slot.name)
        before, after = slot.find_part(first[slot.name]), slot.find_part(value.type)
        if before is None or after is None:
            continue
        if not after.is_only(slot.kinds):
            stable.append(replace(slot, kinds=slot.kinds | after.kinds))
        elif (bound := widen_number(slot, before, value)) is not None:
            stable.append(slot)
            bounds.append((slot, bound))
    return stable, bounds


def _settle_bounds(resolver: Resolver, tree: ast.Query, scope: Scope, first: Types, proved: Types) -> Types:
    """Adds bounds of numbers without a proof that reach a fixpoint: water in a jug, a place on a map.

    The first state's bounds are widened by the results of a step until no step leaves them.
    """
    unknown = [
        name
        for name, kind in proved.items()
        for slot in get_slots(scope.query, name, kind)
        if (part := slot.find_part(kind)) is None or not part.is_bounded(slot.limit / 2)
    ]
    types = {name: first[name] if name in unknown else kind for name, kind in proved.items()}
    for _ in range(_SETTLING if unknown else 0):
        attempt = _resolve_attempt(resolver, tree, scope, types)
        wider = {name: unite((types[name], *(value.type for value in attempt.list_assigned(name)))) for name in unknown}
        if all(is_covering(types[name], kind) for name, kind in wider.items()):
            return types
        types |= wider
    return proved


def _narrow_types(resolver: Resolver, tree: ast.Query, scope: Scope, first: Types, types: Types) -> dict[str, Type]:
    """The types of the reachable states: the first one, and those after a step that did not stop."""
    attempt = _resolve_attempt(resolver, tree, scope, types)
    facts: list[Comparison] = []
    # The first steps have a condition of their own. BY and `next` read the state after a step that stops, too.
    assert scope.path_functions is not None
    stop = None if scope.path_functions.reads_next or any(option.by for option in tree.options) else tree.stop
    for clause, truth in ((stop, False), (tree.made if tree.first is None else None, True)):
        if clause is not None:
            with _discard_findings(resolver):
                entered = attempt.scope.enter_clause("WHERE")
                condition = resolver.record_errors(resolver.resolve_expr, clause, attempt.scope)
                attempt.scope.enter_clause(entered)
                facts += collect_comparisons(resolver.inliner.inline_calls(condition), truth)
    before = {name: _clamp_state_type(scope.query, name, kind, facts) for name, kind in types.items()}
    closer = attempt if before == dict(types) else _resolve_attempt(resolver, tree, scope, before)
    found = dict(first)
    assigned: set[str] = set()
    for (name, value), (_, close) in zip(attempt.connect, closer.connect, strict=True):
        # The facts are about the state before the step; an earlier assignment has changed what a name means.
        changed = any(read == (scope.query, other) for read in list_states(value) for other in assigned)
        kind = value.type if changed else _intersect_types(_clamp_type(value, facts), close.type)
        found[name] = unite((found.get(name, NOTHING), kind))
        assigned.add(name)
    return {name: found[name] for name in first}  # an unknown name is an error elsewhere


def _clamp_type(value: plan.Expr, facts: Sequence[Comparison]) -> Type:
    """The type of a value that CONNECT BY computes, within the bounds that the facts imply."""
    if isinstance(value, plan.MakeList) and value.type.positions is not None:
        return make_list_type([_clamp_type(item, facts) for item in value.items])
    return narrow_type(value, facts)


def _clamp_state_type(query: int, name: str, kind: Type, facts: Sequence[Comparison]) -> Type:
    """The type of a variable in the steps that do not stop."""
    for slot in get_slots(query, name, kind):
        for fact in facts:
            if is_slot(fact.left, slot):
                part = slot.find_part(kind)
                assert part is not None
                kind = set_slots(kind, [(slot, restrict_by_order(part, fact.sign, fact.right.type))])
    return kind


def _intersect_types(a: Type, b: Type) -> Type:
    """The intersection of two types of the same values, element by element for short lists."""
    if a.is_only(NUMBER) and b.is_only(NUMBER):
        return restrict_to_interval(a, b.low, b.high)
    one, other = a.positions or (), b.positions or ()
    if not one or len(one) != len(other) or not a.is_only(Kind.LIST) or not b.is_only(Kind.LIST):
        return a
    return make_list_type([_intersect_types(left, right) for left, right in zip(one, other, strict=True)])

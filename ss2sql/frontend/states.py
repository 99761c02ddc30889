"""The types of START WITH variables, valid in the first state and in every one that CONNECT BY makes.

Types are found by a fixpoint: CONNECT BY is resolved with assumed types and has to stay within them. Bounds of numbers
that change with every step are proved in frontend/drift.py. The types are then narrowed: a state is the first one, or
the result of a step that did not stop.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING, TypeAlias

from ss2sql import plan
from ss2sql.bounds import Fact, compared, facts_of, narrowed, within
from ss2sql.frontend import ast
from ss2sql.frontend.drift import NUMBER, Slot, is_slot, reach, slots_of, with_slots
from ss2sql.frontend.scope import Scope
from ss2sql.frontend.sources import open_sources
from ss2sql.kinds import ANY, NOTHING, Kind, Type, covers, list_of, union, without_bounds
from ss2sql.records import dataclass
from ss2sql.walk import states_read

if TYPE_CHECKING:
    from ss2sql.frontend.resolve import Resolver

Types: TypeAlias = Mapping[str, Type]

# A round resolves FROM and CONNECT BY once more, and in nested queries the rounds multiply.
_ROUNDS = {1: 6, 2: 3}
_SETTLING = 3  # further rounds for numbers without bounds


def settle_states(resolver: Resolver, tree: ast.Query, scope: Scope, start: Mapping[str, plan.Expr]) -> None:
    """Sets the types of the START WITH variables in `scope` that hold throughout the search."""
    first = {name: value.type for name, value in start.items()}
    if scope.depth not in _ROUNDS:
        scope.states.update(dict.fromkeys(first, ANY))
        return
    types = _settled(resolver, tree, scope, first, _proved(resolver, tree, scope, first))
    for _ in range(min(len(first), 2)):  # twice, for a variable may take the value of another
        closer = _narrowed(resolver, tree, scope, first, types)
        types = {name: _meet(closer[name], kind) for name, kind in types.items()}
    scope.states.update(types)


@dataclass(frozen=True, slots=True)
class _Trial:
    """CONNECT BY, resolved with the types of variables in `scope`."""

    scope: Scope
    connect: tuple[tuple[str, plan.Expr], ...]

    def following(self, name: str) -> list[plan.Expr]:
        """The expression that is assigned to a variable."""
        return [value for assigned, value in self.connect if assigned == name]


@contextmanager
def _on_trial(resolver: Resolver) -> Iterator[None]:
    """Discards all findings of the block: errors, names and numbers of sources."""
    errors = len(resolver.errors)
    kept = (dict(resolver.parameters), dict(resolver.tables), resolver.tentative, resolver.numbers)
    yield
    del resolver.errors[errors:]
    resolver.parameters, resolver.tables, resolver.tentative, resolver.numbers = kept


def _try(resolver: Resolver, tree: ast.Query, scope: Scope, types: Types) -> _Trial:
    trial = scope.copy()
    trial.states.update(types)
    with _on_trial(resolver):
        open_sources(resolver, tree, trial)
        before = trial.enter("CONNECT BY")
        values = ((a.name, resolver.guarded(resolver.expression, a.value, trial)) for a in tree.connect)
        # A proof sees through the user's functions.
        connect = tuple((name, resolver.inliner.expr(value)) for name, value in values)
        trial.enter(before)
    return _Trial(trial, connect)


def _proved(resolver: Resolver, tree: ast.Query, scope: Scope, first: Types) -> dict[str, Type]:
    """Types that CONNECT BY stays within.

    A type that grows first loses its bounds; one that still changes in the last round is unknown.
    """
    assigned = [assign.name for assign in tree.connect]
    slots = [s for name, kind in first.items() if assigned.count(name) == 1 for s in slots_of(scope.query, name, kind)]
    types = dict(first)
    for _ in range(_ROUNDS[scope.depth]):
        assumed = {name: with_slots(kind, _assumed(slots, name)) for name, kind in types.items()}
        trial = _try(resolver, tree, scope, assumed)
        kept, bounds = _followed(slots, first, trial)
        settled = kept == slots
        for name, kind in assumed.items():
            for value in trial.following(name):
                # The numbers in slots have a proof of their own.
                grown = with_slots(value.type, _assumed(slots, name))
                if not covers(kind, grown):
                    types[name] = without_bounds(union((types[name], value.type)))
                    settled = False
        if settled:
            return {name: with_slots(kind, [b for b in bounds if b[0].name == name]) for name, kind in assumed.items()}
        slots = [slot for slot in kept if slot.part(types[slot.name]) is not None]
    return dict.fromkeys(first, ANY)


def _assumed(slots: Sequence[Slot], name: str) -> list[tuple[Slot, Type]]:
    return [(slot, slot.assumed) for slot in slots if slot.name == name]


def _followed(slots: Sequence[Slot], first: Types, trial: _Trial) -> tuple[list[Slot], list[tuple[Slot, Type]]]:
    """The slots that stay numbers, with all their kinds, and the types of those with proved bounds."""
    kept: list[Slot] = []
    bounds: list[tuple[Slot, Type]] = []
    for slot in slots:
        (value,) = trial.following(slot.name)
        before, after = slot.part(first[slot.name]), slot.part(value.type)
        if before is None or after is None:
            continue
        if not after.only(slot.kinds):
            kept.append(replace(slot, kinds=slot.kinds | after.kinds))
        elif (bound := reach(slot, before, value)) is not None:
            kept.append(slot)
            bounds.append((slot, bound))
    return kept, bounds


def _settled(resolver: Resolver, tree: ast.Query, scope: Scope, first: Types, proved: Types) -> Types:
    """Adds bounds of numbers without a proof that reach a fixpoint: water in a jug, a place on a map.

    The first state's bounds are widened by the results of a step until no step leaves them.
    """
    unknown = [
        name
        for name, kind in proved.items()
        for slot in slots_of(scope.query, name, kind)
        if (part := slot.part(kind)) is None or not part.bounded(slot.limit / 2)
    ]
    types = {name: first[name] if name in unknown else kind for name, kind in proved.items()}
    for _ in range(_SETTLING if unknown else 0):
        trial = _try(resolver, tree, scope, types)
        wider = {name: union((types[name], *(value.type for value in trial.following(name)))) for name in unknown}
        if all(covers(types[name], kind) for name, kind in wider.items()):
            return types
        types |= wider
    return proved


def _narrowed(resolver: Resolver, tree: ast.Query, scope: Scope, first: Types, types: Types) -> dict[str, Type]:
    """The types of the reachable states: the first one, and those after a step that did not stop."""
    trial = _try(resolver, tree, scope, types)
    facts: list[Fact] = []
    # The first steps have a condition of their own.
    for clause, truth in ((tree.stop, False), (tree.made if tree.first is None else None, True)):
        if clause is not None:
            with _on_trial(resolver):
                entered = trial.scope.enter("WHERE")
                condition = resolver.guarded(resolver.expression, clause, trial.scope)
                trial.scope.enter(entered)
                facts += facts_of(resolver.inliner.expr(condition), truth)
    before = {name: _clamped_state(scope.query, name, kind, facts) for name, kind in types.items()}
    closer = trial if before == dict(types) else _try(resolver, tree, scope, before)
    found = dict(first)
    assigned: set[str] = set()
    for (name, value), (_, close) in zip(trial.connect, closer.connect, strict=True):
        # The facts are about the state before the step; an earlier assignment has changed what a name means.
        changed = any(read == (scope.query, other) for read in states_read(value) for other in assigned)
        kind = value.type if changed else _meet(_clamped(value, facts), close.type)
        found[name] = union((found.get(name, NOTHING), kind))
        assigned.add(name)
    return {name: found[name] for name in first}  # an unknown name is an error elsewhere


def _clamped(value: plan.Expr, facts: Sequence[Fact]) -> Type:
    """The type of a value that CONNECT BY computes, within the bounds that the facts imply."""
    if isinstance(value, plan.MakeList) and value.type.positions is not None:
        return list_of([_clamped(item, facts) for item in value.items])
    return narrowed(value, facts)


def _clamped_state(query: int, name: str, kind: Type, facts: Sequence[Fact]) -> Type:
    """The type of a variable in the steps that do not stop."""
    for slot in slots_of(query, name, kind):
        for fact in facts:
            if is_slot(fact.left, slot):
                part = slot.part(kind)
                assert part is not None
                kind = with_slots(kind, [(slot, compared(part, fact.sign, fact.right.type))])
    return kind


def _meet(a: Type, b: Type) -> Type:
    """The intersection of two types of the same values, element by element for short lists."""
    if a.only(NUMBER) and b.only(NUMBER):
        return within(a, b.low, b.high)
    one, other = a.positions or (), b.positions or ()
    if not one or len(one) != len(other) or not a.only(Kind.LIST) or not b.only(Kind.LIST):
        return a
    return list_of([_meet(left, right) for left, right in zip(one, other, strict=True)])

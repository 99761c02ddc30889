"""The types of START WITH variables, valid in the first state and in every one that CONNECT BY makes.

The types are a fixpoint: CONNECT BY is resolved with assumed types, which grow until its values stay within them or
lose their bounds. In `x = x + dx` a number grows with every step, by a bounded amount, so its size follows from the
number of steps; types alone could not prove it, for each step would widen the bounds of the last one.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, NamedTuple

from ss2sql.frontend.resolve.from_clause import resolve_sources
from ss2sql.frontend.resolve.scope import Scope
from ss2sql.frontend.syntax import ast
from ss2sql.language import plan
from ss2sql.language.kinds import ANY, Kind, Type, drop_bounds, is_supertype, make_list_type, unite
from ss2sql.language.plan_traversal import list_plan_choices

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
    """Types that CONNECT BY stays within; None where some still change in the last round.

    A number that is `counted` may be anything up to the limit until its sum is known, in a round that assumes this.
    """
    types, counted = dict(first), set[Slot]()
    assigned = [assign.name for assign in tree.connect]
    candidates = {
        Slot(scope.query, name, at): part
        for name, kind in first.items()
        for at, part in _split_type(kind).items()
        if assigned.count(name) == 1 and part.kinds in _LIMITS and part.is_bounded(_LIMITS[part.kinds])
    }
    rounds = _ROUNDS.get(scope.depth, 0)
    patience = rounds // 3
    for number in range(rounds):
        far = {slot: Type(kind.kinds, -_LIMITS[kind.kinds], _LIMITS[kind.kinds]) for slot, kind in candidates.items()}
        assumed = {name: _put_parts(name, kind, {slot: far[slot] for slot in counted}) for name, kind in types.items()}
        proved, settled = dict[Slot, Type](), True
        for name, value in _resolve_connect(resolver, tree, scope, assumed):
            if name not in types:
                continue
            for slot in [slot for slot in candidates if slot.name == name]:
                total = _sum_up(value, slot, candidates[slot], number < patience)
                if total is not None:
                    proved[slot] = total
                elif slot in counted:
                    del candidates[slot]
                    counted.discard(slot)
                    settled = False
            kind = _put_parts(name, value.type, {slot: far[slot] for slot in counted})
            if is_supertype(assumed[name], kind):
                continue
            settled = False
            counting = {slot for slot in proved if slot.name == name} - counted
            counted |= counting
            types[name] = unite((types[name], kind if counting or number < patience else drop_bounds(value.type)))
        if settled:
            return {name: _put_parts(name, kind, {s: proved[s] for s in counted}) for name, kind in assumed.items()}
    return None


class Slot(NamedTuple):
    """A number in the state: a START WITH variable, or the element at `position` of one that holds a short list."""

    query: int
    name: str
    position: int | None

    def is_read_by(self, expr: plan.Expr) -> bool:
        """Whether the expression is the number as it was before the step."""
        match expr:
            case plan.State(query=self.query, name=self.name):
                return self.position is None
            case plan.Call(
                function=plan.Function(name="item", builtin=True),
                arguments=(plan.State(query=self.query, name=self.name), plan.Constant(value=int(position))),
            ):
                return position == self.position
            case _:
                return False


def _split_type(kind: Type) -> dict[int | None, Type]:
    """The types of the elements of a short list by their positions; of any other type itself."""
    return dict(enumerate(kind.positions)) if kind.is_only(Kind.LIST) and kind.positions else {None: kind}


def _put_parts(name: str, kind: Type, known: Mapping[Slot, Type]) -> Type:
    """The type of a variable with these types of the numbers in it."""
    parts = _split_type(kind)
    changed = {slot.position: part for slot, part in known.items() if slot.name == name and slot.position in parts}
    if None in changed:
        return changed[None]
    return make_list_type([changed.get(at, part) for at, part in parts.items()]) if changed else kind


def _resolve_connect(
    resolver: Resolver, tree: ast.Query, scope: Scope, types: Mapping[str, Type]
) -> list[tuple[str, plan.Expr]]:
    """CONNECT BY with these types of variables. Nothing else is remembered."""
    attempt = scope.copy_scopes()
    attempt.states.update(types)
    errors = len(resolver.errors)
    stable = (dict(resolver.parameters), dict(resolver.tables), resolver.tentative, resolver.numbers)
    resolve_sources(resolver, tree, attempt)
    before = attempt.enter_clause("CONNECT BY")
    connect: list[tuple[str, plan.Expr]] = []
    for assign in tree.connect:
        value = resolver.record_errors(resolver.resolve_expr, assign.value, attempt)
        value = resolver.inliner.inline_calls(value)  # a proof sees through the user's functions
        connect.append((assign.name, value))
    attempt.enter_clause(before)
    del resolver.errors[errors:]
    resolver.parameters, resolver.tables, resolver.tentative, resolver.numbers = stable
    return connect


# --- the size of numbers that steps change by bounded amounts
def _sum_up(value: plan.Expr, slot: Slot, first: Type, hasty: bool) -> Type | None:
    """The type of a number that steps change by bounded amounts, or set to bounded values; None where none is proved.

    `hasty` sees plain sums alone: `max(x - 1, 0)` may stay within bounds that are closer.
    """
    if slot.position is not None:
        items = value.items if isinstance(value, plan.MakeList) else ()
        if slot.position >= len(items):
            return None
        value = items[slot.position]
    parts = tuple(_list_alternatives(value))
    if not value.type.is_only(first.kinds) or (hasty and len(parts) > 1):
        return None
    changes = [(_find_change(part, slot), part.type) for part in parts]
    least = min((change[0] for change, _ in changes if change is not None), default=0)
    most = max((change[1] for change, _ in changes if change is not None), default=0)
    fixed = unite((first, *(kind for change, kind in changes if change is None)))
    if fixed.low is None or fixed.high is None or least == most == 0:
        return None
    # Rounding changes a sum of floats by at most what was added.
    steps = STEPS * (4 if first.kinds == Kind.FLOAT else 1)
    found = Type(first.kinds, fixed.low + min(least, 0) * steps, fixed.high + max(most, 0) * steps)
    return found if found.is_bounded(_LIMITS[first.kinds]) else None


def _list_alternatives(expr: plan.Expr) -> Iterator[plan.Expr]:
    """The expressions of which the value is that of one."""
    match expr:
        case plan.If(then=then, otherwise=otherwise):
            for branch in (then, otherwise):
                yield from _list_alternatives(branch[-1])
        case plan.Call(function=plan.Function(name="min" | "max", builtin=True)) if choices := list_plan_choices(expr):
            for choice in choices:
                yield from _list_alternatives(choice)
        case _:
            yield expr


def _find_change(expr: plan.Expr, slot: Slot) -> tuple[float, float] | None:
    """What is added to the number at least and at most, where it is known to be a sum with it."""
    if slot.is_read_by(expr):
        return 0, 0
    match expr:
        case plan.Call(function=plan.Function(name="add", builtin=True), arguments=(left, right)):
            change, other = _find_change(left, slot), right.type
            if change is None:
                change, other = _find_change(right, slot), left.type
            if change is not None and other.low is not None and other.high is not None:
                return change[0] + other.low, change[1] + other.high
        case plan.Call(function=plan.Function(name="sub", builtin=True), arguments=(left, right)):
            change, other = _find_change(left, slot), right.type
            if change is not None and other.low is not None and other.high is not None:
                return change[0] - other.high, change[1] - other.low
    return None

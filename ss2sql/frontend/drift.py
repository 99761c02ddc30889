"""Bounds of the numbers in a search's state: `x = x + dx` adds a bounded amount with every step.

Where every step changes a number by bounded amounts, or sets it to a bounded value, its size follows from the number
of steps, by induction. Types alone cannot prove it: each step would widen the bounds of the last one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from ss2sql import plan
from ss2sql.kinds import Kind, Type, list_of
from ss2sql.language.operations.intervals import floats, integers
from ss2sql.records import dataclass
from ss2sql.walk import choices

# No path has more steps: each keeps its row until the search ends, at 100 bytes or more, so 2^36 of them take
# 6 TB (and at 0.3 us a step, which nothing here reaches, 6 hours).
STEPS = 2**36

NUMBER = Kind.INT | Kind.FLOAT

# The bounds that are assumed until they are proved. Integers of this size can be added without leaving 64 bits.
_LARGEST_INT, _LARGEST_FLOAT = 2**62, 1e300
_EXACT = 2**53  # integers up to here are floats, too


@dataclass(frozen=True, slots=True)
class Slot:
    """A number in the state: a START WITH variable, or the element at `position` of one that holds a short list."""

    query: int
    name: str
    position: int | None
    kinds: Kind

    @property
    def limit(self) -> float:
        return _LARGEST_INT if self.kinds & Kind.INT else _LARGEST_FLOAT

    @property
    def assumed(self) -> Type:
        return Type(self.kinds, -self.limit, self.limit)

    def part(self, variable: Type) -> Type | None:
        """The type of the number within a type of its variable; None where the variable may hold something else."""
        if self.position is None:
            return variable if variable.only(NUMBER) else None
        if not variable.only(Kind.LIST) or variable.positions is None or self.position >= len(variable.positions):
            return None
        part = variable.positions[self.position]
        return part if part.only(NUMBER) else None


def slots_of(query: int, name: str, first: Type) -> Iterator[Slot]:
    """The numbers in a START WITH variable, found by the type of its first value."""
    candidates = [Slot(query, name, None, first.kinds)]
    candidates += [Slot(query, name, at, part.kinds) for at, part in enumerate(first.positions or ())]
    return (slot for slot in candidates if slot.part(first) is not None)


def with_slots(variable: Type, types: Sequence[tuple[Slot, Type]]) -> Type:
    """The type of a variable with other types for the numbers in it."""
    changed = {slot.position: kind for slot, kind in types if slot.part(variable) is not None}
    if None in changed:
        return changed[None]
    if not changed:
        return variable
    return list_of([changed.get(at, part) for at, part in enumerate(variable.positions or ())])


Interval = tuple[float, float]


@dataclass(frozen=True, slots=True)
class _Drift:
    """A value in the interval `fixed`, or in the interval `shift` around the number before the step."""

    shift: Interval | None = None
    fixed: Interval | None = None


_UNCHANGED = _Drift(shift=(0, 0))


def reach(slot: Slot, first: Type, following: plan.Expr) -> Type | None:
    """The type of a number throughout the search, None where no bound is proved.

    Args:
        slot: the number, with all kinds that it ever has.
        first: its type in the START WITH state.
        following: what CONNECT BY assigns to its variable.
    """
    drift = _of_variable(following, slot)
    bases = [base for base in (_interval(first), drift.fixed) if base is not None]
    low, high = min((base[0] for base in bases), default=0), max((base[1] for base in bases), default=0)
    if slot.kinds == NUMBER and not -_EXACT <= low <= high <= _EXACT:
        return None  # an integer that becomes a float could be rounded beyond it
    if drift.shift is not None:
        # Rounding changes a sum of floats by at most what was added, an integer that becomes a float as well.
        steps = STEPS * 4 if slot.kinds & Kind.FLOAT else STEPS
        low, high = low + min(drift.shift[0], 0) * steps, high + max(drift.shift[1], 0) * steps
    return Type(slot.kinds, low, high) if -slot.limit <= low <= high <= slot.limit else None


def _interval(kind: Type) -> Interval | None:
    """The bounds of the numbers of a type, None if there are none."""
    return floats(kind) if kind.may(Kind.FLOAT) else integers(kind)


def _of_variable(expr: plan.Expr, slot: Slot) -> _Drift:
    """The change of a number, from the expression that its whole variable is set to."""
    if slot.position is None:
        return _of_number(expr, slot)
    match expr:
        case plan.State(query=slot.query, name=slot.name):
            return _UNCHANGED
        case plan.MakeList(items=items):
            return _of_number(items[slot.position], slot)
        case plan.If(then=then, otherwise=otherwise):
            return _either(_of_variable(branch[-1], slot) for branch in (then, otherwise))
        case _:
            part = slot.part(expr.type)
            return _Drift() if part is None else _Drift(fixed=_interval(part))


def _of_number(expr: plan.Expr, slot: Slot) -> _Drift:
    if is_slot(expr, slot):
        return _UNCHANGED
    moved = _moved(expr, slot)
    return _Drift(fixed=_interval(expr.type)) if moved is None or moved.shift is None else moved


def is_slot(expr: plan.Expr, slot: Slot) -> bool:
    """Whether the expression is the number as it was before the step."""
    match expr:
        case plan.State(query=slot.query, name=slot.name):
            return slot.position is None
        case plan.Call(
            function=plan.Function(name="item", builtin=True),
            arguments=(plan.State(query=slot.query, name=slot.name), plan.Constant(value=int(position))),
        ):
            return slot.position is not None and position == slot.position
        case _:
            return False


def _moved(expr: plan.Expr, slot: Slot) -> _Drift | None:
    """The change that an expression over the number makes; None where only its type is known."""
    match expr:
        case plan.If(then=then, otherwise=otherwise):
            return _either(_of_number(branch[-1], slot) for branch in (then, otherwise))
        case plan.Call(function=plan.Function(name="min" | "max", builtin=True)) if candidates := choices(expr):
            return _either(_of_number(item, slot) for item in candidates)
        case plan.Call(function=plan.Function(name="add", builtin=True), arguments=(left, right)):
            return _sum(_of_number(left, slot), _of_number(right, slot))
        case plan.Call(function=plan.Function(name="sub", builtin=True), arguments=(left, right)):
            taken = _of_number(right, slot)
            if taken.shift is not None or taken.fixed is None:
                return None
            return _sum(_of_number(left, slot), _Drift(fixed=(-taken.fixed[1], -taken.fixed[0])))
        case _:
            return None


def _sum(a: _Drift, b: _Drift) -> _Drift | None:
    if a.shift is not None and b.shift is not None:
        return None
    if b.shift is not None:
        a, b = b, a
    return _Drift(_added(a.shift, b.fixed), _added(a.fixed, b.fixed))


def _added(a: Interval | None, b: Interval | None) -> Interval | None:
    return None if a is None or b is None else (a[0] + b[0], a[1] + b[1])


def _either(drifts: Iterable[_Drift]) -> _Drift:
    all_of_them = list(drifts)
    return _Drift(_hull(drift.shift for drift in all_of_them), _hull(drift.fixed for drift in all_of_them))


def _hull(intervals: Iterable[Interval | None]) -> Interval | None:
    known = [interval for interval in intervals if interval is not None]
    return (min(low for low, _ in known), max(high for _, high in known)) if known else None

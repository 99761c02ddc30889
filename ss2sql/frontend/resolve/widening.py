"""Bounds of the numbers in a search's state: `x = x + dx` adds a bounded amount with every step.

Where every step changes a number by bounded amounts, or sets it to a bounded value, its size follows from the number
of steps, by induction. Types alone cannot prove it: each step would widen the bounds of the last one.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Kind, Type, make_list_type
from ss2sql.language.operations.intervals import bound_floats, bound_integers
from ss2sql.language.plan_traversal import list_choices

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
    def assumed_type(self) -> Type:
        return Type(self.kinds, -self.limit, self.limit)

    def find_part(self, variable: Type) -> Type | None:
        """The type of the number within a type of its variable; None where the variable may hold something else."""
        if self.position is None:
            return variable if variable.is_only(NUMBER) else None
        if not variable.is_only(Kind.LIST) or variable.positions is None or self.position >= len(variable.positions):
            return None
        part = variable.positions[self.position]
        return part if part.is_only(NUMBER) else None


def get_slots(query: int, name: str, first: Type) -> Iterator[Slot]:
    """The numbers in a START WITH variable, found by the type of its first value."""
    candidates = [Slot(query, name, None, first.kinds)]
    candidates += [Slot(query, name, at, part.kinds) for at, part in enumerate(first.positions or ())]
    return (slot for slot in candidates if slot.find_part(first) is not None)


def set_slots(variable: Type, types: Sequence[tuple[Slot, Type]]) -> Type:
    """The type of a variable with other types for the numbers in it."""
    changed = {slot.position: kind for slot, kind in types if slot.find_part(variable) is not None}
    if None in changed:
        return changed[None]
    if not changed:
        return variable
    return make_list_type([changed.get(at, part) for at, part in enumerate(variable.positions or ())])


Interval = tuple[float, float]


@dataclass(frozen=True, slots=True)
class _Change:
    """A value in the interval `fixed`, or in the interval `shift` around the number before the step."""

    shift: Interval | None = None
    fixed: Interval | None = None


_UNCHANGED = _Change(shift=(0, 0))


def widen_number(slot: Slot, first: Type, following: plan.Expr) -> Type | None:
    """The type of a number throughout the search, None where no bound is proved.

    Args:
        slot: the number, with all kinds that it ever has.
        first: its type in the START WITH state.
        following: what CONNECT BY assigns to its variable.
    """
    change = _derive_variable_change(following, slot)
    bases = [base for base in (_make_interval(first), change.fixed) if base is not None]
    low, high = min((base[0] for base in bases), default=0), max((base[1] for base in bases), default=0)
    if slot.kinds == NUMBER and not -_EXACT <= low <= high <= _EXACT:
        return None  # an integer that becomes a float could be rounded beyond it
    if change.shift is not None:
        # Rounding changes a sum of floats by at most what was added, an integer that becomes a float as well.
        steps = STEPS * 4 if slot.kinds & Kind.FLOAT else STEPS
        low, high = low + min(change.shift[0], 0) * steps, high + max(change.shift[1], 0) * steps
    return Type(slot.kinds, low, high) if -slot.limit <= low <= high <= slot.limit else None


def _make_interval(kind: Type) -> Interval | None:
    """The bounds of the numbers of a type, None if there are none."""
    return bound_floats(kind) if kind.may_be(Kind.FLOAT) else bound_integers(kind)


def _derive_variable_change(expr: plan.Expr, slot: Slot) -> _Change:
    """The change of a number, from the expression that its whole variable is set to."""
    if slot.position is None:
        return _derive_number_change(expr, slot)
    match expr:
        case plan.State(query=slot.query, name=slot.name):
            return _UNCHANGED
        case plan.MakeList(items=items):
            return _derive_number_change(items[slot.position], slot)
        case plan.If(then=then, otherwise=otherwise):
            return _join_changes(_derive_variable_change(branch[-1], slot) for branch in (then, otherwise))
        case _:
            part = slot.find_part(expr.type)
            return _Change() if part is None else _Change(fixed=_make_interval(part))


def _derive_number_change(expr: plan.Expr, slot: Slot) -> _Change:
    if is_slot(expr, slot):
        return _UNCHANGED
    moved = _derive_change(expr, slot)
    return _Change(fixed=_make_interval(expr.type)) if moved is None or moved.shift is None else moved


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


def _derive_change(expr: plan.Expr, slot: Slot) -> _Change | None:
    """The change that an expression over the number makes; None where only its type is known."""
    match expr:
        case plan.If(then=then, otherwise=otherwise):
            return _join_changes(_derive_number_change(branch[-1], slot) for branch in (then, otherwise))
        case plan.Call(function=plan.Function(name="min" | "max", builtin=True)) if candidates := list_choices(expr):
            return _join_changes(_derive_number_change(item, slot) for item in candidates)
        case plan.Call(function=plan.Function(name="add", builtin=True), arguments=(left, right)):
            return _add_intervals(_derive_number_change(left, slot), _derive_number_change(right, slot))
        case plan.Call(function=plan.Function(name="sub", builtin=True), arguments=(left, right)):
            taken = _derive_number_change(right, slot)
            if taken.shift is not None or taken.fixed is None:
                return None
            return _add_intervals(_derive_number_change(left, slot), _Change(fixed=(-taken.fixed[1], -taken.fixed[0])))
        case _:
            return None


def _add_intervals(a: _Change, b: _Change) -> _Change | None:
    if a.shift is not None and b.shift is not None:
        return None
    if b.shift is not None:
        a, b = b, a
    return _Change(_add_changes(a.shift, b.fixed), _add_changes(a.fixed, b.fixed))


def _add_changes(a: Interval | None, b: Interval | None) -> Interval | None:
    return None if a is None or b is None else (a[0] + b[0], a[1] + b[1])


def _join_changes(drifts: Iterable[_Change]) -> _Change:
    all_of_them = list(drifts)
    return _Change(
        _join_intervals(change.shift for change in all_of_them), _join_intervals(change.fixed for change in all_of_them)
    )


def _join_intervals(intervals: Iterable[Interval | None]) -> Interval | None:
    known = [interval for interval in intervals if interval is not None]
    return (min(low for low, _ in known), max(high for _, high in known)) if known else None

"""When the parts of a flat query's row are evaluated.

The *level* of an expression is the number of sources that are bound when it is evaluated. As written, WHERE
and the columns are evaluated when all are bound. A part that cannot fail is
evaluated as soon as the sources that it reads are bound. One that may fail waits for the conditions before it, which
guard it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import field

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.plan_traversal import (
    can_fail,
    list_sources,
    walk,
)

# --- when the parts of a flat query's row are evaluated: as early as their guards allow
MAX_HOISTED = 24


@dataclass(frozen=True, slots=True)
class Condition:
    """A part of WHERE with its level. A `free` one may be evaluated at any time from then on."""

    expr: plan.Expr
    level: int
    free: bool


@dataclass(frozen=True, slots=True)
class HoistedValue:
    """A value that is computed once at its level and read further in."""

    expr: plan.Expr
    level: int


@dataclass(slots=True)
class EvaluationOrder:
    """The levels of one query."""

    query: plan.Query
    early: bool
    may_hoist: bool
    number: dict[int, int] = field(init=False)

    def __post_init__(self) -> None:
        self.number = {source.id: position for position, source in enumerate(self.query.sources, 1)}

    # --- expressions -----------------------------------------------------------------------------------

    def count_sources(self, expr: object) -> int:
        """The number of sources that have to be bound for the expression."""
        return max((self.number.get(source, 0) for source in list_sources(expr)), default=0)

    def split_where(self) -> list[Condition]:
        """The parts of WHERE in written order. One that may fail is not evaluated before those that guard it."""
        last = len(self.query.sources)
        parts = () if self.query.where is None else tuple(_iterate_conjuncts(self.query.where))
        placed: list[Condition] = []
        reached = 1
        for part in parts:
            level, fails = self.count_sources(part), can_fail(part)
            if fails:
                level = max(level, reached) if self.early else last
            reached = max(reached, level)
            placed.append(Condition(part, level, not fails))
        return placed

    def find_hoisted_values(self, conditions: Sequence[Condition], outputs: Sequence[plan.Expr]) -> list[HoistedValue]:
        """The values to compute early: those of costly expressions in WHERE, then in `outputs`, innermost first.

        None is computed before the conditions that guard it.
        """
        if not self.may_hoist or len(self.query.sources) < 2:
            return []
        found: dict[plan.Expr, HoistedValue] = {}
        guarded = 1
        for condition in conditions:
            self._hoist(condition.expr, condition.level, guarded, found)
            guarded = max(guarded, condition.level)
        for output in outputs:
            self._hoist(output, len(self.query.sources), guarded, found)
        return list(found.values())[:MAX_HOISTED]

    def _hoist(self, expr: plan.Expr, level: int, guarded: int, found: dict[plan.Expr, HoistedValue]) -> None:
        """Finds what of an expression that is certainly evaluated at this level can be from an earlier one on."""
        if expr in found or not _is_costly(expr):
            return
        own = min(level, max(self.count_sources(expr), guarded))
        for part in _iterate_certain_parts(expr):
            self._hoist(part, own, guarded, found)
        if own < level:
            found[expr] = HoistedValue(expr, own)


def _iterate_conjuncts(expr: plan.Expr) -> Iterator[plan.Expr]:
    """The parts of a conjunction, those of conjunctions inside of it, too: SQLite takes it apart as well."""
    if isinstance(expr, plan.And):
        for part in expr.parts:
            yield from _iterate_conjuncts(part)
    else:
        yield expr


def _iterate_certain_parts(expr: plan.Expr) -> Iterator[plan.Expr]:
    """The parts that are evaluated whenever the expression is, up to the first that may not be."""
    match expr:
        case plan.Call(arguments=arguments):
            yield from arguments
        case plan.MakeList(items=items):
            yield from items
        case plan.And(parts=parts) | plan.Or(parts=parts):
            yield parts[0]
        case plan.Not(operand=operand):
            yield operand
        case plan.If(condition=condition):
            yield condition
        case plan.Xor(left=left, right=right):
            yield left
            yield right


def _is_costly(expr: plan.Expr) -> bool:
    """Whether keeping the value is worth a column: calls of user functions, and queries."""
    return any(
        isinstance(node, plan.Subquery) or (isinstance(node, plan.Call) and not node.function.builtin)
        for node in walk(expr)
    )

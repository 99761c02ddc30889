"""Bounds that a condition implies for the numbers in it: where `x + dx < 0` is false, `x + dx` is at least 0.

Where `grid[y][x] == 1` could be evaluated, y and x are indices of these lists, so the lengths bound them.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import replace

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import NOTHING, Kind, Type, type_of
from ss2sql.language.operations import OPERATIONS
from ss2sql.language.plan_traversal import is_volatile

_ORDERS = {row.name: row for row in OPERATIONS.values() if row.mirrored and row.mirrored != row.name}


@dataclass(frozen=True, slots=True)
class Comparison:
    """The comparison `left sign right` holds; `sign` is one of `< <= > >=`."""

    sign: str
    left: plan.Expr
    right: plan.Expr


def collect_comparisons(condition: plan.Expr, truth: bool) -> Iterator[Comparison]:
    """The comparisons that hold where `condition` is `truth`, each written from both sides."""
    match condition:
        case plan.Not(operand=operand):
            yield from collect_comparisons(operand, not truth)
        case plan.Or(parts=parts) if not truth:
            for part in parts:
                yield from collect_comparisons(part, False)
        case plan.And(parts=parts) if truth:
            for part in parts:
                yield from collect_comparisons(part, True)
        case plan.Call(function=plan.Function(name=name, builtin=True), arguments=arguments):
            if is_volatile(condition):
                return
            if name in _ORDERS:
                left, right = arguments
                sign = name if truth else _ORDERS[name].negated
                yield Comparison(sign, left, right)
                yield Comparison(_ORDERS[sign].mirrored, right, left)
            elif (name, truth) in (("in", True), ("not_in", False)):
                yield from _compare_with_type(arguments[0], arguments[1].type.item)
            yield from _compare_indices(condition)


def _compare_with_type(expr: plan.Expr, kind: Type | None) -> Iterator[Comparison]:
    """The bounds of an expression that equals a value of `kind`, and of the items of a list."""
    if isinstance(expr, plan.MakeList) and kind is not None and kind.positions is not None:
        for item, part in zip(expr.items, kind.positions, strict=False):
            yield from _compare_with_type(item, part)
    elif kind is not None and kind.is_only(Kind.NUMBER) and kind.low is not None and kind.high is not None:
        yield from _compare_with_bounds(expr, kind.low, kind.high)


def _compare_with_bounds(expr: plan.Expr, low: float, high: float) -> Iterator[Comparison]:
    for sign, bound in (("ge", low), ("le", high)):
        yield Comparison(sign, expr, plan.Constant(bound, type_of(bound), span=expr.span))


def _compare_indices(expr: plan.Expr) -> Iterator[Comparison]:
    """The bounds of the numbers that index lists in `expr`."""
    match expr:
        case plan.Call(function=plan.Function(name="item", builtin=True), arguments=(container, index)):
            size = container.type.size
            if container.type.is_only(Kind.LIST) and index.type.is_only(Kind.INT) and size:
                yield from _compare_with_bounds(index, -size, size - 1)
    if isinstance(expr, plan.Call) and expr.function.name != "coalesce":  # SQLite stops at the first value
        for argument in expr.arguments:
            yield from _compare_indices(argument)


def narrow_type(expr: plan.Expr, facts: Iterable[Comparison]) -> Type:
    """The type of an expression, within the bounds of the comparisons `facts`."""
    kind = expr.type
    for fact in facts:
        if fact.left == expr:
            kind = restrict_by_order(kind, fact.sign, fact.right.type)
    return kind


def restrict_by_order(kind: Type, sign: str, other: Type) -> Type:
    """The values of `kind` that compare so with some value of `other`."""
    whole = kind.is_only(Kind.BOOL | Kind.INT)
    low, high = other.low, other.high
    match sign:
        case "ge":
            return restrict_to_interval(kind, low, None)
        case "gt":
            return restrict_to_interval(kind, math.floor(low) + 1 if whole and low is not None else low, None)
        case "le":
            return restrict_to_interval(kind, None, high)
        case _:
            return restrict_to_interval(kind, None, math.ceil(high) - 1 if whole and high is not None else high)


def restrict_to_interval(kind: Type, low: float | None, high: float | None) -> Type:
    """The type with its numbers limited to `low`..`high`; other values are unchanged."""
    if not kind.may_be(Kind.NUMBER):
        return kind
    lows = [bound for bound in (kind.low, low) if bound is not None]
    highs = [bound for bound in (kind.high, high) if bound is not None]
    closer = replace(kind, low=max(lows, default=None), high=min(highs, default=None))
    if closer.low is not None and closer.high is not None and closer.low > closer.high:
        return NOTHING if kind.is_only(Kind.NUMBER) else kind
    return closer

"""Inlining: calls of functions with known bodies, replaced by the expressions that they compute.

The resolver uses the types, so that it can prove as much of `x = move(x)` as of `x = x + 1`; the rewrite `inline` uses
the expressions. Integers beyond 64 bits and infinite floats are errors of the function, so where only large numbers
prevent inlining, the call remains for them:

    IF(x <= limit AND x >= -limit; x + 1; inc(x))
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ss2sql import plan
from ss2sql.frontend.instances import NOWHERE, Instance, Refused, builtin, may_repeat
from ss2sql.kinds import ANY, BOOL, Kind, Type, type_of, union, without_bounds
from ss2sql.records import dataclass
from ss2sql.walk import junction, rebuild

# Sums, products of two and of more stay within 64 bits where their parts stay within these.
LIMITS = (10**15, 10**9, 10**6, 10**4)


@dataclass(frozen=True, slots=True)
class Site:
    """What became of one call: `limit` is the size of numbers up to which it is inlined, `reason` why it is not."""

    function: plan.Function
    limit: int | None = None
    reason: str | None = None


class Inliner:
    """Replaces calls by bodies. `sources` are those that elements belong to, by their numbers.

    `sites` records what became of each call, by its place in the script.
    """

    def __init__(self) -> None:
        self.sources: dict[int, plan.Source] = {}
        self.sites: dict[tuple[int, int, str], Site] = {}
        self._known: dict[int, tuple[Any, Any]] = {}
        self._read: dict[tuple[int, str, Type], plan.Column] = {}

    def expr(self, node: Any) -> Any:
        """The node with every possible call in it inlined."""
        known = self._known.get(id(node))
        if known is not None:
            return known[1]
        changed = rebuild(node, self.expr)
        if isinstance(changed, plan.Call) and changed.function.body is not None:
            changed = self.call(changed)
        return self._note(node, changed)

    def _note(self, node: Any, changed: Any) -> Any:
        """Caches the result for a node by its identity, and keeps the node alive for that."""
        self._known[id(node)] = (node, changed)
        return changed

    def typed(self, call: plan.Call) -> plan.Call:
        """A call with the type of the inlined expression, if any."""
        if call.function.body is None:
            return call
        changed = self.expr(replace(call, type=ANY))
        call = replace(call, type=changed.type)
        self._note(call, changed)
        return call

    def call(self, call: plan.Call) -> plan.Expr:
        """The replacement of a call whose arguments are already processed."""
        limit: int | None = None
        reason: str | None = None
        result: plan.Expr | None = None
        try:
            result = Instance(call, self._column).expr
        except Refused as refused:
            reason = str(refused)
            if refused.fallible:
                limit, result = self._limited(call)
        place = (id(call.span.source), call.span.start, call.function.name)
        self.sites[place] = Site(call.function, limit, reason if result is None else None)
        return call if result is None else result

    def _limited(self, call: plan.Call) -> tuple[int | None, plan.Expr | None]:
        """The call inlined for numbers within a limit, with the limit; None where no limit suffices."""
        if not all(map(may_repeat, call.arguments)):
            return None, None
        for limit in LIMITS:
            instance = self._attempt(call, limit, frozenset())
            if instance is not None:
                return limit, _guarded(call, self._least(call, instance, limit), limit)
        return None, None

    def _attempt(self, call: plan.Call, limit: int, spared: frozenset[int]) -> Instance | None:
        try:
            return Instance(call, self._column, limit, spared)
        except Refused:
            return None

    def _least(self, call: plan.Call, instance: Instance, limit: int) -> Instance:
        """The instance with the limit on as few numbers as possible."""
        for key in list(instance.limited):
            instance = self._attempt(call, limit, instance.spared | {key}) or instance
        return instance

    def _column(self, element: plan.Element, name: str) -> plan.Column | None:
        """The column of a row that certainly has it; always the same node, because limits go by identity."""
        source = self.sources.get(element.source)
        kind = dict(source.columns or ()).get(name) if source is not None else None
        if source is None or kind is None or not kind.kinds or kind.may(Kind.OBJECT):
            return None
        if not isinstance(source, plan.TableSource):
            made = isinstance(source, plan.QuerySource) and source.query.representation.name == "dict"
            # A key that an element lacks counts as None.
            if not source.element.only(Kind.DICT) or (kind.may(Kind.NONE) and not made):
                return None
        return self._read.setdefault((source.id, name, kind), plan.Column(source.id, name, kind, span=element.span))


def _guarded(call: plan.Call, instance: Instance, limit: int) -> plan.Expr:
    """The inlined expression for numbers within the limit, the call for all others."""
    bounds = {
        "le": plan.Constant(limit, type_of(limit), span=NOWHERE),
        "ge": plan.Constant(-limit, type_of(-limit), span=NOWHERE),
    }
    conditions: list[plan.Expr] = []
    for number in instance.limited.values():
        low, high = number.type.low, number.type.high
        needed = {"le": high is None or high > limit, "ge": low is None or low < -limit}
        for name in (name for name, counts in needed.items() if counts):
            function = replace(builtin(name), raises=False)
            conditions.append(plan.Call(function, (number, bounds[name]), BOOL, span=call.span, place=call.place))
    # Beyond the limit the function gives the same kinds of values, or an error.
    kind = instance.expr.type
    kind = kind if kind.only(Kind.BOOL) else without_bounds(kind)
    rest = replace(call, function=replace(call.function, body=None), type=kind)
    condition = junction(plan.And, conditions, call.span)
    return plan.If(condition, (instance.expr,), (rest,), union((instance.expr.type, kind)), span=call.span)

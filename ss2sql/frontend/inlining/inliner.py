"""Inlining: calls of functions with known bodies, replaced by the expressions that they compute.

The resolver uses the types, so that it can prove as much of `x = move(x)` as of `x = x + 1`; the rewrite `inline` uses
the expressions. Integers beyond 64 bits and infinite floats are errors of the function, so where only large numbers
prevent inlining, the call remains for them:

    IF(x <= limit AND x >= -limit; x + 1; inc(x))
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.frontend.inlining.substitution import NO_SPAN, Instance, NotInlinable, find_builtin, is_repeatable
from ss2sql.language import plan
from ss2sql.language.kinds import ANY, BOOL, Kind, Type, drop_bounds, type_of, unite
from ss2sql.language.plan_traversal import join_conditions, rebuild_node

# Sums, products of two and of more stay within 64 bits where their parts stay within these.
LIMITS = (10**15, 10**9, 10**6, 10**4)


@dataclass(frozen=True, slots=True)
class InlinedCall:
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
        self.sites: dict[tuple[int, int, str], InlinedCall] = {}
        self._known: dict[int, tuple[Any, Any]] = {}
        self._read: dict[tuple[int, str, Type], plan.Column] = {}

    def inline_calls(self, node: Any) -> Any:
        """The node with every possible call in it inlined."""
        known = self._known.get(id(node))
        if known is not None:
            return known[1]
        changed = rebuild_node(node, self.inline_calls)
        if isinstance(changed, plan.Call) and changed.function.body is not None:
            changed = self.inline_call(changed)
        return self._cache_result(node, changed)

    def _cache_result(self, node: Any, changed: Any) -> Any:
        """Caches the result for a node by its identity, and keeps the node alive for that."""
        self._known[id(node)] = (node, changed)
        return changed

    def refine_type(self, call: plan.Call) -> plan.Call:
        """A call with the type of the inlined expression, if any."""
        if call.function.body is None:
            return call
        changed = self.inline_calls(replace(call, type=ANY))
        call = replace(call, type=changed.type)
        self._cache_result(call, changed)
        return call

    def inline_call(self, call: plan.Call) -> plan.Expr:
        """The replacement of a call whose arguments are already processed."""
        limit: int | None = None
        reason: str | None = None
        result: plan.Expr | None = None
        try:
            result = Instance(call, self._find_column).expr
        except NotInlinable as refused:
            reason = str(refused)
            if refused.fallible:
                limit, result = self._inline_within_limit(call)
        place = (id(call.span.source), call.span.start, call.function.name)
        self.sites[place] = InlinedCall(call.function, limit, reason if result is None else None)
        return call if result is None else result

    def _inline_within_limit(self, call: plan.Call) -> tuple[int | None, plan.Expr | None]:
        """The call inlined for numbers within a limit, with the limit; None where no limit suffices."""
        if not all(map(is_repeatable, call.arguments)):
            return None, None
        for limit in LIMITS:
            instance = self._try_instance(call, limit, frozenset())
            if instance is not None:
                return limit, _choose_by_limit(call, self._find_least_limit(call, instance, limit), limit)
        return None, None

    def _try_instance(self, call: plan.Call, limit: int, excluded: frozenset[int]) -> Instance | None:
        try:
            return Instance(call, self._find_column, limit, excluded)
        except NotInlinable:
            return None

    def _find_least_limit(self, call: plan.Call, instance: Instance, limit: int) -> Instance:
        """The instance with the limit on as few numbers as possible."""
        for key in list(instance.limited):
            instance = self._try_instance(call, limit, instance.spared | {key}) or instance
        return instance

    def _find_column(self, element: plan.Element, name: str) -> plan.Column | None:
        """The column of a row that certainly has it; always the same node, because limits go by identity."""
        source = self.sources.get(element.source)
        kind = dict(source.columns or ()).get(name) if source is not None else None
        if source is None or kind is None or not kind.kinds or kind.may_be(Kind.OBJECT):
            return None
        if not isinstance(source, plan.TableSource):
            made = isinstance(source, plan.QuerySource) and source.query.representation.name == "dict"
            # A key that an element lacks counts as None.
            if not source.element.is_only(Kind.DICT) or (kind.may_be(Kind.NONE) and not made):
                return None
        return self._read.setdefault((source.id, name, kind), plan.Column(source.id, name, kind, span=element.span))


def _choose_by_limit(call: plan.Call, instance: Instance, limit: int) -> plan.Expr:
    """The inlined expression for numbers within the limit, the call for all others."""
    bounds = {
        "le": plan.Constant(limit, type_of(limit), span=NO_SPAN),
        "ge": plan.Constant(-limit, type_of(-limit), span=NO_SPAN),
    }
    conditions: list[plan.Expr] = []
    for number in instance.limited.values():
        low, high = number.type.low, number.type.high
        needed = {"le": high is None or high > limit, "ge": low is None or low < -limit}
        for name in (name for name, counts in needed.items() if counts):
            function = replace(find_builtin(name), raises=False)
            conditions.append(plan.Call(function, (number, bounds[name]), BOOL, span=call.span, place=call.place))
    # Beyond the limit the function gives the same kinds of values, or an error.
    kind = instance.expr.type
    kind = kind if kind.is_only(Kind.BOOL) else drop_bounds(kind)
    rest = replace(call, function=replace(call.function, body=None), type=kind)
    condition = join_conditions(plan.And, conditions, call.span)
    return plan.If(condition, (instance.expr,), (rest,), unite((instance.expr.type, kind)), span=call.span)

"""What the compiler knows of an expression: what it depends on, and whether its evaluation could be noticed."""

from __future__ import annotations

from collections.abc import Hashable
from dataclasses import dataclass, replace
from typing import Any

from ss2sql import plan
from ss2sql.kinds import Kind
from ss2sql.walk import parts, walk


@dataclass(frozen=True, slots=True)
class Facts:
    """Facts of one node of a plan.

    `sources` and `states` are what it reads, nested queries included; `groups` are the queries of whose groups
    it reads values (OWN_GROUP: aggregates, which no nested query sees). A `steady` node gives the same value in the same row however often it is evaluated, and has no
    effect; it may raise. A `total` node cannot raise. `key` is the same for expressions that are the same
    text with the same meaning (None where that is not known); `costly` marks calls of user functions and
    queries, whose values are worth keeping.
    """

    sources: frozenset[int] = frozenset()
    states: frozenset[tuple[int, str]] = frozenset()
    groups: frozenset[int] = frozenset()
    steady: bool = True
    total: bool = True
    key: int | None = None
    costly: bool = False


OWN_GROUP = -1


class Analysis:
    """The facts of everything below some nodes of a plan.

    With `open_world`, or where there is an `eval` or a late list, any variable may change at any time; else
    only those that are assigned below the nodes.
    """

    def __init__(self, roots: tuple[Any, ...], open_world: bool = False) -> None:
        self._facts: dict[int, Facts] = {}
        self._keys: dict[Hashable, int] = {}
        self._roots = roots  # kept alive, for facts go by identity
        nodes = [node for root in roots for node in walk(root)]
        self.assigned = {node.name for node in nodes if isinstance(node, (plan.Assign, plan.TemporalAssign))}
        self.open_world = open_world or any(isinstance(node, (plan.Eval, plan.AssignLate)) for node in nodes)
        objects = [node for node in nodes if isinstance(node, (plan.ValueSource, plan.QuerySource))]
        self._plain = {source.id for source in objects if not source.element.may(Kind.OBJECT)}
        self._plain.update(node.id for node in nodes if isinstance(node, plan.TableSource))
        depths: dict[int, int] = {}
        for node in reversed(nodes):
            below = list(parts(node))
            depths[id(node)] = 1 + max((depths[id(part)] for part in below), default=0)
            if id(node) not in self._facts:
                self._facts[id(node)] = self._examine(node, [self._facts[id(part)] for part in below])
        self.levels = max((depths[id(root)] for root in roots), default=0)

    def of(self, node: Any) -> Facts:
        """The facts of a node below the roots; any other node is a constant of the compiler's."""
        return self._facts.get(id(node)) or Facts()

    def is_fixed(self, variable: str) -> bool:
        """Whether a script variable keeps its value while the nodes run."""
        return not self.open_world and variable not in self.assigned

    def _examine(self, node: Any, below: list[Facts]) -> Facts:
        facts = Facts(
            frozenset().union(*(part.sources for part in below)),
            frozenset().union(*(part.states for part in below)),
            frozenset().union(*(part.groups for part in below)),
            all(part.steady for part in below),
            all(part.total for part in below),
        )
        facts = replace(facts, key=self._key(node, below))
        match node:
            case plan.Constant():
                return facts
            case plan.Variable(name=name):
                return replace(facts, steady=self.is_fixed(name))
            case plan.Element(source=source):
                return replace(facts, sources=frozenset({source}))
            case plan.Column(source=source, declared=declared):
                return replace(facts, sources=frozenset({source}), total=declared and source in self._plain)
            case plan.State(query=query, name=name):
                return replace(facts, states=frozenset({(query, name)}))
            case plan.Call(function=function):
                steady = facts.steady and function.volatility != "volatile"
                total = facts.total and function.builtin and not function.raises
                return replace(facts, steady=steady, total=total, costly=not function.builtin)
            case plan.And(parts=tested) | plan.Or(parts=tested):
                return replace(facts, total=facts.total and all(map(_has_plain_truth, tested)))
            case plan.Xor(left=left, right=right):
                return replace(facts, total=facts.total and _has_plain_truth(left) and _has_plain_truth(right))
            case plan.Not(operand=tested) | plan.If(condition=tested):
                return replace(facts, total=facts.total and _has_plain_truth(tested))
            case plan.GroupKey(query=query):
                return replace(facts, groups=frozenset({query}))
            case plan.Aggregate():
                return replace(facts, groups=frozenset({OWN_GROUP}))
            case plan.Query(id=query):
                return replace(facts, groups=facts.groups - {query, OWN_GROUP})
            case plan.Subquery():
                return replace(facts, total=False, costly=True)
            case plan.Eval(sources=sources, states=states):
                seen = facts.sources | set(sources), facts.states | set(states)
                return replace(facts, sources=seen[0], states=seen[1], steady=False, total=False)
            case plan.Temporal() | plan.Assign() | plan.TemporalAssign() | plan.AssignLate():
                return replace(facts, steady=False, total=False)
            case _:
                return facts

    def _key(self, node: Any, below: list[Facts]) -> int | None:
        """A number for the meaning of the expression: that of its first appearance."""
        inner = tuple(part.key for part in below)
        own: tuple[Hashable, ...]
        match node:
            case plan.Constant(value=value):
                own = (repr(value),)
            case plan.Variable(name=name):
                own = (name,)
            case plan.Element(source=source):
                own = (source,)
            case plan.Column(source=source, name=name, declared=declared):
                own = (source, name, declared)
            case plan.State(query=query, name=name):
                own = (query, name)
            case plan.Call(function=function):
                own = (function.name, function.builtin)
            case plan.If(then=then):
                own = (len(then),)
            case plan.And() | plan.Or() | plan.Xor() | plan.Not() | plan.MakeList():
                own = ()
            case _:
                return None
        if None in inner:
            return None
        return self._keys.setdefault((type(node).__name__, own, inner), len(self._keys))


def _has_plain_truth(expr: plan.Expr) -> bool:
    """Whether asking for the truth of the value cannot fail; an object may have its own ideas."""
    return not expr.type.may(Kind.OBJECT)

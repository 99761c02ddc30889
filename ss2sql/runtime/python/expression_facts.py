"""What the compiler knows of an expression: what it depends on, and whether its evaluation could be noticed."""

from __future__ import annotations

from collections.abc import Hashable, Iterable
from typing import Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Kind
from ss2sql.language.operations import GROUPS
from ss2sql.language.plan_traversal import list_parts


@dataclass(frozen=True, slots=True)
class ExpressionFacts:
    """Facts of one node of a plan."""

    sources: frozenset[int] = frozenset()  # that it reads, nested queries included
    states: frozenset[tuple[int, str]] = frozenset()  # START WITH variables that it reads, likewise
    groups: frozenset[int] = frozenset()  # queries whose groups it reads; OWN_GROUP: aggregates
    steady: bool = True  # has no effect and one value per row, however often it is evaluated; it may raise
    total: bool = True  # cannot raise
    key: int | None = None  # equal for expressions of the same text and meaning; None: not known
    costly: bool = False  # a call of a user function or a query, whose value is worth keeping
    calls: bool = False  # contains a call of a user function


OWN_GROUP = -1
_NONE: frozenset[int] = frozenset()
_NO_STATES: frozenset[tuple[int, str]] = frozenset()


class ExpressionAnalysis:
    """The facts of everything below some nodes of a plan.

    With `open_world`, or where there is an `eval` or a late list, any variable may change at any time; else
    only those that are assigned below the nodes. `inside` says whether to look into queries, too.
    """

    def __init__(self, roots: tuple[Any, ...], open_world: bool = False, inside: bool = True) -> None:
        self._facts: dict[int, ExpressionFacts] = {}
        self._keys: dict[Hashable, int] = {}
        self._plain: set[int] = set()  # sources whose elements are no objects
        self._inside = inside
        self.open_world = open_world
        self.assigned: set[str] = set()
        self.roots: tuple[Any, ...] = ()
        self.levels = 0
        self.add_roots(roots)

    def add_roots(self, roots: tuple[Any, ...]) -> None:
        """Finds the facts of what is below further nodes."""
        self.roots += roots  # kept alive, for facts go by identity
        nodes: list[tuple[Any, list[Any]]] = []
        stack = list(roots)
        while stack:
            node = stack.pop()
            below = [] if isinstance(node, plan.Subquery) and not self._inside else list(list_parts(node))
            nodes.append((node, below))
            stack.extend(below)
        for node, _ in nodes:
            match node:
                case plan.Assign(name=name) | plan.TemporalAssign(name=name):
                    self.assigned.add(name)
                case plan.Eval() | plan.AssignLate():
                    self.open_world = True
                case plan.ValueSource(id=number, element=element) | plan.QuerySource(id=number, element=element):
                    if not element.may_be(Kind.OBJECT):
                        self._plain.add(number)
                case plan.TableSource(id=number) | plan.WorldSource(id=number):
                    self._plain.add(number)
        depths: dict[int, int] = {}
        for node, below in reversed(nodes):
            depths[id(node)] = 1 + max((depths[id(part)] for part in below), default=0)
            if id(node) not in self._facts:
                self._facts[id(node)] = self._find_facts(node, [self._facts[id(part)] for part in below])
        self.levels = max([self.levels, *(depths[id(root)] for root in roots)])

    def facts(self, node: Any) -> ExpressionFacts:
        """The facts of a node below the roots; any other node is a constant of the compiler's."""
        return self._facts.get(id(node)) or ExpressionFacts()

    def are_steady(self, nodes: Iterable[Any]) -> bool:
        return all(self.facts(node).steady for node in nodes)

    def is_fixed(self, variable: str) -> bool:
        """Whether a script variable keeps its value while the nodes run."""
        return not self.open_world and variable not in self.assigned

    def _find_facts(self, node: Any, below: list[ExpressionFacts]) -> ExpressionFacts:
        sources, states, groups = _NONE, _NO_STATES, _NONE
        steady = total = True
        costly = calls = False
        for part in below:
            calls = calls or part.calls
            sources |= part.sources
            states |= part.states
            groups |= part.groups
            steady = steady and part.steady
            total = total and part.total
        match node:
            case plan.Variable(name=name):
                steady = self.is_fixed(name)
            case plan.Element(source=source):
                sources = frozenset({source})
            case plan.Column(source=source, declared=declared):
                sources, total = frozenset({source}), declared and source in self._plain
            case plan.State(query=query, name=name):
                states = frozenset({(query, name)})
            case plan.Call(function=function):
                steady = steady and function.volatility != "volatile"
                total = total and function.builtin and not function.raises
                costly = not function.builtin
            case plan.And(parts=tested) | plan.Or(parts=tested):
                total = total and all(map(_has_plain_truth, tested))
            case plan.Xor(left=left, right=right):
                total = total and _has_plain_truth(left) and _has_plain_truth(right)
            case plan.Not(operand=tested) | plan.If(condition=tested):
                total = total and _has_plain_truth(tested)
            case plan.GroupKey(query=query):
                groups = frozenset({query})
            case plan.Aggregate(function=name, argument=argument):
                fails = argument is not None and GROUPS[name].can_fail(argument.type)
                groups, total = frozenset({OWN_GROUP}), not fails
            case plan.Query(id=query):
                groups -= {query, OWN_GROUP}
            case plan.Subquery():
                total, costly = False, True
            case plan.Eval(sources=seen, states=seen_states):
                sources, states = sources | set(seen), states | set(seen_states)
                steady = total = False
            case plan.Temporal() | plan.Assign() | plan.TemporalAssign() | plan.AssignLate():
                steady = total = False
        return ExpressionFacts(
            sources, states, groups, steady, total, self._number_meaning(node, below), costly, costly or calls
        )

    def _number_meaning(self, node: Any, below: list[ExpressionFacts]) -> int | None:
        """A number for the meaning of the expression: that of its first appearance."""
        inner = [part.key for part in below]
        if None in inner:
            return None
        own: tuple[Hashable, ...]
        match node:
            case plan.Constant(value=value):
                own = (repr(value),)
            case plan.Variable(name=name, frame=frame):
                own = (name, frame)
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
            case plan.Aggregate(function=name):
                own = (name,)
            case plan.And() | plan.Or() | plan.Xor() | plan.Not() | plan.MakeList():
                own = ()
            case _:
                return None
        return self._keys.setdefault((type(node), own, *inner), len(self._keys))


def _has_plain_truth(expr: plan.Expr) -> bool:
    """Whether asking for the truth of the value cannot fail; an object may have its own ideas."""
    return not expr.type.may_be(Kind.OBJECT)

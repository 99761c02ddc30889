"""Whether equal rows of a search mean equal steps.

UNIQUE, NO CYCLE and MEMORIZE identify steps by their rows. Their results are the promised ones where equal rows have
equal stops, goals and next states; the plan can prove that.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable, Iterator, Sequence
from typing import TypeAlias

from ss2sql import plan
from ss2sql.walk import is_volatile, parts

Missing: TypeAlias = dict[plan.Expr, tuple[str, ...]]
Condition: TypeAlias = tuple[plan.Expr, bool]  # with the truth that it has

_SIGNS = {"eq": ("eq", True), "ne": ("eq", False), "lt": ("lt", True), "ge": ("lt", False), "gt": ("gt", True),
          "le": ("gt", False)}  # fmt: skip


def missing(query: plan.Query) -> Missing:
    """What the clauses of a search read beside its rows, each with the names of the clauses that read it.

    Empty: equal rows are proved to have equal stops, goals and next states, so the steps after them have equal costs.

    Steps that stop and are no goals leave no trace. For all others more is known than their rows: the condition of
    CONNECT BY is true; without WHERE no goal stops; with `src != town` in STOP WITH and `src == town` in WHERE, `town`
    is `src`. The variables that a search carries for `level()` and its like are left out.
    """
    search = query.search
    assert search is not None
    made = list(_simple(search.made, True)) if search.first is None else []
    going, goals = [*made, *_simple(search.stop, False)], list(_simple(query.where, True))
    asked = {_same(*goal) for goal in (*goals, *made)}
    sure = going if query.where is None else [one for one in going if _same(*one) in asked]
    known = {_same(*one) for one in sure}
    shown = query.rows if query.aggregated else tuple(out.expr for out in query.columns)
    told = _with_equals(_told(search.key or shown), sure)
    reader = _Reader(query)
    reader.read("STOP WITH", (expr for expr, truth in going if _same(expr, truth) not in known), told)
    reader.read("WHERE", (expr for expr, truth in goals if _same(expr, truth) not in known), told)
    told = _with_equals(told, going)  # a step that stops has no next state
    for name, expr in search.connect:
        if name.isidentifier():
            reader.read("CONNECT BY", [expr], told)
        reader.moved.discard(name)  # later assignments see its new value, which has been read
    return {expr: tuple(clauses) for expr, clauses in reader.found.items()}


def unnamed(query: plan.Query) -> tuple[str, ...]:
    """The same, as expressions in a script's notation."""
    return tuple(dict.fromkeys(map(as_written, missing(query))))


def as_written(expr: plan.Expr) -> str:
    """An expression in a script's notation."""
    return expr.name if isinstance(expr, plan.State) else " ".join(expr.span.text.split())


def growing(query: plan.Query, evenly: bool = False) -> frozenset[str]:
    """The variables to which CONNECT BY adds or subtracts something; `evenly`: a constant."""
    assert query.search is not None
    found: set[str] = set()
    for name, expr in query.search.connect:
        match expr:
            case plan.Call(function=plan.Function(name="add" | "sub", builtin=True), arguments=(left, right)):
                for own, other in ((left, right), (right, left)):
                    state = isinstance(own, plan.State) and (own.query, own.name) == (query.id, name)
                    if state and (not evenly or isinstance(other, plan.Constant)):
                        found.add(name)
    return frozenset(found)


def stops_of(query: plan.Query) -> Iterator[plan.Expr]:
    """The conditions in STOP WITH that each end a path."""
    assert query.search is not None
    return (expr for expr, truth in _simple(query.search.stop, False) if not truth)


class _Reader:
    """Collects what clauses read of the elements and of variables that change."""

    def __init__(self, query: plan.Query) -> None:
        assert query.search is not None
        self.query = query.id
        self.own = frozenset(source.id for source in query.sources)
        self.moved = {name for name, _ in query.search.connect if name.isidentifier()}
        self.found: dict[plan.Expr, dict[str, None]] = {}

    def read(self, clause: str, exprs: Iterable[plan.Expr], told: Sequence[plan.Expr]) -> None:
        for expr in exprs:
            for found in self._missing(expr, told):
                self.found.setdefault(found, {})[clause] = None

    def _missing(self, expr: plan.Expr, told: Sequence[plan.Expr]) -> Iterator[plan.Expr]:
        if expr in told:
            return
        match expr:
            case plan.State(query=query, name=name) if query == self.query:
                if name in self.moved:
                    yield expr
            case plan.Column(source=source) if source in self.own:
                if not any(isinstance(known, plan.Element) and known.source == source for known in told):
                    yield expr
            case plan.Element(source=source) if source in self.own:
                yield expr
            case plan.Eval():
                yield expr
            case _:
                for part in parts(expr):
                    yield from self._missing(part, told)


def _simple(condition: plan.Expr | None, truth: bool) -> Iterator[Condition]:
    """The conditions that all hold where this one has that truth; none for a missing condition."""
    match condition:
        case None:
            return
        case plan.Not(operand=operand):
            yield from _simple(operand, not truth)
        case plan.And(parts=several) if truth:
            for part in several:
                yield from _simple(part, True)
        case plan.Or(parts=several) if not truth:
            for part in several:
                yield from _simple(part, False)
        case _:
            yield condition, truth


def _same(condition: plan.Expr, truth: bool) -> Hashable:
    """A canonical form: equal for `a == b` and for the opposite of `b != a`."""
    if is_volatile(condition):
        return id(condition)
    match condition:
        case plan.Call(function=plan.Function(name=name, builtin=True), arguments=(left, right)) if name in _SIGNS:
            sign, positive = _SIGNS[name]
            sides: Collection[plan.Expr] = frozenset((left, right)) if sign == "eq" else (left, right)
            if sign == "gt":
                sign, sides = "lt", (right, left)
            return sign, sides, truth == positive
        case _:
            return condition, truth


def _told(columns: Iterable[plan.Expr]) -> list[plan.Expr]:
    """What the values of some columns determine: these, and the items of list literals in them."""
    found: list[plan.Expr] = []
    for expr in columns:
        found.append(expr)
        if isinstance(expr, plan.MakeList):
            found.extend(_told(expr.items))
    return found


def _with_equals(told: list[plan.Expr], conditions: Sequence[Condition]) -> list[plan.Expr]:
    """`told`, and what equals one of them or a constant where the conditions hold."""
    known, pairs = list(told), list[tuple[plan.Expr, plan.Expr]]()
    for condition, truth in conditions:
        match condition:
            case plan.Call(function=plan.Function(name="eq" | "ne" as name, builtin=True), arguments=(left, right)):
                if truth == (name == "eq") and not is_volatile(condition):
                    pairs += [(left, right), (right, left)]
    size = -1
    while size < len(known):
        size = len(known)
        for one, other in pairs:
            if other not in known and (one in known or isinstance(one, plan.Constant)):
                known.append(other)
    return known

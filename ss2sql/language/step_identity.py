"""Whether equal rows of a search mean equal steps.

UNIQUE, NO CYCLE and MEMORIZE identify steps by their rows. Their results are the promised ones where equal rows have
equal stops, goals and next states; the plan can prove that.
"""

from __future__ import annotations

from collections.abc import Collection, Hashable, Iterable, Iterator, Sequence
from typing import TypeAlias

from ss2sql.language import plan
from ss2sql.language.plan_traversal import is_volatile, list_parts

UnnamedRead: TypeAlias = dict[plan.Expr, tuple[str, ...]]
Condition: TypeAlias = tuple[plan.Expr, bool]  # with the truth that it has

_SIGNS = {"eq": ("eq", True), "ne": ("eq", False), "lt": ("lt", True), "ge": ("lt", False), "gt": ("gt", True),
          "le": ("gt", False)}  # fmt: skip


def find_unnamed(query: plan.Query) -> UnnamedRead:
    """What the clauses of a search read beside its rows, each with the names of the clauses that read it.

    Empty: equal rows are proved to have equal stops, goals and next states, so the steps after them have equal costs.

    Steps that stop and are no goals leave no trace. For all others more is known than their rows: the condition of
    CONNECT BY is true; without WHERE no goal stops; with `src != town` in STOP WITH and `src == town` in WHERE, `town`
    is `src`. The variables that a search carries for `level()` and its like are left out.
    """
    search = query.search
    assert search is not None
    substitute = list(_split_condition(search.made, True)) if search.first is None else []
    going, goals = [*substitute, *_split_condition(search.stop, False)], list(_split_condition(query.where, True))
    tests = {_normalize_plan_condition(*goal) for goal in (*goals, *substitute)}
    sure = going if query.where is None else [one for one in going if _normalize_plan_condition(*one) in tests]
    known = {_normalize_plan_condition(*one) for one in sure}
    shown = query.rows if query.aggregated else tuple(out.expr for out in query.columns)
    known_values = _add_equal_values(_list_told_values(search.key or shown), sure)
    reader = _StepIdentityReads(query)
    reader.collect_reads(
        "STOP WITH",
        (expr for expr, truth in going if _normalize_plan_condition(expr, truth) not in known),
        known_values,
    )
    reader.collect_reads(
        "WHERE", (expr for expr, truth in goals if _normalize_plan_condition(expr, truth) not in known), known_values
    )
    known_values = _add_equal_values(known_values, going)  # a step that stops has no next state
    for name, expr in search.connect:
        if name.isidentifier():
            reader.collect_reads("CONNECT BY", [expr], known_values)
        reader.moved.discard(name)  # later assignments see its new value, which has been read
    return {expr: tuple(clauses) for expr, clauses in reader.found.items()}


def describe_unnamed(query: plan.Query) -> tuple[str, ...]:
    """The same, as expressions in a script's notation."""
    return tuple(dict.fromkeys(map(write_in_script, find_unnamed(query))))


def write_in_script(expr: plan.Expr) -> str:
    """An expression in a script's notation."""
    return expr.name if isinstance(expr, plan.State) else " ".join(expr.span.text.split())


def find_growing_states(query: plan.Query, evenly: bool = False) -> frozenset[str]:
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


def split_stop_conditions(query: plan.Query) -> Iterator[plan.Expr]:
    """The conditions in STOP WITH that each end a path."""
    assert query.search is not None
    return (expr for expr, truth in _split_condition(query.search.stop, False) if not truth)


class _StepIdentityReads:
    """Collects what clauses read of the elements and of variables that change."""

    def __init__(self, query: plan.Query) -> None:
        assert query.search is not None
        self.query = query.id
        self.own = frozenset(source.id for source in query.sources)
        self.moved = {name for name, _ in query.search.connect if name.isidentifier()}
        self.found: dict[plan.Expr, dict[str, None]] = {}

    def collect_reads(self, clause: str, exprs: Iterable[plan.Expr], known_values: Sequence[plan.Expr]) -> None:
        for expr in exprs:
            for found in self._find_missing(expr, known_values):
                self.found.setdefault(found, {})[clause] = None

    def _find_missing(self, expr: plan.Expr, known_values: Sequence[plan.Expr]) -> Iterator[plan.Expr]:
        if expr in known_values:
            return
        match expr:
            case plan.State(query=query, name=name) if query == self.query:
                if name in self.moved:
                    yield expr
            case plan.Column(source=source) if source in self.own:
                if not any(isinstance(known, plan.Element) and known.source == source for known in known_values):
                    yield expr
            case plan.Element(source=source) if source in self.own:
                yield expr
            case plan.Eval():
                yield expr
            case _:
                for part in list_parts(expr):
                    yield from self._find_missing(part, known_values)


def _split_condition(condition: plan.Expr | None, truth: bool) -> Iterator[Condition]:
    """The conditions that all hold where this one has that truth; none for a missing condition."""
    match condition:
        case None:
            return
        case plan.Not(operand=operand):
            yield from _split_condition(operand, not truth)
        case plan.And(parts=several) if truth:
            for part in several:
                yield from _split_condition(part, True)
        case plan.Or(parts=several) if not truth:
            for part in several:
                yield from _split_condition(part, False)
        case _:
            yield condition, truth


def _normalize_plan_condition(condition: plan.Expr, truth: bool) -> Hashable:
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


def _list_told_values(columns: Iterable[plan.Expr]) -> list[plan.Expr]:
    """What the values of some columns determine: these, and the items of list literals in them."""
    found: list[plan.Expr] = []
    for expr in columns:
        found.append(expr)
        if isinstance(expr, plan.MakeList):
            found.extend(_list_told_values(expr.items))
    return found


def _add_equal_values(known_values: list[plan.Expr], conditions: Sequence[Condition]) -> list[plan.Expr]:
    """`known_values`, and what equals one of them or a constant where the conditions hold."""
    known, pairs = list(known_values), list[tuple[plan.Expr, plan.Expr]]()
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

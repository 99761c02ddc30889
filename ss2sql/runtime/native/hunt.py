"""Searches: the generator of the steps from one state, which all orders of search share.

The generated function `rows(...)` begins a search. It gives the state of START WITH, the generator function
`steps(state, seen)`, the function `keys(last)`, and the pieces of pieces.py. Each step is evaluated when it is asked
for, its clauses in the order of language.md section 7. What is yielded are the steps that leave a trace, see `Step`
in searches/step.py.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from ss2sql import plan
from ss2sql.kinds import Kind
from ss2sql.runtime.native import options
from ss2sql.runtime.native.call_code import is_remembered, keyed_elements, remembered_call
from ss2sql.runtime.native.expressions import expression
from ss2sql.runtime.native.flat import key_expressions
from ss2sql.runtime.native.lookups import Lookup, lookup
from ss2sql.runtime.native.loops import Loops, read_by_sources
from ss2sql.runtime.native.pieces import pieces
from ss2sql.runtime.native.unit import Body
from ss2sql.runtime.values import freeze

if TYPE_CHECKING:
    from ss2sql.runtime.native.builder import Builder


def finder(builder: Builder, query: plan.Query, body: Body, aggregates: Sequence[plan.Aggregate]) -> str:
    """Compiles the function that begins a search into `body` and gives its name."""
    assert query.search is not None
    unit, pen = builder.unit, builder.unit.pen_at(query.span)
    variables = [name for name, _ in query.search.start]
    keys = key_expressions(query, aggregates)
    for name, expr in query.search.start:
        local = unit.states[query.id, name] = unit.local(name)
        body.add(unit.pen_at(expr.span).assign(local, expression(builder, expr, body)))
        body.states.add((query.id, name))
    names = [unit.states[query.id, name] for name in variables]
    loops = Loops(builder, query, body)
    loops.read_once()
    # A search is no step, so its start does not count as one that went on.
    expanded = unit.counter("expanded", body)
    body.add(pen.increase(expanded, -1))
    steps = Steps(builder, query, body, loops, bool(keys))
    steps.compile(names)
    find_keys = pen.constant(None) if not keys else pen.name(_keys(builder, query, body, keys))
    state = pen.pack(*map(pen.name, names))
    body.add(pen.back(pen.pack(state, pen.name(steps.body.name), find_keys, pieces(builder, query, body, loops))))
    body.define()
    return body.name


def _keys(builder: Builder, query: plan.Query, outer: Body, keys: Sequence[plan.Expr]) -> str:
    """A function of the elements and the state of a last step: what GROUP BY and ORDER BY see of it."""
    unit, pen = builder.unit, builder.unit.pen_at(query.span)
    body = Body(unit, unit.local("keys"), ["last"], outer)
    assert query.search is not None
    _bind_own(body, query)
    body.count(keys)
    names = [unit.names[source.id] for source in query.sources]
    names += [unit.states[query.id, name] for name, _ in query.search.start]
    body.add(pen.unpack(names, pen.name("last")))
    body.add(pen.back(pen.pack(*(expression(builder, key, body) for key in keys))))
    body.define()
    return body.name


def _bind_own(body: Body, query: plan.Query) -> None:
    """Takes the query's sources and state as known in the whole body."""
    assert query.search is not None
    body.levels.update((source.id, 0) for source in query.sources)
    body.states.update((query.id, name) for name, _ in query.search.start)


class Steps:
    """The generator function `steps(state, seen)` of one search."""

    def __init__(self, builder: Builder, query: plan.Query, outer: Body, loops: Loops, has_keys: bool) -> None:
        assert query.search is not None
        self.builder = builder
        self.unit = builder.unit
        self.query = query
        self.search = query.search
        self.outer = outer
        self.loops = loops
        self.has_keys = has_keys
        self.body = Body(self.unit, self.unit.local("steps"), ["state", "seen"], outer)
        self.outputs = query.rows if query.aggregated else tuple(output.expr for output in query.columns)
        self.compares = self.search.repeats != "allowed"
        self.pen = self.unit.pen_at(query.span)
        self.row: list[str] = []  # the names of its values

    def compile(self, states: list[str]) -> None:
        """Writes the function; `states` are the names of the state's variables."""
        pen, search, body = self.pen, self.search, self.body
        body.states = {(self.query.id, name) for name, _ in search.start}
        clauses = [search.stop, self.query.where, search.weight, search.heuristic]
        inside = read_by_sources(self.query)
        connect = [expr for _, expr in search.connect]
        body.count([*inside, *self.outputs, *(clause for clause in clauses if clause), *connect])
        body.add(pen.increase(self.unit.counter("expanded", body)))
        body.add(pen.unpack(states, pen.name("state")))
        body.locals.extend(states)
        self._look_up()
        self._accompany([*self.outputs, *(clause for clause in clauses if clause), *connect])
        self.inner = self.loops.open(body, {})
        self._step()
        self.inner.define()

    def _look_up(self) -> None:
        """Leaves out elements that STOP WITH and WHERE drop at once: `STOP WITH a != b ...`, `WHERE a == b ...`.

        Without a WHERE, STOP WITH drops them alone. With MEMORIZE they matter, for a step to a known row is not asked
        whether it stops.
        """
        stop, where = _parts(self.search.stop, plan.Or), _parts(self.query.where, plan.And)
        rows = [self.unit.analysis.of(expr) for expr in self.outputs] if self.compares else []
        if self.search.repeats == "memorize" or not all(facts.steady and facts.total for facts in rows):
            return
        for part, other in zip(stop, where or stop, strict=False):
            dropped = lookup(part, self.unit.analysis, "ne")
            if dropped is None or (where and not self._is_same(dropped, lookup(other, self.unit.analysis))):
                return
            if not self.loops.look_up(dropped):
                return

    def _is_same(self, one: Lookup, other: Lookup | None) -> bool:
        if other is None:
            return False
        pairs = ((one.column, other.column), (one.other, other.other))
        keys = [(self.unit.analysis.of(a).key, self.unit.analysis.of(b).key) for a, b in pairs]
        return all(a is not None and a == b for a, b in keys)

    def _accompany(self, clauses: list[plan.Expr]) -> None:
        """Elements that are read once, and stand in the row as they are, are frozen once; so are keys of arguments."""
        shown = {expr.source for expr in self.outputs if isinstance(expr, plan.Element)} if self.compares else set()
        keyed = keyed_elements(clauses)
        for source in self.query.sources:
            frozen = source.id in shown and not self.loops.is_scalar(source)
            if frozen or source.id in keyed:
                self.loops.accompany(source, frozen, source.id in keyed)

    # --- one step --------------------------------------------------------------------------------------

    def _step(self) -> None:
        pen, inner = self.pen, self.inner
        if self.compares:
            self._compare()
        may_end = self._judge()
        if not self.compares:
            outputs = [expression(self.builder, expr, inner) for expr in self.outputs]
            inner.add(pen.assign("row", pen.pack(*outputs)))
        self._weigh(inner.blocks[-1])
        if may_end:
            ended = self._yield(pen.constant(True), pen.constant(None), pen.constant(0))
            inner.add(pen.when(pen.name("stop"), ended, pen.next_turn()))
        estimate = pen.constant(0)
        if self.search.heuristic is not None:
            inner.add(pen.assign("estimate", self._checked(self.search.heuristic, options.heuristic)))
            estimate = pen.name("estimate")
        following = self._connect()
        goal = pen.constant(True) if self.query.where is None else pen.name("goal")
        inner.add(self._yield(goal, following, estimate))

    def _compare(self) -> None:
        """Evaluates the row, and drops the step if the row must not occur again."""
        pen, inner = self.pen, self.inner
        values, frozen = [], []
        for expr in self.outputs:
            value, key = self._frozen(expr)
            values.append(value)
            frozen.append(key)
        inner.add(pen.assign("row", pen.pack(*values)))
        self.row = [name.id for name in values if isinstance(name, ast.Name)]
        several = pen.name("row") if frozen == values else pen.pack(*frozen)
        inner.add(pen.assign("key", frozen[0] if len(frozen) == 1 else several))
        known = pen.compare(pen.name("key"), ast.In(), pen.name("seen"))
        if self.search.heuristic is not None and self.search.repeats == "unique":  # see Taken in best_first.py
            total = pen.item(pen.name("seen"), pen.name("key"))
            present = pen.part(pen.name("seen"), "present")
            known = pen.both(ast.And(), [known, pen.compare(total, ast.LtE(), present)])
        if self.search.repeats == "memorize":
            edge: list[ast.stmt] = []
            with inner.unsure():
                self._weigh(edge)
            edge += [self._yield(pen.constant(None), pen.constant(None), pen.constant(0)), pen.next_turn()]
            inner.add(pen.when(known, *edge))
        else:
            inner.add(pen.when(known, pen.increase(self.unit.counter("pruned", inner)), pen.next_turn()))

    def _frozen(self, expr: plan.Expr) -> tuple[ast.expr, ast.expr]:
        """The value of a column, and what stands for it where rows are compared."""
        unit, inner = self.unit, self.inner
        pen = unit.pen_at(expr.span)
        if isinstance(expr, plan.Call) and is_remembered(expr):
            found = self._called(expr)
            if found is not None:
                return found
        value = expression(self.builder, expr, inner)
        if isinstance(expr, plan.Element) and expr.source in self.loops.frozen:
            return value, pen.name(self.loops.frozen[expr.source])
        value = inner.variable(value, pen, "value")
        if expr.type.only(Kind.NONE | Kind.NUMBER | Kind.STR):
            return value, value
        frozen = pen.call(unit.helper(freeze), value)
        facts = unit.analysis.of(expr)
        return value, inner.kept(replace(facts, key=None), frozen, pen, "frozen") if facts.steady else frozen

    def _called(self, expr: plan.Call) -> tuple[ast.expr, ast.expr] | None:
        """The same for a call, which often has the frozen form at hand; None where it is kept from another place."""
        unit, inner = self.unit, self.inner
        facts = unit.analysis.of(expr)
        if inner.name_of(facts) or (facts.steady and inner.home(facts) != (inner, inner.level)):
            return None
        pen = unit.pen_at(expr.span)
        value, key = unit.local(expr.function.name), unit.local("key")
        inner.add(pen.unpack([value, key], remembered_call(self.builder, expr, inner)))
        frozen = pen.assign(key, pen.call(unit.helper(freeze), pen.name(value)))
        inner.add(pen.when(pen.compare(pen.name(key), ast.Is(), pen.constant(None)), frozen))
        if facts.steady and facts.key is not None:
            inner.known[-1][facts.key] = value
        return pen.name(value), pen.name(key)

    def _judge(self) -> bool:
        """Evaluates STOP WITH and WHERE and drops a step that stops without being a goal.

        Gives whether a step may still be one that stops.
        """
        pen, inner, stop, where = self.pen, self.inner, self.search.stop, self.query.where
        if stop is not None and where is None:
            pen = self.unit.pen_at(stop.span)
            facts = self.unit.analysis.of(stop)
            inner.checked_later(facts, lambda: pen.assign("stop", expression(self.builder, stop, inner)), pen)
            inner.add(pen.when(pen.name("stop"), pen.next_turn()))
            return False
        for name, clause in (("stop", stop), ("goal", where)):
            if clause is not None:
                write = partial(self._assigned_truth, name, clause)
                inner.checked_later(self.unit.analysis.of(clause), write, self.unit.pen_at(clause.span))
        if stop is None:
            return False
        traceless = pen.both(ast.And(), [pen.name("stop"), pen.negation(pen.name("goal"))])
        inner.add(pen.when(traceless, pen.next_turn()))
        return True

    def _assigned_truth(self, name: str, clause: plan.Expr) -> ast.stmt:
        pen = self.unit.pen_at(clause.span)
        value = expression(self.builder, clause, self.inner)
        return pen.assign(name, value if clause.type.only(Kind.BOOL) else pen.truth(value))

    def _weigh(self, block: list[ast.stmt]) -> None:
        """Evaluates COST or PROBABILITY; an impossible step is dropped."""
        weight, pen = self.search.weight, self.pen
        if weight is None:
            return
        probable = self.search.order == "probability"
        block.append(pen.assign("weight", self._checked(weight, options.probability if probable else options.cost)))
        if probable:
            block.append(pen.unless(pen.name("weight"), pen.next_turn()))

    def _checked(self, expr: plan.Expr, check: Callable[[Any], Any]) -> ast.expr:
        pen = self.unit.pen_at(expr.span)
        value = expression(self.builder, expr, self.inner)
        return value if options.is_known(expr.type, check) else pen.call(self.unit.helper(check), value)

    def _connect(self) -> ast.expr:
        """CONNECT BY in its order; gives the next state."""
        inner, unit, number = self.inner, self.unit, self.query.id
        for name, expr in self.search.connect:
            pen = unit.pen_at(expr.span)
            inner.moved[number, name] = inner.assigned(expression(self.builder, expr, inner), pen, f"next_{name}")
        state = [(number, name) for name, _ in self.search.start]
        names = [inner.moved.get(name) or unit.states[name] for name in state]
        # The row is often the next state; a tuple less for each step.
        return self.pen.name("row") if names == self.row else self.pen.pack(*map(self.pen.name, names))

    def _yield(self, goal: ast.expr, following: ast.expr, estimate: ast.expr) -> ast.stmt:
        """`yield (row, goal, following, key, weight, estimate, last)`."""
        pen, search, unit = self.pen, self.search, self.unit
        key = pen.name("key") if self.compares else pen.constant(None)
        weight = pen.constant(None) if search.weight is None else pen.name("weight")
        last: ast.expr = pen.constant(None)
        if self.has_keys:
            names = [unit.names[source.id] for source in self.query.sources]
            names += [unit.states[self.query.id, name] for name, _ in search.start]
            last = pen.pack(*map(pen.name, names))
        return pen.run(pen.give(pen.pack(pen.name("row"), goal, following, key, weight, estimate, last)))


def _parts(clause: plan.Expr | None, kind: type[plan.And] | type[plan.Or]) -> tuple[plan.Expr, ...]:
    """The parts of a clause in the order in which they are asked."""
    return clause.parts if isinstance(clause, kind) else () if clause is None else (clause,)

"""The clauses of a search as functions for `search/stepwise.py`: what is no plain search goes step by step.

These are searches with a condition, a key behind BY, EACH or ORDER SIBLINGS BY, the greedy one, MEMORIZE where what is
shown asks for the path, and whatever is watched.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING

from ss2sql import plan
from ss2sql.kinds import Kind
from ss2sql.runtime.native import options
from ss2sql.runtime.native.expressions import expression
from ss2sql.runtime.native.flat import placed_conditions
from ss2sql.runtime.native.pieces import Writer
from ss2sql.runtime.native.step_function import StepLoops
from ss2sql.runtime.native.unit import Body
from ss2sql.runtime.search.stepwise import Steps, searched
from ss2sql.runtime.search.watched import WatchedSteps, noted
from ss2sql.runtime.sources import elements
from ss2sql.runtime.values import freeze

if TYPE_CHECKING:
    from ss2sql.runtime.native.builder import Builder

ROW = 2  # the place of this function among those of `Steps`
PLAIN = Kind.NONE | Kind.NUMBER | Kind.STR


def stepwise(builder: Builder, query: plan.Query, body: Body, keys: str | None) -> list[ast.stmt]:
    """The end of the function that finds the results: it yields None when START WITH is evaluated, then the results."""
    assert query.search is not None
    unit, pen = builder.unit, builder.unit.pen_at(query.span)
    loops = StepLoops(builder, query, body)
    loops.read_once()
    loops.counts_steps = True
    expanded = unit.counter("expanded", body)
    body.add(pen.increase(expanded, -1))  # a search is no step, so its start does not count as one that went on
    functions = StepFunctions(builder, query, body).written(loops)
    known = pen.name(unit.constant(query, "query"))
    kind: type[Steps] = Steps
    if unit.watched is query:
        kind, functions[ROW] = WatchedSteps, pen.call(unit.helper(noted), pen.name("run"), functions[ROW])
        facts = [unit.analysis.of(output.expr) for output in query.columns]
        functions.append(pen.constant(not query.aggregated and all(one.steady and one.total for one in facts)))
    steps = pen.call(unit.helper(kind), pen.name("run"), known, *functions)
    find_keys = pen.constant(None) if keys is None else pen.name(keys)
    found = pen.call(unit.helper(searched), steps, pen.name("starts"), find_keys, pen.name("bound"))
    return [pen.assign("bound", pen.give(pen.constant(None))), pen.run(ast.YieldFrom(found, **pen.at))]


def read_starts(builder: Builder, query: plan.Query, body: Body) -> None:
    """START WITH: puts the states in which the search starts into the list `starts`."""
    search, unit, pen = query.search, builder.unit, builder.unit.pen_at(query.span)
    assert search is not None
    each = {source.id: source for source in search.each}
    body.add(pen.assign("starts", pen.array()))
    for name, expr in search.start:
        local = unit.states[query.id, name] = unit.local(name)
        place = unit.pen_at(expr.span)
        if isinstance(expr, plan.Element) and expr.source in each:
            items = place.call(unit.helper(elements), expression(builder, each[expr.source].value, body))
            body.loop([local], items, place)
        else:
            body.add(place.assign(local, expression(builder, expr, body)))
        body.states.add((query.id, name))
        if each:  # another value in each turn, which nothing may keep
            body.moved[query.id, name] = local
    names = [pen.name(unit.states[query.id, name]) for name, _ in search.start]
    body.add(pen.run(pen.call(pen.part(pen.name("starts"), "append"), pen.pack(*names))))
    body.moved.clear()
    for _ in each:
        body.blocks.pop()
        body.known.pop()


class StepFunctions(Writer):
    """Writes the functions in the order of the fields of `Steps`."""

    def written(self, loops: StepLoops) -> list[ast.expr]:
        search, where = self.search, self.query.where
        stop, weight, estimate = search.stop, search.weight, search.heuristic
        names = [
            self.steps("steps", loops, search.made),
            None if search.first is None else self.steps("first_steps", loops, search.first),
            self.shown(),
            None if search.repeats == "allowed" else self.key(),
            None if stop is None else self.truth("ends", stop),
            None if where is None else self.truth("is_goal", where),
            None if weight is None else self.weight(weight),
            None if estimate is None else self.estimate(estimate),
            self.follow(),
            self.siblings() if search.siblings else None,
        ]
        return [self.pen.constant(None) if name is None else self.pen.name(name) for name in names]

    def steps(self, name: str, loops: StepLoops, condition: plan.Expr | None) -> str:
        """A generator of the elements of a state that meet the condition, each with the state."""
        loops = copy(loops)
        loops.lookups, loops.demands = {}, {}
        body, pen = Body(self.unit, self.unit.local(name), ["state"], self.outer), self.pen
        body.states = {(self.query.id, name) for name, _ in self.search.start}
        body.add(pen.increase(self.unit.counter("expanded", body)))
        if self.states:
            body.add(pen.unpack(self.states, pen.name("state")))
        body.locals.extend(self.states)
        placed, guarded = placed_conditions(self.builder, replace(self.query, where=condition), loops)
        inner = loops.open(body, placed, guarded)
        inner.add(pen.run(pen.give(pen.pack(*map(pen.name, self._names())))))
        inner.define()
        return body.name

    def shown(self) -> str:
        """The row of a step."""
        body = self._function("row", ["last"], self.outputs)
        body.add(self.pen.back(self.pen.pack(*(expression(self.builder, expr, body) for expr in self.outputs))))
        body.define()
        return body.name

    def key(self) -> str:
        """What is compared, frozen: of a step with its row, or of the state that it reaches."""
        compared, state = self.search.key or self.outputs, self.search.by == "state"
        body = self._of_state("key", compared) if state else self._function("key", ["last", "row"], compared)
        if not state and self.search.by == "row":
            self._know_row(body)
        keys = []
        for expr in compared:
            value = expression(self.builder, expr, body)
            keys.append(value if expr.type.only(PLAIN) else self.pen.call(self.unit.helper(freeze), value))
        body.add(self.pen.back(keys[0] if len(keys) == 1 else self.pen.pack(*keys)))
        body.define()
        return body.name

    def _of_state(self, name: str, clauses: Sequence[plan.Expr]) -> Body:
        body = Body(self.unit, self.unit.local(name), ["state"], self.outer)
        body.states.update((self.query.id, name) for name, _ in self.search.start)
        body.count(clauses)
        if self.states:
            body.add(self.pen.unpack(self.states, self.pen.name("state")))
        body.locals.extend(self.states)
        return body

    def estimate(self, clause: plan.Expr) -> str:
        """What is left of the way after a step."""
        body, pen = self._function("estimate", ["last", "row"], [clause]), self.unit.pen_at(clause.span)
        self._know_row(body)
        value = expression(self.builder, clause, body)
        known = options.is_known(clause.type, options.heuristic)
        body.add(pen.back(value if known else pen.call(self.unit.helper(options.heuristic), value)))
        body.define()
        return body.name

    def siblings(self) -> str:
        """The keys of ORDER SIBLINGS BY."""
        keys = [key.expr for key in self.search.siblings]
        body = self._function("siblings", ["last"], keys)
        body.add(self.pen.back(self.pen.pack(*(expression(self.builder, key, body) for key in keys))))
        body.define()
        return body.name

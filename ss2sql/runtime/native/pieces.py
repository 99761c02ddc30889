"""The clauses of a search as functions of their own, where a step is not evaluated in one go.

MEMORIZE needs that where it knows parts of a step already, looks for a step that leads to a given state, or has calls
made by other processes. The generated functions are those of `Pieces` in memorize/pieces.py.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from ss2sql import plan
from ss2sql.kinds import Kind
from ss2sql.runtime.frozen import FREEZERS, Shape
from ss2sql.runtime.memorize.by_key import asks_for_path
from ss2sql.runtime.memorize.reverse import Reverse, reverse_of
from ss2sql.runtime.native import options
from ss2sql.runtime.native.expressions import expression
from ss2sql.runtime.native.facts import OWN_GROUP
from ss2sql.runtime.native.loops import Loops
from ss2sql.runtime.native.unit import UNSET, Body
from ss2sql.walk import set_at_once, walk

if TYPE_CHECKING:
    from ss2sql.runtime.native.builder import Builder


def can_be_taken_apart(builder: Builder, query: plan.Query) -> bool:
    """Whether nobody can notice when, and how often, a clause of the search is evaluated, but by what it costs."""
    search = query.search
    if search is None or not search.plain:
        return False
    clauses = [*(output.expr for output in query.columns), *query.rows, *(expr for _, expr in search.connect)]
    clauses += [clause for clause in (search.stop, query.where, search.weight) if clause is not None]
    facts = [builder.unit.analysis.of(expr) for expr in clauses] + [builder.source_facts(s) for s in query.sources]
    return all(fact.steady and OWN_GROUP not in fact.groups for fact in facts)


def pieces(
    builder: Builder, query: plan.Query, outer: Body, loops: Loops, chooses: bool, columns: Sequence[Shape]
) -> ast.expr:
    """The generated functions, in the order of the fields of `Pieces`; None where the search stays in one piece."""
    pen = builder.unit.pen_at(query.span)
    assert query.search is not None
    writer = Writer(builder, query, outer)
    freezers = [pen.name(builder.unit.helper(FREEZERS[shape])) for shape in columns]
    if not query.search.plain and asks_for_path(query.search):
        return pen.pack(pen.name(writer.row(freezers)), pen.name(writer.follow()))
    if not can_be_taken_apart(builder, query):
        return pen.constant(None)
    stop, where, weight = query.search.stop, query.where, query.search.weight
    names = [
        writer.elements(loops),
        writer.row(freezers),
        None if stop is None else writer.truth("ends", stop),
        None if where is None else writer.truth("is_goal", where),
        None if weight is None else writer.weight(weight),
        writer.follow(),
    ]
    reverse = reverse_of(query)
    names += [None, None] if isinstance(reverse, str) else [writer.goals(reverse), writer.before(reverse)]
    probable = pen.constant(query.search.order == "probability")
    plain = not any(source.id in builder.unit.tuples or source.id in builder.unit.worlds for source in query.sources)
    functions = (pen.constant(None) if name is None else pen.name(name) for name in names)
    return pen.pack(probable, *functions, pen.constant(plain), pen.constant(chooses), pen.pack(*freezers))


class Writer:
    """One function after the other. They take the last part of a step: its elements and the state before it."""

    def __init__(self, builder: Builder, query: plan.Query, outer: Body) -> None:
        assert query.search is not None
        self.builder, self.unit = builder, builder.unit
        self.query, self.search = query, query.search
        self.outer = outer
        self.pen = self.unit.pen_at(query.span)
        self.outputs = query.rows if query.aggregated else tuple(output.expr for output in query.columns)
        self.states = [self.unit.states[query.id, name] for name, _ in self.search.start]

    def elements(self, loops: Loops) -> str:
        """A generator of the elements of a state, each as what the other functions take."""
        body, pen = Body(self.unit, self.unit.local("elements"), ["state"], self.outer), self.pen
        body.states = {(self.query.id, name) for name, _ in self.search.start}
        body.add(pen.increase(self.unit.counter("expanded", body)))
        body.add(pen.unpack(self.states, pen.name("state")))
        body.locals.extend(self.states)
        inner = loops.open(body, {})
        inner.add(pen.run(pen.give(pen.pack(*map(pen.name, self._names())))))
        inner.define()
        return body.name

    def row(self, freezers: list[ast.expr]) -> str:
        """The row of a step, and what stands for it where rows are compared."""
        body, pen = self._function("row", ["last"], self.outputs), self.pen
        values = [body.variable(expression(self.builder, expr, body), pen, "value") for expr in self.outputs]
        keys = [pen.call(freezer, value) for freezer, value in zip(freezers, values, strict=True)]
        body.add(pen.back(pen.pack(pen.pack(*values), keys[0] if len(keys) == 1 else pen.pack(*keys))))
        body.define()
        return body.name

    def truth(self, name: str, clause: plan.Expr) -> str:
        """Whether STOP WITH or WHERE is true of a step. What its row and the state after it tell is not asked again."""
        body, pen = self._function(name, ["last", "row", "following"], [clause]), self.unit.pen_at(clause.span)
        self._may_know_row(body)
        self._may_know_following(body, clause)
        value = expression(self.builder, clause, body)
        body.add(pen.back(value if clause.type.only(Kind.BOOL) else pen.truth(value)))
        body.define()
        return body.name

    def weight(self, clause: plan.Expr) -> str:
        """What a step costs, or how likely it is."""
        body, pen = self._function("weigh", ["last", "row"], [clause]), self.unit.pen_at(clause.span)
        self._know_row(body)
        value = expression(self.builder, clause, body)
        check = options.probability if self.search.order == "probability" else options.cost
        known = options.is_known(clause.type, check)
        body.add(pen.back(value if known else pen.call(self.unit.helper(check), value)))
        body.define()
        return body.name

    def follow(self) -> str:
        """The state after a step."""
        connect, number = self.search.connect, self.query.id
        body = self._function("follow", ["last", "row"], [expr for _, expr in connect])
        self._know_row(body)
        for name, expr in connect:
            pen = self.unit.pen_at(expr.span)
            body.moved[number, name] = body.assigned(expression(self.builder, expr, body), pen, f"next_{name}")
        names = [body.moved.get((number, name)) or self.unit.states[number, name] for name, _ in self.search.start]
        body.add(self.pen.back(self.pen.pack(*map(self.pen.name, names))))
        body.define()
        return body.name

    # --- backwards ---------------------------------------------------------------------------------------

    def goals(self, reverse: Reverse) -> str:
        """The states at the goal; what no step changes has its value from the start."""
        self.unit.analysis.include(tuple(value for goal in reverse.goals for value in goal if value is not None))
        body, pen = Body(self.unit, self.unit.local("goals"), ["state"], self.outer), self.pen
        start = [pen.item(pen.name("state"), position) for position in range(len(self.states))]
        states = []
        for goal in reverse.goals:
            pairs = zip(start, goal, strict=True)
            values = (old if value is None else expression(self.builder, value, body) for old, value in pairs)
            states.append(pen.pack(*values))
        body.add(pen.back(pen.array(*states)))
        body.define()
        return body.name

    def before(self, reverse: Reverse) -> str:
        """The state before a step, from its elements and the state after it; None where there is none."""
        exprs = [expr for expr in reverse.before if expr is not None]
        self.unit.analysis.include(tuple(exprs))
        body, pen = self._function("before", ["last"], exprs), self.pen
        values = []
        for expr, after in zip(reverse.before, self.states, strict=True):
            if isinstance(expr, plan.Call) and expr.function.inverse_of:
                values.append(self._undone(expr, body))
            else:
                values.append(pen.name(after) if expr is None else expression(self.builder, expr, body))
        body.add(pen.back(pen.pack(*values)))
        body.define()
        return body.name

    def _undone(self, expr: plan.Call, body: Body) -> ast.expr:
        """The value of an inverse; ends the function where it is None."""
        unit, pen = self.unit, self.unit.pen_at(expr.place)
        arguments = pen.pack(*(expression(self.builder, argument, body) for argument in expr.arguments))
        unit.page.mark_call(expr.place, expr.function.name)
        value = unit.local("before")
        result = pen.call(unit.function(expr.function, pen), arguments)
        body.add(pen.assign(value, pen.item(result, 0)))
        nothing = pen.compare(pen.name(value), ast.Is(), pen.constant(None))
        body.add(pen.when(nothing, pen.back(pen.constant(None))))
        return pen.name(value)

    # --- what all begin with -----------------------------------------------------------------------------

    def _function(self, name: str, parameters: list[str], clauses: Sequence[plan.Expr]) -> Body:
        body = Body(self.unit, self.unit.local(name), parameters, self.outer)
        body.levels.update((source.id, 0) for source in self.query.sources)
        body.states.update((self.query.id, name) for name, _ in self.search.start)
        body.count(clauses)
        body.add(self.pen.unpack(self._names(), self.pen.name("last")))
        body.locals.extend(self._names())
        return body

    def _names(self) -> list[str]:
        return [*(self.unit.names[source.id] for source in self.query.sources), *self.states]

    def _know_row(self, body: Body) -> None:
        """Takes what SELECT shows from the row."""
        for key, shown in self._shown():
            name = body.known[-1][key] = self.unit.local("shown")
            body.add(self.pen.assign(name, shown))

    def _may_know_row(self, body: Body) -> None:
        """The same where the row may be None, because it is not known."""
        for key, shown in self._shown():
            self._may_know(body, key, "row", shown)

    def _shown(self) -> Iterator[tuple[int, ast.expr]]:
        for position, expr in enumerate(self.outputs):
            key = self.unit.analysis.of(expr).key
            if key is not None and not isinstance(expr, (plan.Element, plan.State, plan.Constant)):
                yield key, self.pen.item(self.pen.name("row"), position)

    def _may_know_following(self, body: Body, clause: plan.Expr) -> None:
        """Takes what CONNECT BY computes from the state after the step, where that is known."""
        wanted = {self.unit.analysis.of(node).key for node in walk(clause)}
        position = {name: number for number, (name, _) in enumerate(self.search.start)}
        for name, expr in set_at_once(self.query).items():
            facts = self.unit.analysis.of(expr)
            if facts.key is not None and facts.costly and facts.key in wanted:
                known = self.pen.item(self.pen.name("following"), position[name])
                self._may_know(body, facts.key, "following", known)

    def _may_know(self, body: Body, key: int, given: str, value: ast.expr) -> None:
        """Takes a value from what a parameter has, unless that is None; else it is computed when it is asked for."""
        pen = self.pen
        first = key not in body.slots
        slot = body.slots.setdefault(key, self.unit.local("shared"))
        self.unit.namespace["UNSET"] = UNSET
        otherwise = pen.name("UNSET" if first else slot)
        body.add(
            pen.assign(
                slot, pen.either(pen.compare(pen.name(given), ast.IsNot(), pen.constant(None)), value, otherwise)
            )
        )
        body.counts[key] += 2  # so that the slot is asked

"""The clauses of one step of a search, and the loops over the elements that steps are taken for.

The clauses are written in the order of language.md section 7. The loop around them is that of the order of search, see
loop_code.py.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Hashable
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Any

from ss2sql import plan
from ss2sql.kinds import Kind, Type
from ss2sql.runtime.native import options
from ss2sql.runtime.native.call_code import is_remembered, keyed_elements, remembered_call
from ss2sql.runtime.native.expressions import expression
from ss2sql.runtime.native.lookups import Lookup, lookups
from ss2sql.runtime.native.loops import Loops, read_by_sources
from ss2sql.runtime.native.new_calls import call_places, new_calls, ways_of
from ss2sql.runtime.native.unit import Body
from ss2sql.runtime.values import freeze
from ss2sql.walk import parts

if TYPE_CHECKING:
    from ss2sql.runtime.native.builder import Builder

_PLAIN = Kind.NONE | Kind.NUMBER | Kind.STR  # equal values of these kinds have the same hash
MOST_INSIDE = 8  # loops over sources inside of the loop of the search; Python nests twenty blocks


class StepLoops(Loops):
    """The loops over the sources of a search, whose innermost turns are its steps.

    Steps are counted by the loop of the search, see loop_code.py, unless `counts_steps` is set.
    """

    counts_steps = False

    def _count(self, body: Body, innermost: bool) -> None:
        if not innermost or self.counts_steps:
            super()._count(body, innermost)


class StepCode:
    """Writes the clauses of one step into `body`, whose outermost block is what is done once for each state.

    `words` says what the clauses that have been written leave behind, see loop_code.py.
    """

    def __init__(self, builder: Builder, query: plan.Query, body: Body, loops: StepLoops) -> None:
        assert query.search is not None
        self.builder = builder
        self.unit = builder.unit
        self.query = query
        self.search = query.search
        self.body = body
        self.inner = body
        self.loops = loops
        self.outputs = query.rows if query.aggregated else tuple(output.expr for output in query.columns)
        self.compares = self.search.repeats != "allowed"
        self.pen = self.unit.pen_at(query.span)
        self.words: dict[str, Any] = {}
        self.has_list = False  # whether the elements of a state are one list
        self._row: list[ast.expr] = []
        self._is_packed = False
        clauses = [self.search.stop, query.where, self.search.weight, self.search.heuristic]
        self.clauses = [clause for clause in clauses if clause is not None]
        self.connect = [expr for _, expr in self.search.connect]
        body.states = {(query.id, name) for name, _ in self.search.start}
        body.count([*read_by_sources(query), *self.outputs, *self.clauses, *self.connect])
        self._look_up()
        self._accompany()
        self._forget_calls()

    # --- elements --------------------------------------------------------------------------------------

    def open(self, left: bool) -> ast.For:
        """Opens the loops over the sources and gives the outermost one.

        A loop that is `left` for another state and entered again must be a single one.
        """
        if len(self.query.sources) > (1 if left else MOST_INSIDE):
            self._generate()
        else:
            self.inner = self.loops.open(self.body, {})
        loop = self.body.blocks[0][-1]
        assert isinstance(loop, ast.For)
        source = self.query.sources[0]
        alone = len(self.query.sources) == 1 and not isinstance(source, plan.WorldSource)
        # Nothing stands before the step that may drop an element.
        self.has_list = alone and not loop.body
        return loop

    def _generate(self) -> None:
        """Loops over all sources in a generator of its own."""
        unit, pen, outer = self.unit, self.pen, self.loops.owner
        states = sorted(self.body.states)
        generator = Body(unit, unit.local("elements"), [unit.states[state] for state in states], outer)
        generator.states = self.body.states
        generator.count(read_by_sources(self.query))
        innermost = self.loops.open(generator, {})
        names = [unit.names[source.id] for source in self.query.sources]
        for known in (self.loops.frozen, unit.keys):
            names += [known[source.id] for source in self.query.sources if source.id in known]
        innermost.add(pen.run(pen.give(pen.pack(*map(pen.name, names)))))
        innermost.define()
        self.body.loop(names, pen.call(generator.name, *map(pen.name, generator.parameters)), pen)
        self.body.levels.update((source.id, 1) for source in self.query.sources)

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
            dropped = lookups(part, self.unit.analysis, "ne")
            if where:
                kept = lookups(other, self.unit.analysis)
                dropped = [one for one in dropped if any(self._is_same(one, same) for same in kept)]
            if not any(map(self.loops.look_up, dropped)):
                return

    def _is_same(self, one: Lookup, other: Lookup) -> bool:
        pairs = ((one.key, other.key), (one.other, other.other))
        keys = [(self.unit.analysis.of(a).key, self.unit.analysis.of(b).key) for a, b in pairs]
        return all(a is not None and a == b for a, b in keys)

    def _accompany(self) -> None:
        """Elements that are read once, and stand in the row as they are, are frozen once; so are keys of arguments."""
        shown = {expr.source for expr in self.outputs if isinstance(expr, plan.Element)} if self.compares else set()
        keyed = keyed_elements([*self.outputs, *self.clauses, *self.connect])
        for source in self.query.sources:
            frozen = source.id in shown and not self.loops.is_scalar(source)
            if frozen or source.id in keyed:
                self.loops.accompany(source, frozen, source.id in keyed)

    def _forget_calls(self) -> None:
        """Lets calls do without a memory that are made once for each state and element, see new_calls.py."""
        unit, source = self.unit, self.query.sources[0].id
        items = self.loops.items.get(source)
        if items is None or source in self.loops.lookups or source in unit.tuples:
            return
        for call in new_calls(self.query, unit.analysis):
            keyed = source in unit.keys
            key = unit.analysis.of(call).key
            assert key is not None
            places = unit.constant(call_places(self.query)[call.function.name], "places")
            function, name = unit.constant(call.function, "function"), unit.local(f"{call.function.name}_of")
            known = [self.pen.name(word) for word in ("run", function, places, items)]
            single = not keyed and source not in self.loops.frozen
            flags = [self.pen.constant(keyed), self.pen.constant(single)]
            self.loops.owner.add(self.pen.assign(name, self.pen.call(unit.helper(ways_of), *known, *flags)))
            self.loops.owner.locals.append(name)
            self.body.new_calls[key] = name

    # --- what can be said before -----------------------------------------------------------------------

    @property
    def may_end(self) -> bool:
        """Whether a step that stops may be a goal; without a WHERE it is none."""
        return self.search.stop is not None and self.query.where is not None

    @property
    def is_settled(self) -> bool:
        """Whether nobody can notice that a step to a row that was reached before does not ask the clauses of `go_on`.

        It cannot raise, or if it could, the first step to that row would have.
        """
        asked = [self.search.heuristic, *self.connect, self.search.stop if self.may_end else None]
        return all(self._is_settled(expr) for expr in asked if expr is not None)

    def _is_settled(self, expr: plan.Expr) -> bool:
        facts = self.unit.analysis.of(expr)
        total = facts.total and (expr is not self.search.heuristic or options.is_known(expr.type, options.heuristic))
        return facts.steady and not facts.calls and ((total and expr is not self.search.stop) or self._follows(expr))

    def _follows(self, expr: plan.Expr) -> bool:
        """Whether the value of a steady expression is known when the row is."""
        facts = self.unit.analysis.of(expr)
        shown = [
            output
            for output in self.outputs
            if facts.key is not None and facts.key == self.unit.analysis.of(output).key
        ]
        if any(output.type.only(kind) for output in shown for kind in (Kind.INT, Kind.FLOAT, Kind.STR)):
            return True  # of one kind equal values are the same
        own = {source.id for source in self.query.sources}
        if own.isdisjoint(facts.sources) and not any(number == self.query.id for number, _ in facts.states):
            return True
        below = list(parts(expr))
        return bool(below) and all(isinstance(part, plan.Expr) and self._follows(part) for part in below)

    # --- the clauses -----------------------------------------------------------------------------------

    def row(self) -> None:
        """SELECT, before all else where rows are compared."""
        if not self.compares:
            return
        pen, inner = self.pen, self.inner
        columns = [self._frozen(expr) for expr in self.outputs]
        self._row = [value for value, _ in columns]
        frozen = [key for _, key in columns]
        same = len(frozen) > 1 and frozen == self._row
        if same:  # else the row is made when its step leaves a trace
            self._pack_row()
        key = frozen[0] if len(frozen) == 1 else pen.name("row") if same else pen.pack(*frozen)
        if not isinstance(key, ast.Name):
            inner.add(pen.assign("key", key))
            key = pen.name("key")
        self.words["key"] = key

    def _pack_row(self) -> None:
        self.inner.add(self.pen.assign("row", self.pen.pack(*self._row)))
        self._is_packed = True

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
        if expr.type.only(_PLAIN):
            return value, value
        if self.search.repeats == "memorize":
            frozen = pen.call(unit.helper(freezer(expr)), value)
        else:
            frozen = pen.call("tuple" if _is_plain_list(expr.type) else unit.helper(freeze), value)
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

    def judge(self) -> None:
        """STOP WITH and WHERE, which drop a step that stops without being a goal; SELECT; COST or PROBABILITY."""
        self._ask()
        if not self.compares:
            self._row = [expression(self.builder, expr, self.inner) for expr in self.outputs]
        if not self._is_packed:
            self._pack_row()
        self.weigh()

    def _ask(self) -> None:
        pen, inner, stop, where = self.pen, self.inner, self.search.stop, self.query.where
        if stop is not None and where is None:
            pen = self.unit.pen_at(stop.span)
            facts = self.unit.analysis.of(stop)
            inner.checked_later(facts, lambda: pen.assign("stop", expression(self.builder, stop, inner)), pen)
            inner.add(pen.when(pen.name("stop"), pen.next_turn()))
            return
        for name, clause in (("stop", stop), ("goal", where)):
            if clause is not None:
                write = partial(self._assigned_truth, name, clause)
                inner.checked_later(self.unit.analysis.of(clause), write, self.unit.pen_at(clause.span))
        if stop is not None:
            traceless = pen.both(ast.And(), [pen.name("stop"), pen.negation(pen.name("goal"))])
            inner.add(pen.when(traceless, pen.next_turn()))

    def _assigned_truth(self, name: str, clause: plan.Expr) -> ast.stmt:
        pen = self.unit.pen_at(clause.span)
        value = expression(self.builder, clause, self.inner)
        return pen.assign(name, value if clause.type.only(Kind.BOOL) else pen.truth(value))

    def weigh(self) -> None:
        """COST or PROBABILITY; an impossible step is dropped."""
        weight, pen, inner = self.search.weight, self.pen, self.inner
        if weight is None:
            return
        probable = self.search.order == "probability"
        inner.add(pen.assign("weight", self._checked(weight, options.probability if probable else options.cost)))
        if probable:
            inner.add(pen.unless(pen.name("weight"), pen.next_turn()))

    def _checked(self, expr: plan.Expr, check: Callable[[Any], Any]) -> ast.expr:
        pen = self.unit.pen_at(expr.span)
        value = expression(self.builder, expr, self.inner)
        return value if options.is_known(expr.type, check) else pen.call(self.unit.helper(check), value)

    def go_on(self) -> None:
        """HEURISTIC, and CONNECT BY in its order."""
        inner, unit, number = self.inner, self.unit, self.query.id
        if self.search.heuristic is not None:
            inner.add(self.pen.assign("estimate", self._checked(self.search.heuristic, options.heuristic)))
        for name, expr in self.search.connect:
            pen = unit.pen_at(expr.span)
            inner.moved[number, name] = inner.assigned(expression(self.builder, expr, inner), pen, f"next_{name}")
        states = [(number, name) for name, _ in self.search.start]
        self.words["state"] = [self.pen.name(inner.moved.get(state) or unit.states[state]) for state in states]

    @property
    def state_is_row(self) -> bool:
        """Whether the state after the step consists of the values of its row."""
        shown = [value.id if isinstance(value, ast.Name) else None for value in self._row]
        return [name.id for name in self.words.get("state", ())] == shown

    def last(self) -> ast.expr:
        """The elements of the step and the state before it."""
        names = [self.unit.names[source.id] for source in self.query.sources]
        names += [self.unit.states[self.query.id, name] for name, _ in self.search.start]
        return self.pen.pack(*map(self.pen.name, names))


def freezer(expr: plan.Expr) -> Callable[[Any], Hashable]:
    """What makes the stand-in of a column where MEMORIZE compares rows.

    Whoever meets a row has to make the same one. So it is `freeze` for elements and calls, which may have it at hand.
    """
    made_here = not isinstance(expr, (plan.Element, plan.Call))
    return tuple if made_here and _is_plain_list(expr.type) else freeze


def _is_plain_list(known: Type) -> bool:
    """Whether a value is a list of numbers and strings: a tuple of them is made in a fifth of the time of `freeze`."""
    return known.only(Kind.LIST) and known.item is not None and known.item.only(_PLAIN)


def _parts(clause: plan.Expr | None, kind: type[plan.And] | type[plan.Or]) -> tuple[plan.Expr, ...]:
    """The parts of a clause in the order in which they are asked."""
    return clause.parts if isinstance(clause, kind) else () if clause is None else (clause,)

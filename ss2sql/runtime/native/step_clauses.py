"""The clauses of one step of a search, in the order of language.md, 7: what `step_function.py` puts into its loop.

A step ends in `yield row, key, goal, goes_on, after, weight, estimate, last`, see search/contract.py, or in `continue`.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from marshal import dumps
from typing import TYPE_CHECKING, Any

from ss2sql import plan
from ss2sql.kinds import SCALAR, Kind, Type
from ss2sql.records import dataclass
from ss2sql.runtime import frozen
from ss2sql.runtime.frozen import Shape
from ss2sql.runtime.native import options
from ss2sql.runtime.native.expressions import expression
from ss2sql.runtime.native.fragments import written
from ss2sql.runtime.native.loops import Loops, read_by_sources
from ss2sql.runtime.native.pen import Pen
from ss2sql.runtime.native.single_calls import SingleCall
from ss2sql.runtime.native.unit import Body, Unit
from ss2sql.runtime.search.best_first import TAKEN

if TYPE_CHECKING:
    from ss2sql.runtime.native.builder import Builder

# The row of a step is closed.
CLOSED = """
if IS_CLOSED:
    LEAVE
"""

# The same where its only value is what a function has given, which is checked when it is new. `marshal` writes five
# bytes for each list and each number of 32 bits, so that these are all that there is if every fifth is "[" or "i": 0.11
# us where a look at every item takes 0.7. It would follow `l = [l, l]` for ever, but that could not be looked up
# before.
CHECKED = """
try:
    if type(VALUE) is not list:
        raise TypeError
    FREEZE
    if IS_CLOSED:
        LEAVE
    plain = not dumps(VALUE, 2)[::5].strip(b"[i")
except (TypeError, ValueError):
    plain = False
if not plain:
    VALUE, KEY = settled(VALUE, GIVER, FREEZER)
    PACK
    if IS_CLOSED:
        LEAVE
"""

# The same where nothing is known of the shape of such a value.
SETTLED = """
VALUE, KEY = settled(VALUE, GIVER, FREEZER)
PACK
if IS_CLOSED:
    LEAVE
"""

PRUNE = """
pruned += 1
continue
"""


@dataclass(frozen=True, slots=True)
class StepForm:
    """What the step functions of one search have in common.

    `start` is the name of the frozen state that START WITH gives, the last of several. `keyed`: somebody asks for the
    last part of a step. `complete`: what leaves no trace is told, see remembered_steps.py; `watched`: the trace of the
    run hears of it. `key_of` is the name of the function that gives the key of a state, where BY names it. `noted`:
    what clauses evaluate is taken from notes, and kept there, see memorize/notes.py.
    """

    shapes: dict[str, Shape]
    start: str
    keyed: bool
    complete: bool
    watched: bool
    key_of: str | None
    noted: bool = False


class StepClauses:
    """Writes the clauses of one step into `inner`, the innermost loop of `body`.

    `owner` is where START WITH is evaluated. Steps are made of elements that meet the condition `made`.
    """

    def __init__(
        self, builder: Builder, query: plan.Query, body: Body, loops: Loops, form: StepForm, made: plan.Expr | None
    ) -> None:
        assert query.search is not None
        self.builder, self.unit = builder, builder.unit
        self.query, self.search = query, query.search
        self.body = self.inner = body
        self.loops, self.owner = loops, loops.owner
        self.form, self.made, self.shapes = form, made, form.shapes
        self.pen = self.unit.pen_at(query.span)
        self.outputs = query.rows if query.aggregated else tuple(output.expr for output in query.columns)
        clauses = [self.search.stop, query.where, self.search.weight, self.search.heuristic]
        self.clauses = [clause for clause in clauses if clause is not None]
        self.connect = dict(self.search.connect)
        self.of_before: set[str] = set()  # variables whose assignments read nothing that was assigned before them
        self.everything = [*self.outputs, *self.clauses, *self.connect.values()]
        self.compares = self.search.repeats != "allowed" and self.search.by == "row"  # before all else
        self.by_key = self.search.repeats != "allowed" and self.search.by != "row"  # by BY, after all else
        self.edges = self.search.repeats == "memorize"
        self.totals = self.search.repeats == "unique" and self.search.weight is not None
        self.steady = all(self.unit.analysis.of(expr).steady for expr in self.everything)
        self.frozen_states = names_of_frozen(self.unit, query, self.shapes)
        body.states = {(query.id, name) for name in self.shapes}
        conditions = [] if made is None else [made]
        siblings = [key.expr for key in self.search.siblings]
        body.count([*read_by_sources(query), *conditions, *siblings, *self.everything, *self.search.key])
        # a call that is made once for each step, without a memory
        self.single = None if form.watched or form.noted else SingleCall.of(self)
        self.columns: list[Shape] = [self._shape_of_column(expr) for expr in self.outputs]
        self.key: ast.expr = self.pen.constant(None)
        self.row: list[ast.expr] = []  # the frozen values of the columns

    # --- all of them -----------------------------------------------------------------------------------

    def write_clauses(self) -> None:
        """Writes all clauses, and what is given of the step."""
        pen, inner = self.pen, self.inner
        early = self.totals and self.compares and self._weighs_early()
        if self.compares:
            self._compare(early)
        self._ask()
        if not self.compares:
            self.row = [self._frozen(expr, shape) for expr, shape in zip(self.outputs, self.columns, strict=True)]
        if not self.compares or len(self.row) == 1:
            self._pack_row()
        if self.search.weight is not None and not early:
            self._weigh()
            if self.totals:
                self._add_up()
                if self.steady and not self.by_key:
                    self._improve(known=self.search.heuristic is None)
        if self._may_end:
            inner.add(pen.when(pen.name("stop"), *self._aside(partial(self._finish, True)), pen.next_turn()))
        self._finish(False)

    def _finish(self, stops: bool) -> None:
        """HEURISTIC, CONNECT BY, and what BY compares, as far as somebody needs them; gives the step."""
        of_state, after = self.by_key and self.search.by == "state", None
        if not stops and self.search.heuristic is not None:
            self.inner.add(self.pen.assign("estimate", self._number(self.search.heuristic, options.heuristic)))
        if not stops or of_state:
            self._go_on()
            after = self._after()
        if self.by_key:
            self._find_key(after)
            if not self.edges:
                self._add(CLOSED, self.pen, IS_CLOSED=self._is_closed(), LEAVE=self._prune())
        if self.totals and (self.by_key or not (self.steady or stops)):
            self._improve(known=self.search.heuristic is None)
        self.inner.add(self.pen.run(self.pen.give(self._step(after, stops))))

    def _aside(self, write: Callable[[], None]) -> list[ast.stmt]:
        """The statements that are written, for a place that not every step comes to."""
        inner, moved = self.inner, dict(self.inner.moved)
        inner.blocks.append([])
        inner.known.append({})
        with inner.unsure():
            write()
        inner.known.pop()
        inner.moved = moved
        return inner.blocks.pop()

    def _find_key(self, after: ast.expr | None) -> None:
        """The key that BY names: of the state reached, or of the step and the state before it."""
        inner, pen = self.inner, self.pen
        if self.search.by == "state":
            assert self.form.key_of is not None
            assert after is not None
            self.key = pen.name(inner.assigned(pen.call(self.form.key_of, after), pen, "key"))
            return
        moved, inner.moved = inner.moved, {}
        self.key = self._packed_key([self._frozen(expr, self._shape_of_column(expr)) for expr in self.search.key])
        inner.moved = moved

    def _packed_key(self, values: list[ast.expr]) -> ast.expr:
        """What stands for the values that are compared."""
        pen = self.pen
        return values[0] if len(values) == 1 else pen.name(self.inner.assigned(pen.pack(*values), pen, "key"))

    def _add(self, text: str, pen: Pen, **words: ast.expr | list[ast.stmt]) -> None:
        self.inner.add(*written(text, pen, words))

    def _prune(self) -> list[ast.stmt]:
        return [*self._told("repeated"), *written(PRUNE, self.pen, {})]

    def _told(self, word: str) -> list[ast.stmt]:
        """Lets the trace hear of a step that leaves none, with its row where it is known, or nobody could notice."""
        pen = self.pen
        if not self.form.watched:
            return []
        leave = pen.part(pen.part(pen.name("run"), "trace"), "leave")

        def write() -> None:
            pairs = zip(self.outputs, self.columns, strict=True)
            row = self.row or [self._frozen(expr, shape) for expr, shape in pairs]
            self.inner.add(pen.run(pen.call(leave, pen.constant(word), pen.pack(*row))))

        facts = [self.unit.analysis.of(expr) for expr in self.outputs]
        if self.row or (not self.query.aggregated and all(one.steady and one.total for one in facts)):
            return self._aside(write)
        return [pen.run(pen.call(leave, pen.constant(word), pen.constant(None)))]

    def _step(self, after: ast.expr | None, stops: bool) -> ast.expr:
        """What is given of a step that leaves a trace."""
        pen, search = self.pen, self.search
        nothing = pen.constant(None)
        weight = pen.name("new_total") if self.totals else pen.name("weight")
        return pen.pack(
            pen.name("row"),
            self.key,
            pen.constant(True) if stops or self.query.where is None else pen.name("goal"),
            pen.constant(not stops),
            after or nothing,
            nothing if search.weight is None else weight,
            nothing if search.heuristic is None or stops else pen.name("estimate"),
            self._last() if self.form.keyed else nothing,
        )

    def _last(self) -> ast.expr:
        """The elements of the step and the state before it."""
        names = [self.unit.names[source.id] for source in self.query.sources]
        names += [self.unit.states[self.query.id, name] for name in self.shapes]
        return self.pen.pack(*map(self.pen.name, names))

    def _value(self, expr: plan.Expr) -> ast.expr:
        """The value of a clause, a column, or a variable after the step."""
        return expression(self.builder, expr, self.inner)

    # --- rows ------------------------------------------------------------------------------------------

    def _shape_of_column(self, expr: plan.Expr) -> Shape:
        if expr.type.only(SCALAR):
            return "scalar"
        if isinstance(expr, plan.State) and expr.query == self.query.id:
            return self.shapes[expr.name]
        if self.single is not None and self.single.key == self.unit.analysis.of(expr).key:
            return self.single.shape
        return "flat" if frozen.is_flat(expr.type) else "any"

    def _frozen(self, expr: plan.Expr, shape: Shape) -> ast.expr:
        """The name of the frozen value of a column."""
        unit, inner = self.unit, self.inner
        pen, facts = unit.pen_at(expr.span), unit.analysis.of(expr)
        if isinstance(expr, plan.State) and expr.query == self.query.id and not inner.has_moved(facts):
            return pen.name(self.frozen_states[expr.name])
        value = self._value(expr)
        if isinstance(expr, plan.Element) and expr.source in self.loops.frozen:
            return pen.name(self.loops.frozen[expr.source])
        if shape == "scalar":
            return pen.name(inner.assigned(value, pen, "value"))
        name = inner.variable(value, pen, "value")
        made = pen.call("tuple" if frozen.is_flat(expr.type) else unit.helper(frozen.FREEZERS[shape]), name)
        if facts.steady and facts.sources.isdisjoint({source.id for source in self.query.sources}):
            made = inner.kept(replace(facts, key=None), made, pen, "frozen")
        return pen.name(inner.assigned(made, pen, "frozen"))

    def _pack_row(self) -> None:
        self.inner.add(self.pen.assign("row", self.pen.pack(*self.row)))

    def _compare(self, early: bool) -> None:
        """SELECT, before all else, and whether its row is closed."""
        pen, single = self.pen, None
        for expr, shape in zip(self.outputs, self.columns, strict=True):
            if self.single is not None and single is None and self.single.key == self.unit.analysis.of(expr).key:
                single = len(self.row)
                self.single.write(self)
                self.row.append(pen.name(self.unit.local("frozen")))
            else:
                self.row.append(self._frozen(expr, shape))
        alone = len(self.row) == 1
        self.key = self.row[0] if alone else pen.name("row")
        if single is not None:
            self._check(single)
            return
        if not alone:
            self._pack_row()
        if self.search.key:
            shown = zip(self.outputs, self.row, strict=True)
            self.key = self._packed_key([value for expr, value in shown if expr in self.search.key])
        if early:
            self._weigh()
            self._add_up()
            self._improve()
        else:
            self._add(
                CLOSED, self.pen, IS_CLOSED=self._is_closed(), LEAVE=self._edge() if self.edges else self._prune()
            )

    def _is_closed(self) -> ast.expr:
        pen = self.pen
        if not self.totals:
            return pen.compare(self.key, ast.In(), pen.name("closed"))
        known = pen.bind("known", pen.call(pen.part(pen.name("closed"), "get"), self.key))
        if self.search.heuristic is None:
            self.unit.namespace["TAKEN"] = TAKEN
            return pen.compare(known, ast.Is(), pen.name("TAKEN"))
        worse = pen.compare(pen.name("known"), ast.LtE(), pen.name("total"))
        return pen.both(ast.And(), [pen.compare(known, ast.IsNot(), pen.constant(None)), worse])

    def _check(self, place: int) -> None:
        """Whether the row is closed whose value at this place has not been checked."""
        unit, single, alone, key = self.unit, self.single, len(self.row) == 1, self.row[place]
        assert single is not None
        pen = unit.pen_at(single.node.place)  # where a value is refused
        assert isinstance(key, ast.Name)
        value = pen.name(single.value)
        made = pen.call("tuple", value)
        if single.shape == "nested":
            copies = pen.call("map", pen.name(unit.constant(list.copy, "copy")), value)  # fails for what is no list
            made = pen.call("tuple", pen.call("map", pen.name("tuple"), copies))
        row = [pen.bind(key.id, made) if at == place else part for at, part in enumerate(self.row)]
        self._add(
            CHECKED if single.shape in ("flat", "nested") else SETTLED,
            pen,
            VALUE=value,
            KEY=key,
            FREEZE=[pen.assign(key.id, made) if alone else pen.assign("row", pen.pack(*row))],
            PACK=[] if alone else [pen.assign("row", pen.pack(*self.row))],
            IS_CLOSED=self._is_closed(),
            LEAVE=self._edge() if self.edges else self._prune(),
            GIVER=pen.constant(single.node.function.name),
            FREEZER=pen.name(unit.helper(frozen.FREEZERS[single.shape])),
            settled=pen.name(unit.helper(frozen.settled)),
            dumps=pen.name(unit.helper(dumps)),
        )

    def _edge(self) -> list[ast.stmt]:
        """What MEMORIZE is given of a step to a known row: its weight is asked for, and nothing else."""
        pen = self.pen

        def write() -> None:
            if len(self.row) == 1:
                self._pack_row()
            self._weigh()

        nothing = pen.constant(None)
        weight = nothing if self.search.weight is None else pen.name("weight")
        last = self._last() if self.form.keyed else nothing
        step = [pen.name("row"), self.key, nothing, pen.constant(False), nothing, weight, nothing, last]
        return [*self._aside(write), pen.run(pen.give(pen.pack(*step))), pen.next_turn()]

    # --- STOP WITH and WHERE ---------------------------------------------------------------------------

    @property
    def _may_end(self) -> bool:
        """Whether a step that stops may be a goal; without a WHERE it is none."""
        return self.search.stop is not None and self.query.where is not None

    def _ask(self) -> None:
        pen, inner, stop, where = self.pen, self.inner, self.search.stop, self.query.where
        leave = [pen.next_turn()]
        if self.form.complete:
            leave.insert(0, pen.run(pen.call("drop", self.key)))
        if self.form.watched and stop is not None:
            leave[:0] = self._told("stopped")
        if stop is not None and where is None:
            pen = self.unit.pen_at(stop.span)
            facts = self.unit.analysis.of(stop)
            inner.checked_later(facts, lambda: pen.assign("stop", self._value(stop)), pen)
            inner.add(pen.when(pen.name("stop"), *leave))
            return
        for name, clause in (("stop", stop), ("goal", where)):
            if clause is not None:
                write = partial(self._assigned_truth, name, clause)
                inner.checked_later(self.unit.analysis.of(clause), write, self.unit.pen_at(clause.span))
        if stop is not None:
            traceless = pen.both(ast.And(), [pen.name("stop"), pen.negation(pen.name("goal"))])
            inner.add(pen.when(traceless, *leave))

    def _assigned_truth(self, name: str, clause: plan.Expr) -> ast.stmt:
        pen = self.unit.pen_at(clause.span)
        value = self._value(clause)
        return pen.assign(name, value if clause.type.only(Kind.BOOL) else pen.truth(value))

    # --- COST, PROBABILITY, HEURISTIC ------------------------------------------------------------------

    def _weigh(self) -> None:
        """The weight of the step; an impossible one is dropped."""
        weight, pen, inner = self.search.weight, self.pen, self.inner
        if weight is None:
            return
        probable = self.search.order == "probability"
        inner.add(pen.assign("weight", self._number(weight, options.probability if probable else options.cost)))
        if probable:
            inner.add(pen.unless(pen.name("weight"), *self._told("stopped"), pen.next_turn()))

    def _number(self, expr: plan.Expr, check: Callable[[Any], Any]) -> ast.expr:
        pen = self.unit.pen_at(expr.span)
        value = self._value(expr)
        return value if options.is_known(expr.type, check) else pen.call(self.unit.helper(check), value)

    def _weighs_early(self) -> bool:
        """Whether the weight is asked for before STOP WITH and WHERE: STOP WITH guards a COST that may fail."""
        weight = self.search.weight
        assert weight is not None
        check = options.probability if self.search.order == "probability" else options.cost
        return self.steady and self.unit.analysis.of(weight).total and options.is_known(weight.type, check)

    def _add_up(self) -> None:
        pen = self.pen
        operator = ast.Mult() if self.search.order == "probability" else ast.Add()
        self.inner.add(pen.assign("new_total", pen.binary(pen.name("total"), operator, pen.name("weight"))))

    def _improve(self, known: bool = False) -> None:
        """A step that is no better than the best to its row, which may be `known`, is dropped."""
        pen = self.pen
        total = pen.name("known")
        if not known:
            total = pen.bind("known", pen.call(pen.part(pen.name("best"), "get"), self.key))
        worse = pen.compare(pen.name("known"), ast.LtE(), pen.name("new_total"))
        is_worse = pen.both(ast.And(), [pen.compare(total, ast.IsNot(), pen.constant(None)), worse])
        self._add(CLOSED, self.pen, IS_CLOSED=is_worse, LEAVE=self._prune())

    # --- CONNECT BY ------------------------------------------------------------------------------------

    def _go_on(self) -> None:
        """CONNECT BY in its order."""
        inner, unit, number = self.inner, self.unit, self.query.id
        for name, expr in self.search.connect:
            pen = unit.pen_at(expr.span)
            if not inner.has_moved(unit.analysis.of(expr)):
                self.of_before.add(name)
            inner.moved[number, name] = inner.assigned(self._value(expr), pen, f"next_{name}")

    def _after(self) -> ast.expr:
        """The frozen state to go on from; what is a column is frozen already."""
        pen, analysis = self.pen, self.unit.analysis
        columns = {
            (analysis.of(expr).key, shape): value
            for expr, shape, value in zip(self.outputs, self.columns, self.row, strict=True)
            if analysis.of(expr).key is not None
        }
        values = []
        for name, shape in self.shapes.items():
            moved = self.inner.moved.get((self.query.id, name))
            is_column = moved is not None and name in self.of_before
            column = columns.get((analysis.of(self.connect[name]).key, shape)) if is_column else None
            if moved is None:
                values.append(pen.name(self.frozen_states[name]))
            elif shape == "scalar":
                values.append(pen.name(moved))
            else:
                made = pen.call(self.unit.helper(frozen.FREEZERS[shape]), pen.name(moved))
                values.append(made if column is None else column)
        if self.search.first is not None:  # it is no start
            values.append(pen.constant(False))
        if self.by_key:  # they are read twice
            values = [self.inner.variable(value, pen, "after") for value in values]
        return pen.pack(*values)


def shapes_of(search: plan.Search) -> dict[str, Shape]:
    """How the START WITH variables of a search are frozen."""
    types = dict(search.states)
    return {name: _shape_of_state(types.get(name, expr.type), expr) for name, expr in search.start}


def names_of_frozen(unit: Unit, query: plan.Query, shapes: Mapping[str, Shape]) -> dict[str, str]:
    """The names of the frozen variables; numbers and strings are their own frozen values."""
    return {
        name: unit.states[query.id, name] if shape == "scalar" else unit.local(f"{name}_frozen")
        for name, shape in shapes.items()
    }


def _shape_of_state(known: Type, start: plan.Expr) -> Shape:
    """The shape of a START WITH variable: scalar where all its values are known to be, else that of the first one."""
    if frozen.shape_of(known) == "scalar":
        return "scalar"
    shape = frozen.shape_of(start.type)
    return "any" if shape == "scalar" else shape

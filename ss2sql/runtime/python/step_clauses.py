"""The clauses of one step of a search, in the order of language.md, 7: what `step_function.py` puts into its loop.

A step ends in `yield row, key, goal, goes_on, after, weight, estimate, last`, see runtime/search/step_contract.py, or
in `continue`.
"""

from __future__ import annotations

import ast
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from marshal import dumps
from typing import TYPE_CHECKING, Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import SCALAR, Kind, Type
from ss2sql.language.values import FREEZERS, Shape, choose_frozen_shape, convert_and_freeze, is_flat_list_type
from ss2sql.runtime.python.codegen_context import CodegenContext, PythonScope
from ss2sql.runtime.python.python_expressions import generate_expression
from ss2sql.runtime.python.single_calls import SingleCall, SingleSourceCall
from ss2sql.runtime.python.source_loops import SourceLoops, list_loop_expressions
from ss2sql.runtime.run import run_state
from ss2sql.runtime.search.best_first import TAKEN

if TYPE_CHECKING:
    from ss2sql.runtime.python.native_query import QueryCompiler

# The row of a step is closed.
CLOSED = """
if IS_CLOSED:
    LEAVE
"""

# The same where its only value is what a function has given, which is checked when it is new. `marshal` writes five
# bytes for each list and each number of 32 bits, so that these are all that there is if every fifth is "[" or "i": 0.11
# us where a look at every item takes 0.7. It would follow `l = [l, l]` for ever, which could not be looked up.
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

    `start` is the name of the frozen state that START WITH gives, the last of several. `keyed`: somebody needs the
    last part of a step. `complete`: what leaves no trace is told, see step_contract.py; `watched`: the trace of the
    run hears of it. `key_of` is the name of the function that gives the key of a state, where BY names it. `noted`:
    what clauses evaluate is taken from notes, and kept there, see runtime/search/step_contract.py.
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
        self,
        builder: QueryCompiler,
        query: plan.Query,
        body: PythonScope,
        loops: SourceLoops,
        form: StepForm,
        made: plan.Expr | None,
    ) -> None:
        assert query.search is not None
        self.builder, self.codegen = builder, builder.codegen
        self.query, self.search = query, query.search
        self.body = self.inner = body
        self.loops, self.owner = loops, loops.owner
        self.form, self.made, self.shapes = form, made, form.shapes
        self.build = self.codegen.build_at(query.span)
        self.outputs = query.rows if query.aggregated else tuple(output.expr for output in query.columns)
        clauses = [self.search.stop, query.where, self.search.weight, self.search.heuristic]
        self.clauses = [clause for clause in clauses if clause is not None]
        self.connect = dict(self.search.connect)
        self.reads_state_before: set[str] = (
            set()
        )  # variables whose assignments read nothing that was assigned before them
        self.keeps_everything = [*self.outputs, *self.clauses, *self.connect.values()]
        self.compares = self.search.repeats != "allowed" and self.search.by == "row"  # before all else
        self.key_is_named = self.search.repeats != "allowed" and self.search.by != "row"  # by BY, after all else
        self.edges = self.search.repeats == "memorize"
        self.totals = self.search.repeats == "unique" and self.search.weight is not None
        self.steady = all(self.codegen.analysis.facts(expr).steady for expr in self.keeps_everything)
        self.frozen_states = name_frozen_variables(self.codegen, query, self.shapes)
        body.states = {(query.id, name) for name in self.shapes}
        conditions = [] if made is None else [made]
        siblings = [key.expr for key in self.search.siblings]
        body.count_uses(
            [*list_loop_expressions(query), *conditions, *siblings, *self.keeps_everything, *self.search.key]
        )
        # a call that is made once for each step, without a memory
        told = form.watched or form.noted
        self.source_call = self.codegen.source_call = None if told else SingleSourceCall.find_source_call(self)
        self.single = None if told else SingleCall.find_single_call(self)
        if self.source_call is not None and self.compares:
            self.single = self.source_call.find_element()
        self.columns: list[Shape] = [self._choose_column_shape(expr) for expr in self.outputs]
        self.key: ast.expr = self.build.constant(None)
        self.row: list[ast.expr] = []  # the frozen values of the columns

    # --- all of them -----------------------------------------------------------------------------------

    def write_clauses(self) -> None:
        """Writes all clauses, and what is given of the step."""
        build, inner = self.build, self.inner
        early = self.totals and self.compares and self._is_weight_early()
        if self.compares:
            self._write_early_select(early)
        self._write_stop_and_goal()
        if not self.compares:
            self.row = [self._name_frozen(expr, shape) for expr, shape in zip(self.outputs, self.columns, strict=True)]
        if not self.compares or len(self.row) == 1:
            self._pack_row()
        if self.search.weight is not None and not early:
            self._write_weight()
            if self.totals:
                self._write_total()
                if self.steady and not self.key_is_named:
                    self._write_improvement_test(known=self.search.heuristic is None)
        if self._can_stopping_step_be_goal:
            inner.emit(
                build.when(
                    build.name("goal" if self._stops_at_goals else "stop"),
                    *self._collect_statements(partial(self._write_rest, True)),
                    build.continue_loop(),
                )
            )
        self._write_rest(False)

    def _write_rest(self, stops: bool) -> None:
        """HEURISTIC, CONNECT BY, and what BY compares, as far as somebody needs them; gives the step."""
        of_state, after = self.key_is_named and self.search.by == "state", None
        if not stops and self.search.heuristic is not None:
            estimate = self._write_number(self.search.heuristic, run_state.check_heuristic)
            self.inner.emit(self.build.assign("estimate", estimate))
        if not stops or of_state:
            self._write_connect()
            after = self._build_next_state()
        if self.key_is_named:
            self._find_key(after)
            if not self.edges:
                is_closed = self._write_closed_test()
                self.inner.emit(*self.build.write(CLOSED, IS_CLOSED=is_closed, LEAVE=self._write_prune()))
        if self.totals and (self.key_is_named or not (self.steady or stops)):
            self._write_improvement_test(known=self.search.heuristic is None)
        self.inner.emit(self.build.run(self.build.yield_(self._write_step(after, stops))))

    def _collect_statements(self, write: Callable[[], None]) -> list[ast.stmt]:
        """The statements that are written, for a place that not every step comes to."""
        inner, moved = self.inner, dict(self.inner.moved)
        inner.blocks.append([])
        inner.known.append({})
        with inner.write_skippable():
            write()
        inner.known.pop()
        inner.moved = moved
        return inner.blocks.pop()

    def _find_key(self, after: ast.expr | None) -> None:
        """The key that BY names: of the state reached, or of the step and the state before it."""
        inner, build = self.inner, self.build
        if self.search.by == "state":
            assert self.form.key_of is not None
            assert after is not None
            self.key = build.name(inner.assign_name(build.call(self.form.key_of, after), build, "key"))
            return
        moved, inner.moved = inner.moved, {}
        self.key = self._write_packed_key(
            [self._name_frozen(expr, self._choose_column_shape(expr)) for expr in self.search.key]
        )
        inner.moved = moved

    def _write_packed_key(self, values: list[ast.expr]) -> ast.expr:
        """What stands for the values that are compared."""
        build = self.build
        return values[0] if len(values) == 1 else build.name(self.inner.assign_name(build.pack(*values), build, "key"))

    def _write_prune(self) -> list[ast.stmt]:
        return [*self._write_trace_note("repeated"), *self.build.write(PRUNE)]

    def _write_trace_note(self, word: str) -> list[ast.stmt]:
        """Lets the trace hear of a step that leaves none, with its row where it is known, or nobody could notice."""
        build = self.build
        if not self.form.watched:
            return []
        leave = build.part(build.part(build.name("run"), "trace"), "note_dropped")

        def write_note() -> None:
            pairs = zip(self.outputs, self.columns, strict=True)
            row = self.row or [self._name_frozen(expr, shape) for expr, shape in pairs]
            self.inner.emit(build.run(build.call(leave, build.constant(word), build.pack(*row))))

        facts = [self.codegen.analysis.facts(expr) for expr in self.outputs]
        if self.row or (not self.query.aggregated and all(one.steady and one.total for one in facts)):
            return self._collect_statements(write_note)
        return [build.run(build.call(leave, build.constant(word), build.constant(None)))]

    def _write_step(self, after: ast.expr | None, stops: bool) -> ast.expr:
        """What is given of a step that leaves a trace."""
        build, search = self.build, self.search
        nothing = build.constant(None)
        weight = build.name("new_total") if self.totals else build.name("weight")
        given = stops or self.query.where is None
        decided = given or self._stops_at_goals  # which a step that goes on is not
        return build.pack(
            build.name("row"),
            self.key,
            build.constant(given) if decided else build.name("goal"),
            build.constant(not stops),
            after or nothing,
            nothing if search.weight is None else weight,
            nothing if search.heuristic is None or stops else build.name("estimate"),
            self._write_last_part() if self.form.keyed else nothing,
        )

    def _write_last_part(self) -> ast.expr:
        """The elements of the step and the state before it."""
        names = [self.codegen.names[source.id] for source in self.query.sources]
        names += [self.codegen.states[self.query.id, name] for name in self.shapes]
        return self.build.pack(*map(self.build.name, names))

    def _write_value(self, expr: plan.Expr) -> ast.expr:
        """The value of a clause, a column, or a variable after the step."""
        return generate_expression(self.builder, expr, self.inner)

    # --- rows ------------------------------------------------------------------------------------------

    def _shows_as_it_is(self, expr: plan.Expr) -> bool:
        """Whether a column is an element that nobody compares: to freeze and to thaw it takes a third of the time."""
        compared = self.search.repeats != "allowed" or self.form.watched or self.form.noted
        return isinstance(expr, plan.Element) and not compared and expr not in self.connect.values()

    def _choose_column_shape(self, expr: plan.Expr) -> Shape:
        if expr.type.is_only(SCALAR) or self._shows_as_it_is(expr):
            return "scalar"
        if isinstance(expr, plan.State) and expr.query == self.query.id:
            return self.shapes[expr.name]
        if self.single is not None and self.single.key == self.codegen.analysis.facts(expr).key:
            return self.single.shape
        if is_flat_list_type(expr.type):
            return "flat"
        if isinstance(expr, plan.Element) and expr.source not in self.loops.items:  # it is not frozen beforehand
            return next((self.shapes[name] for name, other in self.connect.items() if other == expr), "any")
        return "any"

    def _name_frozen(self, expr: plan.Expr, shape: Shape) -> ast.expr:
        """The name of the frozen value of a column."""
        codegen, inner = self.codegen, self.inner
        build, facts = codegen.build_at(expr.span), codegen.analysis.facts(expr)
        if isinstance(expr, plan.State) and expr.query == self.query.id and not inner.has_state_changed(facts):
            return build.name(self.frozen_states[expr.name])
        value = self._write_value(expr)
        if shape == "scalar":
            return build.name(inner.assign_name(value, build, "value"))
        made = self._write_frozen(expr, shape, inner.name_or_constant(value, build, "value"))
        if facts.steady and facts.sources.isdisjoint({source.id for source in self.query.sources}):
            made = inner.compute_once(replace(facts, key=None), made, build, "frozen")
        return build.name(inner.assign_name(made, build, "frozen"))

    def _write_frozen(self, expr: plan.Expr, shape: Shape, value: ast.expr) -> ast.expr:
        build, freezer = self.codegen.build_at(expr.span), self.codegen.use(FREEZERS[shape])
        return build.call("tuple" if is_flat_list_type(expr.type) else freezer, value)

    def _pack_row(self) -> None:
        self.inner.assign_tuple("row", self.row, self.build)

    def _write_early_select(self, early: bool) -> None:
        """SELECT, before all else, and whether its row is closed."""
        build, inner, single = self.build, self.inner, None
        for expr, shape in zip(self.outputs, self.columns, strict=True):
            if self.single is not None and single is None and self.single.key == self.codegen.analysis.facts(expr).key:
                single = len(self.row)
                self.single.write_call(self)
                self.row.append(build.name(self.codegen.new_name("frozen")))
            else:
                self.row.append(self._name_frozen(expr, shape))
        alone = len(self.row) == 1
        self.key = self.row[0] if alone else build.name("row")
        if single is not None:
            self._write_closed_check(single)
            return
        if not alone:
            self._pack_row()
        if self.search.key:
            shown = zip(self.outputs, self.row, strict=True)
            self.key = self._write_packed_key([value for expr, value in shown if expr in self.search.key])
        if early:
            self._write_weight()
            self._write_total()
            self._write_improvement_test()
        else:
            leave = self._write_edge() if self.edges else self._write_prune()
            inner.emit(*build.write(CLOSED, IS_CLOSED=self._write_closed_test(), LEAVE=leave))

    def _write_closed_test(self) -> ast.expr:
        build = self.build
        if not self.totals:
            return build.express("key in closed", key=self.key)
        if self.search.heuristic is None:
            self.codegen.namespace["TAKEN"] = TAKEN
            return build.express("(known := closed.get(key)) is TAKEN", key=self.key)
        return build.express("(known := closed.get(key)) is not None and known <= total", key=self.key)

    def _write_closed_check(self, place: int) -> None:
        """Whether the row is closed whose value at this place has not been checked."""
        codegen, single, alone, key = self.codegen, self.single, len(self.row) == 1, self.row[place]
        assert single is not None
        build = codegen.build_at(single.node.place)  # where a value is refused
        assert isinstance(key, ast.Name)
        value = build.name(single.value)
        made = build.call("tuple", value)
        if single.shape == "nested":
            copy = codegen.embed(list.copy, "copy")  # fails for what is no list
            made = build.express("tuple(map(tuple, map(copy, value)))", copy=copy, value=value)
        row = [build.bind(key.id, made) if at == place else part for at, part in enumerate(self.row)]
        checked = build.write(
            CHECKED if single.shape in ("flat", "nested") else SETTLED,
            VALUE=value,
            KEY=key,
            FREEZE=[build.assign(key.id, made) if alone else build.assign("row", build.pack(*row))],
            PACK=[] if alone else [build.assign("row", build.pack(*self.row))],
            IS_CLOSED=self._write_closed_test(),
            LEAVE=self._write_edge() if self.edges else self._write_prune(),
            GIVER=build.constant(single.node.function.name),
            FREEZER=FREEZERS[single.shape],
            settled=convert_and_freeze,
            dumps=dumps,
        )
        self.inner.emit(*checked)

    def _write_edge(self) -> list[ast.stmt]:
        """What MEMORIZE is given of a step to a known row: its weight is evaluated, and nothing else."""
        build = self.build

        def write_edge() -> None:
            if len(self.row) == 1:
                self._pack_row()
            self._write_weight()

        nothing = build.constant(None)
        weight = nothing if self.search.weight is None else build.name("weight")
        last = self._write_last_part() if self.form.keyed else nothing
        step = [build.name("row"), self.key, nothing, build.constant(False), nothing, weight, nothing, last]
        return [
            *self._collect_statements(write_edge),
            build.run(build.yield_(build.pack(*step))),
            build.continue_loop(),
        ]

    # --- STOP WITH and WHERE ---------------------------------------------------------------------------

    @property
    def _can_stopping_step_be_goal(self) -> bool:
        """Whether a step that stops may be a goal; without a WHERE it is none."""
        return self.search.stop is not None and self.query.where is not None

    @property
    def _stops_at_goals(self) -> bool:
        """Whether STOP WITH and WHERE are the same condition, which is evaluated once."""
        stop, where = map(self.codegen.analysis.facts, (self.search.stop, self.query.where))
        return self._can_stopping_step_be_goal and stop.steady and stop.key == where.key is not None

    def _write_stop_and_goal(self) -> None:
        build, inner, stop, where = self.build, self.inner, self.search.stop, self.query.where
        leave = [build.continue_loop()]
        if self.form.complete:
            leave.insert(0, build.run(build.call("drop", self.key)))
        if self.form.watched and stop is not None:
            leave[:0] = self._write_trace_note("stopped")
        if stop is not None and where is None:
            build = self.codegen.build_at(stop.span)
            inner.emit(build.assign("stop", self._write_value(stop)))
            inner.emit(build.when(build.name("stop"), *leave))
            return
        if where is not None and self._stops_at_goals:
            inner.emit(self._assign_truth("goal", where))
            return
        for name, clause in (("stop", stop), ("goal", where)):
            if clause is not None:
                inner.emit(self._assign_truth(name, clause))
        if stop is not None:
            inner.emit(*build.write("if stop and not goal:\n    LEAVE", LEAVE=leave))

    def _assign_truth(self, name: str, clause: plan.Expr) -> ast.stmt:
        build = self.codegen.build_at(clause.span)
        value = self._write_value(clause)
        return build.assign(name, value if clause.type.is_only(Kind.BOOL) else build.truth(value))

    # --- COST, PROBABILITY, HEURISTIC ------------------------------------------------------------------

    def _write_weight(self) -> None:
        """The weight of the step; an impossible one is dropped."""
        weight, build, inner = self.search.weight, self.build, self.inner
        if weight is None:
            return
        probable = self.search.order == "probability"
        check = run_state.check_probability if probable else run_state.check_cost
        inner.emit(build.assign("weight", self._write_number(weight, check)))
        if probable:
            inner.emit(build.if_not(build.name("weight"), *self._write_trace_note("stopped"), build.continue_loop()))

    def _write_number(self, expr: plan.Expr, check: Callable[[Any], Any]) -> ast.expr:
        build = self.codegen.build_at(expr.span)
        value = self._write_value(expr)
        return value if run_state.is_proven(expr.type, check) else build.call(self.codegen.use(check), value)

    def _is_weight_early(self) -> bool:
        """Whether the weight is evaluated before STOP WITH and WHERE: STOP WITH guards a COST that may fail."""
        weight = self.search.weight
        assert weight is not None
        check = run_state.check_probability if self.search.order == "probability" else run_state.check_cost
        return self.steady and self.codegen.analysis.facts(weight).total and run_state.is_proven(weight.type, check)

    def _write_total(self) -> None:
        operator = "*" if self.search.order == "probability" else "+"
        self.inner.emit(*self.build.write(f"new_total = total {operator} weight"))

    def _write_improvement_test(self, known: bool = False) -> None:
        """A step that is no better than the best to its row, which may be `known`, is dropped."""
        text = "known" if known else "(known := best.get(key))"
        is_worse = self.build.express(f"{text} is not None and known <= new_total", key=self.key)
        self.inner.emit(*self.build.write(CLOSED, IS_CLOSED=is_worse, LEAVE=self._write_prune()))

    # --- CONNECT BY ------------------------------------------------------------------------------------

    def _write_connect(self) -> None:
        inner, codegen, number = self.inner, self.codegen, self.query.id
        for name, expr in self.search.connect:
            build = codegen.build_at(expr.span)
            if not inner.has_state_changed(codegen.analysis.facts(expr)):
                self.reads_state_before.add(name)
            inner.moved[number, name] = inner.assign_name(self._write_value(expr), build, f"next_{name}")

    def _build_next_state(self) -> ast.expr:
        """The frozen state to go on from; what is a column is frozen already."""
        build, analysis = self.build, self.codegen.analysis
        columns = {
            (analysis.facts(expr).key, shape): value
            for expr, shape, value in zip(self.outputs, self.columns, self.row, strict=True)
            if analysis.facts(expr).key is not None
        }
        values = []
        for name, shape in self.shapes.items():
            moved = self.inner.moved.get((self.query.id, name))
            is_column = moved is not None and name in self.reads_state_before
            column = columns.get((analysis.facts(self.connect[name]).key, shape)) if is_column else None
            if moved is None:
                values.append(build.name(self.frozen_states[name]))
            elif shape == "scalar":
                values.append(build.name(moved))
            else:
                made = build.call(self.codegen.use(FREEZERS[shape]), build.name(moved))
                values.append(made if column is None else column)
        if self.search.first is not None:  # it is no start
            values.append(build.constant(False))
        if self.key_is_named:  # they are read twice
            values = [self.inner.name_or_constant(value, build, "after") for value in values]
        return build.pack(*values)


def choose_state_shapes(search: plan.Search) -> dict[str, Shape]:
    """How the START WITH variables of a search are frozen."""
    types = dict(search.states)
    return {name: _choose_state_shape(types.get(name, expr.type), expr) for name, expr in search.start}


def name_frozen_variables(codegen: CodegenContext, query: plan.Query, shapes: Mapping[str, Shape]) -> dict[str, str]:
    """The names of the frozen variables; numbers and strings are their own frozen values."""
    return {
        name: codegen.states[query.id, name] if shape == "scalar" else codegen.new_name(f"{name}_frozen")
        for name, shape in shapes.items()
    }


def _choose_state_shape(known: Type, start: plan.Expr) -> Shape:
    """The shape of a START WITH variable: scalar where all its values are known to be, else that of the first one."""
    if choose_frozen_shape(known) == "scalar":
        return "scalar"
    shape = choose_frozen_shape(start.type)
    return "any" if shape == "scalar" else shape

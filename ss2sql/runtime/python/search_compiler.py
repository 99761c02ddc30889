"""Searches: the function that evaluates START WITH and what is read once, and gives the step function of the query.

A note is a list of what the clauses of one step have come to. `SELECT f(this, n) ... STOP WITH far(n)` becomes

    for note, this in turns:
        value, stop_value, _ = note
        try:
            value_1 = value if value is not UNSET else (value := f(this, n))
            ...
        finally:
            note[:] = [value, stop_value, True]

The generated function `rows(...)` gives the frozen states of START WITH; the step function, or where that pays the loop
of the search with it put in; the functions `keys(last)` for GROUP BY and ORDER BY and `key_of(state)` for BY; and for
MEMORIZE what search_compiler.py writes. The loops are plain Python, see runtime/search.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from copy import copy
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ss2sql.errors import Span
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import SCALAR
from ss2sql.language.plan_traversal import find_direct_assignments, walk
from ss2sql.language.values import FREEZERS, THAWERS, UNSET, FrozenShapes, Shape, State, freeze_any
from ss2sql.runtime.python.codegen_context import OWN_GROUP, ExpressionFacts, PythonScope
from ss2sql.runtime.python.edge_search import EdgeSearch, find_edge_search, make_edge_walk
from ss2sql.runtime.python.flat_query import generate_keys, list_key_expressions
from ss2sql.runtime.python.python_expressions import generate_expression
from ss2sql.runtime.python.step_clauses import StepForm, choose_state_shapes, name_frozen_variables
from ss2sql.runtime.python.step_function import StepFunction, StepLoops
from ss2sql.runtime.search import choose_search
from ss2sql.runtime.search.bidirectional import Regression, find_regression
from ss2sql.runtime.search.memorize import add_graph_level, has_path_rows
from ss2sql.runtime.search.step_contract import Expand, Places, Step
from ss2sql.vtables.frames import list_source_elements

if TYPE_CHECKING:
    from ss2sql.runtime.python.native_query import QueryCompiler


def can_be_noted(builder: QueryCompiler, query: plan.Query) -> bool:
    """Whether nobody can notice when, and how often, a clause of the search is evaluated, but by what it costs."""
    search = query.search
    if search is None or not search.plain:
        return False
    return all(fact.steady and OWN_GROUP not in fact.groups for fact in list_step_facts(builder, query, search))


def list_step_facts(builder: QueryCompiler, query: plan.Query, search: plan.Search) -> list[ExpressionFacts]:
    """The facts of the clauses of a step, and of the sources."""
    clauses = [*(output.expr for output in query.columns), *query.rows, *(expr for _, expr in search.connect)]
    clauses += [c for c in (search.stop, query.where, search.weight, search.heuristic) if c is not None]
    return [*map(builder.codegen.analysis.facts, clauses), *map(builder.get_source_facts, query.sources)]


def generate_noted_steps(
    builder: QueryCompiler,
    query: plan.Query,
    owner: PythonScope,
    loops: StepLoops,
    form: StepForm,
    columns: list[Shape],
) -> ast.expr:
    """What `NotedSearch` is made of, in its order; None where steps are taken in one go."""
    codegen, build = builder.codegen, builder.codegen.build_at(query.span)
    search = query.search
    assert search is not None
    loops = copy(loops)
    loops.lookups, loops.world_conditions = {}, {}
    if not search.plain and has_path_rows(search):  # of a step its row and the state after it are wanted
        search = replace(search, made=None, key=(), by="row", siblings=())
        query = replace(query, where=None, search=replace(search, stop=None, weight=None, heuristic=None))
    elif not can_be_noted(builder, query):
        return build.constant(None)
    step = NotedStepFunction(builder, query, loops, replace(form, noted=True), columns)
    function = step.write_function()
    reverse = find_regression(query) if query.search is not None and search.plain else "it has options"
    backwards = [build.constant(None)] * 2
    if isinstance(reverse, Regression):
        writer = BackwardSteps(builder, query, owner)
        backwards = [build.name(writer.write_goal_state(reverse)), build.name(writer.write_state_before(reverse))]
    made = (step.describe_places(), len(query.sources))
    return build.pack(build.name(function), *backwards, *(build.name(codegen.embed(part)) for part in made))


class NotedStepFunction(StepFunction):
    """Writes the step function with notes."""

    def __init__(
        self, builder: QueryCompiler, query: plan.Query, loops: StepLoops, form: StepForm, columns: list[Shape]
    ) -> None:
        super().__init__(builder, query, loops, form, None)
        self.columns = columns
        self.note = self.codegen.new_name("note")
        target = self.loop.target
        pair = [ast.Name(self.note, ast.Store(), **self.build.at), target]
        self.loop.target = ast.Tuple(pair, ast.Store(), **self.build.at)
        self.at_once = find_direct_assignments(query)
        self.codegen.namespace["UNSET"] = UNSET
        self.slots: dict[object, str] = {}  # by the key of an expression, else by identity
        clauses = [*self.outputs, *(expr for _, expr in self.search.connect), *self.clauses]
        for expr in clauses:
            self.slots.setdefault(self._choose_slot_key(expr), self.codegen.new_name("noted"))
        self.plain = {self._choose_slot_key(expr): expr for expr in self.outputs if _is_known_before(expr)}
        for expr in clauses:  # calls find their slots themselves
            key = self.codegen.analysis.facts(expr).key
            if key is not None and self._choose_slot_key(expr) == key:
                self.body.slots[key] = self.slots[key]

    def _choose_slot_key(self, expr: plan.Expr) -> object:
        """Equal expressions share a slot, unless CONNECT BY has changed what one of them reads."""
        sequential = any(expr is other and self.at_once.get(name) is not expr for name, other in self.search.connect)
        key = self.codegen.analysis.facts(expr).key
        return id(expr) if key is None or sequential else key

    def describe_places(self) -> Places:
        """Where in a note everything is."""
        at = {key: place for place, key in enumerate(self.slots)}
        rows = tuple(at[self._choose_slot_key(expr)] for expr in self.outputs)
        after = (self.connect.get(name) for name in self.shapes)
        states = tuple(None if expr is None else at[self._choose_slot_key(expr)] for expr in after)
        return Places(rows, states, len(at))

    def _write_value(self, expr: plan.Expr) -> ast.expr:
        inner, build, slot = self.inner, self.codegen.build_at(expr.span), self.slots[self._choose_slot_key(expr)]
        if self._choose_slot_key(expr) in self.plain:
            return super()._write_value(expr)
        with inner.write_skippable():
            value = super()._write_value(expr)
        facts = self.codegen.analysis.facts(expr)
        if isinstance(value, ast.Name) and value.id == slot:
            return value
        inner.forget_names(value)
        if facts.key is not None and not inner.has_state_changed(facts):
            inner.known[-1][facts.key] = slot
        known = build.compare(build.name(slot), ast.IsNot(), build.name("UNSET"))
        made = build.if_else(known, build.name(slot), build.bind(slot, value))
        return build.name(inner.assign_name(made, build, "value"))

    def write_clauses(self) -> None:
        super().write_clauses()
        self.inner.moved = {}
        build, names = self.build, list(self.slots.values())
        values = [
            super(NotedStepFunction, self)._write_value(self.plain[key]) if key in self.plain else build.name(name)
            for key, name in self.slots.items()
        ]
        note = ast.Subscript(build.name(self.note), ast.Slice(None, None, None, **build.at), ast.Store(), **build.at)
        kept = ast.Assign([note], build.array(*values, build.constant(True)), **build.at)
        body = self.loop.body
        taken = build.unpack([*names, "_"], build.name(self.note))
        self.loop.body = [taken, ast.Try(body, [], [], [kept], **build.at)]

    def _choose_elements(self, items: ast.expr) -> ast.expr:
        """The elements with their notes, which are known or begun."""
        build, known = self.build, self.codegen.new_name("known")
        choose = build.name("choose")
        is_new = build.compare(
            build.bind(known, build.call(build.part(choose, "get_known_pairs"))), ast.Is(), build.constant(None)
        )
        begun = build.call(build.part(choose, "begin_state"), build.call("list", items))
        return build.if_else(is_new, begun, build.name(known))


def _is_known_before(expr: plan.Expr) -> bool:
    return isinstance(expr, (plan.Element, plan.State, plan.Constant))


class BackwardSteps:
    """Writes the functions that give the state at the goal, and the state before a step."""

    def __init__(self, builder: QueryCompiler, query: plan.Query, outer: PythonScope) -> None:
        assert query.search is not None
        self.builder, self.codegen, self.query, self.outer = builder, builder.codegen, query, outer
        self.build = self.codegen.build_at(query.span)
        self.states = [self.codegen.states[query.id, name] for name, _ in query.search.start]

    def write_goal_state(self, reverse: Regression) -> str:
        """The state at the goal; what no step changes has its value from the start."""
        self.codegen.analysis.add_roots(tuple(value for value in reverse.goal if value is not None))
        body, build = PythonScope(self.codegen, self.codegen.new_name("goal"), ["state"], self.outer), self.build
        start = [build.item(build.name("state"), position) for position in range(len(self.states))]
        pairs = zip(start, reverse.goal, strict=True)
        values = (old if value is None else generate_expression(self.builder, value, body) for old, value in pairs)
        body.emit(build.return_(build.pack(*values)))
        body.define_function()
        return body.name

    def write_state_before(self, reverse: Regression) -> str:
        """The state before a step, from its elements and the state after it; None where there is none."""
        exprs = [expr for expr in reverse.before if expr is not None]
        self.codegen.analysis.add_roots(tuple(exprs))
        body, build = self._open_function(exprs), self.build
        values = []
        for expr, after in zip(reverse.before, self.states, strict=True):
            if isinstance(expr, plan.Call) and expr.function.inverse_of:
                values.append(self._write_inverse(expr, body))
            else:
                values.append(build.name(after) if expr is None else generate_expression(self.builder, expr, body))
        body.emit(build.return_(build.pack(*values)))
        body.define_function()
        return body.name

    def _open_function(self, clauses: Sequence[plan.Expr]) -> PythonScope:
        body = PythonScope(self.codegen, self.codegen.new_name("before"), ["last"], self.outer)
        body.levels.update((source.id, 0) for source in self.query.sources)
        assert self.query.search is not None
        body.states.update((self.query.id, name) for name, _ in self.query.search.start)
        body.count_uses(clauses)
        names = [*(self.codegen.names[source.id] for source in self.query.sources), *self.states]
        body.emit(self.build.unpack(names, self.build.name("last")))
        body.locals.extend(names)
        return body

    def _write_inverse(self, expr: plan.Call, body: PythonScope) -> ast.expr:
        """The value of an inverse; ends the function where it is None."""
        codegen, build = self.codegen, self.codegen.build_at(expr.place)
        arguments = build.pack(*(generate_expression(self.builder, argument, body) for argument in expr.arguments))
        codegen.page.note_call(expr.place, expr.function.name)
        value = codegen.new_name("before")
        result = build.call(codegen.name_function(expr.function, build), arguments)
        body.emit(build.assign(value, result))
        nothing = build.compare(build.name(value), ast.Is(), build.constant(None))
        body.emit(build.when(nothing, build.return_(build.constant(None))))
        return build.name(value)


# --- searches: the function that evaluates START WITH and what is read once, and gives the step function of the query
@dataclass(frozen=True, slots=True)
class SearchForm:
    """What is known of a search when it is compiled."""

    shapes: FrozenShapes
    inlined: bool  # the step function stands in its loop
    chooses: bool  # MEMORIZE may choose among the elements of a state there
    remembered: bool  # steps are remembered, see step_contract.py
    watched: bool  # the trace of the run hears of the steps


def compile_search(
    builder: QueryCompiler, query: plan.Query, body: PythonScope, aggregates: Sequence[plan.Aggregate]
) -> tuple[str, SearchForm]:
    """Writes the function that finds the results of a search into `body`; gives its name and form."""
    search, codegen, build = query.search, builder.codegen, builder.codegen.build_at(query.span)
    assert search is not None
    keys, memorizes = list_key_expressions(query, aggregates), search.repeats == "memorize"
    shapes, start = choose_state_shapes(search), codegen.new_name("start")
    _generate_starts(builder, query, body, shapes, start)
    visits = search.by == "state" and search.repeats != "allowed"
    key_of = _generate_key_function(builder, query, body, shapes) if visits else None
    loops = StepLoops(builder, query, body)
    loops.read_constant_sources()
    watched = codegen.watched is query
    led = codegen.find is not None and query is codegen.level_searched_query  # by others, who ask for its steps
    remembered = _can_revisit_states(builder, query) and not (watched or led)
    complete = remembered and search.repeats == "no cycle"
    form = StepForm(shapes, start, bool(keys) or (memorizes and not search.plain), complete, watched, key_of)
    first = None
    if search.first is not None:
        other = copy(loops)
        other.lookups, other.world_conditions = {}, {}
        first = StepFunction(builder, query, other, form, search.first).write_function()
    step = StepFunction(builder, query, loops, form, search.made)
    inlined = None
    if not (remembered or watched or led) and (search.plain or not memorizes):
        inlined = step.write_search(add_graph_level if memorizes else choose_search(search))
    edges = find_edge_search(query) if inlined and codegen.analysis.roots[0] is query and not keys else None
    function = inlined or step.write_function()
    if edges is not None:
        function = _write_edge_walk(builder, edges, body, function, query.span)
    if first is not None:
        both = codegen.new_name("expand")
        body.emit(
            build.assign(both, build.call(codegen.use(join_first_steps), build.name(first), build.name(function)))
        )
        function = both
    find_keys = codegen.new_name("keys") if keys else None
    if find_keys is not None:
        _generate_last_step_keys(builder, query, body, find_keys, keys)
    noted = build.constant(None)
    if memorizes or led:
        noted = generate_noted_steps(builder, query, body, loops, form, step.columns)
    names = [function, find_keys, key_of]
    made = [build.constant(None) if name is None else build.name(name) for name in names]
    body.emit(build.return_(build.pack(build.name("starts"), *made, noted)))
    body.define_function()
    known = FrozenShapes(tuple(shapes.values()), tuple(step.columns))
    chooses = step.has_list_elements and inlined is not None
    return body.name, SearchForm(known, inlined is not None, chooses, remembered, watched)


def _write_edge_walk(builder: QueryCompiler, edges: EdgeSearch, body: PythonScope, others: str, span: Span) -> str:
    """The search over arrays in place of a loop; gives its name."""
    codegen = builder.codegen
    build, name = codegen.build_at(span), codegen.new_name("search")
    goal = build.constant(None)
    if edges.goal is not None:
        goal = build.express("lambda: goal", goal=generate_expression(builder, edges.goal, body))
    search = build.name(codegen.embed(edges, "edges"))
    body.emit(
        build.assign(name, build.call(codegen.use(make_edge_walk), build.name("run"), search, goal, build.name(others)))
    )
    return name


def join_first_steps(first: Expand, others: Expand) -> Expand:
    """The step function of a search whose first steps have a condition of their own."""

    def expand_state(state: State, *more: Any) -> Iterator[Step]:
        return (first if state[-1] else others)(state, *more)

    return expand_state


def _generate_starts(
    builder: QueryCompiler, query: plan.Query, body: PythonScope, shapes: dict[str, Shape], start: str
) -> None:
    """START WITH: puts the frozen states in which the search starts into the list `starts`."""
    search, codegen, build = query.search, builder.codegen, builder.codegen.build_at(query.span)
    assert search is not None
    each = {source.id: source for source in search.each}
    body.emit(build.assign("starts", build.array()))
    for name, expr in search.start:
        local = codegen.states[query.id, name] = codegen.new_name(name)
        place = codegen.build_at(expr.span)
        if isinstance(expr, plan.Element) and expr.source in each:
            items = place.call(
                codegen.use(list_source_elements), generate_expression(builder, each[expr.source].value, body)
            )
            body.open_loop([local], items, place)
        else:
            body.emit(place.assign(local, generate_expression(builder, expr, body)))
        body.states.add((query.id, name))
        if each:  # another value in each turn, which nothing may keep
            body.moved[query.id, name] = local
    values = []
    for name, shape in shapes.items():
        value = build.name(codegen.states[query.id, name])
        values.append(value if shape == "scalar" else build.call(codegen.use(FREEZERS[shape]), value))
    if search.first is not None:  # it is a start
        values.append(build.constant(True))
    body.emit(build.assign(start, build.pack(*values)))
    body.locals.append(start)
    body.emit(build.run(build.call(build.part(build.name("starts"), "append"), build.name(start))))
    body.moved.clear()
    for _ in each:
        body.blocks.pop()
        body.known.pop()


def _generate_key_function(
    builder: QueryCompiler, query: plan.Query, owner: PythonScope, shapes: dict[str, Shape]
) -> str:
    """A function that gives the key of a frozen state, where BY names the state."""
    search, codegen, build = query.search, builder.codegen, builder.codegen.build_at(query.span)
    assert search is not None
    body = PythonScope(codegen, codegen.new_name("key_of"), ["state"], owner)
    body.states.update((query.id, name) for name in shapes)
    body.count_uses(search.key)
    names = name_frozen_variables(codegen, query, shapes)
    body.emit(build.unpack([*names.values(), *["_"] * (search.first is not None)], build.name("state")))
    computed = [key for key in search.key if not (isinstance(key, plan.State) and key.query == query.id)]
    for name, shape in shapes.items():
        if computed and shape != "scalar":
            value = build.call(codegen.use(THAWERS[shape]), build.name(names[name]))
            body.emit(build.assign(codegen.states[query.id, name], value))
    keys = []
    for expr in search.key:
        if isinstance(expr, plan.State) and expr.query == query.id:
            keys.append(build.name(names[expr.name]))
        else:
            value = generate_expression(builder, expr, body)
            keys.append(value if expr.type.is_only(SCALAR) else build.call(codegen.use(freeze_any), value))
    body.emit(build.return_(keys[0] if len(keys) == 1 else build.pack(*keys)))
    body.define_function()
    return body.name


def _can_revisit_states(builder: QueryCompiler, query: plan.Query) -> bool:
    """Whether the steps of a state are worth keeping: states come again, there are calls, and nobody can notice."""
    search, analysis = query.search, builder.codegen.analysis
    assert search is not None
    if not search.plain or search.repeats not in ("allowed", "no cycle"):
        return False
    if analysis.roots[0] is not query or analysis.open_world:
        return False
    called = any(
        isinstance(node, plan.Subquery) or (isinstance(node, plan.Call) and not node.function.builtin)
        for node in walk(query)
        if node is not query
    )
    return called and all(fact.steady for fact in list_step_facts(builder, query, search))


def _generate_last_step_keys(
    builder: QueryCompiler, query: plan.Query, outer: PythonScope, name: str, keys: Sequence[plan.Expr]
) -> None:
    """A function of the elements and the state of a last step: what GROUP BY and ORDER BY see of it."""
    assert query.search is not None
    codegen, build = builder.codegen, builder.codegen.build_at(query.span)
    body = PythonScope(codegen, name, ["last"], outer)
    body.levels.update((source.id, 0) for source in query.sources)
    body.states.update((query.id, state) for state, _ in query.search.start)
    body.count_uses(keys)
    names = [codegen.names[source.id] for source in query.sources]
    names += [codegen.states[query.id, state] for state, _ in query.search.start]
    body.emit(build.unpack(names, build.name("last")))
    body.emit(build.return_(build.pack(*generate_keys(builder, keys, body))))
    body.define_function()

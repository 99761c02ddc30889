"""Searches: the function that evaluates START WITH and what is read once, and gives the step function of the query.

The generated function `rows(...)` gives the frozen states of START WITH; the step function, or where that pays the loop
of the search with it put in; the functions `keys(last)` for GROUP BY and ORDER BY and `key_of(state)` for BY; and for
MEMORIZE what noted_steps.py writes. The loops are plain Python, see runtime/search.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from typing import TYPE_CHECKING, Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import frozen_values, plan
from ss2sql.language.frozen_values import FrozenShapes, Shape, State
from ss2sql.language.kinds import SCALAR
from ss2sql.language.plan_traversal import walk
from ss2sql.runtime.python.codegen_context import PythonScope
from ss2sql.runtime.python.flat_query import list_key_expressions
from ss2sql.runtime.python.noted_steps import list_step_facts, write_noted_steps
from ss2sql.runtime.python.python_expressions import write_expression
from ss2sql.runtime.python.step_clauses import StepForm, choose_state_shapes, name_frozen_variables
from ss2sql.runtime.python.step_function import StepFunction, StepLoops
from ss2sql.runtime.run.elements import list_elements
from ss2sql.runtime.search import choose_search
from ss2sql.runtime.search.memorize import add_graph_level
from ss2sql.runtime.search.step_contract import Expand, Step

if TYPE_CHECKING:
    from ss2sql.runtime.python.query_compiler import QueryCompiler

INLINE_STEPS = True  # for tests of the step function by itself


@dataclass(frozen=True, slots=True)
class SearchForm:
    """What is known of a search when it is compiled."""

    shapes: FrozenShapes
    inlined: bool  # the step function stands in its loop
    chooses: bool  # MEMORIZE may choose among the elements of a state there
    remembered: bool  # steps are remembered, see memoized_steps.py
    counts_levels: bool  # steps are counted by level
    watched: bool  # the trace of the run hears of the steps


def compile_search(
    builder: QueryCompiler, query: plan.Query, body: PythonScope, aggregates: Sequence[plan.Aggregate]
) -> tuple[str, SearchForm]:
    """Writes the function that finds the results of a search into `body`; gives its name and form."""
    search, codegen, build = query.search, builder.codegen, builder.codegen.build_at(query.span)
    assert search is not None
    keys, memorizes = list_key_expressions(query, aggregates), search.repeats == "memorize"
    shapes, start = choose_state_shapes(search), codegen.new_name("start")
    _write_starts(builder, query, body, shapes, start)
    visits = search.by == "state" and search.repeats != "allowed"
    key_of = _write_key_function(builder, query, body, shapes) if visits else None
    loops = StepLoops(builder, query, body)
    loops.read_constant_sources()
    leveled = codegen.by_level is query
    watched = codegen.watched is query
    led = codegen.find is not None and query is codegen.level_searched_query  # by others, who ask for its steps
    remembered = _can_revisit_states(builder, query) and not (leveled or watched or led)
    complete = remembered and search.repeats == "no cycle"
    form = StepForm(shapes, start, bool(keys) or (memorizes and not search.plain), complete, watched, key_of)
    first = None
    if search.first is not None:
        other = copy(loops)
        other.lookups, other.world_conditions = {}, {}
        first = StepFunction(builder, query, other, form, search.first).write_function()
    step = StepFunction(builder, query, loops, form, search.made)
    inlined = None
    if INLINE_STEPS and not (remembered or leveled or watched or led) and (search.plain or not memorizes):
        inlined = step.write_search(add_graph_level if memorizes else choose_search(search))
    function = inlined or step.write_function()
    if inlined is None or memorizes:
        body.emit(
            build.add_to(codegen.name_counter("expanded", body), -1)
        )  # a search is no step, so its start does not count
    if first is not None:
        both = codegen.new_name("expand")
        body.emit(
            build.assign(both, build.call(codegen.use(join_first_steps), build.name(first), build.name(function)))
        )
        function = both
    find_keys = codegen.new_name("keys") if keys else None
    if find_keys is not None:
        _write_last_step_keys(builder, query, body, find_keys, keys)
    noted = build.constant(None)
    if memorizes or led:
        noted = write_noted_steps(builder, query, body, loops, form, step.columns)
    names = [function, find_keys, key_of]
    made = [build.constant(None) if name is None else build.name(name) for name in names]
    body.emit(build.return_(build.pack(build.name("starts"), *made, noted)))
    body.define_function()
    known = FrozenShapes(tuple(shapes.values()), tuple(step.columns))
    chooses = step.has_list_elements and inlined is not None
    return body.name, SearchForm(known, inlined is not None, chooses, remembered, leveled, watched)


def join_first_steps(first: Expand, others: Expand) -> Expand:
    """The step function of a search whose first steps have a condition of their own."""

    def expand_state(state: State, *more: Any) -> Iterator[Step]:
        return (first if state[-1] else others)(state, *more)

    return expand_state


def _write_starts(
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
            items = place.call(codegen.use(list_elements), write_expression(builder, each[expr.source].value, body))
            body.open_loop([local], items, place)
        else:
            body.emit(place.assign(local, write_expression(builder, expr, body)))
        body.states.add((query.id, name))
        if each:  # another value in each turn, which nothing may keep
            body.moved[query.id, name] = local
    values = []
    for name, shape in shapes.items():
        value = build.name(codegen.states[query.id, name])
        values.append(value if shape == "scalar" else build.call(codegen.use(frozen_values.FREEZERS[shape]), value))
    if search.first is not None:  # it is a start
        values.append(build.constant(True))
    body.emit(build.assign(start, build.pack(*values)))
    body.locals.append(start)
    body.emit(build.run(build.call(build.part(build.name("starts"), "append"), build.name(start))))
    body.moved.clear()
    for _ in each:
        body.blocks.pop()
        body.known.pop()


def _write_key_function(builder: QueryCompiler, query: plan.Query, owner: PythonScope, shapes: dict[str, Shape]) -> str:
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
            value = build.call(codegen.use(frozen_values.THAWERS[shape]), build.name(names[name]))
            body.emit(build.assign(codegen.states[query.id, name], value))
    keys = []
    for expr in search.key:
        if isinstance(expr, plan.State) and expr.query == query.id:
            keys.append(build.name(names[expr.name]))
        else:
            value = write_expression(builder, expr, body)
            keys.append(
                value if expr.type.is_only(SCALAR) else build.call(codegen.use(frozen_values.freeze_any), value)
            )
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


def _write_last_step_keys(
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
    body.emit(build.return_(build.pack(*(write_expression(builder, key, body) for key in keys))))
    body.define_function()

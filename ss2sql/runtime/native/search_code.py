"""Searches: the function that evaluates START WITH and what is read once, and gives the step function of the query.

The generated function `rows(...)` gives the frozen states of START WITH; the step function, or where that pays the loop
of the search with it put in; the functions `keys(last)` for GROUP BY and ORDER BY and `key_of(state)` for BY; and for
MEMORIZE what noted_steps.py writes. The loops are plain Python, see runtime/search.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from copy import copy
from typing import TYPE_CHECKING, Any

from ss2sql import plan
from ss2sql.kinds import SCALAR
from ss2sql.records import dataclass
from ss2sql.runtime import frozen
from ss2sql.runtime.frozen import Shape, Shapes, State
from ss2sql.runtime.memorize.growing import grow
from ss2sql.runtime.native.expressions import expression
from ss2sql.runtime.native.flat import key_expressions
from ss2sql.runtime.native.noted_steps import noted_steps
from ss2sql.runtime.native.step_clauses import StepForm, names_of_frozen, shapes_of
from ss2sql.runtime.native.step_function import StepFunction, StepLoops
from ss2sql.runtime.native.unit import Body
from ss2sql.runtime.search import search_of
from ss2sql.runtime.search.contract import Expand, Step
from ss2sql.runtime.sources import elements
from ss2sql.walk import walk

if TYPE_CHECKING:
    from ss2sql.runtime.native.builder import Builder

INLINES = True  # for tests of the step function by itself


@dataclass(frozen=True, slots=True)
class SearchForm:
    """What is known of a search when it is compiled.

    `inlined`: the step function stands in its loop; `chooses`: there MEMORIZE may choose among the elements of a state;
    `remembered`: steps are, see remembered_steps.py; `leveled`: they are counted level by level; `watched`: the trace
    of the run hears of them.
    """

    shapes: Shapes
    inlined: bool
    chooses: bool
    remembered: bool
    leveled: bool
    watched: bool


def finder(
    builder: Builder, query: plan.Query, body: Body, aggregates: Sequence[plan.Aggregate]
) -> tuple[str, SearchForm]:
    """Writes the function that finds the results of a search into `body`; gives its name and form."""
    search, unit, pen = query.search, builder.unit, builder.unit.pen_at(query.span)
    assert search is not None
    keys, memorizes = key_expressions(query, aggregates), search.repeats == "memorize"
    shapes, start = shapes_of(search), unit.local("start")
    _find_starts(builder, query, body, shapes, start)
    visits = search.by == "state" and search.repeats != "allowed"
    key_of = _define_key_of(builder, query, body, shapes) if visits else None
    loops = StepLoops(builder, query, body)
    loops.read_once()
    leveled = unit.by_level is query
    watched = unit.watched is query
    led = unit.find is not None and query is unit.searched  # by others, who ask for its steps
    remembered = _comes_again(builder, query) and not (leveled or watched or led)
    complete = remembered and search.repeats == "no cycle"
    form = StepForm(shapes, start, bool(keys) or (memorizes and not search.plain), complete, watched, key_of)
    first = None
    if search.first is not None:
        other = copy(loops)
        other.lookups, other.demands = {}, {}
        first = StepFunction(builder, query, other, form, search.first).write_function()
    step = StepFunction(builder, query, loops, form, search.made)
    inlined = None
    if INLINES and not (remembered or leveled or watched or led) and (search.plain or not memorizes):
        inlined = step.write_search(grow if memorizes else search_of(search))
    function = inlined or step.write_function()
    if inlined is None or memorizes:
        body.add(pen.increase(unit.counter("expanded", body), -1))  # a search is no step, so its start does not count
    if first is not None:
        both = unit.local("expand")
        body.add(pen.assign(both, pen.call(unit.helper(begun), pen.name(first), pen.name(function))))
        function = both
    find_keys = unit.local("keys") if keys else None
    if find_keys is not None:
        _define_keys(builder, query, body, find_keys, keys)
    noted = pen.constant(None)
    if memorizes or led:
        noted = noted_steps(builder, query, body, loops, form, step.columns)
    names = [function, find_keys, key_of]
    made = [pen.constant(None) if name is None else pen.name(name) for name in names]
    body.add(pen.back(pen.pack(pen.name("starts"), *made, noted)))
    body.define()
    known = Shapes(tuple(shapes.values()), tuple(step.columns))
    chooses = step.has_list and inlined is not None
    return body.name, SearchForm(known, inlined is not None, chooses, remembered, leveled, watched)


def begun(first: Expand, others: Expand) -> Expand:
    """The step function of a search whose first steps have a condition of their own."""

    def expand(state: State, *more: Any) -> Iterator[Step]:
        return (first if state[-1] else others)(state, *more)

    return expand


def _find_starts(builder: Builder, query: plan.Query, body: Body, shapes: dict[str, Shape], start: str) -> None:
    """START WITH: puts the frozen states in which the search starts into the list `starts`."""
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
    values = []
    for name, shape in shapes.items():
        value = pen.name(unit.states[query.id, name])
        values.append(value if shape == "scalar" else pen.call(unit.helper(frozen.FREEZERS[shape]), value))
    if search.first is not None:  # it is a start
        values.append(pen.constant(True))
    body.add(pen.assign(start, pen.pack(*values)))
    body.locals.append(start)
    body.add(pen.run(pen.call(pen.part(pen.name("starts"), "append"), pen.name(start))))
    body.moved.clear()
    for _ in each:
        body.blocks.pop()
        body.known.pop()


def _define_key_of(builder: Builder, query: plan.Query, owner: Body, shapes: dict[str, Shape]) -> str:
    """A function that gives the key of a frozen state, where BY names the state."""
    search, unit, pen = query.search, builder.unit, builder.unit.pen_at(query.span)
    assert search is not None
    body = Body(unit, unit.local("key_of"), ["state"], owner)
    body.states.update((query.id, name) for name in shapes)
    body.count(search.key)
    names = names_of_frozen(unit, query, shapes)
    body.add(pen.unpack([*names.values(), *["_"] * (search.first is not None)], pen.name("state")))
    computed = [key for key in search.key if not (isinstance(key, plan.State) and key.query == query.id)]
    for name, shape in shapes.items():
        if computed and shape != "scalar":
            value = pen.call(unit.helper(frozen.thaw), pen.name(names[name]))
            body.add(pen.assign(unit.states[query.id, name], value))
    keys = []
    for expr in search.key:
        if isinstance(expr, plan.State) and expr.query == query.id:
            keys.append(pen.name(names[expr.name]))
        else:
            value = expression(builder, expr, body)
            keys.append(value if expr.type.only(SCALAR) else pen.call(unit.helper(frozen.freeze_any), value))
    body.add(pen.back(keys[0] if len(keys) == 1 else pen.pack(*keys)))
    body.define()
    return body.name


def _comes_again(builder: Builder, query: plan.Query) -> bool:
    """Whether the steps of a state are worth keeping: states come again, there are calls, and nobody can notice."""
    search, analysis = query.search, builder.unit.analysis
    assert search is not None
    if not search.plain or search.repeats not in ("allowed", "no cycle"):
        return False
    if analysis.roots[0] is not query or analysis.open_world:
        return False
    clauses = [*(output.expr for output in query.columns), *query.rows, *(expr for _, expr in search.connect)]
    clauses += [c for c in (search.stop, query.where, search.weight, search.heuristic) if c is not None]
    facts = [analysis.of(expr) for expr in clauses] + [builder.source_facts(source) for source in query.sources]
    called = any(
        isinstance(node, plan.Subquery) or (isinstance(node, plan.Call) and not node.function.builtin)
        for node in walk(query)
        if node is not query
    )
    return called and all(one.steady for one in facts)


def _define_keys(builder: Builder, query: plan.Query, outer: Body, name: str, keys: Sequence[plan.Expr]) -> None:
    """A function of the elements and the state of a last step: what GROUP BY and ORDER BY see of it."""
    assert query.search is not None
    unit, pen = builder.unit, builder.unit.pen_at(query.span)
    body = Body(unit, name, ["last"], outer)
    body.levels.update((source.id, 0) for source in query.sources)
    body.states.update((query.id, state) for state, _ in query.search.start)
    body.count(keys)
    names = [unit.names[source.id] for source in query.sources]
    names += [unit.states[query.id, state] for state, _ in query.search.start]
    body.add(pen.unpack(names, pen.name("last")))
    body.add(pen.back(pen.pack(*(expression(builder, key, body) for key in keys))))
    body.define()

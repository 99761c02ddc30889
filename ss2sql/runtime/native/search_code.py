"""Searches: the function that evaluates START WITH and what is read once, and gives the step function of the query.

The generated function `rows(...)` gives the frozen state of START WITH; the step function, or where that pays the loop
of the search with it put in; the function `keys(last)` for GROUP BY and ORDER BY; and for MEMORIZE the pieces of
pieces.py. The loops are plain Python, see runtime/search.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ss2sql import plan
from ss2sql.runtime import frozen
from ss2sql.runtime.frozen import Shapes
from ss2sql.runtime.memorize.growing import grow
from ss2sql.runtime.native.expressions import expression
from ss2sql.runtime.native.flat import key_expressions
from ss2sql.runtime.native.pieces import pieces
from ss2sql.runtime.native.step_function import StepFunction, StepLoops
from ss2sql.runtime.native.stepwise_code import read_starts, stepwise
from ss2sql.runtime.native.unit import Body
from ss2sql.runtime.search import search_of
from ss2sql.walk import walk

if TYPE_CHECKING:
    from ss2sql.runtime.native.builder import Builder

INLINES = True  # for tests of the step function by itself


@dataclass(frozen=True, slots=True)
class SearchForm:
    """What is known of a search when it is compiled.

    `inlined`: the step function stands in its loop; `remembered`: steps are, see remembered_steps.py; `leveled`: they
    are counted level by level.
    """

    shapes: Shapes
    inlined: bool
    remembered: bool
    leveled: bool


def finder(
    builder: Builder, query: plan.Query, body: Body, aggregates: Sequence[plan.Aggregate]
) -> tuple[str, SearchForm | None]:
    """Writes the function that finds the results of a search into `body`; gives its name and form."""
    search, unit, pen = query.search, builder.unit, builder.unit.pen_at(query.span)
    assert search is not None
    if not search.plain or unit.watched is query:
        return _stepwise(builder, query, body, aggregates), None
    for name, expr in search.start:
        local = unit.states[query.id, name] = unit.local(name)
        body.add(unit.pen_at(expr.span).assign(local, expression(builder, expr, body)))
        body.states.add((query.id, name))
    keys = key_expressions(query, aggregates)
    find_keys = unit.local("keys") if keys else None
    loops = StepLoops(builder, query, body)
    loops.read_once()
    leveled = unit.by_level is query
    remembered = _comes_again(builder, query) and not leveled
    start, complete = unit.local("start"), remembered and search.repeats == "no cycle"
    step = StepFunction(builder, query, loops, start, bool(keys), complete)
    values = []
    for name, shape in step.shapes.items():
        value = pen.name(unit.states[query.id, name])
        values.append(value if shape == "scalar" else pen.call(unit.helper(frozen.FREEZERS[shape]), value))
    body.add(pen.assign(start, pen.pack(*values)))
    body.locals.append(start)
    inlines = INLINES and not remembered and not leveled
    loop: Callable[..., Any] = grow if search.repeats == "memorize" else search_of(search)
    inlined = step.write_search(loop) if inlines else None
    function = inlined or step.write_function()
    if inlined is None or search.repeats == "memorize":
        body.add(pen.increase(unit.counter("expanded", body), -1))  # a search is no step, so its start does not count
    if find_keys is not None:
        _define_keys(builder, query, body, find_keys, keys)
    apart = pen.constant(None)
    if search.repeats == "memorize":
        loops.counts_steps = True
        apart = pieces(
            builder, query, body, loops, step.has_list and not loops.lookups and inlined is not None, step.columns
        )
    made = [pen.name(start), pen.name(function), pen.constant(None) if find_keys is None else pen.name(find_keys)]
    body.add(pen.back(pen.pack(*made, apart)))
    body.define()
    shapes = Shapes(tuple(step.shapes.values()), tuple(step.columns))
    return body.name, SearchForm(shapes, inlined is not None, remembered, leveled)


def _stepwise(builder: Builder, query: plan.Query, body: Body, aggregates: Sequence[plan.Aggregate]) -> str:
    """The function that finds the results of a search that goes step by step, see stepwise_code.py."""
    keys = key_expressions(query, aggregates)
    find_keys = builder.unit.local("keys") if keys else None
    read_starts(builder, query, body)
    written = stepwise(builder, query, body, find_keys)
    if find_keys is not None:
        _define_keys(builder, query, body, find_keys, keys)
    body.add(*written)
    body.define()
    return body.name


def _comes_again(builder: Builder, query: plan.Query) -> bool:
    """Whether the steps of a state are worth keeping: states come again, there are calls, and nobody can notice."""
    search, analysis = query.search, builder.unit.analysis
    assert search is not None
    if search.repeats not in ("allowed", "no cycle") or analysis.roots[0] is not query or analysis.open_world:
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

"""Searches: the function that finds the paths, with the loop of the search written out for this very query.

The generated function `rows(...)` is a generator. It first evaluates START WITH and the sources that are read once,
then yields None, then the results: paths, or, where something has to be done with them later, pairs of a path and its
keys, see flat.py. With MEMORIZE it is a function that gives the state of START WITH, the function `grow` of
searches/memorized.py, the function `keys(last)`, and the pieces of pieces.py.
"""

from __future__ import annotations

import ast
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ss2sql import plan
from ss2sql.runtime.native.expressions import expression
from ss2sql.runtime.native.flat import key_expressions
from ss2sql.runtime.native.loop_code import FRAME, GROWTH_FRAME, LoopCode, assigned
from ss2sql.runtime.native.pieces import pieces
from ss2sql.runtime.native.searches import SEARCHES
from ss2sql.runtime.native.searches.memorized import GROW
from ss2sql.runtime.native.step_code import StepCode, StepLoops
from ss2sql.runtime.native.step_functions import read_starts, stepwise
from ss2sql.runtime.native.unit import Body

if TYPE_CHECKING:
    from ss2sql.runtime.native.builder import Builder


def finder(builder: Builder, query: plan.Query, body: Body, aggregates: Sequence[plan.Aggregate]) -> str:
    """Compiles the function that finds the results of a search into `body` and gives its name."""
    search = query.search
    assert search is not None
    unit = builder.unit
    if not search.plain:
        return _stepwise(builder, query, body, aggregates)
    for name, expr in search.start:
        local = unit.states[query.id, name] = unit.local(name)
        body.add(unit.pen_at(expr.span).assign(local, expression(builder, expr, body)))
        body.states.add((query.id, name))
    here = [unit.states[query.id, name] for name, _ in search.start]
    keys = key_expressions(query, aggregates)
    find_keys = unit.local("keys") if keys else None
    memorized = search.repeats == "memorize"
    loops = StepLoops(builder, query, body)
    loops.read_once()
    if memorized:
        written = _memorized(builder, query, body, loops, here, find_keys)
    else:
        written = _loop(builder, query, body, loops, here, find_keys)
    if find_keys is not None:
        _define_keys(builder, query, body, find_keys, keys)
    body.add(*written)
    body.define()
    return body.name


def _stepwise(builder: Builder, query: plan.Query, body: Body, aggregates: Sequence[plan.Aggregate]) -> str:
    keys = key_expressions(query, aggregates)
    find_keys = builder.unit.local("keys") if keys else None
    read_starts(builder, query, body)
    written = stepwise(builder, query, body, find_keys)
    if find_keys is not None:
        _define_keys(builder, query, body, find_keys, keys)
    body.add(*written)
    body.define()
    return body.name


def _loop(
    builder: Builder, query: plan.Query, body: Body, loops: StepLoops, here: list[str], keys: str | None
) -> list[ast.stmt]:
    """The loop of the search. What is done for each state has a `Body`, but is no function of its own."""
    assert query.search is not None
    step = StepCode(builder, query, Body(builder.unit, "loop", [], body), loops)
    order = SEARCHES[query.search.order, query.search.repeats]
    assert isinstance(order, str)
    written = LoopCode(step, here, keys).written(order, FRAME)
    own = assigned([line for line in body.blocks[0] if not isinstance(line, ast.FunctionDef)])
    body.shared.update((name, None) for name in step.body.shared if name not in own)
    return written


def _memorized(
    builder: Builder, query: plan.Query, outer: Body, loops: StepLoops, here: list[str], keys: str | None
) -> list[ast.stmt]:
    """The functions that MEMORIZE asks."""
    unit, pen = builder.unit, builder.unit.pen_at(query.span)
    # A search is no step, so its start does not count as one that went on.
    expanded = unit.counter("expanded", outer)
    outer.add(pen.increase(expanded, -1))
    body = Body(unit, unit.local("grow"), ["graph", "level", "seen", "most", "choose"], outer)
    step = StepCode(builder, query, body, loops)
    body.blocks[0] = LoopCode(step, here, keys).written(GROW, GROWTH_FRAME)
    body.define()
    loops.counts_steps = True
    chooses = step.has_list and not loops.lookups
    find_keys = pen.constant(None) if keys is None else pen.name(keys)
    state = pen.pack(*map(pen.name, here))
    return [pen.back(pen.pack(state, pen.name(body.name), find_keys, pieces(builder, query, outer, loops, chooses)))]


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

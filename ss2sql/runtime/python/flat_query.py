"""Flat queries: a generator of nested loops that yields one result after the other.

A result is a row; after its columns stand the keys of ORDER BY. With GROUP BY it is a pair of the row and its keys:
the arguments of aggregates, the values of GROUP BY, those of ORDER BY; a query that aggregates yields its groups, see
group_loops.py.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Sequence
from typing import TYPE_CHECKING

from ss2sql.language import plan
from ss2sql.language.kinds import INT
from ss2sql.language.plan_traversal import is_volatile, split_and
from ss2sql.runtime.python.call_code import find_keyed_sources
from ss2sql.runtime.python.codegen_context import PythonScope
from ss2sql.runtime.python.equality_index import find_lookups
from ss2sql.runtime.python.group_loops import GroupCollector
from ss2sql.runtime.python.python_expressions import write_expression
from ss2sql.runtime.python.source_loops import SourceLoops, list_source_expressions
from ss2sql.runtime.run.array_calls import count_array_calls, join_stages

if TYPE_CHECKING:
    from ss2sql.runtime.python.query_compiler import QueryCompiler


def compile_flat_query(
    builder: QueryCompiler, query: plan.Query, body: PythonScope, aggregates: Sequence[plan.Aggregate]
) -> str:
    """Compiles the generator of results into `body` and gives its name."""
    loops = SourceLoops(builder, query, body)
    keys = list_key_expressions(query, aggregates)
    outputs = () if query.aggregated else tuple(output.expr for output in query.columns)
    inside = list_source_expressions(query)
    where = () if query.where is None else (query.where,)
    body.count_uses([*inside, *where, *outputs, *keys])

    loops.read_constant_sources()
    conditions, guarded = place_conditions(builder, query, loops)
    if query.aggregated and not query.group:  # there is a group without a row, too, so nothing ends the function early
        conditions[1] = [*conditions.pop(0, []), *conditions.get(1, [])]
        guarded = None if guarded is None else max(guarded, 1)
    keyed = find_keyed_sources([*inside, *where, *outputs, *keys])
    for source in query.sources[1:]:  # the first is walked once
        if source.id in keyed:
            loops.attach_keys(source, frozen=False, keyed=True)
    evaluated = [*where, *outputs, *keys]
    loops.staged = count_array_calls(*query.sources, *evaluated) > 0 and builder.codegen.analysis.are_steady(evaluated)
    collects = query.aggregated and not loops.staged
    groups = GroupCollector(builder, query, aggregates, body) if collects else None
    inner = loops.open_loops(body, conditions, guarded, [*outputs, *keys])
    if query.aggregated:
        groups = groups or GroupCollector(builder, query, aggregates, inner)
        groups.collect_row(inner)
        groups.write_results()
    else:
        build = builder.codegen.build_at(query.span)
        row, behind = write_row_and_keys(builder, query, outputs, keys, inner)
        inner.emit(
            build.run(
                build.yield_(
                    build.pack(build.pack(*row), build.pack(*behind)) if query.group else build.pack(*row, *behind)
                )
            )
        )
    inner.define_function()
    if not loops.stages:
        return body.name
    codegen, build = builder.codegen, builder.codegen.build
    name, early = codegen.new_name("find"), build.constant(query.limit is not None)
    stages = [build.pack(build.name(stage.name), how) for stage, how in loops.stages]
    joined = build.call(codegen.use(join_stages), build.name("run"), early, build.name(body.name), *stages)
    codegen.definitions.append(build.assign(name, joined))
    return name


def write_row_and_keys(
    builder: QueryCompiler,
    query: plan.Query,
    outputs: Sequence[plan.Expr],
    keys: Sequence[plan.Expr],
    body: PythonScope,
) -> tuple[list[ast.expr], list[ast.expr]]:
    """The columns, and the keys, the last of which are those of ORDER BY: a column that one names is computed once."""
    named = [(number, key.column) for number, key in enumerate(query.order, len(keys) - len(query.order))]
    shared = {number: column for number, column in named if column is not None and is_volatile(keys[number])}
    row = [write_expression(builder, expr, body) for expr in outputs]
    if shared:
        build = builder.codegen.build_at(query.span)
        row = [body.name_or_constant(value, build, "column") for value in row]
    return row, [
        row[shared[number]] if number in shared else write_expression(builder, key, body)
        for number, key in enumerate(keys)
    ]


def list_key_expressions(query: plan.Query, aggregates: Sequence[plan.Aggregate]) -> list[plan.Expr]:
    """What is evaluated of a result besides its columns, in this order. `count(*)` counts a constant."""
    one = plan.Constant(1, INT, span=query.span)
    arguments = [one if node.argument is None else node.argument for node in aggregates]
    order = [] if query.aggregated else [key.expr for key in query.order]
    return [*arguments, *query.group, *order]


def place_conditions(
    builder: QueryCompiler, query: plan.Query, loops: SourceLoops
) -> tuple[dict[int, list[plan.Expr]], int | None]:
    """The parts of WHERE by the number of sources that are bound when they are tested; see `SourceLoops.open_loops`.

    As written, all parts are tested from left to right when all sources are bound. A part moves outwards
    only where nobody can notice. It must not have an effect, nor may anything that it then comes before.
    If it may raise, the part before it stays before it, and all later sources must be read once and have
    elements, so that it would be evaluated anyway.
    """
    placed: dict[int, list[plan.Expr]] = defaultdict(list)
    number = {source.id: index + 1 for index, source in enumerate(query.sources)}
    last, reached, guarded = len(query.sources), 0, None
    certain = steady = True  # of all parts so far
    for part in split_and(query.where):
        facts = builder.codegen.analysis.facts(part)
        level = max((number[source] for source in facts.sources if source in number), default=0)
        if certain and any(map(loops.plan_lookup, find_lookups(part, builder.codegen.analysis))):
            reached = max(reached, level)
            if facts.total:
                continue
        elif certain:
            loops.push_condition_to_world(part)
        level = max(level, loops.first_unnoticed)
        if not (certain and facts.total):
            level = max(level, reached, loops.first_read_once)
        steady = steady and facts.steady
        certain = certain and facts.total and steady
        if not steady:
            level = last
        elif not certain and level < last:
            guarded = loops.first_read_once
        reached = max(reached, level)
        placed[level].append(part)
    return dict(placed), guarded

"""Queries in FROM whose loops stand right inside the loops of the query around them.

Such a query is read again for each element before it, or for each state of a search. Its rows need not be collected
first where nobody can notice that its parts are evaluated in between: nothing in it may raise or have an effect.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import chain
from typing import TYPE_CHECKING

from ss2sql.language import plan
from ss2sql.language.plan_traversal import split_and, walk
from ss2sql.runtime.python.codegen_context import PythonScope
from ss2sql.runtime.python.expression_facts import ExpressionAnalysis
from ss2sql.runtime.python.flat_query import place_conditions
from ss2sql.runtime.python.python_expressions import write_expression
from ss2sql.runtime.python.source_loops import SourceLoops, are_elements_rows, list_source_expressions

if TYPE_CHECKING:
    from ss2sql.runtime.python.query_compiler import QueryCompiler


def can_open_inside(query: plan.Query, analysis: ExpressionAnalysis) -> bool:
    """Whether the loops of a query can stand in those of the query around it."""
    if not are_elements_rows(query) or query.grouped or query.order or query.limit is not None:
        return False
    if len({output.name for output in query.columns}) < len(query.columns):
        return False
    # One loop for one: a search may leave the loop over its source, and come back to it later.
    if len(query.sources) > 1 or not isinstance(query.sources[0], (plan.TableSource, plan.ValueSource)):
        return False
    expressions = [*list_source_expressions(query), *(output.expr for output in query.columns)]
    facts = [analysis.facts(expr) for expr in (*expressions, *((query.where,) if query.where is not None else ()))]
    return all(one.steady and one.total for one in facts)


def has_test_before_loop(query: plan.Query, analysis: ExpressionAnalysis) -> bool:
    """Whether a part of WHERE is tested before the loop, for it reads nothing of the element."""
    own = {source.id for source in query.sources}
    return any(own.isdisjoint(analysis.facts(part).sources) for part in split_and(query.where))


def open_inner_loops(
    builder: QueryCompiler, source: plan.QuerySource, read: tuple[str, ...], body: PythonScope
) -> PythonScope:
    """Opens the loops of a query in FROM; its element is a tuple of the columns that are `read`."""
    codegen, query = builder.codegen, source.query
    loops = SourceLoops(builder, query, body, inside=True)
    outputs = {output.name: output.expr for output in query.columns if output.name in read}
    where = () if query.where is None else (query.where,)
    body.count_uses([*list_source_expressions(query), *where, *outputs.values()])
    loops.read_constant_sources()
    conditions, guarded = place_conditions(builder, query, loops)
    inner = query.sources[0]
    wanted = _find_only_column(inner, [*chain.from_iterable(conditions.values()), *outputs.values()])
    if wanted is not None and loops.has_row_index(inner):
        loops.wanted[inner.id] = wanted
        codegen.single_column_queries.add(inner.id)
    body = loops.open_loops(body, conditions, guarded)
    if inner.id in codegen.single_column_queries and all(isinstance(expr, plan.Column) for expr in outputs.values()):
        codegen.single_column_queries.add(source.id)
        codegen.names[source.id], codegen.tuples[source.id] = codegen.names[inner.id], tuple(outputs)
        return body
    row = None if inner.id in codegen.single_column_queries else _find_row_tuple(builder, outputs)
    if row is not None:
        codegen.names[source.id], codegen.tuples[source.id] = row
        return body
    build = codegen.build_at(source.span)
    codegen.tuples[source.id] = tuple(outputs)
    name = codegen.names[source.id] = codegen.new_name(source.name)
    body.emit(build.assign(name, build.pack(*(write_expression(builder, expr, body) for expr in outputs.values()))))
    body.locals.append(name)
    return body


def _find_only_column(source: plan.Source, read: Sequence[plan.Expr]) -> str | None:
    names = set[str | None]()
    for node in chain.from_iterable(map(walk, read)):
        if isinstance(node, (plan.Column, plan.Element)) and node.source == source.id:
            names.add(node.name if isinstance(node, plan.Column) else None)
    return names.pop() if len(names) == 1 else None


def _find_row_tuple(builder: QueryCompiler, outputs: dict[str, plan.Expr]) -> tuple[str, tuple[str, ...]] | None:
    """The name of a tuple that holds all outputs, and what its columns are called then ("": none of the outputs)."""
    codegen, sources, names = builder.codegen, set[int](), dict[str, str]()
    for name, output in outputs.items():
        if not isinstance(output, plan.Column) or output.name in names:
            return None
        sources.add(output.source)
        names[output.name] = name
    source = sources.pop() if len(sources) == 1 else None
    columns = codegen.tuples.get(source) if source is not None else None
    if source is None or columns is None:
        return None
    return codegen.names[source], tuple(names.get(column, "") for column in columns)

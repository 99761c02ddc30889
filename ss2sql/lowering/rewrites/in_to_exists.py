"""`exists`: membership in what a query finds for the row around it is the question whether it finds that value.

    x IN (SELECT e.x FROM e = es WHERE e.k == n.k AS list)

    EXISTS (SELECT 1 FROM e = es WHERE e.k == n.k AND e.x == x)

so that both equalities are looked up, and no list is made. The plan says it with a query `AS value`, cut after its
first row, see `is_exists`. A query that is the same for all rows stays as it is, for its list is made once.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ss2sql.language import plan
from ss2sql.language.kinds import BOOL, NONE, unite
from ss2sql.language.plan_traversal import (
    has_query,
    is_column_query,
    is_exists,
    is_volatile,
    list_inside,
    list_sources,
    list_states,
    split_and,
)
from ss2sql.lowering.rewrites.plan_nodes import make_call, make_conjunction, make_constant, rewrite_bottom_up
from ss2sql.lowering.rewrites.rewrite_context import RewriteContext


def rewrite(query: plan.Query, world: RewriteContext) -> plan.Query:
    """The query with such memberships as questions for rows."""
    if not {"in", "not_in", "eq", "ne"}.isdisjoint(world.replaced):
        return query
    return rewrite_bottom_up(query, _rewrite_node)


def _rewrite_node(node: Any) -> Any:
    match node:
        case plan.Call(
            function=plan.Function(name="in" | "not_in" as name, builtin=True),
            arguments=(item, plan.Subquery(query=inner)),
        ) if is_column_query(inner) and _reads_outer_rows(inner) and not has_query(item) and not is_volatile(node):
            column = inner.columns[0].expr
            equal = make_call("eq", column, item, span=node.span)
            found = replace(
                inner,
                columns=(plan.Output("found", make_constant(True, node.span)),),
                where=make_conjunction([*split_and(inner.where), equal], node.span),
                order=(),
                limit=make_constant(1, node.span),
                representation=plan.Representation("value"),
            )
            assert is_exists(found)
            question = plan.Subquery(found, unite((BOOL, NONE)), span=node.span)
            return make_call("ne" if name == "in" else "eq", question, make_constant(None, node.span), span=node.span)
        case _:
            return node


def _reads_outer_rows(query: plan.Query) -> bool:
    return bool(list_sources(query) - list_inside(query) or list_states(query))

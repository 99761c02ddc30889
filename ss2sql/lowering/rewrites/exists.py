"""`exists`: membership in what a query finds for the row around it is the question whether it finds that value.

    x IN (SELECT e.x FROM e = es WHERE e.k == n.k AS list)

    EXISTS (SELECT 1 FROM e = es WHERE e.k == n.k AND e.x == x)

so that both equalities are looked up, and no list is made. The plan says it with a query `AS value`, cut after its
first row, see `asks_for_rows`. A query that is the same for all rows stays as it is, for its list is made once.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from ss2sql import plan
from ss2sql.kinds import BOOL, NONE, union
from ss2sql.lowering.rewrites.nodes import all_of, bottom_up, call, constant
from ss2sql.lowering.rewrites.world import World
from ss2sql.walk import asks_for_rows, conjuncts, has_query, is_volatile, sources_inside, sources_read, states_read


def rewrite(query: plan.Query, world: World) -> plan.Query:
    """The query with such memberships as questions for rows."""
    if not {"in", "not_in", "eq", "ne"}.isdisjoint(world.replaced):
        return query
    return bottom_up(query, _changed)


def _changed(node: Any) -> Any:
    match node:
        case plan.Call(
            function=plan.Function(name="in" | "not_in" as name, builtin=True),
            arguments=(item, plan.Subquery(query=inner)),
        ) if _is_plain(inner) and _reads_around(inner) and not has_query(item) and not is_volatile(node):
            column = inner.columns[0].expr
            equal = call("eq", column, item, span=node.span)
            found = replace(
                inner,
                columns=(plan.Output("found", constant(True, node.span)),),
                where=all_of([*conjuncts(inner.where), equal], node.span),
                order=(),
                limit=constant(1, node.span),
                representation=plan.Representation("value"),
            )
            assert asks_for_rows(found)
            question = plan.Subquery(found, union((BOOL, NONE)), span=node.span)
            return call("ne" if name == "in" else "eq", question, constant(None, node.span), span=node.span)
        case _:
            return node


def _is_plain(query: plan.Query) -> bool:
    """Whether a query gives the list of one column of all rows that its conditions hold for."""
    if query.representation.name != "list" or len(query.columns) > 1 or query.columns[0].star:
        return False
    return not (query.search or query.grouped or query.limit)


def _reads_around(query: plan.Query) -> bool:
    return bool(sources_read(query) - sources_inside(query) or states_read(query))

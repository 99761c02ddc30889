"""Nested queries over a list whose elements are known: what each element comes to."""

from __future__ import annotations

from typing import Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.plan_traversal import can_fail, list_sources, list_states, rebuild_node, walk
from ss2sql.lowering.rewrites.constant_eval import resolve_constant_string
from ss2sql.lowering.rewrites.constant_folding import fold_node
from ss2sql.lowering.rewrites.plan_nodes import make_constant
from ss2sql.lowering.rewrites.rewrite_context import MAX_ELEMENTS, RewriteContext, is_plain_value

MAX_NODES = 20_000  # of the conditions and columns of all elements together
LIST_FORMS = ("list", "rows", "dict")


@dataclass(frozen=True, slots=True)
class UnrolledRow:
    """What one element of the list comes to: the condition that it passes, and the columns that it gives."""

    passes: plan.Expr
    columns: tuple[plan.Expr, ...]


def unroll_rows(query: plan.Query, world: RewriteContext) -> list[UnrolledRow] | None:
    """A row for each element of a nested query's list; None where the query cannot be taken apart unnoticed.

    All elements and what is made of them must not fail: the query evaluates all, and what its rows are used
    for may stop early. A query that mentions nothing of the queries around it is left alone, for it is evaluated once.
    """
    if not _is_plain_query(query) or not isinstance(query.sources[0], plan.ValueSource):
        return None
    source = query.sources[0]
    if not _is_correlated(query):
        return None
    items = _list_items(source.value, world)
    parts = [query.where or make_constant(True, query.span), *(output.expr for output in query.columns)]
    if items is None or len(items) * sum(1 for part in parts for _ in walk(part)) > MAX_NODES:
        return None
    rows: list[UnrolledRow] = []
    for item in items:
        passes, *columns = (substitute_element(part, source.id, item, world) for part in parts)
        if any(part is None or can_fail(part) for part in (item, passes, *columns)):
            return None
        rows.append(UnrolledRow(passes, tuple(columns)))
    return rows


def find_searched_item(query: plan.Query, world: RewriteContext) -> tuple[plan.Expr, plan.Constant] | None:
    """What a query looks for in which list, if its WHERE asks for nothing but `this == x`; else None."""
    match query.where:
        case plan.Call(function=plan.Function(name="eq", builtin=True), arguments=arguments):
            pass
        case _:
            return None
    if not _is_plain_query(query) or not isinstance(query.sources[0], plan.ValueSource):
        return None
    source = query.sources[0]
    for one, item in (arguments, arguments[::-1]):
        if isinstance(one, plan.Element) and one.source == source.id and source.id not in list_sources(item):
            shown = [item, *(output.expr for output in query.columns)]
            items = None if any(map(can_fail, shown)) or not _is_correlated(query) else _list_items(source.value, world)
            if items and all(isinstance(known, plan.Constant) for known in items):
                values = [known.value for known in items if isinstance(known, plan.Constant)]
                return item, make_constant(values, source.value.span)
    return None


def _is_plain_query(query: plan.Query) -> bool:
    """Whether the query gives a list of the rows that pass its WHERE, in the order of its one source."""
    shaped = (
        query.search or query.grouped or query.limit or query.representation.arguments or query.representation.named
    )
    keys = any(can_fail(key.expr) for key in query.order)
    labelled = any(output.label is not None or output.star for output in query.columns)
    alone = len(query.sources) == 1
    return alone and not (shaped or keys or labelled) and query.representation.name in LIST_FORMS


def _is_correlated(query: plan.Query) -> bool:
    """Whether the query reads anything of the queries around it."""
    return bool(list_sources(query) - {query.sources[0].id} or list_states(query))


def _list_items(value: plan.Expr, world: RewriteContext) -> list[plan.Expr] | None:
    match value:
        case plan.MakeList(items=items):
            known: list[plan.Expr] | None = list(items)
        case plan.Constant(value=list(values)) if is_plain_value(values):
            known = [make_constant(element, value.span) for element in values]
        case plan.Variable(name=name):
            listed = world.get_list(name)
            known = None if listed is None else [make_constant(element, value.span) for element in listed]
        case _:
            return None
    return known if known is not None and len(known) <= MAX_ELEMENTS else None


def substitute_element(expr: Any, source: int, item: plan.Expr, world: RewriteContext) -> Any:
    """The expression with `item` in place of the element, and what that makes known; None where it reads columns."""
    if any(isinstance(node, (plan.Column, plan.Subquery)) and source in list_sources(node) for node in walk(expr)):
        return None

    def put_element(node: Any) -> Any:
        if isinstance(node, plan.Element) and node.source == source:
            return item
        node = fold_node(rebuild_node(node, put_element))
        if isinstance(node, plan.Eval):
            meaning = resolve_constant_string(node, world)
            return node if meaning is None else put_element(meaning)
        return node

    return put_element(expr)

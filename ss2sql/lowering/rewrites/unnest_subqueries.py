"""`unnest` and `exists`: nested queries that only test elements become conditions.

    [] == (SELECT this FROM [[a.this, b.this], [b.this, c.this]] WHERE this[0] == this[1] AS list)

means the same as `a.this != b.this AND b.this != c.this`, which both executors can evaluate as soon as the sources
are bound: the four-colour map over eight countries takes 8.7 s nested and 0.01 s so. The list may be a
literal, a constant, or a variable's value; in the last case the query relies on the value, and is made anew
when it has changed. A text for `eval` that is constant by then is read, too. The conditions must not fail,
because the nested query evaluates all of them and a conjunction stops early.

    x IN (SELECT e.x FROM e = es WHERE e.k == n.k AS list)

    EXISTS (SELECT 1 FROM e = es WHERE e.k == n.k AND e.x == x)

so that both equalities are looked up, and no list is made. The plan says it with a query `AS value`, cut after its
first row, see `is_exists`. A query that is the same for all rows stays as it is, for its list is made once.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace
from typing import Any

from ss2sql.errors import Span
from ss2sql.language import plan
from ss2sql.language.kinds import BOOL, NONE, unite
from ss2sql.language.plan_traversal import (
    has_query,
    is_column_query,
    is_exists,
    is_volatile,
    list_sources,
    reads_outside,
    rebuild_node,
    split_and,
    walk,
)
from ss2sql.lowering.guards import is_free
from ss2sql.lowering.rewrites.constant_folding import fold_constant_string, fold_node
from ss2sql.lowering.rewrites.rewrite_context import (
    COMPARISONS,
    MAX_ELEMENTS,
    RewriteContext,
    is_foldable_value,
    make_call,
    make_connective,
    make_constant,
    negate_expression,
    rewrite_bottom_up,
    rewrite_to_bool,
)

MAX_NODES = 20_000  # of the conditions and columns of all elements together
LIST_FORMS = ("list", "rows", "dict")


def unroll_rows(query: plan.Query, world: RewriteContext) -> list[plan.Expr] | None:
    """The condition that each element of a nested query's list has to pass; None where this could be noticed.

    All elements and what is made of them must not fail: the query evaluates all, and what its rows are used
    for may stop early. A query that mentions nothing of the queries around it is left alone, for it is evaluated once.
    """
    if not _is_plain_query(query) or not isinstance(query.sources[0], plan.ValueSource) or not reads_outside(query):
        return None
    source = query.sources[0]
    items = _list_elements(source.value, world)
    parts = [query.where or make_constant(True, query.span), *(output.expr for output in query.columns)]
    if items is None or len(items) * sum(1 for part in parts for _ in walk(part)) > MAX_NODES:
        return None
    rows: list[plan.Expr] = []
    for item in items:
        passes, *columns = (substitute_element(part, source.id, item, world) for part in parts)
        if None in (passes, *columns) or not is_free(item, passes, *columns):
            return None
        rows.append(passes)
    return rows


def _is_plain_query(query: plan.Query) -> bool:
    """Whether the query gives a list of the rows that pass its WHERE, in the order of its one source."""
    shaped = (
        query.search or query.grouped or query.limit or query.representation.arguments or query.representation.named
    )
    sortable = is_free(*(key.expr for key in query.order))
    return len(query.sources) == 1 and sortable and not shaped and query.representation.name in LIST_FORMS


def _list_elements(value: plan.Expr, world: RewriteContext) -> list[plan.Expr] | None:
    match value:
        case plan.MakeList(items=items):
            known: list[plan.Expr] | None = list(items)
        case plan.Constant(value=list(values)) if is_foldable_value(values):
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
            meaning = fold_constant_string(node, world)
            return node if meaning is None else put_element(meaning)
        return node

    return put_element(expr)


# --- `unnest`: a nested query over a known list, which only tests its elements, becomes conditions
def unnest_subqueries(query: plan.Query, world: RewriteContext) -> plan.Query:
    if not COMPARISONS.isdisjoint(world.replaced):
        return query
    rewritten = rewrite_bottom_up(query, lambda node: _unnest_node(node, world))
    if _can_assign(rewritten, {*world.lists, *world.types}):
        world.forget_values()
        return rewrite_bottom_up(query, lambda node: _unnest_node(node, world))
    return rewritten


def _can_assign(query: plan.Query, names: Collection[str]) -> bool:
    """Whether the query itself may change one of the variables while it runs."""
    return bool(names) and any(
        isinstance(node, (plan.Eval, plan.AssignLate))
        or (isinstance(node, (plan.Assign, plan.TemporalAssign)) and node.name in names)
        for node in walk(query)
    )


def _unnest_node(node: Any, world: RewriteContext) -> Any:
    """The node, whose parts are rewritten already, rewritten; a text that was read has told more of their types."""
    found: plan.Expr | None = None
    match node:
        case plan.Eval():
            found = fold_constant_string(node, world)
        case plan.Not(operand=operand):
            found = _test_rows(operand, False, world, node.span)
        case plan.Call(
            function=plan.Function(name="eq" | "ne" as name, builtin=True),
            arguments=(tested, plan.Constant(value=known)) | (plan.Constant(value=known), tested),
        ):
            if type(known) is int and known == 0 and isinstance(tested, plan.Call) and tested.function.builtin:
                tested = tested.arguments[0] if tested.function.name in ("len", "count") else tested
                known = []
            found = _test_rows(tested, name == "ne", world, node.span) if known == [] else None
    return fold_node(node) if found is None else found


def _test_rows(expr: plan.Expr, wanted: bool, world: RewriteContext, span: Span) -> plan.Expr | None:
    """Whether a query has rows, or, if that is wanted, none."""
    rows = unroll_rows(expr.query, world) if isinstance(expr, plan.Subquery) else None
    if rows is None:
        return None
    tests = rows if wanted else list(map(negate_expression, rows))
    made = make_connective(plan.Or if wanted else plan.And, tests, span)
    return rewrite_to_bool(fold_node(made))


# --- `exists`: membership in what a query finds for the row around it is the question whether it finds that value
def search_for_members(query: plan.Query, world: RewriteContext) -> plan.Query:
    """The query with such memberships as questions for rows."""
    if not {"in", "not_in", "eq", "ne"}.isdisjoint(world.replaced):
        return query
    return rewrite_bottom_up(query, _rewrite_node)


def _rewrite_node(node: Any) -> Any:
    match node:
        case plan.Call(
            function=plan.Function(name="in" | "not_in" as name, builtin=True),
            arguments=(item, plan.Subquery(query=inner)),
        ) if is_column_query(inner) and reads_outside(inner) and not has_query(item) and not is_volatile(node):
            column = inner.columns[0].expr
            equal = make_call("eq", column, item, span=node.span)
            found = replace(
                inner,
                columns=(plan.Output("found", make_constant(True, node.span)),),
                where=make_connective(plan.And, [*split_and(inner.where), equal], node.span),
                order=(),
                limit=make_constant(1, node.span),
                representation=plan.Representation("value"),
            )
            assert is_exists(found)
            question = plan.Subquery(found, unite((BOOL, NONE)), span=node.span)
            return make_call("ne" if name == "in" else "eq", question, make_constant(None, node.span), span=node.span)
        case _:
            return node

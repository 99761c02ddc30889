"""GROUP BY: group keys and aggregates in place of the expressions that mean them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ss2sql.errors import ResolveError, Span
from ss2sql.language import plan
from ss2sql.language.kinds import Kind, Type, make_list_type, type_of, unite
from ss2sql.language.operations import GROUPS
from ss2sql.language.plan_traversal import (
    is_structurally_equal,
    is_volatile,
    list_parts,
    list_sources,
    list_states,
    rebuild_node,
    walk_own,
)

if TYPE_CHECKING:
    from ss2sql.frontend.resolve.resolver import Resolver


def resolve_groups(resolver: Resolver, query: plan.Query) -> plan.Query:
    """The query with group keys and aggregates in the clauses that see groups.

    A query whose columns consist of these alone gives one row per group. A search that compares rows keeps them too.
    """
    columns = tuple(replace(output, expr=_lift_aggregates(resolver, output.expr, query)) for output in query.columns)
    aggregates = any(isinstance(node, plan.Aggregate) for output in columns for node in walk_own(output.expr))
    aggregated = not any(_reads_ungrouped_rows(output.expr, query) for output in columns)
    compares = query.search is not None and query.search.repeats != "allowed" and query.search.by == "row"
    if query.search is not None and compares and aggregates:
        message = "SELECT makes the rows that this search compares, so it cannot aggregate"
        hint = f"write what is to be compared in place of the row: {query.search.repeats.upper()} BY name"
        resolver.refuse("R008", message, query.columns[0].expr.span, hint)
    if aggregates and not aggregated:
        _refuse_mixture(resolver, query, columns)
    having = None if query.having is None else _lift_aggregates(resolver, query.having, query)
    if having is not None and _reads_ungrouped_rows(having, query):
        message = "HAVING sees group values and aggregates only"
        resolver.refuse("R008", message, having.span, "put a condition on single rows into WHERE")
    query = replace(query, having=having)
    if not aggregated:
        _refuse_star(resolver, query)
        return query
    order = tuple(replace(key, expr=_lift_aggregates(resolver, key.expr, query)) for key in query.order)
    for key in order:
        if _reads_ungrouped_rows(key.expr, query):
            message = "ORDER BY sorts groups here, so it sees group values and aggregates only"
            hint = f"add it to GROUP BY, or aggregate it: max({key.expr.span.text})"
            if query.distinct:
                message = "ORDER BY sorts what SELECT DISTINCT leaves, so it sees the columns of SELECT only"
                hint = f"add {key.expr.span.text} to SELECT, or leave DISTINCT out"
            resolver.refuse("R008", message, key.expr.span, hint)
    rows = tuple(output.expr for output in query.columns) if compares else ()
    return _share_resolved_aggregates(
        replace(query, columns=columns, order=order, aggregated=True, rows=rows, distinct=False)
    )


COUNT_TYPE = Type(Kind.INT, 0, 2**53)


def resolve_count(function: plan.Function, grouped: bool, argument: plan.Expr | None, span: Span) -> plan.Aggregate:
    """`count(*)` of a group, or `count(DISTINCT argument)`.

    Raises ResolveError R008 for another function, and without a group.
    """
    name = function.name
    if function.builtin and name == "count" and grouped:
        return plan.Aggregate("count" if argument is None else "count_distinct", argument, COUNT_TYPE, span=span)
    if argument is None:
        message = "count(*) alone takes a star, and counts the rows of a group"
        hint = "count the rows of a query: (SELECT count(*) FROM ... AS value)"
        other = f"write count(*), or name what {name} is to take"
    else:
        text = argument.span.text
        message = "count alone takes DISTINCT, and counts the different values of a group"
        hint = f"count what differs in a list: len(uniq({text}))"
        other = f"write {name}(uniq(SELECT {text} FROM ... AS list))"
    raise ResolveError("R008", message, span, (hint if name == "count" else other,))


def _share_resolved_aggregates(query: plan.Query) -> plan.Query:
    """The query with equal aggregates replaced by the first of them, so that SQL computes each once."""
    exprs = [output.expr for output in query.columns] + [key.expr for key in query.order]
    exprs = exprs if query.having is None else [query.having, *exprs]
    firsts: dict[plan.Aggregate, plan.Aggregate] = {}
    for node in (node for expr in exprs for node in walk_own(expr)):
        if isinstance(node, plan.Aggregate):
            firsts.setdefault(node, node)

    def mark_shared(node: Any) -> Any:
        if isinstance(node, plan.Aggregate):
            # An aggregate with a volatile argument stays a node of its own, so that its calls are made again.
            return replace(firsts[node], span=node.span) if is_volatile(node) else firsts[node]
        return node if isinstance(node, plan.Query) else rebuild_node(node, mark_shared)

    return replace(
        query,
        columns=tuple(replace(output, expr=mark_shared(output.expr)) for output in query.columns),
        order=tuple(replace(key, expr=mark_shared(key.expr)) for key in query.order),
        having=None if query.having is None else mark_shared(query.having),
    )


def _lift_aggregates(resolver: Resolver, expr: plan.Expr, query: plan.Query, within: bool = False) -> plan.Expr:
    """The expression with GroupKey and Aggregate in place of group keys and aggregates.

    `within` another query the group keys are visible, but its calls of `sum` and other aggregates are its own.
    """
    for index, key in enumerate(query.group):
        if not isinstance(key, plan.Constant) and is_structurally_equal(expr, key):
            return plan.GroupKey(query.id, index, key.type, span=expr.span)
    match expr:
        case plan.Aggregate(argument=argument) if not within:  # `count(*)`, `count(DISTINCT x)`
            if argument is not None:
                _refuse_nested(resolver, "count", argument, "SELECT DISTINCT")
            return expr  # its argument reads rows, so no key of the group belongs into it
        case plan.Call(function=plan.Function(name=name, builtin=True), arguments=(argument,)) if (
            name in GROUPS and not within and not _is_list_query(argument)
        ):
            _refuse_nested(resolver, name, argument)
            kind = GROUPS[name].type_of_group(argument.type)
            if not query.group:  # there may be no row
                kind = unite((kind, type_of(GROUPS[name].nothing)))
            return plan.Aggregate(name, argument, kind, not query.group, span=expr.span)
        case plan.Call(function=plan.Function(name=name, collects=True), arguments=(argument, *others)) if (
            not within and not _is_list_query(argument)
        ):
            _refuse_nested(resolver, name, argument)
            kind = GROUPS["collect"].type_of_group(argument.type)
            collected = plan.Aggregate("collect", argument, kind, not query.group, span=expr.span)
            beside = (_lift_aggregates(resolver, other, query) for other in others)
            return _resolve_type_again(resolver, replace(expr, arguments=(collected, *beside)))
    within = within or isinstance(expr, plan.Query)
    lifted = rebuild_node(expr, lambda part: _lift_aggregates(resolver, part, query, within))
    return lifted if lifted is expr else _resolve_type_again(resolver, lifted)


def _is_list_query(argument: plan.Expr) -> bool:
    """Whether an aggregate works on the list that its argument is, a query, and not on the rows of the group."""
    return isinstance(argument, plan.Subquery) and argument.query.representation.name != "value"


def _resolve_type_again(resolver: Resolver, expr: plan.Expr) -> plan.Expr:
    """The expression with its type computed again, since an aggregate's type differs from a list's."""
    match expr:
        case plan.Call(function=function, arguments=arguments) if function.builtin:
            return resolver.make_call(function.name, arguments, expr.span, expr.place)
        case plan.Call():
            return resolver.refine_call(expr)
        case plan.If():
            return replace(expr, type=unite((expr.then[-1].type, expr.otherwise[-1].type)))
        case plan.MakeList(items=items):
            return replace(expr, type=make_list_type([item.type for item in items]))
        case plan.Assign(value=value):
            return replace(expr, type=value.type)
    return expr


def _reads_ungrouped_rows(node: object, query: plan.Query, within: bool = False) -> bool:
    """Whether the node reads the query's own elements or state outside aggregates; `within`: see `_lift_aggregates`."""
    own = {source.id for source in query.sources}
    match node:
        case plan.Aggregate() if not within:
            return False
        case plan.Element() | plan.Column() | plan.Eval():
            return bool(list_sources(node) & own)
        case plan.State():
            return any(number == query.id for number, _ in list_states(node))
        case _:
            within = within or isinstance(node, plan.Query)
            return any(_reads_ungrouped_rows(part, query, within) for part in list_parts(node))


def _refuse_star(resolver: Resolver, query: plan.Query) -> None:
    """Refuses `count(*)` where ORDER BY sorts single rows."""
    for key in query.order:
        if any(isinstance(node, plan.Aggregate) for node in walk_own(key.expr)):
            message = "ORDER BY sorts rows here, because SELECT mentions them, so it cannot count those of a group"
            hint = f"for one row per group write SELECT {', '.join(key.span.text for key in query.group)}, count(*)"
            resolver.refuse("R008", message, key.expr.span, hint)


def _refuse_nested(resolver: Resolver, name: str, argument: plan.Expr, select: str = "SELECT") -> None:
    """Refuses `max(sum(v))` and `max(count(*))`, written so or by the name of a column of SELECT."""
    node = next(filter(_is_aggregate_of_rows, walk_own(argument)), None)
    if node is not None:
        message = f"{name} is computed of single rows, and {node.span.text} of a whole group"
        hint = f"aggregate groups in a query around: {name}({select} ... GROUP BY ... AS list)"
        other = "or, if a column of SELECT was meant as that of a source, give it another name"
        resolver.refuse("R008", message, node.span, hint, other)


def _is_aggregate_of_rows(node: Any) -> bool:
    """Whether it is a call such as `sum(v)`, of what is no list, or `count(*)`."""
    match node:
        case plan.Aggregate():
            return True
        case plan.Call(function=plan.Function(name=name, builtin=True), arguments=(argument,)):
            return name in GROUPS and argument.type.excludes(Kind.LIST)
        case _:
            return False


def _refuse_mixture(resolver: Resolver, query: plan.Query, columns: tuple[plan.Output, ...]) -> None:
    """Refuses an aggregate beside a value of single rows; the error names both."""
    single = next(output for output in columns if _reads_ungrouped_rows(output.expr, query))
    message = f"'{single.name}' belongs to a row, not to a group, so it cannot stand beside an aggregate"
    text = single.expr.span.text
    by = "add it to GROUP BY" if query.group else f"write GROUP BY {text}"
    resolver.refuse("R008", message, single.expr.span, f"{by}, or aggregate it: max({text})")

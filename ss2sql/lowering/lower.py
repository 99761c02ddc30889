"""One query of the plan becomes one statement of SQL."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ss2sql import plan
from ss2sql.lowering import sql
from ss2sql.lowering.dialects import SQLITE, Dialect
from ss2sql.lowering.expressions import Env, is_flag
from ss2sql.lowering.parameters import Needs, Shown, SqlQuery
from ss2sql.lowering.search import lower_search
from ss2sql.lowering.select import Selects
from ss2sql.lowering.unsupported import check


def lower(query: plan.Query, function_names: Mapping[str, str], dialect: Dialect = SQLITE) -> SqlQuery:
    """The statement of a query that stands by itself, not inside another.

    `function_names` maps registered functions to their names in SQL. Raises UnsupportedError with the reason
    where the query has to run natively.
    """
    check(query)
    needs = Needs(function_names)
    selects = Selects(needs)
    is_sorted = is_limited = False
    if query.search is not None:
        select = lower_search(selects, query)
        keys, orders = query.group, query.order
    elif query.aggregated:
        is_sorted, is_limited = True, _cut_by_sql(query)
        select = selects.rows(query if is_limited else replace(query, limit=None), Env(), _names(query))
        keys, orders = (), ()
    else:
        flat = selects.flat(query, Env())
        order = selects.order(query, flat)
        keys = query.group
        orders = query.order if order is None else ()
        outputs = selects.outputs(query, flat.env, _names(query))
        outputs += [selects.expressions.lower(key, flat.env) for key in keys]
        outputs += [selects.expressions.lower(key.expr, flat.env) for key in orders]
        is_sorted, is_limited = order is not None, order is not None and _cut_by_sql(query)
        limit = needs.count(query.limit, "limit") if is_limited and query.limit is not None else None
        select = sql.select(outputs, flat.items, sql.conjunction(flat.conditions), order or (), limit)
    return SqlQuery(
        query,
        dialect.print(select),
        tuple(needs.parameters.values()),
        _shown([output.expr for output in query.columns]),
        _shown(keys),
        _shown([key.expr for key in orders]),
        is_sorted,
        is_limited,
        {name: tuple(sorted(spans, key=lambda span: span.start)) for name, spans in needs.calls.items()},
        dict(needs.modules),
    )


def _cut_by_sql(query: plan.Query) -> bool:
    """Whether LIMIT may stand in the SQL.

    LIMIT 0 would keep SQLite from evaluating rows that have to be sorted or grouped first, and a partition is
    cut before it is made.
    """
    if query.limit is None or (query.group and not query.aggregated):
        return False
    positive = isinstance(query.limit, plan.Constant) and query.limit.value != 0
    return positive or not (query.order or query.group)


def _names(query: plan.Query) -> list[str | None]:
    """Names for the columns of the statement; a name that is the column's own text is not repeated."""
    return [None if output.name == output.expr.span.text else output.name for output in query.columns]


def _shown(exprs: Sequence[plan.Expr]) -> tuple[Shown, ...]:
    return tuple(Shown(is_flag(expr.type)) for expr in exprs)

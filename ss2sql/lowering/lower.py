"""One query of the plan becomes one statement of SQL."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace

from sqlglot import exp

from ss2sql.language import plan
from ss2sql.language.kinds import Kind, is_flag
from ss2sql.lowering import sql_builder
from ss2sql.lowering.flat import FlatLowering, can_sort_in_sql
from ss2sql.lowering.none_tests import narrow_after_none_tests
from ss2sql.lowering.sql_builder import SQLITE
from ss2sql.lowering.sql_query import Bookkeeping, SqlQuery
from ss2sql.lowering.sqlite_expressions import SqlScope
from ss2sql.lowering.sqlite_forms import strip_numeric_affinity
from ss2sql.lowering.statement_needs import StatementNeeds
from ss2sql.lowering.union_branches import replace_elements_by_columns
from ss2sql.lowering.unsupported import check_supported

SCALAR_KINDS = Kind.INT | Kind.FLOAT | Kind.STR | Kind.NONE


def lower(
    query: plan.Query,
    function_names: Mapping[str, str],
    *,
    cut: bool = False,
    by_value: bool = False,
    disabled: Collection[str] = (),
) -> SqlQuery:
    """The statement of a query that stands by itself, not inside another.

    `function_names` maps registered functions to their names in SQL. `cut`: the search may end before its steps are
    used up. `by_value` compares values by their content instead of their handles, for a run that has met equal values
    of several forms. `disabled` names rewrites that are switched off. Raises UnsupportedError with the reason if only
    Python can run the query.
    """
    check_supported(query)
    needs = StatementNeeds(function_names, by_value=by_value, disabled=disabled)
    if "none" not in disabled and (narrowed := narrow_after_none_tests(query)) is not query:
        query, needs.applied["none"] = narrowed, None
    if "positions" not in disabled:
        query, needs.written = replace_elements_by_columns(query)
        if needs.written is not None:
            needs.applied["positions"] = None
    selects = FlatLowering(needs)
    columns = [output.expr for output in query.columns]
    # A name that is the column's own text is not repeated.
    names = [None if output.name == output.expr.span.text else output.name for output in query.columns]
    is_sorted = query.aggregated or (query.search is None and can_sort_in_sql(query))
    keys = () if query.aggregated else query.group
    orders = () if is_sorted else tuple(key.expr for key in query.order)  # Python sorts what has its own order
    is_limited = is_sorted and query.limit is not None and not keys  # Python cuts partitions
    bookkeeping = Bookkeeping()
    late = () if "late" in disabled or keys or orders else _find_late_columns(query)
    if query.search is not None:
        from ss2sql.lowering.search import EagerSearch

        cut = cut or query.search.maximum is not None or (query.limit is not None and not query.aggregated)
        search = EagerSearch(selects, query, cut)
        select = search.build_statement()
        bookkeeping = search.describe_steps()
        if query.aggregated:
            select = sql_builder.sort_query(search.group_results(select, names), (), *needs.bind_limits(query))
    else:
        shown: tuple[plan.Expr, ...] = late or (*columns, *keys, *orders)
        lowered = replace(query, columns=tuple(plan.Output("", expr) for expr in shown))
        lowered = lowered if is_sorted else replace(lowered, order=())
        lowered = lowered if is_limited else replace(lowered, limit=None, offset=None)
        names = [None] * len(shown) if late else [*names, *[None] * (len(shown) - len(names))]
        select = selects.lower_rows(lowered, SqlScope(), names)
    snapshot = read_late = None
    if needs.worlds:
        from ss2sql.vtables.reading import plan_late_columns, plan_snapshot

        snapshot = plan_snapshot((query,))
        if late:
            for key, node in zip(late, select.expressions, strict=True):
                _tell_late_columns(columns, key, node)
            read_late = plan_late_columns(query, late)
            needs.applied["late"] = None
    if query.search is None and (
        tables := [*needs.materialized_ctes.values(), *selects.copies.add_materialized_tables(select)]
    ):
        select.set("with_", exp.With(expressions=tables))
    strip_numeric_affinity(select, selects.tables.values())
    truths = frozenset[str]() if by_value else _strip_sql_truth(select, needs)
    compared = (query.search.key if query.search else ()) or query.rows or columns
    only_walked = _find_walked_sql_parameters(select, needs)
    return SqlQuery(
        query,
        SQLITE.print_tree(select),
        tuple(needs.parameters.values()),
        _list_flags(columns),
        _list_flags(keys),
        _list_flags(orders),
        is_sorted,
        is_limited,
        {name: tuple(sorted(spans, key=lambda span: span.start)) for name, spans in needs.calls.items()},
        dict(needs.modules),
        frozenset(needs.plain),
        plain_rows=all(output.expr.type.is_only(SCALAR_KINDS) for output in query.columns),
        plain_keys=all(expr.type.is_only(SCALAR_KINDS) for expr in compared),
        bookkeeping=bookkeeping,
        snapshot=snapshot,
        late=read_late,
        applied=tuple(needs.applied),
        only_iterated=only_walked,
        truths=truths,
    )


def _strip_sql_truth(select: exp.Select, needs: StatementNeeds) -> frozenset[str]:
    """Removes `truth` from calls of user functions that are conditions; gives the functions' names.

    SQLite tests numbers and handles as Python does, but not strings and None: when one turns up, the run changes to the
    statement that compares by value.
    """
    users = {needs.function_names.get(name, name): name for name in needs.calls}
    found: set[str] = set()
    for node in list(select.find_all(exp.Anonymous)):
        if node.name != "truth" or not _is_condition(node):
            continue
        (call,) = node.expressions
        if isinstance(call, exp.Anonymous) and call.name in users:
            node.replace(call)
            found.add(users[call.name])
    return frozenset(found)


def _is_condition(node: sql_builder.Node) -> bool:
    """Whether only the truth of a node counts."""
    parent = node.parent
    condition = isinstance(parent, exp.If) and parent.this is node
    return condition or isinstance(parent, (exp.And, exp.Or, exp.Not, exp.Where, exp.Having))


def _find_walked_sql_parameters(select: exp.Select, needs: StatementNeeds) -> frozenset[str]:
    """The parameters that are only walked, so that their value as a whole is never compared."""
    read: set[str] = set()
    for node in select.find_all(exp.Placeholder):
        call = node.parent
        table = needs.modules.get(call.name) if isinstance(call, exp.Anonymous) else None
        if table is None or table.function is not None or node.index:
            read.add(node.name)
    return frozenset(needs.parameters) - read


def _find_late_columns(query: plan.Query) -> tuple[plan.Column, ...]:
    """The keys of worlds that SQL selects in place of columns, which are read afterwards; none where it selects all."""
    if query.search is not None or query.aggregated or not any(isinstance(s, plan.WorldSource) for s in query.sources):
        return ()
    from ss2sql.vtables.reading import find_late_columns

    return find_late_columns(query)


def _tell_late_columns(columns: Sequence[plan.Expr], key: plan.Column, node: sql_builder.Node) -> None:
    """Adds to the column of a key, as a comment, what is read of it afterwards."""
    of_key = [expr for expr in columns if isinstance(expr, (plan.Column, plan.Element)) and expr.source == key.source]
    read = dict.fromkeys(expr.name if isinstance(expr, plan.Column) else "this" for expr in of_key)
    names = ", ".join(name for name in read if name != key.name)
    if names:  # of columns of worlds, which are names of scripts and end no comment
        node.add_comments([f"then {names if len(names) <= 60 else names[:57] + '...'}"])


def _list_flags(exprs: Sequence[plan.Expr]) -> tuple[bool, ...]:
    return tuple(is_flag(expr.type) for expr in exprs)

"""Queries that are no searches as one SELECT.

Rows come in the order of the sources, as the language has it, so each source is sorted by its places. Groups come in
the order of their first rows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

from sqlglot import exp

from ss2sql.language import plan
from ss2sql.language.kinds import Kind
from ss2sql.language.operations import GROUPS
from ss2sql.language.plan_traversal import walk
from ss2sql.lowering import sql_builder
from ss2sql.lowering.operation_forms import fill_operands
from ss2sql.lowering.portable.portable_expressions import Node, PortableExpressions, PortableScope
from ss2sql.lowering.portable.portable_from import (
    NUMBER_COLUMN,
    OpenSource,
    PortableSource,
    RemoteSources,
    build_named_column,
)
from ss2sql.lowering.portable.portable_names import ColumnNames
from ss2sql.lowering.portable.sql_types import build_refusal, cast_literal, get_column_type, write_cast


def write_flat(query: plan.Query, variable: Callable[[str], Any] | None = None) -> exp.Select:
    """The query as a SELECT of DuckDB. Raises UnsupportedError where it could mean something else.

    Args:
        query: a query without a search.
        variable: gives the values of script variables; without it a query that reads one is refused.
    """
    portable = GroupedExpressions(variable)
    limit = None if query.limit is None else portable.lower_value(query.limit, PortableScope())
    return FlatWriter(query, portable, RemoteSources(query, portable).open_source).write_select(limit)


class GroupedExpressions(PortableExpressions):
    """The expressions of a query that may have aggregates, whose arguments are seen as its rows are."""

    def lower_value(self, expr: plan.Expr, scope: PortableScope) -> Node:
        return (
            self._lower_aggregate(expr, scope) if isinstance(expr, plan.Aggregate) else super().lower_value(expr, scope)
        )

    def _lower_aggregate(self, expr: plan.Aggregate, scope: PortableScope) -> Node:
        if expr.argument is None:
            return exp.Count(this=exp.Star())
        argument = self.lower_value(expr.argument, scope)
        for form in GROUPS[expr.function].portable:
            if form.when([expr.argument.type]):
                return fill_operands(str(form.text), [argument], dialect="duckdb")
        raise build_refusal(f"{expr.function} of such values is not the same everywhere", expr.span)


class FlatWriter:
    """Writes one query, whose sources `open` brings into its FROM."""

    def __init__(self, query: plan.Query, portable: PortableExpressions, open: OpenSource) -> None:
        assert query.search is None
        self.query, self.portable, self.open = query, portable, open
        self.labels, self.name_scope = ColumnNames(), PortableScope()
        self.items: list[Node] = []
        self.places: list[Node] = []  # what sorts the sources

    def write_select(self, limit: Node | None) -> exp.Select:
        query = self.query
        if query.offset is not None:
            raise build_refusal("OFFSET", query.offset.span, "leave the engine to ss2sql")
        for source in query.sources:
            self._open_source(source)
        where = None if query.where is None else self.portable.lower_condition(query.where, self.name_scope)
        if query.aggregated:
            return self._write_groups(where, limit)
        if query.group:
            raise build_refusal("GROUP BY that makes parts is no SQL", query.group[0].span)
        outputs = [self._write_output(output, self.name_scope) for output in query.columns]
        order = [*self._write_order(self.name_scope), *((place.copy(), False) for place in self.places)]
        return sql_builder.select(outputs, self.items, where, _drop_constant_keys(order), limit)

    def _open_source(self, source: plan.Source) -> None:
        for node in walk(source):
            if isinstance(node, (plan.Element, plan.Column)) and node.source in self.name_scope.sources:
                raise build_refusal("what stands in FROM depends on another source", source.span)
        if isinstance(source, plan.QuerySource) and source.optional:
            raise build_refusal("LEFT JOIN", source.span, "leave the engine to ss2sql")
        label = self.labels.claim(source.name, "source")
        opened = (
            self._write_subquery(source, label) if isinstance(source, plan.QuerySource) else self.open(source, label)
        )
        self.items.append(opened.item)
        self.places += opened.places
        self.name_scope = self.name_scope.with_source(source.id, opened.read)

    def _write_subquery(self, source: plan.QuerySource, label: str) -> PortableSource:
        """A query in FROM: its columns, and what sorts its rows as columns, too."""
        query = source.query
        if query.search is not None:
            raise build_refusal("a search in FROM", source.span, "write it as a query of its own")
        one = query.representation.name == "list" and len(query.columns) == 1
        if not one and query.representation.name != "dict":
            raise build_refusal("the elements of this query are no rows of columns", source.span)
        select = self.make_inner_writer(query).write_select(write_inner_limit(query))
        names, found, outputs = ColumnNames(), dict[str | None, str](), list[Node]()
        for output, node in zip(query.columns, select.expressions, strict=True):
            name = names.claim(output.name, "element")
            found[None if one else output.name] = name
            outputs.append(sql_builder.alias(cast_literal(node.unalias(), get_column_type(output.expr.type)), name))
        keys = _build_sort_columns(query, select)
        places = dict(
            zip((NUMBER_COLUMN, *(names.claim(NUMBER_COLUMN, NUMBER_COLUMN) for _ in keys[1:])), keys, strict=False)
        )
        select.set("expressions", [*(sql_builder.alias(key, name) for name, key in places.items()), *outputs])
        if query.limit is None:
            select.set("order", None)
        sorting = tuple(sql_builder.column(name, label) for name in places)
        return PortableSource(sql_builder.derived(select, label), sorting, partial(build_named_column, label, found))

    def make_inner_writer(self, query: plan.Query) -> FlatWriter:
        """What writes a query in FROM."""
        return FlatWriter(query, self.portable, RemoteSources(query, self.portable).open_source)

    def _write_output(self, output: plan.Output, scope: PortableScope) -> Node:
        if output.star or output.label is not None:
            raise build_refusal("the names of these columns are not known", output.expr.span)
        return self._write_alias(self.portable.lower_value(output.expr, scope), output.name)

    def _write_alias(self, node: Node, name: str) -> Node:
        return sql_builder.alias(node, name)

    def _write_order(self, scope: PortableScope) -> list[tuple[Node, bool]]:
        return [(self.portable.lower_value(key.expr, scope), key.descending) for key in self.query.order]

    # --- GROUP BY ----------------------------------------------------------------------------------------

    def _write_groups(self, where: Node | None, limit: Node | None) -> exp.Select:
        """One row for each group, in the order in which the groups appear."""
        query = self.query
        keys = [self._find_group_key(key) for key in query.group]
        shown = [self._write_group_value(key, expr) for key, expr in zip(keys, query.group, strict=True)]
        scope = replace(self.name_scope, groups={(query.id, n): key for n, key in enumerate(shown)})
        outputs = [self._write_output(output, scope) for output in query.columns]
        order = self._write_order(scope) + [(place, False) for place in self._write_group_order()] if keys else []
        select = sql_builder.select(outputs, self.items, where, _drop_constant_keys(order), limit)
        if keys:
            select.set("group", exp.Group(expressions=[key.copy() for key in keys]))
        if query.having is not None:
            if query.having.type.kinds != Kind.BOOL:
                raise build_refusal("the truth of such a value is not the same everywhere", query.having.span)
            select.set("having", exp.Having(this=self.portable.lower_value(query.having, scope)))
        return select

    def _write_group_order(self) -> list[Node]:
        """The place of the first row of a group."""
        if len(self.places) > 1:
            raise build_refusal(
                "groups of several sources have no order in SQL", self.query.group[0].span, "add ORDER BY"
            )
        return [exp.Min(this=place.copy()) for place in self.places]

    def _write_group_value(self, key: Node, expr: plan.Expr) -> Node:
        return key

    def _find_group_key(self, expr: plan.Expr) -> Node:
        """What is grouped by; a number alone would be the position of a column."""
        node, kind = self.portable.lower_value(expr, self.name_scope), get_column_type(expr.type)
        return node if node.find(exp.Column) or kind is None else write_cast(node, kind)


def write_inner_limit(query: plan.Query) -> Node | None:
    """LIMIT of a query inside of another one, which is there however many rows the query around it asks for."""
    match query.limit:
        case None:
            return None
        case plan.Constant(value=int(most)) if most > 0:
            return sql_builder.number(most)
    raise build_refusal("LIMIT of an inner query is a number above 0 there", query.limit.span)


def _build_sort_columns(query: plan.Query, select: exp.Select) -> list[Node]:
    """What sorts the rows of a SELECT, ascending; with ORDER BY it is their number."""
    order = select.args.get("order")
    if order is None:
        return []
    number: Node = exp.Window(this=exp.RowNumber(), order=order.copy())
    return [number] if query.order else [ordered.this.copy() for ordered in order.expressions]


def _drop_constant_keys(order: list[tuple[Node, bool]]) -> list[tuple[Node, bool]]:
    """The keys without those that are constant, and sort nothing."""
    return [(key, descending) for key, descending in order if key.find(exp.Column, exp.AggFunc)]

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

from ss2sql import plan
from ss2sql.kinds import Kind
from ss2sql.lowering import sql
from ss2sql.lowering.portable import forms
from ss2sql.lowering.portable.expressions import Node, Portable, Sight
from ss2sql.lowering.portable.names import Names
from ss2sql.lowering.portable.sources import NUMBER, Elsewhere, Opened, Opener, named
from ss2sql.lowering.portable.types import cast, column_type, refused, typed
from ss2sql.walk import walk


def write_flat(query: plan.Query, variable: Callable[[str], Any] | None = None) -> exp.Select:
    """The query as a SELECT of DuckDB. Raises UnsupportedError where it could mean something else.

    Args:
        query: a query without a search.
        variable: gives the values of script variables; without it a query that reads one is refused.
    """
    portable = Grouping(variable)
    limit = None if query.limit is None else portable.value(query.limit, Sight())
    return FlatWriter(query, portable, Elsewhere(query, portable).open).select(limit)


class Grouping(Portable):
    """The expressions of a query that may have aggregates, whose arguments are seen as its rows are."""

    def value(self, expr: plan.Expr, sight: Sight) -> Node:
        return self._aggregate(expr, sight) if isinstance(expr, plan.Aggregate) else super().value(expr, sight)

    def _aggregate(self, expr: plan.Aggregate, sight: Sight) -> Node:
        if expr.argument is None:
            return exp.Count(this=exp.Star())
        node = forms.aggregated(expr, self.value(expr.argument, sight))
        if node is not None:
            return node
        raise refused(f"{expr.function} of such values is not the same everywhere", expr.span)


class FlatWriter:
    """Writes one query, whose sources `open` brings into its FROM."""

    def __init__(self, query: plan.Query, portable: Portable, open: Opener) -> None:
        assert query.search is None
        self.query, self.portable, self.open = query, portable, open
        self.labels, self.sight = Names(), Sight()
        self.items: list[Node] = []
        self.places: list[Node] = []  # what sorts the sources

    def select(self, limit: Node | None) -> exp.Select:
        query = self.query
        if query.offset is not None:
            raise refused("OFFSET", query.offset.span, "leave the engine to ss2sql")
        for source in query.sources:
            self._open(source)
        where = None if query.where is None else self.portable.condition(query.where, self.sight)
        if query.aggregated:
            return self._grouped(where, limit)
        if query.group:
            raise refused("GROUP BY that makes parts is no SQL", query.group[0].span)
        outputs = [self._output(output, self.sight) for output in query.columns]
        order = [*self._order(self.sight), *((place.copy(), False) for place in self.places)]
        return sql.select(outputs, self.items, where, _sorting(order), limit)

    def _open(self, source: plan.Source) -> None:
        for node in walk(source):
            if isinstance(node, (plan.Element, plan.Column)) and node.source in self.sight.sources:
                raise refused("what stands in FROM depends on another source", source.span)
        if isinstance(source, plan.QuerySource) and source.optional:
            raise refused("LEFT JOIN", source.span, "leave the engine to ss2sql")
        label = self.labels.free(source.name, "source")
        opened = self._nested(source, label) if isinstance(source, plan.QuerySource) else self.open(source, label)
        self.items.append(opened.item)
        self.places += opened.places
        self.sight = self.sight.with_source(source.id, opened.read)

    def _nested(self, source: plan.QuerySource, label: str) -> Opened:
        """A query in FROM: its columns, and what sorts its rows as columns, too."""
        query = source.query
        if query.search is not None:
            raise refused("a search in FROM", source.span, "write it as a query of its own")
        one = query.representation.name == "list" and len(query.columns) == 1
        if not one and query.representation.name != "dict":
            raise refused("the elements of this query are no rows of columns", source.span)
        select = self.inner(query).select(limit_inside(query))
        names, found, outputs = Names(), dict[str | None, str](), list[Node]()
        for output, node in zip(query.columns, select.expressions, strict=True):
            name = names.free(output.name, "element")
            found[None if one else output.name] = name
            outputs.append(sql.alias(typed(node.unalias(), column_type(output.expr.type)), name))
        keys = _places(query, select)
        places = dict(zip((NUMBER, *(names.free(NUMBER, NUMBER) for _ in keys[1:])), keys, strict=False))
        select.set("expressions", [*(sql.alias(key, name) for name, key in places.items()), *outputs])
        if query.limit is None:
            select.set("order", None)
        sorting = tuple(sql.column(name, label) for name in places)
        return Opened(sql.derived(select, label), sorting, partial(named, label, found))

    def inner(self, query: plan.Query) -> FlatWriter:
        """What writes a query in FROM."""
        return FlatWriter(query, self.portable, Elsewhere(query, self.portable).open)

    def _output(self, output: plan.Output, sight: Sight) -> Node:
        if output.star or output.label is not None:
            raise refused("the names of these columns are not known", output.expr.span)
        return self._named(self.portable.value(output.expr, sight), output.name)

    def _named(self, node: Node, name: str) -> Node:
        return sql.alias(node, name)

    def _order(self, sight: Sight) -> list[tuple[Node, bool]]:
        return [(self.portable.value(key.expr, sight), key.descending) for key in self.query.order]

    # --- GROUP BY ----------------------------------------------------------------------------------------

    def _grouped(self, where: Node | None, limit: Node | None) -> exp.Select:
        """One row for each group, in the order in which the groups appear."""
        query = self.query
        keys = [self._key_of(key) for key in query.group]
        shown = [self._shown_key(key, expr) for key, expr in zip(keys, query.group, strict=True)]
        sight = replace(self.sight, groups={(query.id, n): key for n, key in enumerate(shown)})
        outputs = [self._output(output, sight) for output in query.columns]
        order = self._order(sight) + [(place, False) for place in self._first()] if keys else []
        select = sql.select(outputs, self.items, where, _sorting(order), limit)
        if keys:
            select.set("group", exp.Group(expressions=[key.copy() for key in keys]))
        if query.having is not None:
            if query.having.type.kinds != Kind.BOOL:
                raise refused("the truth of such a value is not the same everywhere", query.having.span)
            select.set("having", exp.Having(this=self.portable.value(query.having, sight)))
        return select

    def _first(self) -> list[Node]:
        """The place of the first row of a group."""
        if len(self.places) > 1:
            raise refused("groups of several sources have no order in SQL", self.query.group[0].span, "add ORDER BY")
        return [exp.Min(this=place.copy()) for place in self.places]

    def _shown_key(self, key: Node, expr: plan.Expr) -> Node:
        """The value of a group that is shown."""
        return key

    def _key_of(self, expr: plan.Expr) -> Node:
        """What is grouped by; a number alone would be the position of a column."""
        node, kind = self.portable.value(expr, self.sight), column_type(expr.type)
        return node if node.find(exp.Column) or kind is None else cast(node, kind)


def limit_inside(query: plan.Query) -> Node | None:
    """LIMIT of a query inside of another one, which is there however many rows the query around it asks for."""
    match query.limit:
        case None:
            return None
        case plan.Constant(value=int(most)) if most > 0:
            return sql.number(most)
    raise refused("LIMIT of an inner query is a number above 0 there", query.limit.span)


def _places(query: plan.Query, select: exp.Select) -> list[Node]:
    """What sorts the rows of a SELECT, ascending; with ORDER BY it is their number."""
    order = select.args.get("order")
    if order is None:
        return []
    number: Node = exp.Window(this=exp.RowNumber(), order=order.copy())
    return [number] if query.order else [ordered.this.copy() for ordered in order.expressions]


def _sorting(order: list[tuple[Node, bool]]) -> list[tuple[Node, bool]]:
    """The keys without those that are constant, and sort nothing."""
    return [(key, descending) for key, descending in order if key.find(exp.Column, exp.AggFunc)]

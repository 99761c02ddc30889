"""Queries that are no searches as one SELECT.

The rows of a list are written out with their number, tables are those of the same name. Rows come in the order of the
sources, as the language has it, so each source is sorted by its numbers or by the primary key of its table.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import partial
from typing import Any

from sqlglot import exp

from ss2sql import plan
from ss2sql.kinds import Kind, Type
from ss2sql.lowering import sql
from ss2sql.lowering.portable.expressions import Node, Portable, Sight, constant
from ss2sql.lowering.portable.names import Names
from ss2sql.lowering.portable.types import cast, column_type, is_nullable, refused
from ss2sql.walk import walk

MOST_ROWS = 1_000  # of a list that are written out
NUMBER = "nth"


def write_flat(query: plan.Query, variable: Callable[[str], Any] | None = None) -> exp.Select:
    """The query as a SELECT of DuckDB. Raises UnsupportedError where it could mean something else.

    Args:
        query: a query without a search.
        variable: gives the values of script variables; without it a query that reads one is refused.
    """
    return _Writer(query, variable).select()


class _Writer:
    def __init__(self, query: plan.Query, variable: Callable[[str], Any] | None) -> None:
        assert query.search is None
        self.query = query
        self.portable = Portable(variable)
        self.labels, self.sight = Names(), Sight()
        self.items: list[Node] = []
        self.places: list[Node] = []  # what sorts the sources

    def select(self) -> exp.Select:
        query = self.query
        for source in query.sources:
            self._open(source)
        where = None if query.where is None else self.portable.condition(query.where, self.sight)
        if query.aggregated:
            return self._grouped(where)
        if query.group:
            raise refused("GROUP BY that makes parts is no SQL", query.group[0].span)
        outputs = [self._output(output, self.sight) for output in query.columns]
        order = [(self.portable.value(key.expr, self.sight), key.descending) for key in query.order]
        order += [(place.copy(), False) for place in self.places]
        return _ended(sql.select(outputs, self.items, where), order, self._limit())

    def _output(self, output: plan.Output, sight: Sight) -> Node:
        if output.star or output.label is not None:
            raise refused("the names of these columns are not known", output.expr.span)
        return sql.alias(self._aggregated(output.expr, sight), output.name)

    def _limit(self) -> Node | None:
        return None if self.query.limit is None else self.portable.value(self.query.limit, Sight())

    # --- sources ---------------------------------------------------------------------------------------

    def _open(self, source: plan.Source) -> None:
        for node in walk(source):
            if isinstance(node, (plan.Element, plan.Column)) and node.source in self.sight.sources:
                raise refused("what stands in FROM depends on another source", source.span)
        label = self.labels.free(source.name, "source")
        match source:
            case plan.TableSource(table=table):
                self.items.append(sql.table(table, label))
                self.places += [sql.column(name, label) for name in self._key(source)]
                read = partial(_column, label)
            case plan.ValueSource():
                names = self._written_out(source, label)
                self.places.append(sql.column(NUMBER, label))
                read = partial(_named, label, names)
            case plan.QuerySource():
                raise refused("a query in FROM", source.span, "write it as a query of its own")
            case _:
                raise refused("worlds are read by Python", source.span)
        self.sight = self.sight.with_source(source.id, read)

    def _key(self, source: plan.TableSource) -> tuple[str, ...]:
        """The columns that sort the rows of a table: its primary key."""
        keys = (columns for columns, index in source.indexes if not index)
        order = next(keys, ()) if source.order == ("rowid",) else source.order
        nullable = {name for name, kind in source.columns if is_nullable(kind)}
        if not order or nullable.intersection(order):
            if self.query.order or self.query.aggregated:
                return ()
            reason = f"the rows of {source.table} have no order but that of SQLite"
            raise refused(reason, source.span, "give the table a primary key, or sort the rows")
        return order

    def _written_out(self, source: plan.ValueSource, label: str) -> dict[str | None, str]:
        """Adds the elements of a list as VALUES, and names the columns: None is the element itself."""
        elements = self._elements(source)
        columns: dict[str | None, Type] = {None: source.element}
        if source.element.kinds == Kind.DICT:
            columns = dict(source.columns or ())
        names = Names()
        found: dict[str | None, str] = {}
        kinds = {}
        for key, kind in columns.items():
            written = column_type(kind)
            if written is None:
                raise refused(f"the kind of {source.name if key is None else key} is not known", source.span)
            found[key] = names.free(source.name if key is None else key, "element")
            kinds[found[key]] = written
        rows = [exp.Tuple(expressions=[sql.number(n), *self._row(element, columns, source)]) for n, element in elements]
        alias = exp.TableAlias(this=sql.identifier("listed"), columns=[sql.identifier(n) for n in (NUMBER, *kinds)])
        values = exp.Values(expressions=rows, alias=alias)
        typed = [sql.column(NUMBER), *(sql.alias(cast(sql.column(name), kind), name) for name, kind in kinds.items())]
        if not rows:
            typed = [sql.alias(cast(sql.null(), kind), name) for name, kind in {NUMBER: "BIGINT", **kinds}.items()]
            self.items.append(sql.derived(exp.Select(expressions=typed).where(exp.false()), label))
        else:
            self.items.append(sql.derived(sql.select(typed, [values]), label))
        return found

    def _elements(self, source: plan.ValueSource) -> Iterable[tuple[int, Any]]:
        match source.value:
            case plan.Constant(value=list(elements)):
                pass
            case plan.Variable(name=name) if self.portable.variable is not None:
                elements = self.portable.known(name, source.span)
            case plan.MakeList(items=items) if all(isinstance(item, plan.Constant) for item in items):
                elements = [item.value for item in items if isinstance(item, plan.Constant)]
            case _:
                raise refused("this list is not known before the query runs", source.span)
        if not isinstance(elements, list) or len(elements) > MOST_ROWS:
            raise refused(f"only lists of up to {MOST_ROWS:,} elements are written out", source.span)
        return enumerate(elements)

    def _row(self, element: Any, columns: dict[str | None, Type], source: plan.ValueSource) -> Iterable[Node]:
        for key, kind in columns.items():
            value = element if key is None else element.get(key)
            yield constant(value, kind, source.value)

    # --- GROUP BY ----------------------------------------------------------------------------------------

    def _grouped(self, where: Node | None) -> exp.Select:
        """One row for each group, in the order in which the groups appear."""
        query = self.query
        keys = [self._key_of(key) for key in query.group]
        sight = replace(self.sight, groups={(query.id, n): key for n, key in enumerate(keys)})
        outputs = [self._output(output, sight) for output in query.columns]
        order = [(self._aggregated(key.expr, sight), key.descending) for key in query.order]
        if keys:
            if len(self.places) > 1:
                raise refused("groups of several sources have no order in SQL", query.group[0].span, "add ORDER BY")
            order += [(exp.Min(this=place.copy()), False) for place in self.places]
        select = sql.select(outputs, self.items, where)
        if keys:
            select.set("group", exp.Group(expressions=[key.copy() for key in keys]))
        if query.having is not None:
            if query.having.type.kinds != Kind.BOOL:
                raise refused("the truth of such a value is not the same everywhere", query.having.span)
            select.set("having", exp.Having(this=self._aggregated(query.having, sight)))
        return _ended(select, order, self._limit())

    def _key_of(self, expr: plan.Expr) -> Node:
        """What is grouped by; a number alone would be the position of a column."""
        node, kind = self.portable.value(expr, self.sight), column_type(expr.type)
        return node if node.find(exp.Column) or kind is None else cast(node, kind)

    def _aggregated(self, expr: plan.Expr, sight: Sight) -> Node:
        aggregates = {}
        for node in walk(expr):
            if isinstance(node, plan.Aggregate):
                aggregates[node] = self._aggregate(node, sight)
        return _WithAggregates(self.portable.variable, aggregates).value(expr, sight)

    def _aggregate(self, expr: plan.Aggregate, sight: Sight) -> Node:
        if expr.argument is None:
            return exp.Count(this=exp.Star())
        kind = expr.argument.type.kinds & ~Kind.NONE
        argument = self.portable.value(expr.argument, sight)
        match expr.function:
            case "count":
                return exp.Count(this=argument)
            case "min" | "max" if kind in (Kind.INT, Kind.STR):
                return (exp.Min if expr.function == "min" else exp.Max)(this=argument)
            case "sum" if kind == Kind.INT and expr.argument.type.bounded(2**31):
                total = cast(exp.Sum(this=argument), "BIGINT")
                return exp.Coalesce(this=total, expressions=[sql.number(0)])
        raise refused(f"{expr.function} of such values is not the same everywhere", expr.span)


class _WithAggregates(Portable):
    """The same where aggregates stand among the expressions."""

    def __init__(self, variable: Callable[[str], Any] | None, aggregates: dict[plan.Aggregate, Node]) -> None:
        super().__init__(variable)
        self.aggregates = aggregates

    def value(self, expr: plan.Expr, sight: Sight) -> Node:
        if isinstance(expr, plan.Aggregate):
            return self.aggregates[expr].copy()
        return super().value(expr, sight)


def _column(label: str, expr: plan.Element | plan.Column) -> Node:
    if isinstance(expr, plan.Element):
        raise refused("a whole row is a dict, which not every database has", expr.span)
    return sql.column(expr.name, label)


def _named(label: str, names: dict[str | None, str], expr: plan.Element | plan.Column) -> Node:
    name = names.get(expr.name if isinstance(expr, plan.Column) else None)
    if name is None:
        raise refused("a whole element is a dict, which not every database has", expr.span)
    return sql.column(name, label)


def _ended(select: exp.Select, order: list[tuple[Node, bool]], limit: Node | None) -> exp.Select:
    """With ORDER BY, in which None comes first and with DESC last, and LIMIT. What is constant sorts nothing."""
    keys = [
        exp.Ordered(this=key, desc=descending, nulls_first=not descending)
        for key, descending in order
        if key.find(exp.Column, exp.AggFunc)
    ]
    if keys:
        select.set("order", exp.Order(expressions=keys))
    if limit is not None:
        select.set("limit", exp.Limit(expression=limit))
    return select

"""Queries that are no searches as one SELECT: names of columns, what stands in FROM, and the clauses.

A source is sorted by its `places`, because SQL promises no order of rows.

Rows come in the order of the sources, as the language has it, so each source is sorted by its places. Groups come in
the order of their first rows.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, TypeAlias

import apsw
from sqlglot import exp

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Kind, Type
from ss2sql.language.plan_traversal import list_sources, walk
from ss2sql.lowering import sql_builder
from ss2sql.lowering.portable.portable_expressions import (
    Node,
    PortableExpressions,
    build_refusal,
    cast_literal,
    get_sql_column_type,
    is_nullable,
    lower_constant,
    write_cast,
)
from ss2sql.lowering.sql_query import choose_free_name
from ss2sql.lowering.sqlite_expressions import Reader, SqlScope

PLAIN_NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_]*\Z")
# What is reserved in SQLite, and beside it in DuckDB, Spark and PostgreSQL.
_RESERVED_ELSEWHERE = (
    "analyse anti any array asymmetric at authorization binary both cast client column concurrently cube date "
    "describe false fetch for force freeze function grant ilike initially install interval lambda lateral leading "
    "leave localtime localtimestamp lock map merge minus native nothing only out overlaps percentile pivot placing "
    "position positional qualify range revoke rollup semi session_user show similar some struct summarize symmetric "
    "system table tablesample time timestamp top trailing true try_cast unique unknown unpivot user using values "
    "variable variadic verbose window within"
)
RESERVED = frozenset(word.lower() for word in apsw.keywords).union(_RESERVED_ELSEWHERE.split())
OWN_COLUMNS = (
    *("step", "parent", "place", "depth", "goal", "goes_on", "nth", "previous", "distance", "total"),
    *("trail", "flags", "nth_to_row", "part", "nth_of_part"),
)


class ColumnNames:
    """The names of the columns of some tables."""

    def __init__(self) -> None:
        self.taken = set(OWN_COLUMNS)

    def claim(self, wanted: str, otherwise: str) -> str:
        """The wanted name where it can stand without quotes and is not taken, which goes without case; else another."""
        return choose_free_name(wanted.lower() if is_plain_name(wanted) else otherwise, self.taken)


def is_plain_name(name: str) -> bool:
    """Whether the name can stand without quotes in every database."""
    return bool(PLAIN_NAME.match(name)) and name.isascii() and name.lower() not in RESERVED


# --- what stands in FROM: tables of the same name, lists written out row by row, and what the database is given
MAX_WRITTEN_ROWS = 1_000  # of a list that are written out
NUMBER_COLUMN = "nth"


@dataclass(frozen=True, slots=True)
class PortableSource:
    """A source: what stands in FROM, what sorts its rows, and how its columns are read."""

    item: Node
    places: tuple[Node, ...]
    read: Reader


# Opens a source under a label; raises UnsupportedError.
OpenSource: TypeAlias = Callable[[plan.Source, str], PortableSource]


class PortableSources:
    """Sources for a database that is not here: its tables have the names of SQLite's, lists are written out."""

    def __init__(self, query: plan.Query, portable: PortableExpressions) -> None:
        self.query, self.portable = query, portable

    def open_source(self, source: plan.Source, label: str) -> PortableSource:
        match source:
            case plan.TableSource(table=table):
                places = tuple(sql_builder.column(name, label) for name in self._choose_sort_columns(source))
                names = {name: name for name, _ in source.columns}
                return PortableSource(sql_builder.table(table, label), places, partial(build_sql_column, label, names))
            case plan.ValueSource():
                return write_values(source, label, self._list_elements(source))
            case _:
                raise build_refusal("worlds are read by Python", source.span)

    def _choose_sort_columns(self, source: plan.TableSource) -> tuple[str, ...]:
        """The columns that sort the rows of a table: its primary key."""
        keys = (columns for columns, index in source.indexes if not index)
        order = next(keys, ()) if source.order == ("rowid",) else source.order
        unlike = {name for name, kind in source.columns if is_nullable(kind)} | set(source.collated)
        if not order or unlike.intersection(order):
            if self.query.order or self._is_one_group:
                return ()
            reason = f"the rows of {source.table} have no order but that of SQLite"
            raise build_refusal(reason, source.span, "give the table a primary key, or sort the rows")
        return order

    @property
    def _is_one_group(self) -> bool:
        """Whether there is one group at the most, whatever the rows are: it needs no order."""
        return self.query.aggregated and not any(map(list_sources, self.query.group))

    def _list_elements(self, source: plan.ValueSource) -> Iterable[tuple[int, Any]]:
        value = source.value
        if isinstance(value, plan.Variable) and self.portable.variable is not None:
            elements = self.portable.get_constant(value.name, source.span)
        else:
            elements = get_literal_elements(value)
            if elements is None:
                raise build_refusal("this list is not known before the query runs", source.span)
        if not isinstance(elements, list) or len(elements) > MAX_WRITTEN_ROWS:
            raise build_refusal(f"only lists of up to {MAX_WRITTEN_ROWS:,} elements are written out", source.span)
        return enumerate(elements)


def get_literal_elements(value: plan.Expr) -> list[Any] | None:
    """The elements of a list that the script spells out."""
    return value.value if isinstance(value, plan.Constant) and isinstance(value.value, list) else None


def get_portable_columns(source: plan.ValueSource) -> dict[str | None, Type]:
    """The columns of the elements with their types; None is the element itself."""
    return dict(source.columns or ()) if source.element.kinds == Kind.DICT else {None: source.element}


def write_values(source: plan.ValueSource, label: str, elements: Iterable[tuple[int, Any]]) -> PortableSource:
    """The numbered elements of a list as VALUES."""
    columns = get_portable_columns(source)
    names, found, kinds = ColumnNames(), dict[str | None, str](), dict[str, str]()
    for key, kind in columns.items():
        written = get_sql_column_type(kind)
        if written is None:
            raise build_refusal(f"the kind of {source.name if key is None else key} is not known", source.span)
        found[key] = names.claim(source.name if key is None else key, "element")
        kinds[found[key]] = written
    rows = [exp.Tuple(expressions=[sql_builder.number(n), *_lower_row(e, columns, source)]) for n, e in elements]
    alias = exp.TableAlias(
        this=sql_builder.identifier("listed"), columns=[sql_builder.identifier(n) for n in (NUMBER_COLUMN, *kinds)]
    )
    values = exp.Values(expressions=rows, alias=alias)
    typed = [
        sql_builder.column(NUMBER_COLUMN),
        *(sql_builder.alias(write_cast(sql_builder.column(name), kind), name) for name, kind in kinds.items()),
    ]
    select = sql_builder.select(typed, [values])
    if not rows:
        typed = [
            sql_builder.alias(write_cast(sql_builder.null(), kind), name)
            for name, kind in {NUMBER_COLUMN: "BIGINT", **kinds}.items()
        ]
        select = exp.Select(expressions=typed).where(exp.false())
    return PortableSource(
        sql_builder.derived(select, label),
        (sql_builder.column(NUMBER_COLUMN, label),),
        partial(build_sql_column, label, found),
    )


def _lower_row(element: Any, columns: dict[str | None, Type], source: plan.ValueSource) -> list[Node]:
    values = [element if key is None else element.get(key) for key in columns]
    return [lower_constant(value, kind, source.value) for value, kind in zip(values, columns.values(), strict=True)]


def build_sql_column(label: str, names: Mapping[Any, str], expr: plan.Element | plan.Column) -> Node:
    """A column by its name in SQL."""
    return sql_builder.column(names[expr.name if isinstance(expr, plan.Column) else None], label)


# --- queries that are no searches as one SELECT
def write_flat(query: plan.Query, variable: Callable[[str], Any] | None = None) -> exp.Select:
    """The query as a SELECT of DuckDB. Raises UnsupportedError where it could mean something else.

    Args:
        query: a query without a search.
        variable: gives the values of script variables; without it a query that reads one is refused.
    """
    portable = PortableExpressions(variable)
    limit = None if query.limit is None else portable.lower_expr(query.limit, SqlScope())
    return FlatWriter(query, portable, PortableSources(query, portable).open_source).write_select(limit)


class FlatWriter:
    """Writes one query, whose sources `open` brings into its FROM."""

    def __init__(self, query: plan.Query, portable: PortableExpressions, open: OpenSource) -> None:
        assert query.search is None
        self.query, self.portable, self.open = query, portable, open
        self.labels, self.name_scope = ColumnNames(), SqlScope()
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
            outputs.append(sql_builder.alias(cast_literal(node.unalias(), get_sql_column_type(output.expr.type)), name))
        keys = _build_sort_columns(query, select)
        places = dict(
            zip((NUMBER_COLUMN, *(names.claim(NUMBER_COLUMN, NUMBER_COLUMN) for _ in keys[1:])), keys, strict=False)
        )
        select.set("expressions", [*(sql_builder.alias(key, name) for name, key in places.items()), *outputs])
        if query.limit is None:
            select.set("order", None)
        sorting = tuple(sql_builder.column(name, label) for name in places)
        return PortableSource(sql_builder.derived(select, label), sorting, partial(build_sql_column, label, found))

    def make_inner_writer(self, query: plan.Query) -> FlatWriter:
        """What writes a query in FROM."""
        return FlatWriter(query, self.portable, PortableSources(query, self.portable).open_source)

    def _write_output(self, output: plan.Output, scope: SqlScope) -> Node:
        if output.star or output.label is not None:
            raise build_refusal("the names of these columns are not known", output.expr.span)
        return self._write_alias(self.portable.lower_expr(output.expr, scope), output.name)

    def _write_alias(self, node: Node, name: str) -> Node:
        return sql_builder.alias(node, name)

    def _write_order(self, scope: SqlScope) -> list[tuple[Node, bool]]:
        return [(self.portable.lower_expr(key.expr, scope), key.descending) for key in self.query.order]

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
            select.set("having", exp.Having(this=self.portable.lower_expr(query.having, scope)))
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
        node, kind = self.portable.lower_expr(expr, self.name_scope), get_sql_column_type(expr.type)
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

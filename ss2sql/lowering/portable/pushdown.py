"""Queries that are no searches for a database that runs them here: its own tables, and others that it is given.

What `portable_flat.py` refuses to other databases has an order here, because every row of a source has a number.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import field
from functools import partial
from typing import Any

from sqlglot import exp

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import FLOAT, Kind, Type
from ss2sql.language.operations import GROUPS, OPERATIONS
from ss2sql.language.operations.operation import remove_none_kind
from ss2sql.language.plan_traversal import list_inside, list_sources
from ss2sql.language.rows import make_unique_name
from ss2sql.lowering import sql_builder
from ss2sql.lowering.guards import is_free
from ss2sql.lowering.portable.portable_expressions import (
    Node,
    PortableExpressions,
    build_refusal,
    get_sql_column_type,
    is_exact_as_float,
    is_nullable,
    write_cast,
)
from ss2sql.lowering.portable.portable_flat import (
    NUMBER_COLUMN,
    ColumnNames,
    FlatWriter,
    OpenSource,
    PortableSource,
    get_literal_elements,
    get_portable_columns,
    is_plain_name,
    write_inner_limit,
    write_values,
)
from ss2sql.lowering.sqlite_expressions import SqlScope

# Begins the names of all that the database is given: nothing that a view of the user's reads is called so.
FUNCTION_PREFIX = "ss2sql_"
# For the aggregates of floats: macros of the database's own compensated sums, and functions of a list of all values.
SUMMED_AGGREGATES = {name: f"{FUNCTION_PREFIX}{name}" for name in ("sum", "average")}
LISTED_AGGREGATES = {
    name: f"{FUNCTION_PREFIX}{name}"
    for name, row in GROUPS.items()
    if not row.portable and row.result(FLOAT).is_only(Kind.FLOAT | Kind.NONE)
}
LIMIT_PARAMETER = "limit"  # has the value of LIMIT: no variable is called as a keyword
MAX_WRITTEN_ROWS = 100  # elements of a list that the script spells out


@dataclass(frozen=True, slots=True)
class ExternalTable:
    """A table of the database itself: what stands in FROM, the column that numbers its rows, and its columns.

    A column is None where only Python can make a value of the language of it. Those of one `shape` are written alike.
    """

    item: Node
    number: str
    columns: Mapping[str, Node | None]
    shape: tuple[Hashable, ...]


@dataclass(frozen=True, slots=True)
class LoadedTable:
    """A table that is made of the elements of a value, with a number: of each column its name in SQL and its type.

    The column None is the element itself.
    """

    name: str
    value: plan.Expr
    columns: dict[str | None, tuple[str, Type]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class PushdownQuery:
    """A query as a SELECT, the tables that it is given, and by parameters the script variables that are bound in it.

    `functions` are those of Python that it calls: of each its call in the plan, None for an aggregate of floats.
    """

    select: exp.Select
    loaded: tuple[LoadedTable, ...]
    parameters: Mapping[str, str]
    functions: Mapping[str, plan.Call | None]


def write_pushdown(query: plan.Query, outside: Callable[[plan.ValueSource], ExternalTable | None]) -> PushdownQuery:
    """The query for a database that runs it here. Raises UnsupportedError where it could mean something else.

    Args:
        query: a query without a search.
        outside: finds the table of the database that a source is, if it is one.
    """
    sources = _PortableSourceWriter(outside)
    portable = _ExactSqlExpressions()
    select = _PushdownWriter(query, portable, sources.open_source).write_select(_write_limit(query.limit))
    # Keys of ORDER BY that sort nothing are left out, and so are parameters that only they have.
    bound = {node.this for node in select.find_all(exp.Placeholder)}
    parameters = {label: name for label, name in portable.parameters.items() if label in bound}
    return PushdownQuery(select, tuple(sources.loaded), parameters, portable.functions)


def lower_table_pushdown(
    outside: ExternalTable, source: plan.ValueSource, conditions: Sequence[plan.Expr], variable: Callable[[str], Any]
) -> ExternalTable:
    """A table with the rows that keep all conditions. Raises UnsupportedError where these could mean something else.

    Args:
        outside: the table.
        source: reads it; the conditions speak of nothing else.
        conditions: of its rows, none of which can fail.
        variable: gives the values of script variables.
    """
    label = "kept"
    scope = SqlScope().with_source(source.id, partial(_read_sql_column, label, outside.columns, source.name))
    portable = PortableExpressions(variable)
    where = sql_builder.conjunction([portable.lower_condition(condition, scope) for condition in conditions])
    number = choose_sql_number_column(outside.columns)
    numbered = exp.Alias(this=_build_sql_column(outside.number, label), alias=quote_sql_identifier(number))
    every = exp.Column(this=exp.Star(), table=quote_sql_identifier(label))
    select = sql_builder.select([every, numbered], [_add_sql_alias(outside.item, label)], where)
    return ExternalTable(exp.Subquery(this=select), number, outside.columns, (*outside.shape, select.sql("duckdb")))


def choose_sql_number_column(columns: Iterable[str]) -> str:
    """A name for the numbers of rows that no column has."""
    return make_unique_name(NUMBER_COLUMN, {name.lower() for name in columns})


def _write_limit(limit: plan.Expr | None) -> Node | None:
    if isinstance(limit, plan.Constant) and type(limit.value) is int:
        return sql_builder.number(limit.value)
    return None if limit is None else write_cast(sql_builder.parameter(LIMIT_PARAMETER), "BIGINT")


class _PortableSourceWriter:
    """Opens the sources of one query."""

    def __init__(self, outside: Callable[[plan.ValueSource], ExternalTable | None]) -> None:
        self.outside = outside
        self.loaded: list[LoadedTable] = []
        self.names = ColumnNames()
        self.count = 0

    def open_source(self, source: plan.Source, label: str) -> PortableSource:
        self.count += 1
        match source:
            case plan.TableSource(table=table):
                raise build_refusal(f"{table} is a table of SQLite", source.span)
            case plan.WorldSource():
                raise build_refusal("worlds are read by Python", source.span)
        assert isinstance(source, plan.ValueSource), "queries in FROM have sources of their own"
        known = self.outside(source)
        if known is not None:
            read = partial(_read_sql_column, label, known.columns, source.name)
            return PortableSource(_add_sql_alias(known.item, label), (_build_sql_column(known.number, label),), read)
        spelt = get_literal_elements(source.value)
        if spelt is not None and len(spelt) <= MAX_WRITTEN_ROWS:
            return write_values(source, label, enumerate(spelt))
        if self.count > 1 and not is_free(source.value):
            raise build_refusal("the sources before decide whether this is evaluated, and it may fail", source.span)
        return self._load_source(source, label)

    def _load_source(self, source: plan.ValueSource, label: str) -> PortableSource:
        table = LoadedTable(
            self.names.claim(f"{FUNCTION_PREFIX}{source.name}", f"{FUNCTION_PREFIX}source"), source.value
        )
        self.loaded.append(table)
        kinds, names = get_portable_columns(source), ColumnNames()

        def read_column(expr: plan.Element | plan.Column) -> Node:
            key = expr.name if isinstance(expr, plan.Column) else None
            if get_sql_column_type(kinds[key]) is None:
                raise build_refusal(f"the kind of {source.name if key is None else key} is not known", expr.span)
            if key not in table.columns:
                table.columns[key] = (names.claim(source.name if key is None else key, "element"), kinds[key])
            return sql_builder.column(table.columns[key][0], label)

        return PortableSource(
            sql_builder.table(table.name, label), (sql_builder.column(NUMBER_COLUMN, label),), read_column
        )


class _ExactSqlExpressions(PortableExpressions):
    """Aggregates of floats: rounded once, whatever the order, and the first of two that are equal.

    `places` sort the sources of the query that `writer` writes. Built-in functions that have no form are called in
    Python, which costs a microsecond or two.
    """

    places: list[Node]
    writer: FlatWriter

    def __init__(self) -> None:
        super().__init__()
        self.names = ColumnNames()
        self.functions: dict[str, plan.Call | None] = {}

    def name_parameter(self, name: str) -> str:
        return self.names.claim(name, "value")

    def lower_query(self, expr: plan.Expr, scope: SqlScope) -> Node:
        if isinstance(expr, plan.Subquery) and _has_one_row(expr.query):
            return exp.Subquery(this=self.write_rows(expr.query))
        return super().lower_query(expr, scope)

    def write_rows(self, query: plan.Query) -> Node:
        if len(query.columns) > 1 or query.search is not None:
            raise build_refusal("the elements of this query are no single values", query.span)
        if list_sources(query) - list_inside(query):
            raise build_refusal("this query reads the row around it", query.span)
        select = self.writer.make_inner_writer(query).write_select(write_inner_limit(query))
        if query.limit is None:
            select.set("order", None)
        return select

    def call_function(self, expr: plan.Call, scope: SqlScope) -> Node | None:
        """The call of the function itself, where all its values have types in the database."""
        name = expr.function.name
        row, kinds = OPERATIONS[name], [get_sql_column_type(one.type) for one in expr.arguments]
        if row.value is None or row.volatility != "immutable" or None in kinds or not kinds:
            return None
        known = (
            other for other, call in self.functions.items() if call is not None and _is_same_sql_function(call, expr)
        )
        function = next(known, None) or self.names.claim(f"{FUNCTION_PREFIX}{name}", name)
        self.functions[function] = expr
        return exp.Anonymous(this=function, expressions=[self.lower_expr(one, scope) for one in expr.arguments])

    def write_aggregate(self, expr: plan.Aggregate, argument: Node) -> Node:
        assert expr.argument is not None
        nullable, kind = is_nullable(expr.argument.type), remove_none_kind(expr.argument.type)
        floats = kind.kinds == Kind.FLOAT
        if floats or _gives_float_only(expr, kind):
            value = argument if floats else write_cast(argument, "DOUBLE")
            if function := SUMMED_AGGREGATES.get(expr.function):
                return self._call_aggregate(function, value)
            if function := LISTED_AGGREGATES.get(expr.function):
                return self._call_aggregate(function, _write_list(value, nullable))
        if expr.function in ("min", "max") and floats:
            return self._write_extreme(expr, argument, kind)
        return super().write_aggregate(expr, argument)

    def _call_aggregate(self, function: str, argument: Node) -> Node:
        self.functions[function] = None
        return exp.Anonymous(this=function, expressions=[argument])

    def _write_extreme(self, expr: plan.Aggregate, node: Node, kind: Type) -> Node:
        """`min` or `max`."""
        found = (exp.Min if expr.function == "min" else exp.Max)(this=node)
        if (kind.low is not None and kind.low > 0) or (kind.high is not None and kind.high < 0):
            return found
        # 0.0 and -0.0 are equal; the first of them counts.
        zero = sql_builder.binary(exp.EQ, node.copy(), sql_builder.number(0))
        first = exp.Filter(this=self.take_first(node.copy()), expression=exp.Where(this=zero))
        nonzero = exp.Anonymous(this="NULLIF", expressions=[found, sql_builder.number(0)])
        return exp.Coalesce(this=nonzero, expressions=[first])

    def take_first(self, node: Node) -> Node:
        """The value in the first row of a group."""
        return exp.ArgMin(this=node, expression=_write_row_order(self.places))


def _write_list(node: Node, nullable: bool) -> Node:
    """The values of a group as a list, without NULL."""
    values: Node = exp.Anonymous(this="LIST", expressions=[node])
    if not nullable:
        return values
    present = exp.Not(this=exp.Is(this=sql_builder.wrap_operand(node.copy()), expression=exp.Null()))
    return exp.Filter(this=values, expression=exp.Where(this=present))


def _is_same_sql_function(one: plan.Call, other: plan.Call) -> bool:
    """Whether two calls are those of one function in the database."""
    kinds = [[get_sql_column_type(part.type) for part in (call, *call.arguments)] for call in (one, other)]
    return one.function.name == other.function.name and kinds[0] == kinds[1]


def _has_one_row(query: plan.Query) -> bool:
    """Whether the value of a query is that of its only row, or of none."""
    whole = query.aggregated and not query.group
    first = isinstance(query.limit, plan.Constant) and query.limit.value == 1
    return query.representation.name == "value" and (whole or first)


def _gives_float_only(expr: plan.Aggregate, kind: Type) -> bool:
    """Whether integers, which are floats as well, make a float for which there is no form."""
    row = GROUPS[expr.function]
    known = any(form.when([kind]) for form in row.portable)
    return not known and is_exact_as_float(kind) and not row.result(kind).may_be(Kind.INT)


class _PushdownWriter(FlatWriter):
    """Writes one query: columns have names of the script where these are plain, groups have an order."""

    portable: _ExactSqlExpressions

    def __init__(self, query: plan.Query, portable: _ExactSqlExpressions, open: OpenSource) -> None:
        super().__init__(query, portable, open)
        portable.places, portable.writer = self.places, self

    def make_inner_writer(self, query: plan.Query) -> FlatWriter:
        return _PushdownWriter(query, copy(self.portable), self.open)

    def _write_alias(self, node: Node, name: str) -> Node:
        return super()._write_alias(node, name) if is_plain_name(name) else node

    def _write_group_order(self) -> list[Node]:
        return [exp.Min(this=_write_row_order(self.places))]

    def _write_group_value(self, key: Node, expr: plan.Expr) -> Node:
        # Of 0.0 and -0.0, which are equal, the first is shown.
        return self.portable.take_first(key.copy()) if expr.type.may_be(Kind.FLOAT) else key


def _write_row_order(places: list[Node]) -> Node:
    """What sorts rows as the product of the sources does.

    Two numbers become one, which DuckDB compares twice as fast as a row of both.
    """
    copies = [place.copy() for place in places]
    if len(copies) == 1:
        return copies[0]
    if len(copies) > 2:
        return exp.Anonymous(this="ROW", expressions=copies)
    high = exp.BitwiseLeftShift(this=write_cast(copies[0], "HUGEINT"), expression=sql_builder.number(64))
    return exp.BitwiseOr(this=exp.Paren(this=high), expression=copies[1])


def _build_sql_column(name: str, label: str) -> exp.Column:
    return exp.Column(this=quote_sql_identifier(name), table=quote_sql_identifier(label))


def quote_sql_identifier(name: str) -> exp.Identifier:
    """A name of the user's, in quotes where any database could take it for something else."""
    return exp.Identifier(this=name, quoted=not is_plain_name(name))


def _add_sql_alias(item: Node, label: str) -> Node:
    labelled = item.copy()
    labelled.set("alias", exp.TableAlias(this=quote_sql_identifier(label)))
    return labelled


def _read_sql_column(
    label: str, columns: Mapping[str, Node | None], owner: str, expr: plan.Element | plan.Column
) -> Node:
    """The value of a column, which is read from the label."""
    assert isinstance(expr, plan.Column), "a whole row is a dict, which has no type there"
    node = columns.get(expr.name)
    if node is None:
        raise build_refusal(f"the values of {owner}.{expr.name} are made in Python", expr.span)
    read = node.copy()
    for column in read.find_all(exp.Column):
        column.set("table", quote_sql_identifier(label))
    return read

"""Queries that are no searches for a database that runs them here: its own tables, and others that it is given.

What `flat.py` refuses to other databases has an order here, because every row of a source has a number.
"""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterable, Mapping, Sequence
from copy import copy
from dataclasses import field
from functools import partial
from typing import Any

from sqlglot import exp

from ss2sql import plan
from ss2sql.kinds import Kind, Type
from ss2sql.language.operations import GROUPS, OPERATIONS
from ss2sql.language.operations.row import without_none
from ss2sql.lowering import sql
from ss2sql.lowering.portable.expressions import Node, Portable, Sight
from ss2sql.lowering.portable.flat import FlatWriter, Grouping, limit_inside
from ss2sql.lowering.portable.names import Names, plain
from ss2sql.lowering.portable.sources import NUMBER, Opened, Opener, columns_of, listed, written_out
from ss2sql.lowering.portable.types import cast, column_type, is_nullable, is_real, refused
from ss2sql.records import dataclass
from ss2sql.runtime.rows import free_name
from ss2sql.walk import can_fail

# Begins the names of all that the database is given: nothing that a view of the user's reads is called so.
PREFIX = "ss2sql_"
# Functions that the database is given, for the aggregates of floats: they take all values of a group as a list.
EXACT = {name: f"{PREFIX}{name}" for name, row in GROUPS.items() if row.of_floats is not None}
LIMIT = "most_rows"  # the parameter that has the value of LIMIT
WRITTEN_OUT = 100  # elements of a list that the script spells out


@dataclass(frozen=True, slots=True)
class Outside:
    """A table of the database itself: what stands in FROM, the column that numbers its rows, and its columns.

    A column is None where only Python can make a value of the language of it. Those of one `shape` are
    written alike.
    """

    item: Node
    number: str
    columns: Mapping[str, Node | None]
    shape: tuple[Hashable, ...]


@dataclass(frozen=True, slots=True)
class Loaded:
    """A table that is made of the elements of a value, with a number: of each column its name in SQL and its type.

    The column None is the element itself.
    """

    name: str
    value: plan.Expr
    columns: dict[str | None, tuple[str, Type]] = field(default_factory=dict)


@dataclass(frozen=True, slots=True)
class WrittenHere:
    """A query as a SELECT, the tables that it is given, and by parameters the script variables that are bound in it.

    `functions` are those of Python that it calls: of each its call in the plan, None for those of EXACT.
    """

    select: exp.Select
    loaded: tuple[Loaded, ...]
    parameters: Mapping[str, str]
    functions: Mapping[str, plan.Call | None]


def write_here(query: plan.Query, outside: Callable[[plan.ValueSource], Outside | None]) -> WrittenHere:
    """The query for a database that runs it here. Raises UnsupportedError where it could mean something else.

    Args:
        query: a query without a search.
        outside: finds the table of the database that a source is, if it is one.
    """
    sources = _Sources(outside)
    portable = _Exact()
    select = _Writer(query, portable, sources.open).select(_limit(query.limit))
    # Keys of ORDER BY that sort nothing are left out, and so are parameters that only they have.
    bound = {node.this for node in select.find_all(exp.Placeholder)}
    parameters = {label: name for label, name in portable.parameters.items() if label in bound}
    return WrittenHere(select, tuple(sources.loaded), parameters, portable.functions)


def narrowed(
    outside: Outside,
    source: plan.ValueSource,
    conditions: Sequence[plan.Expr],
    variable: Callable[[str], Any],
) -> Outside:
    """A table with those rows alone that keep all conditions. Raises UnsupportedError where these could mean something
    else.

    Args:
        outside: the table.
        source: reads it; the conditions speak of nothing else.
        conditions: of its rows, none of which can fail.
        variable: gives the values of script variables.
    """
    label = "kept"
    sight = Sight().with_source(source.id, partial(_of_outside, label, outside.columns, source.name))
    where = _all(conditions, variable, sight)
    number = number_of(outside.columns)
    numbered = exp.Alias(this=_column(outside.number, label), alias=identifier(number))
    every = exp.Column(this=exp.Star(), table=identifier(label))
    select = sql.select([every, numbered], [_labelled(outside.item, label)], where)
    return Outside(exp.Subquery(this=select), number, outside.columns, (*outside.shape, select.sql("duckdb")))


def joined(
    tables: Sequence[tuple[plan.ValueSource, Outside]],
    names: Mapping[tuple[int, str], str],
    conditions: Sequence[plan.Expr],
    variable: Callable[[str], Any],
) -> exp.Select:
    """The rows of the product of tables that keep all conditions, in its order. Raises UnsupportedError as `narrowed`.

    Args:
        tables: what reads each table, and the table.
        names: under which names to give the columns of sources.
        conditions: of the rows of the product, none of which can fail.
        variable: gives the values of script variables.
    """
    labels, sight, label_of = Names(), Sight(), dict[int, str]()
    items, places = list[Node](), list[Node]()
    for source, outside in tables:
        label = label_of[source.id] = labels.free(source.name, "source")
        items.append(_labelled(outside.item, label))
        places.append(_column(outside.number, label))
        sight = sight.with_source(source.id, partial(_of_outside, label, outside.columns, source.name))
    outputs = [sql.alias(_column(name, label_of[source]), new) for (source, name), new in names.items()]
    where = _all(conditions, variable, sight)
    return sql.select(outputs, items, where, [(place, False) for place in places])


def _all(conditions: Sequence[plan.Expr], variable: Callable[[str], Any], sight: Sight) -> Node | None:
    portable = Portable(variable)
    return sql.conjunction([portable.condition(condition, sight) for condition in conditions])


def number_of(columns: Iterable[str]) -> str:
    """A name for the numbers of rows that no column has."""
    return free_name(NUMBER, {name.lower() for name in columns})


def _limit(limit: plan.Expr | None) -> Node | None:
    if isinstance(limit, plan.Constant) and type(limit.value) is int:
        return sql.number(limit.value)
    return None if limit is None else cast(sql.parameter(LIMIT), "BIGINT")


class _Sources:
    """Opens the sources of one query."""

    def __init__(self, outside: Callable[[plan.ValueSource], Outside | None]) -> None:
        self.outside = outside
        self.loaded: list[Loaded] = []
        self.names = Names()
        self.count = 0

    def open(self, source: plan.Source, label: str) -> Opened:
        self.count += 1
        match source:
            case plan.TableSource(table=table):
                raise refused(f"{table} is a table of SQLite", source.span)
            case plan.WorldSource():
                raise refused("worlds are read by Python", source.span)
        assert isinstance(source, plan.ValueSource), "queries in FROM have sources of their own"
        known = self.outside(source)
        if known is not None:
            read = partial(_of_outside, label, known.columns, source.name)
            return Opened(_labelled(known.item, label), (_column(known.number, label),), read)
        spelt = listed(source.value)
        if spelt is not None and len(spelt) <= WRITTEN_OUT:
            return written_out(source, label, enumerate(spelt))
        if self.count > 1 and can_fail(source.value):
            raise refused("the sources before decide whether this is evaluated, and it may fail", source.span)
        return self._load(source, label)

    def _load(self, source: plan.ValueSource, label: str) -> Opened:
        table = Loaded(self.names.free(f"{PREFIX}{source.name}", f"{PREFIX}source"), source.value)
        self.loaded.append(table)
        kinds, names = columns_of(source), Names()

        def read(expr: plan.Element | plan.Column) -> Node:
            key = expr.name if isinstance(expr, plan.Column) else None
            if column_type(kinds[key]) is None:
                raise refused(f"the kind of {source.name if key is None else key} is not known", expr.span)
            if key not in table.columns:
                table.columns[key] = (names.free(source.name if key is None else key, "element"), kinds[key])
            return sql.column(table.columns[key][0], label)

        return Opened(sql.table(table.name, label), (sql.column(NUMBER, label),), read)


class _Exact(Grouping):
    """Aggregates of floats: rounded once, whatever the order, and the first of two that are equal.

    `places` sort the sources of the query that `writer` writes. Built-in functions that have no form are called in
    Python, which costs a microsecond or two.
    """

    places: list[Node]
    writer: FlatWriter

    def __init__(self) -> None:
        super().__init__()
        self.names = Names()
        self.names.free(LIMIT, LIMIT)
        self.functions: dict[str, plan.Call | None] = {}

    def label(self, name: str) -> str:
        return self.names.free(name, "value")

    def value(self, expr: plan.Expr, sight: Sight) -> Node:
        if isinstance(expr, plan.Subquery) and _has_one_row(expr.query):
            return exp.Subquery(this=self.rows_of(expr.query))
        return super().value(expr, sight)

    def rows_of(self, query: plan.Query) -> Node:
        if len(query.columns) > 1 or query.search is not None:
            raise refused("the elements of this query are no single values", query.span)
        select = self.writer.inner(query).select(limit_inside(query))
        if query.limit is None:
            select.set("order", None)
        return select

    def of_python(self, expr: plan.Call, sight: Sight) -> Node | None:
        """The call of the function itself, where all its values have types in the database."""
        name = expr.function.name
        row, kinds = OPERATIONS[name], [column_type(one.type) for one in expr.arguments]
        if row.value is None or row.volatility != "immutable" or None in kinds or not kinds:
            return None
        known = (other for other, call in self.functions.items() if call is not None and _is_alike(call, expr))
        function = next(known, None) or self.names.free(f"{PREFIX}{name}", name)
        self.functions[function] = expr
        return exp.Anonymous(this=function, expressions=[self.value(one, sight) for one in expr.arguments])

    def _aggregate(self, expr: plan.Aggregate, sight: Sight) -> Node:
        argument = expr.argument
        if argument is None:
            return super()._aggregate(expr, sight)
        kind = without_none(argument.type)
        floats = kind.kinds == Kind.FLOAT
        if expr.function in EXACT and (floats or _gives_floats(expr, kind)):
            return self._exactly(EXACT[expr.function], argument, sight)
        if expr.function in ("min", "max") and floats:
            return self._extreme(expr, argument, sight)
        return super()._aggregate(expr, sight)

    def _exactly(self, function: str, argument: plan.Expr, sight: Sight) -> Node:
        self.functions[function] = None
        node = self.value(argument, sight)
        if not argument.type.may(Kind.FLOAT):
            node = cast(node, "DOUBLE")
        values: Node = exp.Anonymous(this="LIST", expressions=[node])
        if is_nullable(argument.type):
            present = exp.Not(this=exp.Is(this=sql.operand(node.copy()), expression=exp.Null()))
            values = exp.Filter(this=values, expression=exp.Where(this=present))
        return exp.Anonymous(this=function, expressions=[values])

    def _extreme(self, expr: plan.Aggregate, argument: plan.Expr, sight: Sight) -> Node:
        """`min` or `max`."""
        node, kind = self.value(argument, sight), argument.type
        found = (exp.Min if expr.function == "min" else exp.Max)(this=node)
        if (kind.low is not None and kind.low > 0) or (kind.high is not None and kind.high < 0):
            return found
        # 0.0 and -0.0 are equal; the first of them counts.
        zero = sql.binary(exp.EQ, node.copy(), sql.number(0))
        first = exp.Filter(this=self.first(node.copy()), expression=exp.Where(this=zero))
        nonzero = exp.Anonymous(this="NULLIF", expressions=[found, sql.number(0)])
        return exp.Coalesce(this=nonzero, expressions=[first])

    def first(self, node: Node) -> Node:
        """The value in the first row of a group."""
        return exp.ArgMin(this=node, expression=_in_order(self.places))


def _is_alike(one: plan.Call, other: plan.Call) -> bool:
    """Whether two calls are those of one function in the database."""
    kinds = [[column_type(part.type) for part in (call, *call.arguments)] for call in (one, other)]
    return one.function.name == other.function.name and kinds[0] == kinds[1]


def _has_one_row(query: plan.Query) -> bool:
    """Whether the value of a query is that of its only row, or of none."""
    whole = query.aggregated and not query.group
    first = isinstance(query.limit, plan.Constant) and query.limit.value == 1
    return query.representation.name == "value" and (whole or first)


def _gives_floats(expr: plan.Aggregate, kind: Type) -> bool:
    """Whether integers, which are floats as well, make a float for which there is no form."""
    row = GROUPS[expr.function]
    known = any(form.when([kind]) for form in row.portable)
    return not known and is_real(kind) and not row.result(kind).may(Kind.INT)


class _Writer(FlatWriter):
    """Writes one query: columns have names of the script where these are plain, groups have an order."""

    portable: _Exact

    def __init__(self, query: plan.Query, portable: _Exact, open: Opener) -> None:
        super().__init__(query, portable, open)
        portable.places, portable.writer = self.places, self

    def inner(self, query: plan.Query) -> FlatWriter:
        return _Writer(query, copy(self.portable), self.open)

    def _named(self, node: Node, name: str) -> Node:
        return super()._named(node, name) if plain(name) else node

    def _first(self) -> list[Node]:
        return [exp.Min(this=_in_order(self.places))]

    def _shown_key(self, key: Node, expr: plan.Expr) -> Node:
        # Of 0.0 and -0.0, which are equal, the first is shown.
        return self.portable.first(key.copy()) if expr.type.may(Kind.FLOAT) else key


def _in_order(places: list[Node]) -> Node:
    """What sorts rows as the product of the sources does."""
    copies = [place.copy() for place in places]
    return copies[0] if len(copies) == 1 else exp.Anonymous(this="ROW", expressions=copies)


def _column(name: str, label: str) -> exp.Column:
    return exp.Column(this=identifier(name), table=identifier(label))


def identifier(name: str) -> exp.Identifier:
    """A name of the user's, in quotes where any database could take it for something else."""
    return exp.Identifier(this=name, quoted=not plain(name))


def _labelled(item: Node, label: str) -> Node:
    labelled = item.copy()
    labelled.set("alias", exp.TableAlias(this=identifier(label)))
    return labelled


def _of_outside(label: str, columns: Mapping[str, Node | None], owner: str, expr: plan.Element | plan.Column) -> Node:
    """The value of a column, which is read from the label."""
    assert isinstance(expr, plan.Column), "a whole row is a dict, which has no type there"
    node = columns.get(expr.name)
    if node is None:
        raise refused(f"the values of {owner}.{expr.name} are made in Python", expr.span)
    read = node.copy()
    for column in read.find_all(exp.Column):
        column.set("table", identifier(label))
    return read

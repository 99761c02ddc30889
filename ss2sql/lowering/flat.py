"""Flat queries: FROM, WHERE, GROUP BY, ORDER BY and LIMIT, and queries nested in expressions; filters of tables."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import field, replace
from typing import Any

from sqlglot import exp

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Kind, Type, is_flag
from ss2sql.language.plan_traversal import join_conditions, list_sources, list_states, split_and, walk_own
from ss2sql.lowering import sql_builder
from ss2sql.lowering.evaluation_order import EvaluationOrder
from ss2sql.lowering.from_clause import FromItem, is_view, lower_numbered_rows, lower_sources
from ss2sql.lowering.guards import is_free
from ss2sql.lowering.join import JoinBuilder
from ss2sql.lowering.sql_builder import SQLITE, Node
from ss2sql.lowering.sql_query import SQLITE_FUNCTIONS, Parameter, can_be_literal, choose_sql_names
from ss2sql.lowering.sqlite_expressions import ExpressionLowering, SqlScope
from ss2sql.lowering.sqlite_forms import strip_numeric_affinity
from ss2sql.lowering.statement_needs import MaterializedTables, StatementNeeds, is_row_number, require_index

COLLECTORS = {
    "list": "collect",
    "rows": "collect_rows",
    "set": "collect_set",
    "value": "collect_value",
    "void": "collect_nothing",
}


def is_sortable(kind: Type) -> bool:
    """Whether SQLite's order of these values is the language's: numbers, or strings, or None among them."""
    plain = Kind.INT | Kind.FLOAT | Kind.NONE
    return is_flag(kind) or kind.is_only(plain) or kind.is_only(Kind.STR | Kind.NONE)


def can_sort_in_sql(query: plan.Query) -> bool:
    """Whether SQLite's order of all keys is the language's."""
    return all(is_sortable(key.expr.type) for key in query.order)


class FlatLowering:
    """Lowers flat queries of one statement, and queries nested in its expressions."""

    def __init__(self, needs: StatementNeeds) -> None:
        self.needs = needs
        self.expressions = ExpressionLowering(needs, self.lower_subquery, self.lower_unordered)
        self.tables: dict[str, plan.TableSource] = {}
        self.copies = MaterializedTables(needs)

    # --- parts -----------------------------------------------------------------------------------------

    def lower_where(self, where: plan.Expr | None, scope: SqlScope) -> list[Node]:
        """WHERE, which cannot fail, as conditions that all have to hold, in any order."""
        return [self.expressions.lower_condition(part, scope) for part in split_and(where)]

    def lower_from_and_where(self, query: plan.Query, scope: SqlScope, ordered: bool = True) -> JoinBuilder:
        """The product of the sources and its conditions; `ordered`: the order of the rows counts."""
        opened, inner = lower_sources(self, query.sources, scope)
        if ordered and _is_sorted_by_rows(query):
            query = self._number_rows(query, opened, inner)
        tables = any(isinstance(source, plan.TableSource) for source in _find_all_sources(query))
        disabled = self.needs.disabled
        may_hoist, may_look_up = "hoist" not in disabled and not tables, "lookup" not in disabled
        levels = EvaluationOrder(query, "early" not in disabled, may_hoist, may_look_up)
        return JoinBuilder(self, query, opened, inner, levels)

    def _number_rows(self, query: plan.Query, opened: list[FromItem], scope: SqlScope) -> plan.Query:
        """Numbers the rows of those `opened` that nothing sorts; gives the query without conditions on these alone."""
        where = split_and(query.where)
        for place, (part, source) in enumerate(zip(opened, query.sources, strict=True)):
            if not part.order:
                own = _find_row_conditions(source, where)
                nodes = [self.expressions.lower_condition(condition, scope) for condition in own]
                opened[place] = lower_numbered_rows(part, source, query, nodes)
                where = tuple(condition for condition in where if condition not in own)
        return replace(query, where=join_conditions(plan.And, where, query.span) if where else None)

    def lower_order(self, query: plan.Query, flat: JoinBuilder) -> list[tuple[Node, bool]]:
        """The keys of ORDER BY, which SQL can sort, then those of the product's own order."""
        if not query.order:
            if _is_sorted_product(query) and not flat.rows_sorted:
                return [(key, False) for key in flat.natural_order or ()]
            self._scan_in_order(flat)
            return []
        keys = [(self.expressions.lower_expr(key.expr, flat.scope), key.descending) for key in query.order]
        return keys + [(key, False) for key in flat.natural_order or ()]

    def _scan_in_order(self, flat: JoinBuilder) -> None:
        """Makes SQLite walk tables in their own order.

        Among virtual tables an ORDER BY would make it sort the whole product, and evaluate rows that a LIMIT cuts off.
        """
        copies = {*self.copies.tables, *self.needs.list_world_modules}
        copies |= {table.alias for table in self.needs.materialized_ctes.values()}
        for place, joined in enumerate(flat.items):
            item = joined.this if isinstance(joined, exp.Join) else joined
            if not isinstance(item, exp.Table) or isinstance(item.this, exp.Anonymous) or item.name in copies:
                continue
            source = self.tables[item.alias_or_name]
            if item.args.get("indexed"):  # an index that is named keeps the order
                continue
            if source.kept_by or is_row_number(source.order):
                require_index(item, source.kept_by)
            elif source.order:  # PRIMARY KEY (k DESC) of a table WITHOUT ROWID: no index has its order
                found = self.copies.copy_table(item, source)
                flat.items[place] = found if item is joined else exp.Join(**{**joined.args, "this": found})

    # --- grouped queries -------------------------------------------------------------------------------

    def lower_grouped(self, query: plan.Query, scope: SqlScope, names: list[str | None]) -> exp.Select:
        """One row per group, in order of first appearance."""
        flat = self.lower_from_and_where(query, scope)
        where = sql_builder.conjunction(flat.terms)
        first = flat.natural_order
        if (not query.group or (first is not None and len(first) == 1)) and not _needs_sql_row_inputs(query):
            keys = [self.expressions.lower_expr(key, flat.scope) for key in query.group]
            number = first[0] if query.group and first else sql_builder.null()
            return self._write_groups(query, flat.scope, flat.items, where, keys, number, names)
        return self._group_numbered(query, flat, where, names)

    def _group_numbered(
        self, query: plan.Query, flat: JoinBuilder, where: Node | None, names: list[str | None]
    ) -> exp.Select:
        """Groups of a product: its rows are numbered first, so that groups can be sorted by first appearance."""
        arguments = tuple(dict.fromkeys(lower_aggregate_inputs(query)))
        natural = flat.natural_order or []
        alone = len(natural) == 1
        number = natural[0] if alone else sql_builder.row_number([(key, False) for key in natural])
        inputs = lower_group_inputs(self, arguments, query.group, flat.scope, number)
        limit = sql_builder.build_sql_no_limit() if alone else None  # a window keeps a query apart, too
        inner = sql_builder.select(inputs, flat.items, where, (), limit)
        return self.group_numbered_rows(query, inner, arguments, flat.scope, names)

    def group_numbered_rows(
        self,
        query: plan.Query,
        inner: exp.Select,
        arguments: Sequence[plan.Expr],
        scope: SqlScope,
        names: list[str | None],
    ) -> exp.Select:
        """The groups of rows with the columns of the numbered product `inner`."""
        label = self.needs.choose_label("product")
        columns = [sql_builder.column(f"argument_{index}", label) for index, _ in enumerate(arguments, 1)]
        keys: list[Node] = [sql_builder.column(f"key_{index}", label) for index, _ in enumerate(query.group, 1)]
        known = [
            (node, self.expressions.write_aggregate(node, columns[arguments.index(node.argument)].copy()).copy)
            for node in _find_aggregates(query)
            if node.argument is not None
        ]
        rows = [sql_builder.derived(inner, label)]
        position = sql_builder.column("position", label)
        return self._write_groups(query, replace(scope, known=tuple(known)), rows, None, keys, position, names)

    def _write_groups(
        self,
        query: plan.Query,
        scope: SqlScope,
        items: Sequence[Node],
        where: Node | None,
        keys: list[Node],
        number: Node,
        names: list[str | None],
    ) -> exp.Select:
        """The groups of rows that FROM and WHERE give, by these keys; `number` numbers the rows."""
        scope = scope.with_groups({(query.id, index): key for index, key in enumerate(keys)})
        select = sql_builder.select(self.lower_columns(query, scope, names), items, where)
        if keys:
            select.set("group", exp.Group(expressions=[sql_builder.sort_key(key.copy()) for key in keys]))
        if query.having is not None:
            having = self.expressions.lower_condition(query.having, scope)
            select.set("having", exp.Having(this=having))
        if not query.group:
            return select
        order = [(self.expressions.lower_expr(key.expr, scope), key.descending) for key in query.order]
        if not all(isinstance(key, plan.Constant) for key in query.group):  # else there is one group
            order.append((exp.Min(this=number.copy()), False))
        return sql_builder.sort_query(select, order)

    # --- whole queries ---------------------------------------------------------------------------------

    def lower_columns(
        self, query: plan.Query, scope: SqlScope, names: list[str | None], boxed: bool = False
    ) -> list[Node]:
        lower = self.expressions.lower_value if boxed else self.expressions.lower_expr
        nodes = [lower(output.expr, scope) for output in query.columns]
        return [sql_builder.named(node, name) for node, name in zip(nodes, names, strict=True)]

    def lower_rows(
        self, query: plan.Query, scope: SqlScope, names: list[str | None], boxed: bool = False
    ) -> exp.Select:
        """The query's rows, sorted and cut; the caller guarantees that SQL can sort them."""
        limit, offset = self.needs.bind_limits(query)
        if query.aggregated:
            select = self.lower_grouped(query, scope, names)
            return sql_builder.sort_query(select, (), limit, offset)
        flat = self.lower_from_and_where(query, scope)
        order = self.lower_order(query, flat)
        outputs = self.lower_columns(query, flat.scope, names, boxed)
        return sql_builder.select(outputs, flat.items, sql_builder.conjunction(flat.terms), order, limit, offset)

    def lower_derived(self, query: plan.Query, scope: SqlScope) -> exp.Select:
        """The query as a derived table, its columns under the names of sql_names."""
        names = choose_sql_names(tuple(output.name for output in query.columns))
        select = self.lower_rows(query, scope, list(names.values()))
        if select.args.get("limit") is None:
            sql_builder.sort_query(select, (), sql_builder.build_sql_no_limit())
        return select

    def lower_subquery(self, query: plan.Query, scope: SqlScope) -> Node:
        """A query in an expression: the value that its representation gives."""
        name = query.representation.name
        flag = query.aggregated and is_flag(query.columns[0].expr.type)  # which would not be made a value again
        if name == "value" and not flag:
            select = self.lower_rows(
                replace(query, columns=query.columns[:1]), scope, [None], boxed=not query.aggregated
            )
            if select.args.get("limit") is None:
                sql_builder.sort_query(select, (), sql_builder.number(1))
            return exp.Subquery(this=select)
        # An aggregate of SQL belongs to the innermost query whose columns it mentions, so it must mention this one's.
        own = {source.id for source in query.sources}
        simple = any(list_sources(output.expr) & own for output in query.columns)
        simple = simple and not (query.aggregated or query.order or query.limit)
        tables = any(isinstance(source, plan.TableSource) for source in _find_all_sources(query))
        if simple and not tables:
            flat = self.lower_from_and_where(query, scope)
            values = self.lower_columns(query, flat.scope, [None] * len(query.columns), boxed=True)
            collected = self._collect_values(query, values)
            return exp.Subquery(this=sql_builder.select([collected], flat.items, sql_builder.conjunction(flat.terms)))
        label = self.needs.choose_label("results")
        select = self.lower_derived(query, scope)
        columns: list[Node] = []
        for output, name_ in zip(
            query.columns, choose_sql_names(tuple(o.name for o in query.columns)).values(), strict=True
        ):
            node: Node = sql_builder.column(name_, label)
            columns.append(self.expressions.box_flag(node) if is_flag(output.expr.type) else node)
        return exp.Subquery(
            this=sql_builder.select([self._collect_values(query, columns)], [sql_builder.derived(select, label)])
        )

    def lower_unordered(self, query: plan.Query, scope: SqlScope, output: Callable[[SqlScope], Node]) -> exp.Select:
        """One column over the rows of a query whose order is of no account."""
        flat = self.lower_from_and_where(replace(query, limit=None), scope, ordered=False)
        where = sql_builder.conjunction([term for term in flat.terms if term not in flat.ordering])
        return sql_builder.select([output(flat.scope)], flat.items, where)

    def _collect_values(self, query: plan.Query, values: list[Node]) -> Node:
        if query.representation.name != "dict":
            return sql_builder.call(COLLECTORS[query.representation.name], *values)
        arguments: list[Node] = []
        for output, value in zip(query.columns, values, strict=True):
            arguments += [sql_builder.string(output.name), value]
        return sql_builder.call("collect_records", *arguments)


def _is_sorted_by_rows(query: plan.Query) -> bool:
    """Whether the numbers of rows are needed to sort a product: ties of ORDER BY, and tables found by an index.

    A product of other sources is walked in its order.
    """
    sources = _find_all_sources(query)
    found = len(sources) > 1 and any(isinstance(source, plan.TableSource) for source in sources)
    return (bool(query.order) and not query.aggregated) or (found and (query.grouped or _is_sorted_product(query)))


def _is_sorted_product(query: plan.Query) -> bool:
    """Whether SQLite sorts the rows, which it finds in any order: nothing but tables, or a view among others."""
    sources = _find_all_sources(query)
    return all(isinstance(source, plan.TableSource) for source in sources) or any(map(is_view, sources))


def _find_row_conditions(source: plan.Source, where: Sequence[plan.Expr]) -> list[plan.Expr]:
    """The conditions on the rows of a view alone, which are evaluated before the rows are numbered."""
    if not isinstance(source, plan.TableSource):
        return []
    return [one for one in where if list_sources(one) == {source.id} and not list_states(one) and is_free(one)]


def _find_all_sources(query: plan.Query) -> list[plan.Source]:
    found: list[plan.Source] = []
    for source in query.sources:
        found.append(source)
        if isinstance(source, plan.QuerySource):
            found.extend(_find_all_sources(source.query))
    return found


def _needs_sql_row_inputs(query: plan.Query) -> bool:
    """Whether an aggregate's argument has to be evaluated for each row before the groups are made.

    An argument without a column of the query itself would make SQL take the aggregate for one of an outer query.
    """
    own = {source.id for source in query.sources}
    return any(not list_sources(argument) & own for argument in lower_aggregate_inputs(query))


def lower_group_inputs(
    selects: FlatLowering,
    arguments: Sequence[plan.Expr],
    keys: Sequence[plan.Expr],
    scope: SqlScope,
    number: Node,
) -> list[Node]:
    """What is computed of each row before groups are made: arguments of aggregates, the keys, and its number."""
    lower, value = selects.expressions.lower_expr, selects.expressions.lower_value
    shown = [sql_builder.alias(value(expr, scope), f"argument_{index}") for index, expr in enumerate(arguments, 1)]
    shown += [sql_builder.alias(lower(key, scope), f"key_{index}") for index, key in enumerate(keys, 1)]
    return [*shown, sql_builder.alias(number, "position")]


def lower_aggregate_inputs(query: plan.Query) -> list[plan.Expr]:
    """What the aggregates are fed with, row by row."""
    return [node.argument for node in _find_aggregates(query) if node.argument is not None]


def _find_aggregates(query: plan.Query) -> list[plan.Aggregate]:
    """The aggregates of SELECT, HAVING and ORDER BY, in the order of evaluation."""
    places = [output.expr for output in query.columns] + ([query.having] if query.having is not None else [])
    places += [key.expr for key in query.order]
    return [node for place in places for node in walk_own(place) if isinstance(node, plan.Aggregate)]


# --- what SQLite leaves out while it reads a table for the Python engine, which tests all of WHERE by itself
#
#     SELECT sqrt(x) FROM t WHERE id == n AND near(y);
#     SELECT "id", "x", "y" FROM "main"."t" AS t WHERE t.id = :n ORDER BY "rowid"
#
# These are rows that a part of WHERE drops that SQLite evaluates without Python. It may find the others by an index.
PLAIN = (int, float, str, type(None))


@dataclass(frozen=True, slots=True)
class TableFilter:
    """What comes after the table in FROM, and before its order; what is bound in it; how many rows are enough."""

    text: str
    parameters: tuple[Parameter, ...] = ()
    limit: int | None = None
    values: Mapping[str, Any] = field(default_factory=dict)

    def bind_values(self, values: Sequence[Any]) -> TableFilter | None:
        """The filter with values of its parameters; None where one is neither a number nor a string in SQLite."""
        encoded = {}
        for parameter, value in zip(self.parameters, values, strict=True):
            plain = encoded[parameter.name] = int(value) if parameter.flag else parameter.encode_value(value)
            if type(plain) not in PLAIN or (type(plain) is str and not can_be_literal(plain)):
                return None
        return replace(self, values=encoded)


def lower_table_filter(source: plan.TableSource, parts: Sequence[plan.Expr], enough: int | None) -> TableFilter | None:
    """The filter of a table, if there is anything to leave out.

    The `parts` of WHERE cannot fail and read nothing else of a row. No more than `enough` rows that meet all are read.
    """
    needs = StatementNeeds({})
    selects = FlatLowering(needs)
    opened, scope = lower_sources(selects, (source,), SqlScope())
    lowered = [selects.expressions.lower_condition(part, scope) for part in parts]
    terms = [term for term in lowered if _can_stand_alone(term, needs)]
    where = sql_builder.conjunction(terms)
    if where is not None:
        strip_numeric_affinity(where, (source,))
    limit = enough if len(terms) == len(parts) else None
    if where is None:
        return None if limit is None else TableFilter("", limit=limit)
    label = sql_builder.identifier(opened[0].items[0].alias_or_name).sql("sqlite")
    text = f" AS {label} WHERE {SQLITE.print_tree(where)}"
    return TableFilter(text, tuple(_list_sql_values(where, needs)), limit)


def _can_stand_alone(term: sql_builder.Node, needs: StatementNeeds) -> bool:
    """Whether SQLite needs nothing of Python but values that are known beforehand."""
    own = all(call.name.lower() in SQLITE_FUNCTIONS for call in term.find_all(exp.Anonymous))
    return own and all(isinstance(one.expr, (plan.Constant, plan.Variable)) for one in _list_sql_values(term, needs))


def _list_sql_values(node: sql_builder.Node, needs: StatementNeeds) -> list[Parameter]:
    bound = {placeholder.name for placeholder in node.find_all(exp.Placeholder)}
    return [parameter for name, parameter in needs.parameters.items() if name in bound]

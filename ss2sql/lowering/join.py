"""FROM and WHERE of a flat query as SQL: the product of its sources, filtered as early as that may be.

SQLite evaluates a term of WHERE as soon as the columns are known that it mentions; one that has to wait for a source
that it does not mention is tied to it by `in_turn`. A value that is worth keeping (`hoist`) is computed in a
table of its own, once for each row of the sources that it depends on:

    FROM (SELECT m1.this AS m1, move(m1.this, :p1) AS move FROM elements(:moves) AS m1 LIMIT -1) AS to_m1
    CROSS JOIN elements(:moves) AS m2

LIMIT -1 keeps SQLite from putting the expression back to where it is used. SQLite takes the rows of such a
table one by one, so nothing is evaluated ahead. Lists that are walked again and again are copied once, see
statement_needs.py. Seven moves inside each other (279,936 rows) take 1.3 s without, 0.2 s so.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import field, replace
from functools import partial
from typing import TYPE_CHECKING, TypeGuard

from sqlglot import exp

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import Kind
from ss2sql.language.plan_traversal import list_sources, reads_outside, split_and
from ss2sql.lowering import sql_builder
from ss2sql.lowering.evaluation_order import (
    MIN_INDEXED_LENGTH,
    Condition,
    EvaluationOrder,
    ExpressionKey,
    find_expression_key,
)
from ss2sql.lowering.from_clause import FromItem
from ss2sql.lowering.guards import is_free
from ss2sql.lowering.sql_builder import Node
from ss2sql.lowering.sql_query import choose_free_name, choose_sql_names
from ss2sql.lowering.sqlite_expressions import Reader, SqlScope
from ss2sql.lowering.statement_needs import (
    find_alternatives,
    find_equality_columns,
    find_labels,
    number_sql_rows,
    require_sql_index_order,
    sort_sql_by_row_number,
    strip_affinity,
)

if TYPE_CHECKING:
    from ss2sql.lowering.flat import FlatLowering


@dataclass(slots=True)
class DerivedTable:
    """Sources joined in a table of their own; `carry_node` makes what is read of them columns of it."""

    select: exp.Select
    label: str
    labels: frozenset[str]
    names: dict[tuple[str, str], str] = field(default_factory=dict)
    taken: set[str] = field(default_factory=lambda: {"rowid"})

    def carry_node(self, node: Node) -> Node:
        """The expression as it reads outside of the table."""
        node = node.copy()
        for column in list(node.find_all(exp.Column)):
            if column.table in self.labels:
                outside = sql_builder.column(self.name_of(column), self.label)
                if column is node:
                    return outside
                column.replace(outside)
        return node

    def name_of(self, column: exp.Column) -> str:
        key = (column.table, column.name)
        if key not in self.names:
            wanted = column.table if column.name == "this" else column.name
            self.names[key] = self.add_column(wanted, column, len(self.names))
        return self.names[key]

    def add_column(self, wanted: str, node: Node, position: int | None = None) -> str:
        """A new column of the table, the last one or one at a position; gives its name."""
        name = choose_free_name(wanted, self.taken)
        columns = list(self.select.expressions)
        columns.insert(len(columns) if position is None else position, sql_builder.named(node.copy(), name))
        self.select.set("expressions", columns)
        return name


MAX_TERMS = 14


class JoinBuilder:
    """The product of a query's sources, put together level by level."""

    def __init__(
        self, selects: FlatLowering, query: plan.Query, opened: list[FromItem], scope: SqlScope, levels: EvaluationOrder
    ) -> None:
        self.selects = selects
        self.query = query
        self.opened = opened
        self.levels = levels
        self.tables: list[DerivedTable] = []
        self.scope = replace(scope, sources={**scope.sources, **self._make_readers(scope)})
        self.keys: dict[int, dict[ExpressionKey, str]] = {}  # by source: columns of its copy that are computed
        self.items: list[Node] = []
        self.terms: list[Node] = []
        self.ordering: list[Node] = []  # terms that are there for the order of rows alone
        self.optional: set[str] = set()  # what is joined with LEFT JOIN
        self.runs_again = reads_outside(query)  # for each row around it
        self.keeps = self.rows_sorted = False
        conditions = levels.split_where()
        if self._must_sort(conditions):
            self._sort_rows(conditions)
        else:
            self._join_by_levels(conditions)

    def _join_by_levels(self, conditions: list[Condition]) -> None:
        """Joins the sources from level to level, and evaluates at each what can be by then."""
        query, opened, levels, applied = self.query, self.opened, self.levels, self.selects.needs.applied
        outputs = () if query.aggregated else tuple(output.expr for output in query.columns)
        hoisted = levels.find_hoisted_values(conditions, outputs)
        self.keeps = bool(hoisted)
        if any(not condition.free and condition.level < len(opened) for condition in conditions):
            applied["early"] = None
        if hoisted:
            applied["hoist"] = None
        bound = 0
        for level in sorted(set(hoisted.values())):
            self._bind_sources(bound, level, conditions)
            self._close_level(level, [expr for expr, own in hoisted.items() if own == level])
            bound = level
        self._bind_sources(bound, len(opened), conditions)
        self.terms = self._write_where()

    def translate_outward(self, node: Node, inner: int = 0) -> Node:
        """An expression as it reads outside of all tables that have been made of the sources, but the first `inner`."""
        for table in self.tables[inner:]:
            node = table.carry_node(node)
        return node

    def _make_readers(self, scope: SqlScope) -> dict[int, Reader]:
        def make_outward(reader: Reader) -> Reader:
            return lambda expr: self.translate_outward(reader(expr))

        readers = {source.id: scope.sources[source.id] for source in self.query.sources}
        for source, part in zip(self.query.sources, self.opened, strict=True):
            if part.rows is not None:
                assert isinstance(source, plan.QuerySource)
                readers[source.query.sources[0].id] = part.rows
        return {number: make_outward(reader) for number, reader in readers.items()}

    @property
    def copies(self) -> bool:
        """Whether lists are copied: the inner ones of three and more are walked often, at 0.5 us per element.

        SQLite sees when a copy is empty, and then evaluates nothing before it: that must not show.
        """
        return self.keeps or len(self.query.sources) > 2

    @property
    def natural_order(self) -> list[Node] | None:
        """The keys of the product's own order; None where a source has none."""
        if not all(part.order for part in self.opened):
            return None
        return [self.translate_outward(key) for part in self.opened for key in part.order]

    # --- tables ----------------------------------------------------------------------------------------

    def _must_sort(self, conditions: list[Condition]) -> bool:
        """Whether SQLite might evaluate rows that LIMIT cuts off: it may find rows by an index, not in order."""
        query, tables = self.query, [one for one in self.query.sources if isinstance(one, plan.TableSource)]
        if query.limit is None or query.order or query.grouped or not all(part.order for part in self.opened):
            return False
        evaluated = [condition.expr for condition in conditions if condition.free]
        late = [condition.expr for condition in conditions if not condition.free]
        late += [output.expr for output in query.columns]
        if len(tables) < len(query.sources) or not any(map(list_sources, evaluated)):
            return False
        return not is_free(*late)

    def _sort_rows(self, conditions: list[Condition]) -> None:
        """Joins tables by what cannot fail, sorts the rows, and evaluates the rest row by row."""
        for part in self.opened:
            self.items += part.items
            self.terms += part.conditions
        self.terms += [self._lower_free(condition) for condition in conditions if condition.free]
        natural = self.natural_order or []
        table = self._enclose_join("found", [(key.copy(), False) for key in natural])
        for key in natural:
            table.carry_node(key)  # one column has to be there
        self.tables.append(table)
        late = [condition.expr for condition in conditions if not condition.free]
        self.terms = [self.selects.expressions.lower_and(tuple(late), self.scope)] if late else []
        self.rows_sorted = True

    def _enclose_join(self, name: str, order: Sequence[tuple[Node, bool]] = ()) -> DerivedTable:
        """A table of what is joined so far, which is all that is joined then."""
        where = sql_builder.conjunction(self._write_where())
        labels = frozenset(item.alias_or_name for item in self.items)
        select = sql_builder.select([], self.items, where, order, sql_builder.build_sql_no_limit())
        table = DerivedTable(select, self.selects.needs.choose_label(name), labels)
        self.items, self.terms = [sql_builder.derived(select, table.label)], []
        return table

    # --- joining ---------------------------------------------------------------------------------------

    def _bind_sources(self, bound: int, level: int, conditions: list[Condition]) -> None:
        """Joins the sources after `bound` up to `level`, and evaluates what can be by then."""
        first = 0 if bound == 0 else bound + 1
        for condition in conditions:
            if condition.key is not None and first <= condition.level <= level:
                self._add_key(self.query.sources[condition.level - 1], condition.key)
        terms = [(c.level, self._lower_free(c)) for c in conditions if c.free and first <= c.level <= level]
        for position in range(bound, level):
            part = self.opened[position]
            if part.rows is not None:
                self._left_join_source(self.query.sources[position], part)
                continue
            conditions_here = [node for step, node in terms if step == position + 1]
            filters = [self.translate_outward(condition) for condition in part.conditions]
            sources = part.merged or (self.query.sources[position],)
            later = {item.alias_or_name for item in part.items}
            for source, item in zip(sources, map(self.translate_outward, part.items), strict=True):
                later.discard(item.alias_or_name)
                known = [c for c in (*conditions_here, *filters) if later.isdisjoint(find_labels(c))]
                written = list(known)
                found = self._look_up_source(source, item, known, self.terms)
                changed = {id(old): new for old, new in zip(written, known, strict=True) if old is not new}
                terms = [(step, changed.get(id(node), node)) for step, node in terms]
                filters = [changed.get(id(node), node) for node in filters]
                if found is None and self.copies:
                    found = self._materialize_source(source, item)
                self.items.append(found or item)
            self.terms += filters
        self.terms += [node for _, node in terms]
        for step in range(first, level + 1):
            group = [c.expr for c in conditions if not c.free and c.level == step]
            if group:
                free = [c.expr for c in conditions if c.free and c.level == step]
                self.terms.append(self._order_fallible(group, step, free))

    def _add_key(self, source: plan.Source, key: ExpressionKey) -> str:
        """Plans a column of the source's copy, under a name that no other column of the source has."""
        known = self.keys.setdefault(source.id, {})
        if key not in known:
            columns = tuple(name for name, _ in source.columns or ())
            taken = {"this", "rowid", *map(str.lower, columns), *choose_sql_names(columns).values()}
            known[key] = choose_free_name(key.name, taken | {name.lower() for name in known.values()})
        return known[key]

    def _write_key(self, key: ExpressionKey, side: plan.Expr) -> Node:
        lower = self.selects.expressions
        if key.plain:
            return lower.lower_expr(side, self.scope)
        return sql_builder.call("as_key", lower.lower_value(side, self.scope))

    def _write_key_equality(self, label: str, key: ExpressionKey, name: str) -> Node:
        none = not key.plain or any(side.type.may_be(Kind.NONE) for side in (key.expr, key.other))
        sides = sql_builder.column(name, label), self._write_key(key, key.other)
        return sql_builder.binary(exp.NullSafeEQ if none else exp.EQ, *sides)

    def _write_key_column(self, key: ExpressionKey, name: str) -> Node:
        node = self._write_key(key, key.expr)
        if key.guards:
            guards = self.selects.expressions.lower_and(key.guards, self.scope)
            node = sql_builder.case([(guards, node)], sql_builder.null())
        return sql_builder.alias(node, name)

    def _left_join_source(self, source: plan.Source, part: FromItem) -> None:
        """Joins a source that may have no row."""
        assert isinstance(source, plan.QuerySource)
        (inner,), (item,), lower = source.query.sources, part.items, self.selects.expressions
        parts = split_and(source.query.where)
        on = [self.translate_outward(condition) for condition in part.conditions]
        # What cannot fail stands by itself, so that SQLite makes an index for an equality, and guards the others, too.
        for index, one in enumerate(parts):
            key = find_expression_key(self.query, inner, parts, index) if self.levels.may_look_up else None
            if key is not None:
                on.append(self._write_key_equality(item.alias_or_name, key, self._add_key(inner, key)))
            elif is_free(one):
                on.append(sql_builder.keep_condition(lower.lower_condition(one, self.scope)))
            else:
                on.append(lower.lower_and(parts, self.scope))
                break
        item = self.translate_outward(item)
        found = self._look_up_source(inner, item, on, on)
        self.items.append(exp.Join(this=found or item, side="LEFT", on=sql_builder.conjunction(on)))
        self.optional.add(item.alias_or_name)

    def _lower_free(self, condition: Condition) -> Node:
        known = self.keys.get(self.query.sources[condition.level - 1].id, {})
        if condition.key is not None and condition.key in known:
            label = self.opened[condition.level - 1].items[0].alias_or_name
            return self._write_key_equality(label, condition.key, known[condition.key])
        node = self.selects.expressions.lower_condition(condition.expr, self.scope)
        return self._delay_condition(condition.level, self.levels.count_sources(condition.expr), node)

    def _order_fallible(self, group: list[plan.Expr], level: int, free: list[plan.Expr]) -> Node:
        """Parts of WHERE that may fail, in their order."""
        node = self.selects.expressions.lower_and(tuple(group), self.scope)
        if isinstance(self.query.sources[level - 1], plan.TableSource):
            # SQLite evaluates first what an index of the table answers, whatever stands before it.
            before = [self.selects.expressions.lower_condition(part, self.scope) for part in free]
            node = sql_builder.case_in_order([*before, node])
        elif isinstance(node, (exp.LT, exp.LTE, exp.GT, exp.GTE)):
            # Nor is a range of a list to be looked up by what may fail before other conditions are evaluated.
            for side in (node.this, node.expression):
                if isinstance(side, exp.Column):
                    sql_builder.drop_affinity(side)
        # What can fail calls a function, so that SQLite never evaluates it before the first source is read. Only the
        # other side of `column = ...` it evaluates before a derived table, to look that up in an index that it makes.
        indexed = isinstance(self.opened[level - 1].items[-1], exp.Subquery)
        return self._delay_condition(level, 0 if indexed else max(1, *map(self.levels.count_sources, group)), node)

    def _delay_condition(self, level: int, known: int, node: Node) -> Node:
        """A condition that is not evaluated before the source at its level is read."""
        return (
            node
            if known >= level
            else sql_builder.call("in_turn", self.translate_outward(self.opened[level - 1].witness_column), node)
        )

    def _close_level(self, level: int, values: Sequence[plan.Expr]) -> None:
        """Makes a table of what is joined so far, with the values of its level."""
        table = self._enclose_join(f"to_{self.query.sources[level - 1].name}")
        nodes = [self.selects.expressions.lower_expr(expr, self.scope) for expr in values]
        self.tables.append(table)
        columns = [table.add_column(_choose_column_name(e), n) for e, n in zip(values, nodes, strict=True)]
        here = [
            (e, partial(self.translate_outward, sql_builder.column(name, table.label), len(self.tables)))
            for e, name in zip(values, columns, strict=True)
        ]
        self.scope = replace(self.scope, known=(*here, *self.scope.known))

    def _write_where(self) -> list[Node]:
        """The terms of WHERE, so written that SQLite keeps the order of rows."""
        terms = [part for term in self.terms for part in (term.flatten() if isinstance(term, exp.And) else (term,))]
        terms += number_sql_rows(self.items, terms, self.selects.needs.materialized_ctes.values())
        if self.optional:
            # Else SQLite sees where None cannot meet a term, makes a plain join of it, and changes the order of rows.
            terms = [_wrap_disjunction(t) if not self.optional.isdisjoint(find_labels(t)) else t for t in terms]
        if self.selects.needs.worlds:
            terms = [_wrap_disjunction(term) if isinstance(term.unnest(), exp.Or) else term for term in terms]
        if len(terms) > MAX_TERMS and any(map(_can_be_none, self.query.sources)):
            # After so many conditions SQLite asks `elements` again whether NULL equals its argument.
            rest = sql_builder.join_by_and(terms[MAX_TERMS:])
            terms[MAX_TERMS:] = [sql_builder.case([(rest, sql_builder.number(1))], sql_builder.number(0))]
        return terms

    def _materialize_source(self, source: plan.Source, item: Node) -> Node:
        """A source that is walked again and again: a copy of its list, if that stays the same for the statement."""
        if not isinstance(source, plan.ValueSource) or self.query.order or self.query.group:
            return item
        value = source.value
        # SQLite may make an index on a copy; with one column it keeps equal elements in their order.
        if not (_walks_same_list(item) and value.type.is_only(Kind.LIST) and source.columns == ()):
            return item
        name = f"{value.name if isinstance(value, plan.Variable) else source.name}_once"
        walked = exp.Table(this=item.this.copy())
        return self.selects.copies.copy_item(walked, item.alias_or_name, [sql_builder.column("this")], name)

    def _look_up_source(
        self, source: plan.Source, item: Node, conditions: list[Node], terms: list[Node]
    ) -> Node | None:
        """A source that SQLite can look rows up in, where these must equal something that is known before.

        What keeps its rows in order is added to `terms`.
        """
        copies, needs = self.selects.copies, self.selects.needs
        if "lookup" in needs.disabled or not isinstance(item, exp.Table):
            return None
        label = item.alias_or_name
        keys = {column for table, column, others in find_equality_columns(conditions) if table == label and others}
        computed = [self._write_key_column(key, name) for key, name in self.keys.get(source.id, {}).items()]
        asked = find_alternatives(conditions, label, (label,))
        several = asked is not None and len(asked.keys) > 1 and _can_split_rows(source, asked.keys)
        if not keys and not computed and not several:
            return None
        position = "rowid"
        match source:
            case plan.TableSource():
                if computed:
                    strip_affinity(conditions, label, self.selects.tables)
                elif not several and all(isinstance(one, plan.TableSource) for one in self.query.sources):
                    # SQLite uses any index, and makes one for a join, but none for a query that runs again and again.
                    if not self.runs_again or any(first in keys for (first, *_), _ in source.indexes):
                        return None
                elif require_sql_index_order(item, source, keys):  # beside lists it is walked in its order
                    needs.applied["lookup"] = None
                    return item
                found = copies.copy_table(item, source, computed)
                position = copies.get_number_column(found.name)
            case plan.ValueSource() | plan.QuerySource() if _walks_same_list(item):
                size = source.value.type.size if isinstance(source, plan.ValueSource) else None
                if size is not None and size < MIN_INDEXED_LENGTH:
                    return None
                strip_affinity(conditions, label, self.selects.tables)
                if not computed and not several and self._has_narrow_range(source, conditions, label):
                    return None  # `elements` looks up both
                walked = item.copy()
                if not computed:  # which read it by its label
                    walked.set("alias", None)
                columns = [name for name, _ in source.columns or ()]
                found = copies.copy_list(walked, label, columns, position, computed)
            case _:
                return None
        if asked is not None and several:
            found = copies.split_rows_by_keys(found, conditions, asked)
        ordered = sort_sql_by_row_number(label, position)
        self.ordering.append(ordered)
        terms.append(ordered)
        needs.applied["lookup"] = None
        return found

    def _has_narrow_range(self, source: plan.Source, conditions: Sequence[Node], label: str) -> bool:
        """Whether other rows bound a column from both sides, or from one where LIMIT ends a walk in its order."""
        ends = set[tuple[str, bool]]()
        for condition in (one.unnest() for one in conditions):
            if isinstance(condition, (exp.LT, exp.LTE, exp.GT, exp.GTE)):
                below = isinstance(condition, (exp.LT, exp.LTE))
                sides = (condition.this, condition.expression, below), (condition.expression, condition.this, not below)
                for column, other, upper in sides:
                    if isinstance(column, exp.Column) and column.table == label and find_labels(other) - {label}:
                        ends.add((column.name, upper))
        first = self.query.order[0].expr if self.query.order and self.query.limit is not None else None
        walked = first.name if isinstance(first, plan.Column) and first.source == source.id else None
        return any((name, not upper) in ends or name == walked for name, upper in ends)


def _can_split_rows(source: plan.Source, keys: Sequence[Node]) -> bool:
    """Whether rows may come once for each key: texts and numbers are as they are, and SQLite has no indexes for it."""
    if not isinstance(source, plan.TableSource):
        return True
    indexed = {first for (first, *_), _ in source.indexes}
    if all(isinstance(key, exp.Column) and key.name in indexed for key in keys):
        return False
    compared = {column.name for key in keys for column in key.find_all(exp.Column)}
    return compared.isdisjoint((*source.texts_for_numbers, *source.collated))


def _walks_same_list(item: Node) -> TypeGuard[exp.Table]:
    """Whether `elements` walks a list that is the same for all rows."""
    inside = {table.alias_or_name for table in item.find_all(exp.Table, exp.Subquery)}
    return isinstance(item.this, exp.Anonymous) and find_labels(item) <= inside


def _can_be_none(source: plan.Source) -> bool:
    """Whether a source that `elements` walks may be None instead of a list."""
    match source:
        case plan.ValueSource(value=value):
            return value.type.may_be(Kind.NONE)
        case _:
            return not isinstance(source, plan.TableSource)


def _wrap_disjunction(term: Node) -> Node:
    """`(a OR b) IS TRUE`: SQLite would walk a world's table once for each part, and put its rows out of order."""
    return exp.Is(this=sql_builder.parenthesize_sql(term, exp.Or), expression=exp.true())


def _choose_column_name(expr: plan.Expr) -> str:
    return expr.function.name if isinstance(expr, plan.Call) else "value"

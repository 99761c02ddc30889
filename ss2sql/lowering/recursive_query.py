"""Hierarchical queries as WITH RECURSIVE.

SQLite takes the rows of the recursive table from a queue, in the order of the recursive term's ORDER BY,
hands each to the outer query and then runs the recursive term on it. So one statement is a best-first search:
a row is a step, the queue's order is the strategy.

A step is evaluated before it enters the queue (search.py): what leads nowhere never waits, and a row carries what
its children need.

What SQL has no words for are functions of the run (runtime/sqlite/search_functions.py): they number the steps, keep
the rows of those that go on, so that a path follows from its last step by backpointers, at a cost that does not
depend on its length, and know the rows that were met.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import replace

from sqlglot import exp

from ss2sql.language import plan
from ss2sql.language.kinds import is_flag
from ss2sql.language.plan_traversal import list_sources, rebuild_node
from ss2sql.lowering import sql_builder
from ss2sql.lowering.flat import FlatLowering
from ss2sql.lowering.from_clause import FromItem, lower_sources
from ss2sql.lowering.sql_builder import Node
from ss2sql.lowering.sql_query import ROW_NUMBER, choose_free_name
from ss2sql.lowering.sqlite_expressions import SqlScope
from ss2sql.lowering.statement_needs import (
    find_alternatives,
    find_equality_columns,
    number_sql_rows,
    require_sql_index_order,
    sort_sql_by_row_number,
)
from ss2sql.lowering.strategies import get_order, get_repeat_rule
from ss2sql.lowering.union_branches import find_union_branches, lower_parts_as_list

SEARCH_TABLE = "search"


def shorten_sql_column_name(name: str) -> str:
    """The name of a variable as a column; those that the search carries have names such as `prior(id)`."""
    return re.sub(r"\W+", "_", name).strip("_") or "value" if not name.isidentifier() else name


def _get_carried_read(node: plan.Element | plan.Column) -> plan.Element | plan.Column:
    """What is carried for it: of a column that may be missing the element, for only who reads it may fail."""
    missing = isinstance(node, plan.Column) and not node.declared
    return plan.Element(node.source, span=node.span) if missing else node


class RecursiveQuery:
    """What is the same in all searches: the terms' sources, the START WITH state, and the statement."""

    def __init__(self, selects: FlatLowering, query: plan.Query, cut: bool) -> None:
        search = query.search
        assert search is not None
        self.selects = selects
        self.expressions = selects.expressions
        self.query = query
        self.search = search
        self.cut = cut  # whether the search may end before its steps are used up, so that their order shows
        self.guard = get_repeat_rule(search)
        self.order = get_order(search)
        self.table = selects.needs.choose_label(SEARCH_TABLE)
        self.taken: set[str] = {"step", "parent"}  # names of the recursive table's columns
        self.reads: list[tuple[str, plan.Element | plan.Column]] = []  # elements that it holds
        self.flags = {name: is_flag(kind) for name, kind in search.states}
        # What is compared is not the row, so that the run keeps it beside the row.
        self.keyed = bool(search.key) and search.repeats != "allowed"
        self.outputs = query.rows if query.aggregated else tuple(output.expr for output in query.columns)
        self.compared = search.key or self.outputs
        self.starts: Node | None = None  # the table of START WITH states, where there is one
        last = {name: number for number, (name, _) in enumerate(search.connect)}
        self.variables = sorted((name for name, _ in search.start), key=lambda name: last.get(name, -1))
        self.assigned = set(last)
        self.copies = selects.copies  # of what is read once: tables, lists and worlds, and the starts
        self.arms = None if "arms" in selects.needs.disabled else find_union_branches(query)

    # --- the recursive table ---------------------------------------------------------------------------

    def carry_element(self, node: plan.Element | plan.Column) -> str:
        """The column of the recursive table that holds what is read of an element."""
        for name, known in self.reads:
            if known == node:
                return name
        source = next(source for source in self.query.sources if source.id == node.source)
        name = choose_free_name(node.name if isinstance(node, plan.Column) else source.name, self.taken)
        self.reads.append((name, node))
        return name

    def list_parts(self, expr: plan.Expr) -> tuple[plan.Column, ...]:
        """The columns of the parts as which an element travels, if it does."""
        return () if self.arms is None else self.arms.list_parts(expr)

    def column(self, name: str) -> Node:
        return sql_builder.column(name, self.table)

    def make_row_scope(self) -> SqlScope:
        """Reads elements from a row of the recursive table."""
        return SqlScope({source.id: self._find_carried_reads for source in self.query.sources})

    def _find_carried_reads(self, expr: plan.Element | plan.Column) -> Node:
        if parts := self.list_parts(expr):
            return lower_parts_as_list(self.expressions, [(self.column(self.carry_element(p)), p) for p in parts])
        carried = self.column(self.carry_element(_get_carried_read(expr)))
        if isinstance(expr, plan.Column) and not expr.declared:
            return self.expressions.read_field(carried, expr)
        return carried

    def build_recursive_query(
        self, names: list[str], terms: list[exp.Select], queue: Iterable[tuple[str, bool]], results: exp.Select
    ) -> exp.Select:
        """`WITH RECURSIVE table(names) AS (first UNION ALL others ORDER BY ...) results`; columns sort the queue."""
        union = sql_builder.build_sql_union(terms)
        keys = [
            exp.Ordered(this=sql_builder.number(names.index(column) + 1), desc=descending, nulls_first=not descending)
            for column, descending in queue
        ]
        union.set("order", exp.Order(expressions=keys))
        columns = [sql_builder.identifier(name) for name in names]
        cte = exp.CTE(this=union, alias=exp.TableAlias(this=sql_builder.identifier(self.table), columns=columns))
        copies = self.copies.add_materialized_tables(union, results)
        tables = [*self.selects.needs.materialized_ctes.values(), *copies, cte]
        results.set("with_", exp.With(expressions=tables, recursive=True))
        return results

    # --- the START WITH state --------------------------------------------------------------------------

    def lower_start(self) -> dict[tuple[int, str], Node]:
        """The START WITH variables as parameters, or as literals where they are plain.

        Where EACH walks a list, or the first steps of a search BY the state reached differ, the starts are a table:

            starts(town) AS MATERIALIZED (SELECT this FROM elements(:towns) WHERE visit(this))

        All of it is made before the first step is, so that every start counts as visited then.
        """
        needs, values = self.selects.needs, dict[str, plan.Expr]()
        for name, expr in self.search.start:
            values[name] = self._substitute_start_values(expr, values)
        each = tuple(
            replace(source, value=self._substitute_start_values(source.value, values)) for source in self.search.each
        )
        opened, scope = lower_sources(self.selects, each, SqlScope())
        states: dict[tuple[int, str], Node] = {}
        for name, value in values.items():
            flag = self.flags[name]
            plain = isinstance(value, plan.Constant) and not isinstance(value.value, (list, bool))
            if list_sources(value):
                states[(self.query.id, name)] = (self.expressions.lower_expr if flag else self.expressions.lower_value)(
                    value, scope
                )
            else:
                known = self.expressions.lower_expr(value, SqlScope()) if plain else needs.bind_value(value, name, flag)
                states[(self.query.id, name)] = known
        return self._lower_starts(opened, states) if self.has_special_first_steps and (each or self.visits) else states

    @property
    def has_special_first_steps(self) -> bool:
        return bool(self.search.each) or self.search.first is not None

    @property
    def visits(self) -> bool:
        """Whether the state of a start counts as visited."""
        return self.keyed and self.search.by == "state"

    def write_visit(self, scope: SqlScope) -> Node | None:
        """What lets the state of a start count as visited, where it does."""
        if not self.visits:
            return None
        return sql_builder.call("visit", *(self.expressions.lower_value(part, scope) for part in self.compared))

    def _lower_starts(self, opened: list[FromItem], states: dict[tuple[int, str], Node]) -> dict[tuple[int, str], Node]:
        """The START WITH variables as columns of a table, where they are another value in each start."""
        name = self.selects.needs.choose_table_name("starts")
        moved = {state: node for state, node in states.items() if node.find(exp.Column)}
        taken: set[str] = set()
        columns = {state: choose_free_name(shorten_sql_column_name(state[1]), taken) for state in moved}
        shown = [sql_builder.alias(node, columns[state]) for state, node in moved.items()] or [
            sql_builder.alias(sql_builder.number(1), "start")
        ]
        items = [item for part in opened for item in part.items]
        visit = self.write_visit(SqlScope().with_states(states))
        if visit is not None and opened:
            visit = self.evaluate_for_each_row(visit, opened[-1].witness_column)
        counted = [*([] if visit is None else [visit]), sql_builder.call("expand")]
        self.copies.tables[name] = sql_builder.select(shown, items, sql_builder.conjunction(counted))
        self.starts = sql_builder.table(name, name)
        return states | {state: sql_builder.column(column, name) for state, column in columns.items()}

    def _substitute_start_values(self, expr: plan.Expr, values: dict[str, plan.Expr]) -> plan.Expr:
        """The expression with the values of the START WITH variables before it in place of their names."""
        if isinstance(expr, plan.State) and expr.query == self.query.id:
            return values[expr.name]
        return rebuild_node(expr, lambda part: self._substitute_start_values(part, values))

    def lower_next_state(self, scope: SqlScope) -> dict[tuple[int, str], Node]:
        """The state after CONNECT BY. A later assignment sees an earlier one: its expression stands for the name.

        Where the columns are made in the order of `variables`, all that may fail is evaluated in the order of the text.
        """
        states = dict(scope.states)
        for name, expr in self.search.connect:
            lower = self.expressions.lower_expr if self.flags[name] else self.expressions.lower_value
            states[(self.query.id, name)] = lower(expr, scope.with_states(states))
        return states

    @staticmethod
    def evaluate_for_each_row(node: Node, witness: Node) -> Node:
        """A condition that SQLite evaluates for each row; `witness` is a column of the last source.

        SQLite evaluates a condition once the columns in it are known.
        """
        (last,) = {column.table for column in witness.find_all(exp.Column)}
        if any(column.table == last for column in node.find_all(exp.Column)):
            return node
        return sql_builder.call("in_turn", witness.copy(), node)

    # --- sources ---------------------------------------------------------------------------------------

    def order_items(self, items: list[Node], conditions: list[Node]) -> list[Node]:
        """The items of FROM, read so that their rows come in order under these conditions, which may become more."""
        conditions += number_sql_rows(items, conditions, self.selects.needs.materialized_ctes.values())
        labels = [item.alias_or_name for item in items]
        ordered = [self._order_item(item, conditions, labels[index:]) for index, item in enumerate(items)]
        return [self._split_rows_by_keys(item, conditions, labels[index:]) for index, item in enumerate(ordered)]

    def keep_rows_in_order(self, items: list[Node], conditions: list[Node]) -> list[Node]:
        """What reads the positions of rows that SQLite may look up: it indexes copies that must equal something."""
        compared = {table for table, _, _ in find_equality_columns(conditions)}
        return [
            sort_sql_by_row_number(item.alias_or_name, self.copies.get_number_column(item.name))
            for item in items
            if isinstance(item, exp.Table) and item.name in self.copies.tables and item.alias_or_name in compared
        ]

    def _order_item(self, item: Node, conditions: list[Node], unknown: list[str]) -> Node:
        """An item of FROM; a table, and a list that is the same for all states, is read from a copy in its own order.

        A table needs no copy where conditions ask for all columns of an index that gives its rows in their order,
        and the items from this one on, which are `unknown` as yet, have no say in it.
        Steps are numbered as they are walked, so the walk must be in order. SQLite keeps a materialised copy
        in the order of its making. Where a condition asks for equality it builds an index on the copy, so that
        a step costs its neighbours, not the table. That index holds the key and then the columns that are
        read, in their order: the first, which numbers the rows, keeps equal keys in the order of the table.

        A list costs three Python calls per element each time it is walked, 0.5 us, its copy 0.04 us.
        """
        assert isinstance(item, exp.Table), "queries in FROM of a search are tables of WITH"
        needs = self.selects.needs
        if item.alias_or_name in needs.worlds:
            return self._materialize_item(item, (n for n, _ in needs.worlds[item.alias_or_name].columns), ROW_NUMBER)
        if isinstance(item.this, exp.Anonymous):
            walked = needs.modules[item.this.name]
            return item if walked.calls else self._materialize_item(item, walked.columns, "rowid")
        if any(item.name == table.alias for table in needs.materialized_ctes.values()):
            return item
        source = self.selects.tables[item.alias_or_name]
        compared = {
            column
            for table, column, others in find_equality_columns(conditions)
            if table == item.alias_or_name and others.isdisjoint(unknown)
        }
        if require_sql_index_order(item, source, compared):
            return item
        return self.copies.copy_table(item, source)

    def _split_rows_by_keys(self, item: Node, conditions: list[Node], unknown: list[str]) -> Node:
        """An item of FROM; a copy with a row for each of its keys where a condition asks one of several."""
        source = self.selects.tables.get(item.alias_or_name)
        if item.name not in self.copies.tables or (source is not None and source.texts_for_numbers):
            return item
        assert isinstance(item, exp.Table)
        asked = find_alternatives(conditions, item.alias_or_name, unknown)
        return item if asked is None else self.copies.split_rows_by_keys(item, conditions, asked)

    def _materialize_item(self, item: exp.Table, columns: Iterable[str], place: str) -> Node:
        """A list or a world's table that mentions no column is walked once; `place` numbers its rows.

        A source may be another list in the first step than later, where START WITH and CONNECT BY give constants: so
        what is copied decides, not the name of the source.
        """
        if any(True for _ in item.find_all(exp.Column)):
            return item
        return self.copies.copy_list(item, item.alias_or_name, columns, place)

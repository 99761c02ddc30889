"""What a lowered query needs beside its text: values to bind, functions to have, and copies of lists and tables.

A list that is walked again and again is copied: walking it costs three Python calls for each element, 0.5 us; its copy
0.04 us. Where a condition asks for equality, SQLite makes an index on the copy, as it never does on a virtual table:

    WITH kinds_once AS MATERIALIZED (SELECT rowid, kind, shelf FROM elements_kind_shelf(:kinds))
    SELECT sales.id, kinds.shelf FROM elements_id_kind(:sales) AS sales CROSS JOIN kinds_once AS kinds
    WHERE sales.kind = kinds.kind AND NOT kinds.rowid IS NULL

That index has the key and then the columns that are read, in their order: `rowid`, the first, keeps equal keys in the
order of the list, and has to be read for that. 20,000 rows that look for theirs among 1,000 take 0.1 s, not 9 s. A
table that stands beside lists is walked in its order, too, so an index that does not keep it is of no use there.
SQLite makes an index on a table for a join, but none for a query that runs for each row around it, which reads a copy.

On the rows of a query in FROM, too, SQLite makes such an index when it likes: where a condition asks for equality they
are numbered, see `number_sql_rows`. If something of that query may fail it is collected first:

    WITH best_once AS MATERIALIZED (SELECT f(rows.v) AS v FROM elements_v(:rows) AS rows LIMIT -1)
    SELECT best.v FROM best_once AS best LIMIT 1

For all rows of FROM are made before the first is used. SQLite makes one when it needs it, and leaves out columns that
nobody reads; of a table that is materialised it does neither.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import field
from typing import Any

from sqlglot import exp

from ss2sql.errors import Span
from ss2sql.errors.exceptions import escape_controls
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.lowering import sql_builder
from ss2sql.lowering.sql_builder import Node
from ss2sql.lowering.sql_query import (
    BlobEncoding,
    ListTable,
    Parameter,
    build_module_name,
    choose_free_name,
    choose_sql_names,
)


@dataclass(slots=True)
class StatementNeeds:
    """Collects what one statement needs while it is lowered."""

    function_names: Mapping[str, str]  # function of the language -> its name in SQL
    parameters: dict[str, Parameter] = field(default_factory=dict)
    calls: dict[str, list[Span]] = field(default_factory=dict)
    modules: dict[str, ListTable] = field(default_factory=dict)
    worlds: dict[str, Any] = field(default_factory=dict)  # label -> the table of a world
    materialized_ctes: dict[int, exp.CTE] = field(default_factory=dict)  # source -> its query, evaluated as a whole
    labels: set[str] = field(default_factory=set)
    tables: set[str] = field(default_factory=set)
    by_value: bool = False  # no values are compared by their handles
    plain: set[str] = field(default_factory=set)  # parameters that are compared by their handles
    walked: dict[int, str] = field(default_factory=dict)  # source -> the parameter that it walks
    disabled: Collection[str] = ()  # the rewrites that are switched off
    applied: dict[str, None] = field(default_factory=dict)  # the rewrites that lowering has applied
    memoized_expressions: list[plan.Expr] = field(default_factory=list)  # what is remembered, see sqlite_expressions.py
    written: Callable[[plan.Expr], plan.Expr] | None = None  # an expression before the rewrites, for Python

    def number_reduction(self, expr: plan.Expr) -> int:
        """The number of an expression whose values are remembered; equal ones share them."""
        if expr not in self.memoized_expressions:
            self.memoized_expressions.append(expr)
        return self.memoized_expressions.index(expr) + 1

    def choose_label(self, name: str) -> str:
        """A name for a source that no other source of the statement has; the user's own for the first."""
        return choose_free_name(name, self.labels)

    def choose_table_name(self, name: str) -> str:
        """A name for a table of WITH that nothing else has; unlike a label it is seen in all of the statement."""
        table = choose_free_name(name, self.labels | self.tables)
        self.tables.add(table.lower())
        return table

    def bind_packed(self, expr: plan.Expr, encoding: BlobEncoding) -> Node:
        """The placeholder for a list that is packed."""
        self.applied["cells"] = None
        return self.bind_value(
            expr, f"{expr.name if isinstance(expr, plan.Variable) else 'list'}_cells", False, encoding
        )

    def bind_value(
        self, expr: plan.Expr, name: str | None = None, flag: bool = False, encoding: BlobEncoding | None = None
    ) -> Node:
        """The placeholder for the value of an expression; equal expressions share one."""
        expr = expr if self.written is None else self.written(expr)
        for known in self.parameters.values():
            alike = known.flag == flag and known.blob_encoding == encoding
            if alike and known.expr == expr and type(known.expr) is type(expr):
                return self._make_placeholder(known)
        base = (name or "p1").replace(".", "_")  # a table of the engine has a dot in its name
        label, count = base, 1
        while label in self.parameters:
            count += 1
            label = f"p{count}" if name is None else f"{base}_{count}"
        bound = self.parameters[label] = Parameter(label, expr, flag, encoding)
        return self._make_placeholder(bound)

    def bind_plain(self, expr: plan.Expr) -> Node:
        """The placeholder for a value with which others are compared by their handles."""
        node = self.bind_value(expr, expr.name if isinstance(expr, plan.Variable) else None)
        self.plain.add(node.name)
        return node

    def bind_limits(self, query: plan.Query) -> tuple[Node | None, Node | None]:
        limit = None if query.limit is None else self.bind_count(query.limit, "limit")
        return limit, None if query.offset is None else self.bind_count(query.offset, "offset")

    def bind_count(self, expr: plan.Expr, name: str) -> Node:
        """A LIMIT: a whole number as it is written, anything else bound."""
        if isinstance(expr, plan.Constant) and type(expr.value) is int:
            return sql_builder.number(expr.value)
        return self.bind_value(expr, name)

    def _make_placeholder(self, bound: Parameter) -> Node:
        node = sql_builder.parameter(bound.name)
        if isinstance(bound.expr, plan.Constant):
            text = bound.expr.span.text or repr(bound.expr.value)
            # The text of the literal is shown beside it; anything that could end the comment is left out.
            shown = escape_controls(" ".join(text.split()))
            if "*/" not in shown and "/*" not in shown:
                node.add_comments([shown if len(shown) <= 60 else shown[:57] + "..."])
        return node

    def name_function(self, name: str, span: Span) -> str:
        """The SQL name of a user's function; notes that it is called at this place."""
        self.calls.setdefault(name, []).append(span)
        return self.function_names.get(name, name)

    @property
    def list_world_modules(self) -> set[str]:
        """The names of the virtual tables of worlds that the statement reads."""
        return {table.module for table in self.worlds.values()}

    def name_elements_table(self, columns: tuple[str, ...]) -> str:
        """The name of the virtual table that walks a list whose elements have these columns."""
        return self.name_list_table(ListTable(columns)) or ""

    def name_list_table(self, table: ListTable) -> str | None:
        """The name of a virtual table that walks lists; None where another one of the statement has it."""
        name = build_module_name(table.columns, tuple(call.name for call in table.calls), table.function)
        return name if self.modules.setdefault(name, table) == table else None


# --- lists and tables that a statement copies: what is walked again and again, and what a condition looks up
class MaterializedTables:
    """The copies of one statement, by their names."""

    def __init__(self, needs: StatementNeeds) -> None:
        self.needs = needs
        self.tables: dict[str, exp.Query] = {}

    def copy_item(
        self,
        item: exp.Table,
        label: str,
        columns: Sequence[Node],
        name: str,
        order: Sequence[tuple[Node, bool]] = (),
    ) -> exp.Table:
        """A copy of a list or table, under a label: the one that there is, or a new one under a name like this.

        The first column numbers the rows where SQLite may look them up, see `sort_sql_by_row_number`.
        """
        select = sql_builder.select(columns, [item.copy()], order=order)
        bare = _drop_labels(select)
        chosen = next((known for known, made in self.tables.items() if _drop_labels(made) == bare), None)
        if chosen is None:
            chosen = self.needs.choose_table_name(name)
            self.tables[chosen] = select
        return sql_builder.table(chosen, label)

    def copy_list(
        self, item: exp.Table, label: str, columns: Iterable[str], place: str, computed: Sequence[Node] = ()
    ) -> exp.Table:
        """A copy of what a virtual table walks, whose column `place` numbers its rows, with computed columns."""
        names = (place, "this", *choose_sql_names(tuple(columns)).values())
        shown: list[Node] = [sql_builder.column(name, label if computed else None) for name in names]
        return self.copy_item(item, label, [*shown, *computed], f"{label}_once")

    def copy_table(self, item: exp.Table, source: plan.TableSource, computed: Sequence[Node] = ()) -> exp.Table:
        """A copy of a table or view in its order, under the label of its item, with computed columns."""
        order = [(sql_builder.column(key), False) for key in source.order]
        number: Node = sql_builder.column("rowid")
        if is_row_number(source.order) and source.order != ("rowid",):
            # SQLite would call it rowid, as a column of the table is called.
            number = sql_builder.alias(sql_builder.column(source.order[0]), source.order[0])
        elif not is_row_number(source.order):
            position = choose_free_name("position", {column.lower() for column, _ in source.columns})
            number = sql_builder.alias(sql_builder.row_number(order), position)
        columns = [number, *(sql_builder.column(column) for column, _ in source.columns)]
        label = item.alias_or_name
        return self.copy_item(item, label, [*columns, *computed], f"{label}_in_order", order)

    def split_rows_by_keys(self, copied: exp.Table, conditions: list[Node], asked: Alternatives) -> exp.Table:
        """A copy of a copy that has each row once for each key of which a condition asks one: `a = x OR b - 1 = x`.

        The condition becomes `either = x`, for which SQLite makes an index.
        """
        label = copied.alias_or_name
        columns = [sql_builder.column(column.alias_or_name, label) for column in self.tables[copied.name].selects]
        several = len(asked.keys) > 1
        key = choose_free_name("either" if several else "computed", {column.name.lower() for column in columns})
        made = [
            sql_builder.select([*columns, sql_builder.alias(one.copy(), key)], [copied.copy()]) for one in asked.keys
        ]
        name = self.needs.choose_table_name(f"{label}_by_{key}")
        self.tables[name] = sql_builder.build_sql_union(made, distinct=True)
        conditions[asked.number] = sql_builder.binary(asked.same, sql_builder.column(key, label), asked.other.copy())
        return sql_builder.table(name, label)

    def get_number_column(self, name: str) -> str:
        """The first column of a copy."""
        return str(self.tables[name].selects[0].alias_or_name)

    def add_materialized_tables(self, *statement: exp.Query) -> list[exp.CTE]:
        """The copies as WITH of a statement, with the columns that its parts read."""
        made: list[exp.CTE] = []
        readers: list[exp.Expr] = [*statement]
        for name, copied in reversed(self.tables.items()):  # a copy reads those that were made before it
            items = [item for one in readers for item in one.find_all(exp.Table) if item.name == name]
            if items:
                _prune_columns(copied, {item.alias_or_name for item in items}, readers)
                made.insert(0, build_materialized_cte(name, copied))
                readers.append(copied)
        return made


def build_materialized_cte(name: str, select: exp.Query) -> exp.CTE:
    """`name AS MATERIALIZED (SELECT ...)`."""
    return exp.CTE(this=select, alias=exp.TableAlias(this=sql_builder.identifier(name)), materialized=True)


def number_sql_rows(items: Sequence[Node], conditions: Sequence[Node], tables: Iterable[exp.CTE]) -> list[Node]:
    """Numbers the rows of those queries in FROM that conditions let SQLite make an index on; what has it read them.

    `tables` are the collected ones. An index on what a later item has to equal would not be of use.
    """
    found: list[Node] = []
    compared = find_equality_columns(conditions)
    labels = [item.alias_or_name for item in items]
    by_name = {table.alias: table for table in tables}
    for index, item in enumerate(items):
        label, later = labels[index], set(labels[index + 1 :])
        of_query = item if isinstance(item, exp.Subquery) else by_name.get(item.name)
        if of_query is None or not any(table == label and others.isdisjoint(later) for table, _, others in compared):
            continue
        if not isinstance(of_query.this.expressions[0].unalias(), exp.Window):
            of_query.set("this", add_sql_row_numbers(of_query.this, label))
        found.append(sort_sql_by_row_number(label, of_query.this.expressions[0].alias))
    return found


def add_sql_row_numbers(select: exp.Select, label: str) -> exp.Select:
    """The same rows, and before their columns their numbers."""
    names = [column.alias_or_name for column in select.expressions]
    position = choose_free_name("position", {name.lower() for name in names})
    shown = [
        sql_builder.alias(sql_builder.row_number([]), position),
        *(sql_builder.column(name, label) for name in names),
    ]
    return sql_builder.select(shown, [sql_builder.derived(select, label)])


def require_sql_index_order(item: exp.Table, source: plan.TableSource, keys: Collection[str]) -> bool:
    """Has a table be read by an index that keeps its order, if columns that have to equal something have one."""
    for columns, index in source.indexes:
        if set(columns).issubset(keys):
            require_index(item, index or source.kept_by)
            return True
    return False


def is_row_number(order: tuple[str, ...]) -> bool:
    """Whether a table is sorted by the number that SQLite gives its rows, under a name that none of its columns has."""
    return order[:1] in {("rowid",), ("_rowid_",), ("oid",)}


def require_index(item: exp.Table, index: str) -> None:
    """Has a table be read by this index, or by none: of a table WITHOUT ROWID SQLite takes any where none is named."""
    item.set("indexed", sql_builder.identifier(index) if index else False)


def sort_sql_by_row_number(label: str, position: str = "rowid") -> Node:
    """Has SQLite read the number of a copied row, which is all that puts the rows of its index in order."""
    return exp.Not(this=exp.Is(this=sql_builder.column(position, label), expression=sql_builder.null()))


def strip_affinity(conditions: list[Node], label: str, tables: Collection[str]) -> None:
    """Takes the affinity from columns of tables, by their labels, that a copied list is compared with.

    With an affinity a text could equal a number, so SQLite uses no index of the list. What `=` compares here is of one
    kind. 20,000 rows of a table that look for theirs among 1,000 take 0.01 s, not 0.9 s.
    """
    for key, other in find_equalities(conditions):
        if (
            isinstance(key, exp.Column)
            and key.table == label
            and isinstance(other, exp.Column)
            and other.table in tables
        ):
            sql_builder.drop_affinity(other)


def find_equality_columns(conditions: Iterable[Node]) -> set[tuple[str, str, frozenset[str]]]:
    """The columns whose values conditions ask for by equality, as (label, name, the labels of what they must equal)."""
    found: set[tuple[str, str, frozenset[str]]] = set()
    for left, other in find_equalities(conditions):
        bare = left.unnest()
        side = bare.this if isinstance(bare, exp.Collate) else bare
        others = find_labels(other)
        if isinstance(side, exp.Column) and side.table not in others:
            found.add((side.table, side.name, others))
    return found


def find_labels(node: Node) -> frozenset[str]:
    """The labels of the items whose columns are read."""
    return frozenset(column.table for column in node.find_all(exp.Column))


@dataclass(frozen=True, slots=True)
class Alternatives:
    """The condition with this number asks that one of the keys equals the other side: `a = x OR b - 1 = x`."""

    number: int
    keys: tuple[Node, ...]
    other: Node
    same: type[exp.Binary]


def find_alternatives(conditions: Sequence[Node], label: str, unknown: Collection[str]) -> Alternatives | None:
    """The first such condition on an item, whose other side reads something, but none of the `unknown` items.

    `a = x` is none, for SQLite makes an index for it by itself.
    """
    for number, condition in enumerate(conditions):
        whole = condition.unnest()
        parts = list(whole.flatten()) if isinstance(whole, exp.Or) else [condition]
        sides = [
            (key, other)
            for key, other in find_equalities(parts)
            if find_labels(key) == {label} and find_labels(other) and find_labels(other).isdisjoint(unknown)
        ]
        if len(sides) != len(parts) or len({other for _, other in sides}) != 1:
            continue
        keys, (other, *_) = zip(*sides, strict=True)
        if len(keys) > 1 or not isinstance(keys[0], (exp.Column, exp.Collate)):
            same = exp.EQ if all(isinstance(part, exp.EQ) for part in parts) else exp.NullSafeEQ
            return Alternatives(number, keys, other, same)
    return None


def find_equalities(conditions: Iterable[Node]) -> list[tuple[Node, Node]]:
    """Each side of the conditions that ask for equality, with the other one."""
    equal = [condition for condition in conditions if isinstance(condition, (exp.EQ, exp.Is, exp.NullSafeEQ))]
    return [sides for one in equal for sides in ((one.this, one.expression), (one.expression, one.this))]


def _drop_labels(select: exp.Query) -> exp.Query:
    """What is copied, under whatever label."""
    bare = select.copy()
    for node in bare.find_all(exp.Table, exp.Column):
        node.set("alias" if isinstance(node, exp.Table) else "table", None)
    return bare


def _prune_columns(copied: exp.Query, labels: Collection[str], readers: Sequence[exp.Expr]) -> None:
    """Keeps the columns that somebody reads who has the copy under these labels."""
    read = {column.name for one in readers for column in one.find_all(exp.Column) if column.table in labels}
    kept = [place for place, column in enumerate(copied.selects) if column.alias_or_name in read] or [0]
    if isinstance(copied, exp.Union) and 0 not in kept:
        kept.insert(0, 0)  # the number tells equal rows apart
    while isinstance(copied, exp.Union):
        _keep_columns(copied.expression, kept)
        copied = copied.this
    _keep_columns(copied, kept)


def _keep_columns(select: exp.Expr, kept: Sequence[int]) -> None:
    select.set("expressions", [select.expressions[place] for place in kept])

"""Lists and tables that a statement copies: what is walked again and again, and what a condition looks up.

Walking a list costs three Python calls for each element, 0.5 us; its copy 0.04 us. Where a condition asks for equality,
SQLite makes an index on the copy, as it never does on a virtual table:

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

from collections.abc import Collection, Iterable, Sequence
from typing import TYPE_CHECKING

from sqlglot import exp

from ss2sql.language import plan
from ss2sql.lowering import sql_builder
from ss2sql.lowering.sql_builder import Node
from ss2sql.lowering.sql_names import choose_free_name

if TYPE_CHECKING:
    from ss2sql.lowering.statement_needs import StatementNeeds


class MaterializedTables:
    """The copies of one statement, by their names."""

    def __init__(self) -> None:
        self.tables: dict[str, exp.Query] = {}

    def copy_item(
        self,
        item: exp.Table,
        label: str,
        columns: Sequence[Node],
        name: str,
        needs: StatementNeeds,
        order: Sequence[tuple[Node, bool]] = (),
    ) -> exp.Table:
        """A copy of a list or table, under a label: the one that there is, or a new one under a name like this.

        The first column numbers the rows where SQLite may look them up, see `sort_sql_by_row_number`.
        """
        select = sql_builder.select(columns, [item.copy()], order=order)
        bare = _drop_labels(select)
        chosen = next((known for known, made in self.tables.items() if _drop_labels(made) == bare), None)
        if chosen is None:
            chosen = needs.choose_table_name(name)
            self.tables[chosen] = select
        return sql_builder.table(chosen, label)

    def copy_table(
        self, item: exp.Table, source: plan.TableSource, needs: StatementNeeds, computed: Sequence[Node] = ()
    ) -> exp.Table:
        """A copy of a table or view in its order, under the label of its item, with computed columns."""
        number: Node = sql_builder.column("rowid")
        order = [(sql_builder.column(key), False) for key in source.order]
        if source.order != ("rowid",):
            position = choose_free_name("position", {column.lower() for column, _ in source.columns})
            number = sql_builder.alias(sql_builder.row_number(order), position)
        columns = [number, *(sql_builder.column(column) for column, _ in source.columns)]
        label = item.alias_or_name
        return self.copy_item(item, label, [*columns, *computed], f"{label}_in_order", needs, order)

    def split_rows_by_keys(
        self, copied: str, label: str, keys: Sequence[Node], needs: StatementNeeds
    ) -> tuple[str, str]:
        """A copy of a copy that has each row once for each of its keys, in a column of its own; the names of both."""
        columns = [sql_builder.column(column.alias_or_name, label) for column in self.tables[copied].selects]
        key = choose_free_name("either" if len(keys) > 1 else "computed", {column.name.lower() for column in columns})
        item = sql_builder.table(copied, label)
        made = [sql_builder.select([*columns, sql_builder.alias(one.copy(), key)], [item.copy()]) for one in keys]
        union: exp.Query = made[0]
        for select in made[1:]:
            union = exp.Union(this=union, expression=select, distinct=True)
        name = needs.choose_table_name(f"{label}_by_{key}")
        self.tables[name] = union
        return name, key

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
            other.replace(sql_builder.WithoutAffinity(this=other.copy()))


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
    while isinstance(copied, exp.Union):
        _keep_columns(copied.expression, kept)
        copied = copied.this
    _keep_columns(copied, kept)


def _keep_columns(select: exp.Expr, kept: Sequence[int]) -> None:
    select.set("expressions", [select.expressions[place] for place in kept])

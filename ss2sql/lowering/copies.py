"""Lists and tables that a statement copies: what is walked again and again, and what a condition looks up.

Walking a list costs three Python calls for each element, 0.5 us; its copy 0.04 us. Where a condition asks for equality,
SQLite makes an index on the copy, as it never does on a virtual table:

    WITH kinds_once AS MATERIALIZED (SELECT rowid, kind, shelf FROM elements_kind_shelf(:kinds))
    SELECT sales.id, kinds.shelf FROM elements_id_kind(:sales) AS sales CROSS JOIN kinds_once AS kinds
    WHERE sales.kind = kinds.kind AND NOT kinds.rowid IS NULL

That index has the key and then the columns that are read, in their order: `rowid`, the first, keeps equal keys in the
order of the list, and has to be read for that. 20,000 rows that look for theirs among 1,000 take 0.1 s, not 9 s. A
table that stands beside lists is walked in its order, too, so an index that does not keep it is of no use there.
"""

from __future__ import annotations

from collections.abc import Callable, Collection

from sqlglot import exp

from ss2sql.lowering import sql
from ss2sql.lowering.sql import Node


class Copies:
    """The copies of one statement, by their names."""

    def __init__(self) -> None:
        self.tables: dict[str, exp.Select] = {}
        self.indexed: set[str] = set()

    def walked(self, item: exp.Table, make_name: Callable[[], str]) -> exp.Table:
        """A copy of a list whose elements have no columns, under a new name where there is none of this list."""
        select = sql.select([sql.column("this")], [exp.Table(this=item.this.copy())])
        name = next((name for name, made in self.tables.items() if made == select), None) or make_name()
        self.tables[name] = select
        return sql.table(name, item.alias_or_name)

    def looked_up(self, item: exp.Table, name: str, columns: tuple[str, ...]) -> exp.Table:
        """A copy of a list or table that SQLite can index, `rowid` first."""
        walked = item.copy()
        walked.set("alias", None)
        self.tables[name] = sql.select([sql.column(column) for column in columns], [walked])
        self.indexed.add(name)
        return sql.table(name, item.alias_or_name)

    def tables_of(self, select: exp.Select) -> list[exp.CTE]:
        """The copies as WITH of the statement, with the columns that it reads."""
        made = []
        for name, copied in self.tables.items():
            table = exp.CTE(this=copied, alias=exp.TableAlias(this=sql.identifier(name)), materialized=True)
            if name in self.indexed:
                keep_columns(table, select)
            made.append(table)
        return made


def in_order(label: str) -> Node:
    """Has SQLite read the number of a copied row, which is all that puts the rows of its index in order."""
    return exp.Not(this=exp.Is(this=sql.column("rowid", label), expression=sql.null()))


def without_affinity(conditions: list[Node], label: str, tables: Collection[str]) -> None:
    """Takes the affinity from columns of tables, by their labels, that a copied list is compared with.

    With an affinity a text could equal a number, so SQLite uses no index of the list. What `=` compares here is of one
    kind. 20,000 rows of a table that look for theirs among 1,000 take 0.01 s, not 0.9 s.
    """
    for condition in conditions:
        if not isinstance(condition, (exp.EQ, exp.Is, exp.NullSafeEQ)):
            continue
        for side, other in (("this", "expression"), ("expression", "this")):
            found, key = condition.args[side], condition.args[other]
            typed = isinstance(found, exp.Column) and found.table in tables
            if typed and isinstance(key, exp.Column) and key.table == label:
                condition.set(side, sql.Bare(this=found))


def asked_equal(conditions: list[Node]) -> set[tuple[str, str, frozenset[str]]]:
    """The columns whose values conditions ask for by equality, as (label, name, the labels of what they must equal)."""
    found: set[tuple[str, str, frozenset[str]]] = set()
    for condition in conditions:
        if not isinstance(condition, (exp.EQ, exp.Is, exp.NullSafeEQ)):
            continue
        for left, other in ((condition.this, condition.expression), (condition.expression, condition.this)):
            bare = left.unnest()
            side = bare.this if isinstance(bare, exp.Collate) else bare
            others = frozenset(column.table for column in other.find_all(exp.Column))
            if isinstance(side, exp.Column) and side.table not in others:
                found.add((side.table, side.name, others))
    return found


def keep_columns(copied: exp.CTE, terms: exp.Expr) -> None:
    """Leaves only those columns in the copy of a table that the terms read."""
    name = copied.alias_or_name
    labels = {item.alias_or_name for item in terms.find_all(exp.Table) if item.name == name}
    read = {column.name for column in terms.find_all(exp.Column) if column.table in labels}
    select = copied.this
    kept = [column for column in select.expressions if column.alias_or_name in read]
    select.set("expressions", kept or select.expressions[:1])

"""A part of a query's product as a table of its own, whose columns are what is read of it outside."""

from __future__ import annotations

from dataclasses import field

from sqlglot import exp

from ss2sql.lowering import sql
from ss2sql.lowering.names import free_name
from ss2sql.lowering.sql import Node
from ss2sql.records import dataclass


@dataclass(slots=True)
class Table:
    """Sources joined in a table of their own; `carry` makes what is read of them columns of it."""

    select: exp.Select
    label: str
    labels: frozenset[str]
    names: dict[tuple[str, str], str] = field(default_factory=dict)
    taken: set[str] = field(default_factory=lambda: {"rowid"})

    def carry(self, node: Node) -> Node:
        """The expression as it reads outside of the table."""
        node = node.copy()
        for column in list(node.find_all(exp.Column)):
            if column.table in self.labels:
                outside = sql.column(self.name_of(column), self.label)
                if column is node:
                    return outside
                column.replace(outside)
        return node

    def name_of(self, column: exp.Column) -> str:
        key = (column.table, column.name)
        if key not in self.names:
            wanted = column.table if column.name == "this" else column.name
            self.names[key] = self.add(wanted, column, len(self.names))
        return self.names[key]

    def add(self, wanted: str, node: Node, position: int | None = None) -> str:
        """A new column of the table, the last one or one at a position; gives its name."""
        name = free_name(wanted, self.taken)
        columns = list(self.select.expressions)
        columns.insert(len(columns) if position is None else position, sql.named(node.copy(), name))
        self.select.set("expressions", columns)
        return name

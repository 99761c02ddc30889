"""What a lowered query needs beside its text: values to bind, functions to have, and where these are called."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from dataclasses import field
from typing import Any

from sqlglot import exp

from ss2sql.errors import Span
from ss2sql.errors.exceptions import escape_controls
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.lowering import sql_builder
from ss2sql.lowering.sql_builder import Node
from ss2sql.lowering.sql_names import build_module_name, choose_free_name
from ss2sql.lowering.sql_query import BlobEncoding, ListTable, Parameter


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

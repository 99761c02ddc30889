"""`arms`: a search over a list literal has a SELECT for each item, where else a list would be made for each state.

    SELECT this FROM [[a + 1, b], [a, b + 1]] ...      SELECT ..., search.a + 1, search.b FROM search WHERE ...
                                                       UNION ALL
                                                       SELECT ..., search.a, search.b + 1 FROM search WHERE ...

Items are scalars, or lists of scalars of one length, whose parts travel as columns; a list is made where a result shows
it. The water jugs of 1,001 litres take a seventh of their time so.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import SCALAR, is_flag, type_of
from ss2sql.language.plan_traversal import walk
from ss2sql.lowering import sql_builder
from ss2sql.lowering.scalar_replacement import build_item_column_name, get_item_position
from ss2sql.lowering.sql_builder import Node
from ss2sql.lowering.sqlite_expressions import ExpressionLowering, Reader, SqlScope

if TYPE_CHECKING:
    from collections.abc import Iterator

MAX_BRANCHES = 8  # items, each of which has all clauses of its own
MAX_NUMBERS = 2  # of these where they are numbers


@dataclass(frozen=True, slots=True)
class UnionBranches:
    """The only source of a search, with its items; `size` is the length of those that are lists."""

    source: plan.ValueSource
    items: tuple[plan.Expr, ...]
    size: int | None

    def list_parts(self, expr: plan.Expr) -> tuple[plan.Column, ...]:
        """The columns that an element travels as; nothing for what does not travel as its parts."""
        if self.size is None or not isinstance(expr, plan.Element) or expr.source != self.source.id:
            return ()
        kinds = self.source.element.positions or ()
        return tuple(
            plan.Column(expr.source, build_item_column_name(at), kind, span=expr.span) for at, kind in enumerate(kinds)
        )

    def make_reader(self, expressions: ExpressionLowering, item: plan.Expr, scope: SqlScope) -> Reader:
        """Reads an item, in the sight of its parts, and these."""

        def read_part(expr: plan.Element | plan.Column) -> Node:
            read_of = item
            if isinstance(expr, plan.Column):
                assert isinstance(item, plan.MakeList)
                read_of = item.items[get_item_position(expr.name)]
            if is_flag(expr.type) and is_flag(read_of.type):
                return expressions.lower_expr(read_of, scope)
            return expressions.unbox_value(expressions.lower_value(read_of, scope), expr.type)

        return read_part

    def lower_row(
        self, expressions: ExpressionLowering, query: plan.Query, item: plan.Expr, scope: SqlScope
    ) -> Iterator[Node]:
        """The values of a step's row, a list as its parts."""
        for output in query.columns:
            if self.list_parts(output.expr) and isinstance(item, plan.MakeList):
                yield from (expressions.lower_value(part, scope) for part in item.items)
            else:
                yield expressions.lower_value(output.expr, scope)


def find_union_branches(query: plan.Query) -> UnionBranches | None:
    """The items of the only source of a search, where each may have a SELECT of its own."""
    search, source = query.search, query.sources[0]
    if search is None or search.weight is not None or len(query.sources) > 1:
        return None
    if not search.plain or not query.gives_paths:
        return None
    if not isinstance(source, plan.ValueSource):
        return None
    items = (
        _get_number_items(query, source.value)
        if isinstance(source.value, plan.Constant)
        else _get_list_items(source.value)
    )
    if not items or len(items) > MAX_BRANCHES or any(_calls_user_code(item) for item in items):
        return None
    if all(item.type.is_only(SCALAR) for item in items):
        return UnionBranches(source, items, None)
    sizes = {len(item.items) if isinstance(item, plan.MakeList) else 0 for item in items}
    parts = [part for item in items if isinstance(item, plan.MakeList) for part in item.items]
    size = sizes.pop()
    if sizes or not size or not all(part.type.is_only(SCALAR) for part in parts):
        return None
    return None if len(source.element.positions or ()) != size else UnionBranches(source, items, size)


def _get_list_items(value: plan.Expr) -> tuple[plan.Expr, ...]:
    return value.items if isinstance(value, plan.MakeList) else ()


def _get_number_items(query: plan.Query, value: plan.Constant) -> tuple[plan.Expr, ...]:
    """Those of a literal of a few numbers, which is a constant; a function that takes one is called with the list."""
    items = value.value
    few = type(items) is list and len(items) <= MAX_NUMBERS and all(type(item) in (int, float) for item in items)
    if not few or _calls_user_code(query):
        return ()
    return tuple(plan.Constant(item, type_of(item), span=value.span) for item in items)


def _calls_user_code(item: plan.Expr | plan.Query) -> bool:
    """Whether an item calls a function of the user, or evaluates a query: every clause would do so."""
    return any(
        isinstance(n, plan.Subquery) or (isinstance(n, plan.Call) and not n.function.builtin) for n in walk(item)
    )


def lower_parts_as_list(expressions: ExpressionLowering, parts: list[tuple[Node, plan.Column]]) -> Node:
    """The list of parts that stand in columns."""
    return sql_builder.call("list", *(expressions.box_flag(node) if is_flag(p.type) else node for node, p in parts))

"""Short lists without a table of elements: `positions` makes columns of what is read, `arms` a SELECT for each item.

    SELECT this[1] FROM edges WHERE this[0] == 3        as if it were        SELECT dst FROM edges WHERE src == 3

So `this[0]` costs no call of a function (0.2 us), and SQLite can look rows up by it, as by the parts of `x IN this`,
which is `x IN [this[0], this[1]]`. It is done where the lists are known to have one length, for sources of searches,
for those that stand alone, and in a join for those whose `this[0]` has to equal something: other lists are walked
again and again, and a copy of the lists alone is the quickest to walk.

    SELECT this FROM [[a + 1, b], [a, b + 1]] ...      SELECT ..., search.a + 1, search.b FROM search WHERE ...
                                                       UNION ALL
                                                       SELECT ..., search.a, search.b + 1 FROM search WHERE ...

Items are scalars, or lists of scalars of one length, whose parts travel as columns; a list is made where a result shows
it. The water jugs of 1,001 litres take a seventh of their time so.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import TYPE_CHECKING, Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.kinds import SCALAR, Kind, is_flag, type_of
from ss2sql.language.plan_traversal import list_sources, rebuild_node, split_and, walk
from ss2sql.lowering import sql_builder
from ss2sql.lowering.guards import is_costly
from ss2sql.lowering.rewrites.rewrite_context import list_items, make_call
from ss2sql.lowering.sql_builder import Node
from ss2sql.lowering.sqlite_expressions import ExpressionLowering, Reader, SqlScope

if TYPE_CHECKING:
    from collections.abc import Iterator


_ListSource = plan.ValueSource | plan.QuerySource
MAX_MEMBERS = 8  # parts of a list of which one has to be equal


def replace_elements_by_columns(query: plan.Query) -> tuple[plan.Query, Callable[[plan.Expr], plan.Expr] | None]:
    """The query with `this[0]` as the column `this_0`, and what gives a part of it as it was; None if all is.

    Only SQL has these columns: what Python evaluates of the query, as a parameter, has to be as it was.
    """
    sources = {
        source.id: source
        for node in walk(query)
        if isinstance(node, plan.Query)
        for source in node.sources
        if isinstance(source, _ListSource) and source.element.kinds == Kind.LIST and source.columns == ()
        if node.search is not None or len(node.sources) == 1 or _is_join_key(node, source.id)
    }
    used: dict[int, dict[int, plan.Call]] = {}
    for node in walk(query):
        for read_of in (node, *_list_members(node, sources)):
            place = _find_list_element(read_of, sources)
            if place is not None:
                used.setdefault(place[0], {}).setdefault(place[1], read_of)
    if not used:
        return query, None
    read = {(source, name_element_column(at)): n for source, places in used.items() for at, n in places.items()}

    def replace_source(node: Any) -> Any:
        place = _find_list_element(node, sources)
        if place is not None:
            return plan.Column(place[0], name_element_column(place[1]), node.type, span=node.span)
        if members := _list_members(node, sources):
            item, element = node.arguments
            parts = plan.MakeList(members, element.type, span=element.span)
            node = replace(node, arguments=(item, parts))
        node = rebuild_node(node, replace_source)
        if isinstance(node, _ListSource) and node.id in used:
            positions = node.element.positions or ()
            return replace(
                node, columns=tuple((name_element_column(at), positions[at]) for at in sorted(used[node.id]))
            )
        return node

    def replace_reads(node: Any) -> Any:
        if isinstance(node, plan.Column) and (node.source, node.name) in read:
            return read[node.source, node.name]
        node = rebuild_node(node, replace_reads)
        return replace(node, columns=()) if isinstance(node, _ListSource) and node.id in used else node

    return rebuild_node(query, replace_source), replace_reads


def name_element_column(position: int) -> str:
    return f"this_{position}"


def get_element_position(column: str) -> int:
    return int(column.removeprefix("this_"))


def _is_join_key(query: plan.Query, source: int) -> bool:
    """Whether an element of the lists of a source has to equal what other sources give."""
    for part in split_and(query.where):
        match part:
            case plan.Call(function=plan.Function(name="eq", builtin=True), arguments=(left, right)):
                for key, other in ((left, right), (right, left)):
                    item = isinstance(key, plan.Call) and key.function.name == "item" and key.function.builtin
                    if item and list_sources(key) == {source} and source not in list_sources(other):
                        return True
    return False


def _find_list_element(node: Any, sources: dict[int, _ListSource]) -> tuple[int, int] | None:
    """The source and the position of an element of one of its lists, where the node reads one."""
    match node:
        case plan.Call(
            function=plan.Function(name="item", builtin=True),
            arguments=(plan.Element(source=source), plan.Constant(value=int(index))),
        ) if source in sources:
            size = len(sources[source].element.positions or ())
            return (source, index % size) if -size <= index < size else None
    return None


def _list_members(node: Any, sources: dict[int, _ListSource]) -> tuple[plan.Call, ...]:
    """`this[0]` and `this[1]` of `x IN this`, where lists have one short length."""
    match node:
        case plan.Call(
            function=plan.Function(name="in" | "not_in", builtin=True),
            arguments=(_, plan.Element(source=source) as this),
        ) if source in sources:
            size = len(sources[source].element.positions or ())
            places = [plan.Constant(at, type_of(at), span=this.span) for at in range(size)]
            return tuple(make_call("item", this, place, span=this.span) for place in places if size <= MAX_MEMBERS)
    return ()


# --- `arms`: a search over a list literal has a SELECT for each item, where else a list would be made for each state
MAX_BRANCHES = 8  # items, each of which has all clauses of its own
MAX_NUMBERS = 2  # of these where they are numbers


@dataclass(frozen=True, slots=True)
class UnionBranches:
    """The only source of a search, with its items."""

    source: plan.ValueSource
    items: tuple[plan.Expr, ...]

    def list_parts(self, expr: plan.Expr) -> tuple[plan.Column, ...]:
        """The columns that an element travels as; nothing for what does not travel as its parts."""
        if not isinstance(expr, plan.Element) or expr.source != self.source.id:
            return ()
        kinds = self.source.element.positions or ()
        return tuple(
            plan.Column(expr.source, name_element_column(at), kind, span=expr.span) for at, kind in enumerate(kinds)
        )

    def make_reader(self, expressions: ExpressionLowering, item: plan.Expr, scope: SqlScope) -> Reader:
        """Reads an item, in the sight of its parts, and these."""

        def read_part(expr: plan.Element | plan.Column) -> Node:
            read_of = item
            if isinstance(expr, plan.Column):
                assert isinstance(item, plan.MakeList)
                read_of = item.items[get_element_position(expr.name)]
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
    if search is None or search.weight is not None or len(query.sources) > 1 or query.aggregated:
        return None
    if search.each or search.key or search.siblings or search.order == "greedy":
        return None
    if not isinstance(source, plan.ValueSource):
        return None
    items = _list_branch_values(query, source.value)
    if not items or len(items) > MAX_BRANCHES or any(map(is_costly, items)):  # every clause would evaluate them
        return None
    if all(item.type.is_only(SCALAR) for item in items):
        return UnionBranches(source, items)
    sizes = {len(item.items) if isinstance(item, plan.MakeList) else 0 for item in items}
    parts = [part for item in items if isinstance(item, plan.MakeList) for part in item.items]
    size = sizes.pop()
    if sizes or not size or not all(part.type.is_only(SCALAR) for part in parts):
        return None
    return None if len(source.element.positions or ()) != size else UnionBranches(source, items)


def _list_branch_values(query: plan.Query, value: plan.Expr) -> tuple[plan.Expr, ...]:
    """The items of a list that is written out; of a constant one if they are a few numbers, not for a function."""
    items = list_items(value)
    numbers = all(item.type.is_only(Kind.INT | Kind.FLOAT) for item in items)
    few = len(items) <= MAX_NUMBERS and numbers and not is_costly(query)
    return items if isinstance(value, plan.MakeList) or few else ()


def lower_parts_as_list(expressions: ExpressionLowering, parts: list[tuple[Node, plan.Column]]) -> Node:
    """The list of parts that stand in columns."""
    return sql_builder.call("list", *(expressions.box_flag(node) if is_flag(p.type) else node for node, p in parts))

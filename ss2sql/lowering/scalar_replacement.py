"""`positions`: what is read of short lists that a source gives becomes columns of the source.

    SELECT this[1] FROM edges WHERE this[0] == 3        as if it were        SELECT dst FROM edges WHERE src == 3

So `this[0]` costs no call of a function (0.2 us), and SQLite can look rows up by it. It is done where the lists are
known to have one length, for sources of searches, for those that stand alone, and in a join for those whose `this[0]`
has to equal something: other lists are walked again and again, and a copy of the lists alone is the quickest to walk.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from ss2sql.language import plan
from ss2sql.language.kinds import Kind
from ss2sql.language.plan_traversal import list_sources, rebuild_node, split_and, walk

_ListSource = plan.ValueSource | plan.QuerySource


def replace_items_by_columns(query: plan.Query) -> tuple[plan.Query, Callable[[plan.Expr], plan.Expr] | None]:
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
        place = _find_item(node, sources)
        if place is not None:
            used.setdefault(place[0], {}).setdefault(place[1], node)
    if not used:
        return query, None
    read = {(source, build_item_column_name(at)): n for source, places in used.items() for at, n in places.items()}

    def replace_source(node: Any) -> Any:
        place = _find_item(node, sources)
        if place is not None:
            return plan.Column(place[0], build_item_column_name(place[1]), node.type, span=node.span)
        node = rebuild_node(node, replace_source)
        if isinstance(node, _ListSource) and node.id in used:
            positions = node.element.positions or ()
            return replace(
                node, columns=tuple((build_item_column_name(at), positions[at]) for at in sorted(used[node.id]))
            )
        return node

    def replace_reads(node: Any) -> Any:
        if isinstance(node, plan.Column) and (node.source, node.name) in read:
            return read[node.source, node.name]
        node = rebuild_node(node, replace_reads)
        return replace(node, columns=()) if isinstance(node, _ListSource) and node.id in used else node

    return rebuild_node(query, replace_source), replace_reads


def build_item_column_name(position: int) -> str:
    return f"this_{position}"


def get_item_position(column: str) -> int:
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


def _find_item(node: Any, sources: dict[int, _ListSource]) -> tuple[int, int] | None:
    """The source and the position of an element of one of its lists, where the node reads one."""
    match node:
        case plan.Call(
            function=plan.Function(name="item", builtin=True),
            arguments=(plan.Element(source=source), plan.Constant(value=int(index))),
        ) if source in sources:
            size = len(sources[source].element.positions or ())
            return (source, index % size) if -size <= index < size else None
    return None

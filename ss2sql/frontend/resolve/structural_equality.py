"""Structural equality of expressions, whatever the numbers of the queries and sources inside."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from ss2sql.language import plan
from ss2sql.language.plan_traversal import rebuild_node, walk


def is_structurally_equal(one: plan.Expr, other: plan.Expr) -> bool:
    """Whether both are equal once the queries and sources inside have the same numbers."""
    if type(one) is not type(other) or one == other:
        return one == other
    ones, others = _collect_structural_ids(one), _collect_structural_ids(other)
    return 0 < len(ones) == len(others) and renumber_node(other, dict(zip(others, ones, strict=True))) == one


def _collect_structural_ids(node: plan.Expr) -> list[int]:
    """The numbers of the queries and sources inside, in the order of the plan; they are unique in a script."""
    return [part.id for part in walk(node) if isinstance(part, (plan.Query, *plan.SOURCES))]


def renumber_node(node: Any, numbers: Mapping[int, int]) -> Any:
    """The node with the numbers of queries and sources replaced by `numbers`, as far as that names them."""
    node = rebuild_node(node, lambda part: renumber_node(part, numbers))
    match node:
        case plan.Element(source=number) | plan.Column(source=number):
            return replace(node, source=numbers.get(number, number))
        case plan.State(query=number) | plan.GroupKey(query=number):
            return replace(node, query=numbers.get(number, number))
        case plan.Eval(sources=sources, states=states):
            renamed = tuple((numbers.get(query, query), name) for query, name in states)
            return replace(node, sources=tuple(numbers.get(each, each) for each in sources), states=renamed)
        case _:
            own = isinstance(node, (plan.Query, *plan.SOURCES)) and node.id in numbers
            return replace(node, id=numbers[node.id]) if own else node

"""The paths of a search as a graph of networkx."""

from __future__ import annotations

from collections.abc import Hashable
from itertools import islice, pairwise
from typing import TYPE_CHECKING, Any

from ss2sql.errors import RepresentationError
from ss2sql.language.rows import Row
from ss2sql.language.values import Opaque, copy_for_python
from ss2sql.results import get_paths, require_package

if TYPE_CHECKING:
    from ss2sql.results.result import Result

NONE: Any = type(None)


def build_graph(result: Result, most: int | None = None) -> Any:
    """A networkx.DiGraph of the rows of the first `most` paths, see `Result.graph`."""
    networkx = require_package("networkx", "plot", "graph()")
    paths = get_paths(result)
    if paths is None:
        raise RepresentationError(
            "V001", "graph() needs the paths of a search", hints=("a query is a search with CONNECT BY",)
        )
    made = networkx.DiGraph(columns=result.columns[2:])
    for path in islice(paths, most):
        nodes = [make_graph_node(row) for row in path]
        for step, (name, row) in enumerate(zip(nodes, path, strict=True), 1):
            if name not in made:
                made.add_node(name, row=tuple(map(copy_for_python, row)), step=step, start=False, goal=False)
            known = made.nodes[name]
            known["step"] = min(known["step"], step)
        made.nodes[nodes[0]]["start"] = True
        made.nodes[nodes[-1]]["goal"] = True
        for step, (left, right) in enumerate(pairwise(nodes), 2):
            if not made.has_edge(left, right):
                made.add_edge(left, right, step=step, paths=0)
            edge = made.edges[left, right]
            edge["step"] = min(edge["step"], step)
            edge["paths"] += 1
    return made


def make_graph_node(row: Row) -> Hashable:
    """The node of a row: its value where it has one column, else a tuple of its values; equal rows are one node.

    None alone, which is no node for networkx, becomes NoneType.
    """
    if len(row) != 1:
        return tuple(map(_make_hashable, row))
    name: Hashable = _make_hashable(row[0])
    return NONE if name is None else name


def _make_hashable(value: Any) -> Any:
    """The value as a key: lists as tuples, dicts as frozensets of pairs; an object without a hash as an Opaque."""
    if isinstance(value, list):
        return tuple(map(_make_hashable, value))
    if isinstance(value, dict):
        return frozenset((key, _make_hashable(item)) for key, item in value.items())
    return value.object if isinstance(value, Opaque) and value.key is value.object else value

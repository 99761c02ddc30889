"""The graph libraries: each builds its graph from a list of edges and looks for one shortest path."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from problems.base import Prepare, Work


@dataclass(frozen=True)
class Graph:
    """Nodes 0 .. `nodes` - 1 and directed edges (from, to), or (from, to, cost) where `weighted`."""

    nodes: int
    edges: Sequence[tuple[Any, ...]]
    start: int
    goal: int
    weighted: bool = False


Make = Callable[[int], Callable[[], Graph]]  # takes the size, gives what is run
Distance = Callable[[int, int], float]


def libraries(
    make: Make,
    answer: Callable[[Sequence[int], int], Any],
    bound: Callable[[int], Distance] | None = None,
) -> dict[str, Prepare]:
    """One contender per library. `answer(path, size)` makes a path of nodes comparable.

    Making the edges and building the graph is measured with the search: the problem is given as it is, not as a graph.
    With `bound`, a lower bound of the cost between two nodes, the search is A*.
    """
    searches = {"networkx": with_networkx, "rustworkx": with_rustworkx, "igraph": with_igraph}

    def contender(search: Callable[[Distance | None], Callable[[Graph], Sequence[int]]]) -> Prepare:
        def prepare(size: int) -> Work:
            edges = make(size)
            find = search(None if bound is None else bound(size))
            return Work(lambda: find(edges()), lambda path: answer(path, size))

        return prepare

    return {name: contender(search) for name, search in searches.items()}


def with_networkx(bound: Distance | None) -> Callable[[Graph], Sequence[int]]:
    import networkx as nx

    def find(graph: Graph) -> Sequence[int]:
        built = nx.DiGraph()
        if graph.weighted:
            built.add_weighted_edges_from(graph.edges)
        else:
            built.add_edges_from(graph.edges)
        weight = "weight" if graph.weighted else None
        if bound is not None:
            return list(nx.astar_path(built, graph.start, graph.goal, bound, weight))
        return list(nx.shortest_path(built, graph.start, graph.goal, weight))

    return find


def with_rustworkx(bound: Distance | None) -> Callable[[Graph], Sequence[int]]:
    import rustworkx as rx

    def find(graph: Graph) -> Sequence[int]:
        built = rx.PyDiGraph(multigraph=False)
        built.add_nodes_from(range(graph.nodes))
        if graph.weighted:
            built.add_edges_from(graph.edges)
        else:
            built.add_edges_from_no_data(graph.edges)
        if bound is not None:
            goal = graph.goal
            return list(rx.astar_shortest_path(built, graph.start, goal.__eq__, float, lambda node: bound(node, goal)))
        weight = float if graph.weighted else None
        return list(rx.dijkstra_shortest_paths(built, graph.start, graph.goal, weight_fn=weight)[graph.goal])

    return find


def with_igraph(bound: Distance | None) -> Callable[[Graph], Sequence[int]]:
    import igraph

    def find(graph: Graph) -> Sequence[int]:
        edges = [edge[:2] for edge in graph.edges] if graph.weighted else graph.edges
        built = igraph.Graph(graph.nodes, edges, directed=True)
        weights = [edge[2] for edge in graph.edges] if graph.weighted else None
        if bound is not None:
            return built.get_shortest_path_astar(
                graph.start, graph.goal, lambda _, node, goal: bound(node, goal), weights=weights
            )
        return built.get_shortest_path(graph.start, graph.goal, weights=weights)

    return find

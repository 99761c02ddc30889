"""The graph or the tree of a search: as one of networkx, and as a picture in layers from left to right."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Hashable, Mapping, Sequence
from itertools import islice, pairwise
from statistics import mean
from typing import TYPE_CHECKING, Any

from ss2sql.errors import require_package
from ss2sql.language.rows import Row
from ss2sql.language.values import Opaque, copy_for_python
from ss2sql.results import count_words, get_result_paths
from ss2sql.results.plot_style import (
    BLUE,
    FRAME,
    NO_PATHS,
    ORANGE,
    PALE,
    count_drawn_paths,
    describe_status,
    make_plot_error,
    shorten_plot_label,
)
from ss2sql.results.show import format_cell

if TYPE_CHECKING:
    from ss2sql.results.result import Result


NONE: Any = type(None)


def build_graph(result: Result, most: int | None = None) -> Any:
    """A networkx.DiGraph of the rows of the first `most` paths, see `Result.graph`."""
    networkx = require_package("networkx", "plot", "graph()")
    paths = get_result_paths(result)
    if paths is None:
        make_plot_error("graph() needs the paths of a search", NO_PATHS)
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
        return tuple(map(_make_plot_node, row))
    name: Hashable = _make_plot_node(row[0])
    return NONE if name is None else name


def _make_plot_node(value: Any) -> Any:
    """The value as a key: lists as tuples, dicts as frozensets of pairs; an object without a hash as an Opaque."""
    if isinstance(value, list):
        return tuple(map(_make_plot_node, value))
    if isinstance(value, dict):
        return frozenset((key, _make_plot_node(item)) for key, item in value.items())
    return value.object if isinstance(value, Opaque) and value.key is value.object else value


MOST_NODES = 150
MOST_NAMED = 40  # nodes with labels
MOST_TEXT = 22
MOST_LINES = 2  # in the text of a node, one for each column
WIDEST = 18.0  # inches of a picture
LONGER = 2  # layers with all edges to the right, at most this multiple of the layers by steps
SWEEPS = 4  # over the layers, to draw neighbours close to each other
RING = 2.2  # points of the ring around a first step
TALL = 0.5  # inches that a row of a tree takes


def draw_graph(result: Result, ax: Any, most: int | None, own: bool) -> str:
    """Draws the graph of the first paths, as many as fit, or `most`; gives the title.

    The figure gets the size that the graph needs where it is our own.
    """
    networkx = require_package("networkx", "plot", "plot()")
    paths = get_result_paths(result)
    assert paths is not None
    graph, drawn = (
        _fit_graph(result, len(paths)) if most is None else (build_graph(result, most), min(most, len(paths)))
    )
    layers = assign_layers(networkx, graph)
    places = place_layers(graph, layers)
    texts = {node: _label_row(graph.nodes[node]["row"]) for node in places}
    tall = 1 + 0.7 * max(map(len, layers))
    _draw_graph(networkx, graph, places, texts, ax, (len(layers), tall) if own else None)
    return f"{count_words(len(graph), 'row')} on {count_drawn_paths(len(paths), drawn)}{describe_status(result)}"


def draw_tree(result: Result, ax: Any, most: int | None, own: bool) -> str:
    """Draws the tree of the first paths, with common beginnings shared; gives the title."""
    networkx = require_package("networkx", "plot", "plot()")
    paths = get_result_paths(result)
    assert paths is not None
    graph, drawn = build_tree(networkx, paths, most)
    places = place_trees(graph, [0])
    texts = {number: _label_row(row) if row is not None else "start" for number, row in graph.nodes(data="row")}
    layers = max(int(across) for across, _ in places.values())
    tall = 1 + TALL * sum(1 for number in graph if not graph.out_degree(number))
    _draw_graph(networkx, graph, places, texts, ax, (layers, tall) if own else None, arrows=False)
    return f"the tree of {count_drawn_paths(len(paths), drawn)}, {len(graph) - 1} steps{describe_status(result)}"


def build_tree(networkx: Any, paths: Sequence[Sequence[Row]], most: int | None) -> tuple[Any, int]:
    """A graph whose nodes are numbers, 0 the start, with the number of its paths: `most`, or as many as fit."""
    graph = networkx.DiGraph()
    graph.add_node(0, row=None, start=False, goal=False)
    known: dict[tuple[int, Any], int] = {}
    drawn = 0
    for path in islice(paths, most):
        if most is None and drawn and len(graph) + len(path) > MOST_NODES:
            break
        drawn += 1
        layer = 0
        for step, row in enumerate(path):
            key = (layer, make_graph_node(row))
            if key not in known:
                known[key] = len(graph)
                graph.add_node(known[key], row=row, start=step == 0, goal=False)
                graph.add_edge(layer, known[key])
            layer = known[key]
        graph.nodes[layer]["goal"] = True
    return graph, drawn


def place_trees(graph: Any, roots: list[int]) -> dict[Any, tuple[int, float]]:
    """A position for each node of trees: leaves one under the other, others in the middle of their children."""
    places: dict[Any, tuple[int, float]] = {}
    ends = 0
    depths = dict.fromkeys(roots, 1)
    for number in graph:  # parents come before their children
        for child in graph.successors(number):
            depths[child] = depths[number] + 1
    order, stack = [], roots[::-1]
    while stack:
        order.append(stack.pop())
        stack.extend(reversed(list(graph.successors(order[-1]))))
    for number in order:
        if not graph.out_degree(number):
            places[number] = (depths[number], float(-ends))
            ends += 1
    for number in reversed(order):
        if number not in places:
            heights = [places[child][1] for child in graph.successors(number)]
            places[number] = (depths[number], (heights[0] + heights[-1]) / 2)
    return places


def _draw_graph(
    networkx: Any,
    graph: Any,
    places: Mapping[Any, tuple[int, float]],
    texts: dict[Any, str],
    ax: Any,
    size: tuple[int, float] | None,
    arrows: bool = True,
) -> None:
    """Draws nodes, edges and labels; `size` is the number of layers and the height in inches of our own figure."""
    layers = size[0] if size else max(across for across, _ in places.values())
    widest = max(len(line) for text in texts.values() for line in text.splitlines())
    wide = 1.5 + layers * max(0.7, 0.09 * widest)  # inches
    named = len(graph) <= MOST_NAMED and wide <= WIDEST
    if size:
        ax.figure.set_size_inches(max(6.0, min(WIDEST, wide)), max(3.0, min(WIDEST * 0.75, size[1])))
    data, node_size = [own for _, own in graph.nodes(data=True)], 160 if named else 40
    networkx.draw_networkx_nodes(
        graph, places, ax=ax, node_size=node_size,
        node_color=[ORANGE if own["goal"] else PALE for own in data],
        edgecolors=[BLUE if own["start"] else FRAME for own in data],
        linewidths=[RING if own["start"] else 0.7 for own in data],
    )  # fmt: skip
    straight = [edge for edge in graph.edges if places[edge[1]][0] - places[edge[0]][0] == 1]  # to the next layer
    bent = [edge for edge in graph.edges if places[edge[1]][0] - places[edge[0]][0] != 1]  # around nodes between
    for edges, rad in ((straight, 0.0), (bent, 0.25)):
        networkx.draw_networkx_edges(
            graph, places, edgelist=edges, ax=ax, node_size=node_size, edge_color="#888888", arrowsize=9, width=0.9,
            arrowstyle="-|>" if arrows else "-", connectionstyle=f"arc3,rad={rad}",
        )  # fmt: skip
    for number, text in texts.items() if named else ():
        ax.annotate(text, places[number], xytext=(0, 9), textcoords="offset points", ha="center", fontsize=8, zorder=3,
                    bbox={"boxstyle": "square,pad=0", "facecolor": "white", "alpha": 0.7, "linewidth": 0})  # fmt: skip
    heights = [y for _, y in places.values()]
    ax.set_xlim(0.5, layers + 0.5)
    ax.set_ylim(min(heights) - 0.7, max(heights) + 0.9)
    ax.set_axis_off()
    marks: dict[str, dict[str, Any]] = {"first step": {"color": PALE, "edgecolor": BLUE, "linewidth": RING},
             "last step": {"color": ORANGE, "edgecolor": FRAME}}  # fmt: skip
    handles = [ax.scatter([], [], s=70, label=name, **mark) for name, mark in marks.items()]
    ax.legend(handles=handles, frameon=False, loc="upper left", bbox_to_anchor=(1, 1))


def _fit_graph(result: Result, total: int) -> tuple[Any, int]:
    """The graph of all paths, or of as many as leave it readable."""
    most = total
    graph = build_graph(result, min(most, MOST_NODES))
    while len(graph) > MOST_NODES and most > 1:
        most = min(most, MOST_NODES) // 2
        graph = build_graph(result, most)
    return graph, min(most, total)


def assign_layers(networkx: Any, graph: Any) -> list[list[Any]]:
    """The layers from left to right: if possible with all edges to the right, else by least steps."""
    steps: defaultdict[int, list[Any]] = defaultdict(list)
    for node, data in graph.nodes(data=True):
        steps[data["step"]].append(node)
    if networkx.is_directed_acyclic_graph(graph):
        layers = [list(nodes) for nodes in networkx.topological_generations(graph)]
        if len(layers) <= LONGER * len(steps):
            return layers
    return [steps[step] for step in sorted(steps)]


def place_layers(graph: Any, layers: list[list[Any]]) -> dict[Any, tuple[int, float]]:
    """A position for each node: its layer's x, and a y near its neighbours."""
    heights: dict[Any, float] = {}
    for nodes in layers:
        heights.update(_spread_nodes(nodes))
    for sweep in range(SWEEPS):
        forward = sweep % 2 == 0
        near = graph.predecessors if forward else graph.successors
        for nodes in layers if forward else reversed(layers):
            wanted = {node: mean([heights[other] for other in near(node)] or [heights[node]]) for node in nodes}
            nodes.sort(key=wanted.__getitem__)
            nodes.reverse()
            heights.update(_spread_nodes(nodes))
    return {node: (across, heights[node]) for across, nodes in enumerate(layers, 1) for node in nodes}


def _spread_nodes(nodes: list[Any]) -> dict[Any, float]:
    """The nodes of a layer one over the other, around the middle."""
    return {node: (len(nodes) - 1) / 2 - index for index, node in enumerate(nodes)}


def _label_row(row: tuple[Any, ...]) -> str:
    return "\n".join(shorten_plot_label(format_cell(value), MOST_TEXT) for value in row[:MOST_LINES])

"""The graph of a search as a picture, in layers from left to right."""

from __future__ import annotations

from collections import defaultdict
from statistics import mean
from typing import TYPE_CHECKING, Any

from ss2sql.results import found_paths, package
from ss2sql.results.graphs import graph
from ss2sql.results.show import cell

if TYPE_CHECKING:
    from ss2sql.runtime.result import Result

MOST_NODES = 150
MOST_NAMED = 40  # nodes that are written at
MOST_TEXT = 22
MOST_LINES = 2  # in the text of a node, one for each column
WIDEST = 18.0  # inches of a picture
LONGER = 2  # times the layers by steps that the other ones may be
SWEEPS = 4  # over the layers, to draw neighbours close to each other
START, GOAL, OTHER, FRAME = "#8fd3ac", "#f2a38c", "#c9d8ea", "#444444"


def draw_graph(result: Result, ax: Any, most: int | None, own: bool) -> str:
    """Draws the graph of the first paths, as many as fit, or `most`; gives the title.

    The figure gets the size that the graph needs where it is our own.
    """
    networkx = package("networkx", "plot", "plot()")
    paths = found_paths(result)
    assert paths is not None
    made, drawn = _fitting(result, len(paths)) if most is None else (graph(result, most), min(most, len(paths)))
    layers = layers_of(networkx, made)
    places = layered(made, layers)
    texts = {node: _text(made.nodes[node]["row"]) for node in places}
    widest = max(len(line) for text in texts.values() for line in text.splitlines())
    wide = 1.5 + len(layers) * max(0.7, 0.09 * widest)  # inches
    named = len(made) <= MOST_NAMED and wide <= WIDEST
    if not named:
        texts.clear()
    if own:
        tall = 1 + 0.7 * max(map(len, layers))
        ax.figure.set_size_inches(max(6.0, min(WIDEST, wide)), max(3.0, min(WIDEST * 0.75, tall)))
    _draw_nodes(networkx, made, places, ax, 160 if named else 40)
    for node, text in texts.items():
        ax.annotate(text, places[node], xytext=(0, 9), textcoords="offset points", ha="center", fontsize=8,
                    bbox={"boxstyle": "square,pad=0", "facecolor": "white", "alpha": 0.7, "linewidth": 0})  # fmt: skip
    heights = [y for _, y in places.values()]
    ax.set_xlim(0.5, len(layers) + 0.5)
    ax.set_ylim(min(heights) - 0.7, max(heights) + 0.9)
    ax.set_axis_off()
    marks = [("first step", START), ("last step", GOAL)]
    handles = [ax.scatter([], [], color=colour, edgecolor=FRAME, label=name) for name, colour in marks]
    ax.legend(handles=handles, frameon=False, loc="upper left", bbox_to_anchor=(1, 1))
    counted = f"{drawn} path{'' if drawn == 1 else 's'}"
    return f"{len(made)} rows on {counted if drawn == len(paths) else f'the first {drawn} of {len(paths)} paths'}"


def _draw_nodes(networkx: Any, made: Any, places: dict[Any, tuple[int, float]], ax: Any, size: int) -> None:
    """The nodes and the edges: straight ones to the next layer, others bent around the nodes between."""
    colours = [GOAL if data["goal"] else START if data["start"] else OTHER for _, data in made.nodes(data=True)]
    networkx.draw_networkx_nodes(
        made, places, ax=ax, node_color=colours, node_size=size, edgecolors=FRAME, linewidths=0.7
    )
    straight = [edge for edge in made.edges if places[edge[1]][0] - places[edge[0]][0] == 1]
    bent = [edge for edge in made.edges if places[edge[1]][0] - places[edge[0]][0] != 1]
    for edges, rad in ((straight, 0.0), (bent, 0.25)):
        networkx.draw_networkx_edges(
            made, places, edgelist=edges, ax=ax, node_size=size, edge_color="#888888", arrowsize=9, width=0.9,
            connectionstyle=f"arc3,rad={rad}",
        )  # fmt: skip


def _fitting(result: Result, total: int) -> tuple[Any, int]:
    """The graph of all paths, or of as many as leave it readable."""
    most = total
    made = graph(result, min(most, MOST_NODES))
    while len(made) > MOST_NODES and most > 1:
        most = min(most, MOST_NODES) // 2
        made = graph(result, most)
    return made, min(most, total)


def layers_of(networkx: Any, made: Any) -> list[list[Any]]:
    """The nodes from left to right: if possible so that every edge leads to the right, else by least steps."""
    steps: defaultdict[int, list[Any]] = defaultdict(list)
    for node, data in made.nodes(data=True):
        steps[data["step"]].append(node)
    if networkx.is_directed_acyclic_graph(made):
        layers = [list(nodes) for nodes in networkx.topological_generations(made)]
        if len(layers) <= LONGER * len(steps):
            return layers
    return [steps[step] for step in sorted(steps)]


def layered(made: Any, layers: list[list[Any]]) -> dict[Any, tuple[int, float]]:
    """A place for each node: across by its layer, up and down near its neighbours."""
    heights: dict[Any, float] = {}
    for nodes in layers:
        heights.update(_spread(nodes))
    for sweep in range(SWEEPS):
        forward = sweep % 2 == 0
        near = made.predecessors if forward else made.successors
        for nodes in layers if forward else reversed(layers):
            wanted = {node: mean([heights[other] for other in near(node)] or [heights[node]]) for node in nodes}
            nodes.sort(key=wanted.__getitem__)
            nodes.reverse()
            heights.update(_spread(nodes))
    return {node: (across, heights[node]) for across, nodes in enumerate(layers, 1) for node in nodes}


def _spread(nodes: list[Any]) -> dict[Any, float]:
    """The nodes of a layer one over the other, around the middle."""
    return {node: (len(nodes) - 1) / 2 - index for index, node in enumerate(nodes)}


def _text(row: tuple[Any, ...]) -> str:
    lines = [cell(value) for value in row[:MOST_LINES]]
    return "\n".join(line if len(line) <= MOST_TEXT else line[: MOST_TEXT - 1] + "…" for line in lines)

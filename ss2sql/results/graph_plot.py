"""The graph of a search as a picture: steps from left to right, in layers."""

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
SWEEPS = 4  # over the layers, to draw neighbours close to each other
START, GOAL, OTHER = "#8fd3ac", "#f2a38c", "#c9d8ea"


def draw_graph(result: Result, ax: Any, most: int | None) -> str:
    """Draws the graph of the first paths, as many as fit, or `most`; gives the title."""
    networkx = package("networkx", "plot", "plot()")
    paths = found_paths(result)
    assert paths is not None
    made, drawn = _fitting(result, len(paths)) if most is None else (graph(result, most), min(most, len(paths)))
    places = layered(made)
    colours = [GOAL if data["goal"] else START if data["start"] else OTHER for _, data in made.nodes(data=True)]
    named = len(made) <= MOST_NAMED
    networkx.draw_networkx_nodes(
        made, places, ax=ax, node_color=colours, node_size=160 if named else 40, edgecolors="#444444", linewidths=0.7
    )
    networkx.draw_networkx_edges(
        made, places, ax=ax, node_size=160 if named else 40, edge_color="#888888", arrowsize=9, width=0.9,
        connectionstyle="arc3,rad=0.08",
    )  # fmt: skip
    if named:
        for node, (x, y) in places.items():
            ax.annotate(_text(made.nodes[node]["row"]), (x, y), xytext=(0, 9), textcoords="offset points", ha="center",
                        fontsize=8)  # fmt: skip
    depth = max(x for x, _ in places.values())
    ax.tick_params(bottom=True, labelbottom=True)
    ax.set_xticks(range(1, depth + 1) if depth <= 20 else range(1, depth + 1, depth // 10))
    ax.set_xlabel("step")
    ax.spines[["top", "right", "left"]].set_visible(False)
    ax.margins(0.1)
    marks = [("first step", START), ("last step", GOAL)]
    handles = [ax.scatter([], [], color=colour, edgecolor="#444444", label=name) for name, colour in marks]
    ax.legend(handles=handles, frameon=False, loc="upper left", bbox_to_anchor=(1, 1))
    of = (
        f"{drawn} path{'' if drawn == 1 else 's'}"
        if drawn == len(paths)
        else f"the first {drawn} of {len(paths)} paths"
    )
    return f"{len(made)} rows on {of}"


def _fitting(result: Result, total: int) -> tuple[Any, int]:
    """The graph of all paths, or of as many as leave it readable."""
    most = total
    made = graph(result, min(most, MOST_NODES))
    while len(made) > MOST_NODES and most > 1:
        most = min(most, MOST_NODES) // 2
        made = graph(result, most)
    return made, min(most, total)


def layered(made: Any) -> dict[Any, tuple[int, float]]:
    """A place for each node: across by the first step that it is, up and down near its neighbours."""
    layers: defaultdict[int, list[Any]] = defaultdict(list)
    for node, data in made.nodes(data=True):
        layers[data["step"]].append(node)
    heights: dict[Any, float] = {}
    for nodes in layers.values():
        heights.update(_spread(nodes))
    for sweep in range(SWEEPS):
        forward = sweep % 2 == 0
        for step in sorted(layers, reverse=not forward):
            near = made.predecessors if forward else made.successors
            wanted = {node: mean([heights[other] for other in near(node)] or [heights[node]]) for node in layers[step]}
            layers[step].sort(key=wanted.__getitem__)
            heights.update(_spread(layers[step]))
    return {node: (step, heights[node]) for step, nodes in layers.items() for node in nodes}


def _spread(nodes: list[Any]) -> dict[Any, float]:
    """The nodes of a layer one over the other, around the middle."""
    return {node: (len(nodes) - 1) / 2 - index for index, node in enumerate(nodes)}


def _text(row: tuple[Any, ...]) -> str:
    lines = [cell(value) for value in row[:MOST_LINES]]
    return "\n".join(line if len(line) <= MOST_TEXT else line[: MOST_TEXT - 1] + "…" for line in lines)

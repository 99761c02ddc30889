"""The picture of a traced search: over a map the cells in order of expansion, else the tree of what was generated."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ss2sql.results import require_package
from ss2sql.results.graph_plot import WIDEST, place_trees
from ss2sql.results.plot_style import BLUE, FRAME, GREEN, ORANGE, shorten
from ss2sql.results.watching.animation_steps import Place, TraceScene, format_traced_row, make_scene
from ss2sql.results.watching.search_trace import get_trace

if TYPE_CHECKING:
    from ss2sql.results.result import Result

MOST_STEPS = 60  # of a tree
MOST_NUMBERS = 400  # cells with numbers
MOST_TEXT = 18
CELL, LAYER, LEAF, BESIDE = 0.42, 1.3, 0.25, 3.4  # inches of a numbered cell, of the parts of a tree, of the legend
STYLES: dict[str, dict[str, Any]] = {
    "expanded": {"color": BLUE, "s": 170},
    "generated": {"color": "white", "edgecolor": ORANGE, "linewidth": 2, "s": 120},
    "goal": {"color": GREEN, "marker": "*", "s": 240},
    "repeated": {"color": "#999999", "marker": "x", "s": 25},
    "stopped": {"color": "#999999", "marker": "s", "s": 25},
}
NAMES = {"expanded": "expanded, in this order", "generated": "in the frontier", "goal": "goal"}


def draw_search(result: Result, ax: Any, most: int | None, own: bool) -> str:
    """Draws a trace, of a tree at most so many steps; gives the title.

    The figure gets the size that the picture needs where it is our own.
    """
    scene = make_scene(get_trace(result, "plot('search')"))
    size, drawn = _draw_map(scene, ax) if scene.is_map else _draw_tree(scene, ax, most or MOST_STEPS)
    if own:
        ax.figure.set_size_inches(min(WIDEST, size[0] + BESIDE), max(3.0, min(WIDEST, size[1] + 0.8)))
    marker = {"marker": "s"} if scene.is_map else {}
    handles = [ax.scatter([], [], label=name, **marker | STYLES[word] | {"s": 70}) for word, name in NAMES.items()]
    ax.legend(handles=handles, frameon=False, loc="upper left", bbox_to_anchor=(1, 1))
    traced, total = scene.traced, len(scene.steps)
    cut = "" if traced.is_whole else f", {len(traced.events):,} of {traced.total:,} events"
    left_out = "" if drawn == total else f", {drawn:,} drawn"
    return f"{traced.strategy}: {len(scene.expanded):,} of {total:,} steps expanded{cut}{left_out}"


def _draw_map(scene: TraceScene, ax: Any) -> tuple[tuple[float, float], int]:
    """Draws a square for each place; steps to one place share it, an expanded one determines its style."""
    rectangle = require_package("matplotlib.patches", "plot", "plot()").Rectangle
    cells: dict[Place, int] = {}
    for n, place in enumerate(scene.places):
        if place is not None and (place not in cells or n in scene.expanded or cells[place] in scene.lost):
            cells[place] = n
    side = scene.pitch
    for (x, y), n in cells.items():
        if n in scene.lost:
            continue
        look = (
            {"facecolor": BLUE, "edgecolor": "white"} if n in scene.expanded else {"fill": False, "edgecolor": ORANGE}
        )
        ax.add_patch(rectangle((x - side / 2, y - side / 2), side, side, linewidth=1.2, **look))
        if n in scene.expanded and len(cells) <= MOST_NUMBERS:
            ax.annotate(str(scene.expanded[n]), (x, y), ha="center", va="center", fontsize=8, color="white", zorder=5)
    for n in scene.goals[:1]:
        line = [place for step in scene.find_path(n) if (place := scene.places[step]) is not None]
        ax.plot(*zip(*line, strict=True), color=GREEN, lw=4, alpha=0.7, zorder=4)
    ends = {place for n in scene.goals if (place := scene.places[n]) is not None}
    if ends:
        ax.scatter(*zip(*ends, strict=True), zorder=6, **STYLES["goal"])
    left, low, right, high = (end(place[axis] for place in cells) for end in (min, max) for axis in (0, 1))
    ax.set_xlim(left - side, right + side)
    ax.set_ylim(low - side, high + side)
    ax.set_aspect("equal")
    return (CELL * ((right - left) / side + 2), CELL * ((high - low) / side + 2)), len(scene.steps)


def _draw_tree(scene: TraceScene, ax: Any, most: int) -> tuple[tuple[float, float], int]:
    """Draws the tree of steps, without repeated and stopped ones where there are too many."""
    made = require_package("networkx", "plot", "plot()").DiGraph()
    every = list(range(len(scene.steps)))
    kept = every if len(every) <= most else [n for n in every if n not in scene.lost][:most]
    parents = {n: scene.steps[n].parent for n in kept}
    made.add_nodes_from(kept)
    made.add_edges_from((parent, n) for n, parent in parents.items() if parent is not None)
    places = place_trees(made, [n for n, parent in parents.items() if parent is None])
    path = {n for goal in scene.goals[:1] for n in scene.find_path(goal)}
    for edge in made.edges:
        look = {"color": GREEN, "lw": 3} if path.issuperset(edge) else {"color": "#999999", "lw": 0.9}
        ax.plot(*zip(*map(places.__getitem__, edge), strict=True), zorder=1, **look)
    box = {"boxstyle": "square,pad=0", "facecolor": "white", "alpha": 0.7, "linewidth": 0}
    for n, place in places.items():
        word = "goal" if n in scene.goals else "expanded" if n in scene.expanded else scene.last[n]
        ax.scatter(*place, zorder=3, **STYLES[word])
        if word == "expanded":
            ax.annotate(str(scene.expanded[n]), place, ha="center", va="center", fontsize=7, color="white", zorder=4)
        step = scene.steps[n]
        text = shorten(format_traced_row(step.row or step.state), MOST_TEXT)
        ax.annotate(
            text, place, xytext=(9, 0), textcoords="offset points", va="center", fontsize=7, color=FRAME, bbox=box
        )
    layers, leaves = max(across for across, _ in places.values()), sum(1 for n in made if not made.out_degree(n))
    ax.set_xlim(0.7, layers + 1)
    ax.set_axis_off()
    return (LAYER * layers, LEAF * leaves), len(kept)

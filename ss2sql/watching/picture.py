"""The picture of a traced search: over a map the cells in order of expansion, else the tree of what was generated."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ss2sql.results import package
from ss2sql.results.graph_plot import MOST_NODES, TALL, WIDEST, branched
from ss2sql.results.looks import BLUE, FRAME, GREEN, ORANGE, short
from ss2sql.watching.scenes import Place, Scene, scene_of, text_of
from ss2sql.watching.traced import traced_of_result

if TYPE_CHECKING:
    from ss2sql.runtime.result import Result

MOST_NUMBERS = 400  # cells with numbers
MOST_TEXT = 18
INCHES = 0.42  # that a numbered cell is wide
LOST = ("repeated", "stopped")


def draw_search(result: Result, ax: Any, most: int | None, own: bool) -> str:
    """Draws it, of a tree at most so many steps; gives the title.

    The figure gets the size that the picture needs where it is our own.
    """
    scene = scene_of(traced_of_result(result, "plot('search')"))
    last, order = scene.last_events(), scene.expanded()
    if scene.is_map:
        _draw_map(scene, last, order, ax, own)
        drawn = len(scene.steps)
    else:
        drawn = _draw_tree(scene, last, order, ax, most or MOST_NODES, own)
    looks: tuple[tuple[str, dict[str, Any]], ...] = (
        ("expanded, in this order", {"color": BLUE}),
        ("in the frontier", {"color": "white", "edgecolor": ORANGE, "linewidth": 2}),
        ("goal", {"color": GREEN, "marker": "*"}),
    )
    handles = [ax.scatter([], [], label=name, **{"s": 70, "marker": "s" if scene.is_map else "o", **look})
               for name, look in looks]  # fmt: skip
    ax.legend(handles=handles, frameon=False, loc="upper left", bbox_to_anchor=(1, 1))
    steps = f"{len(order):,} of {len(scene.steps):,} steps expanded"
    cut = "" if scene.traced.is_whole else f", {len(scene.traced.events):,} of {scene.traced.total:,} events"
    return f"{scene.traced.strategy}: {steps}{cut}" + ("" if drawn == len(scene.steps) else f", {drawn} drawn")


def _goals(scene: Scene) -> list[int]:
    return [event.n for event in scene.traced.events if event.event == "goal"]


def _draw_map(scene: Scene, last: dict[int, str], order: dict[int, int], ax: Any, own: bool) -> None:
    """A square for each place; several steps to one share it, and one that was expanded counts most."""
    patches = package("matplotlib.patches", "plot", "plot()")
    ranks = {"expanded": 3, "generated": 2, "goal": 2}
    cells: dict[Place, int] = {}
    for n, place in enumerate(scene.places):
        known = None if place is None else cells.get(place)
        if place is not None and (known is None or ranks.get(last[n], 0) > ranks.get(last[known], 0)):
            cells[place] = n
    side = scene.pitch
    numbered = len(cells) <= MOST_NUMBERS
    for (x, y), n in cells.items():
        if n not in order and last[n] in LOST:
            continue
        look = {"facecolor": BLUE, "edgecolor": "white"} if n in order else {"facecolor": "none", "edgecolor": ORANGE}
        ax.add_patch(patches.Rectangle((x - side / 2, y - side / 2), side, side, linewidth=1.2, **look))
        if numbered and n in order:
            ax.annotate(str(order[n]), (x, y), ha="center", va="center", fontsize=8, color="white", zorder=5)
    goals = _goals(scene)
    if goals:
        line = [place for n in scene.path(goals[0]) if (place := scene.places[n]) is not None]
        ax.plot(*zip(*line, strict=True), color=GREEN, lw=4, alpha=0.6, zorder=4)
        ends = {place for n in goals if (place := scene.places[n]) is not None}
        ax.scatter(*zip(*ends, strict=True), s=150, marker="*", color=GREEN, edgecolor="white", zorder=6)
    left, low, right, high = (end(place[axis] for place in cells) for end in (min, max) for axis in (0, 1))
    ax.set_xlim(left - side, right + side)
    ax.set_ylim(low - side, high + side)
    ax.set_aspect("equal")
    if own and numbered:
        across, up = ((right - left) / side + 3, (high - low) / side + 3)
        ax.figure.set_size_inches(min(WIDEST, INCHES * across + 2.2), min(WIDEST * 0.75, INCHES * up + 0.6))


def _draw_tree(scene: Scene, last: dict[int, str], order: dict[int, int], ax: Any, most: int, own: bool) -> int:
    """The steps with those they come from, without those that were repeated or stopped where there are too many."""
    networkx = package("networkx", "plot", "plot()")
    every = range(len(scene.steps))
    kept = [n for n in every if n in order or last[n] not in LOST] if len(every) > most else list(every)
    made = networkx.DiGraph()
    roots = [n for n in kept[:most] if scene.steps[n].parent is None]
    made.add_nodes_from(kept[:most])
    made.add_edges_from((scene.steps[n].parent, n) for n in kept[:most] if n not in roots)
    places = branched(made, roots)
    goals, found = set(_goals(scene)), _goals(scene)[:1]
    path = set(scene.path(found[0])) if found else set()
    for a, b in made.edges:
        on_path = a in path and b in path
        look = {"color": GREEN, "lw": 3} if on_path else {"color": "#999999", "lw": 0.9}
        ax.plot(*zip(places[a], places[b], strict=True), zorder=1, **look)
    for n in made:
        x, y = places[n]
        if n in goals:
            ax.scatter(x, y, s=190, marker="*", color=GREEN, edgecolor="white", zorder=3)
        elif n in order:
            ax.scatter(x, y, s=170, color=BLUE, zorder=3)
        elif last[n] in LOST:
            ax.scatter(x, y, s=25, marker="x" if last[n] == "repeated" else "s", color="#999999", zorder=3)
        else:
            ax.scatter(x, y, s=120, color="white", edgecolor=ORANGE, linewidth=2, zorder=3)
        if n in order and n not in goals:
            ax.annotate(str(order[n]), (x, y), ha="center", va="center", fontsize=7, color="white", zorder=4)
        step = scene.steps[n]
        text = text_of(step.state if step.parent is None else step.row or step.state)
        box = {"boxstyle": "square,pad=0", "facecolor": "white", "alpha": 0.7, "linewidth": 0}
        ax.annotate(short(text, MOST_TEXT), (x, y), xytext=(9, 0), textcoords="offset points", va="center",
                    fontsize=7, color=FRAME, bbox=box)  # fmt: skip
    layers, leaves = max(x for x, _ in places.values()), sum(1 for n in made if not made.out_degree(n))
    ax.set_xlim(0.7, layers + 1)
    ax.set_axis_off()
    if own:
        tall = max(3.0, min(1.2 * WIDEST, 0.5 * TALL * leaves + 0.6))
        ax.figure.set_size_inches(min(WIDEST, 2.5 + 1.3 * layers), tall)
    return len(made)

"""A traced search: its steps with texts, places and outcomes, its picture, and the page that plays it."""

from __future__ import annotations

import json
from collections.abc import Sequence
from functools import cached_property
from html import escape
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from ss2sql.errors import SessionError, require_package
from ss2sql.fast_dataclasses import dataclass
from ss2sql.package_data import find_package_file
from ss2sql.results import cut_text
from ss2sql.results.graph_plot import WIDEST, place_trees
from ss2sql.results.plot_style import BLUE, FRAME, GREEN, ORANGE, find_coordinates, shorten_plot_label
from ss2sql.results.show import format_cell
from ss2sql.results.watching.search_trace import SearchTrace, get_trace
from ss2sql.runtime.search.trace import Event

if TYPE_CHECKING:
    from ss2sql.results.result import Result


MOST_TEXT = 60  # characters of a row or a state
FINEST = 200  # cells that a map is across at most
Place: TypeAlias = tuple[float, float]


@dataclass(frozen=True)
class TraceScene:
    """The `steps` of a trace, each by its first event, and the place of each where there is a map.

    The cells of the map are `pitch` wide.
    """

    traced: SearchTrace
    steps: Sequence[Event]
    places: Sequence[Place | None]
    pitch: float

    @property
    def is_map(self) -> bool:
        return self.pitch > 0

    @cached_property
    def expanded(self) -> dict[int, int]:
        """The expanded steps, each with its number in the order of expansion."""
        order = (event.n for event in self.traced.events if event.event == "expanded")
        return {n: number for number, n in enumerate(order, 1)}

    @cached_property
    def last(self) -> dict[int, str]:
        """The last event of each step."""
        return {event.n: event.event for event in self.traced.events}

    @cached_property
    def goals(self) -> list[int]:
        return [event.n for event in self.traced.events if event.event == "goal"]

    @cached_property
    def lost(self) -> set[int]:
        """The repeated or stopped steps that are neither goals nor expanded."""
        lost = {n for n, event in self.last.items() if event in ("repeated", "stopped")}
        return lost - self.expanded.keys() - set(self.goals)

    def find_path(self, n: int | None) -> list[int]:
        """The steps from the start to this one."""
        found = []
        while n is not None:
            found.append(n)
            n = self.steps[n].parent
        return found[::-1]


def make_animation_scene(traced: SearchTrace) -> TraceScene:
    steps: dict[int, Event] = {}
    for event in traced.events:
        steps.setdefault(event.n, event)
    every = list(steps.values())
    found = _find_places(traced, every)
    return TraceScene(traced, every, found, _measure_animated_pitch([place for place in found if place is not None]))


def format_traced_row(shown: dict[str, Any] | None, named: bool = False) -> str:
    """A row or a state as a short text; the names of several values are `named`."""
    several = named and len(shown or ()) > 1
    values = (f"{key} {format_cell(value)}" if several else format_cell(value) for key, value in (shown or {}).items())
    return cut_text(", ".join(values), MOST_TEXT, "…")


def _find_places(traced: SearchTrace, steps: Sequence[Event]) -> list[Place | None]:
    """The places of the steps: those of their states, or else of their rows.

    A step that stops has no state. Its row gives its place where the rows of other steps equal their states' places.
    In states with other lists, as in a puzzle, lists of two numbers are moves, not places.
    """
    counters = traced.counters
    states = _read_animated_places(
        [event.state and {n: v for n, v in event.state.items() if n not in counters} for event in steps]
    )
    rows = _read_animated_places([event.row for event in steps])
    if any(states):
        both = [(state, row) for state, row in zip(states, rows, strict=True) if state and row]
        told = bool(both) and all(state == row for state, row in both)
        return [state or (row if told else None) for state, row in zip(states, rows, strict=True)]
    puzzle = any(isinstance(value, (list, dict)) for event in steps for value in (event.state or {}).values())
    return [None] * len(steps) if puzzle else rows


def _read_animated_places(shown: Sequence[dict[str, Any] | None]) -> list[Place | None]:
    """The places in rows or states; empty where one of them has no place."""
    there = [tuple(one.values()) for one in shown if one]
    where = find_coordinates(list(next(filter(None, shown), ())), there)
    if where is None:
        return [None] * len(shown)
    values = iter(there)
    return [(round((at := where.of(next(values)))[0], 6), round(at[1], 6)) if one else None for one in shown]


def _measure_animated_pitch(found: Sequence[Place]) -> float:
    """The least distance of two places along an axis."""
    if not found:
        return 0.0
    axes = [sorted({place[axis] for place in found}) for axis in (0, 1)]
    gaps = [after - before for axis in axes for before, after in pairwise(axis)]
    return max(min(gaps, default=1.0), *((axis[-1] - axis[0]) / FINEST for axis in axes))


# --- the picture of a traced search: over a map the cells in order of expansion, else the tree of what was generated
MOST_STEPS = 60  # of a tree
MOST_NUMBERS = 400  # cells with numbers
MOST_LABEL = 18
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
    scene = make_animation_scene(get_trace(result, "plot('search')"))
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
        text = shorten_plot_label(format_traced_row(step.row or step.state), MOST_LABEL)
        ax.annotate(
            text, place, xytext=(9, 0), textcoords="offset points", va="center", fontsize=7, color=FRAME, bbox=box
        )
    layers, leaves = max(across for across, _ in places.values()), sum(1 for n in made if not made.out_degree(n))
    ax.set_xlim(0.7, layers + 1)
    ax.set_axis_off()
    return (LAYER * layers, LEAF * leaves), len(kept)


# --- the page that plays a search in a browser: one HTML file that needs no network
CODES = {"generated": "g", "expanded": "x", "repeated": "r", "stopped": "s", "goal": "!"}
TALL = 760  # pixels in a notebook


class Page:
    """A page that plays searches: `html` is its text. Notebooks show it."""

    def __init__(self, html: str) -> None:
        self.html = html

    def __repr__(self) -> str:
        return f"<the page of a search, {len(self.html.encode()) / 1e6:.1f} MB: animate(path) writes it>"

    def _repr_html_(self) -> str:
        frame = f'style="width: 100%; height: {TALL}px; border: 0" title="the page of a search"'
        return f'<iframe srcdoc="{escape(self.html)}" {frame}></iframe>'


def make_watching_page(results: Sequence[Result], title: str | None) -> Page:
    traced = [get_trace(result, "animate()") for result in results]
    heading = title or " and ".join(dict.fromkeys(one.strategy for one in traced))
    data = json.dumps({"panels": list(map(_make_panel, traced))}, ensure_ascii=False, separators=(",", ":"))
    template = find_package_file("ss2sql.results.watching", "page.html").read_text("utf-8")
    named = template.replace("@TITLE@", escape(heading)).replace("@HEADING@", escape(title or ""))
    before, after = named.split("@DATA@")
    # Between the tags of a script "<" may begin the end of it.
    return Page(f"{before}{data.replace('<', chr(92) + 'u003c')}{after}")


def write_page(page: Page, path: str | Path) -> None:
    try:
        Path(path).write_text(page.html, encoding="utf-8")
    except OSError as error:
        raise SessionError("S002", f"{path} cannot be written: {error.strerror or error}") from error


def _make_panel(traced: SearchTrace) -> dict[str, Any]:
    """One search as columns of short texts and numbers: 10,000 events are less than 1 MB."""
    scene = make_animation_scene(traced)
    steps, texts = scene.steps, dict[str, int]()
    rows = [texts.setdefault(format_traced_row(step.row), len(texts)) for step in steps]
    states = [texts.setdefault(format_traced_row(step.state, named=True), len(texts)) for step in steps]
    kept = "" if traced.is_whole else f", the first {len(traced.events):,} of {traced.total:,} events"
    return {
        "title": f"{traced.strategy}{kept}", "text": traced.script, "clauses": traced.clauses, "weight": traced.weight,
        "codes": "".join(CODES[event.event] for event in traced.events),
        "nodes": [event.n for event in traced.events],
        "parent": [-1 if step.parent is None else step.parent for step in steps],
        "depth": [step.depth for step in steps],
        "g": [_round_animated(step.g) for step in steps], "h": [_round_animated(step.h) for step in steps],
        "texts": list(texts), "row_text": rows, "state_text": states,
        "leaves": [int(step.event in ("repeated", "stopped")) for step in steps],
        "pitch": scene.pitch,
        **{name: [place and place[axis] for place in scene.places] for axis, name in enumerate("xy") if scene.is_map},
    }  # fmt: skip


def _round_animated(value: Any) -> float | None:
    return None if value is None else float(f"{min(value, 1e300):.6g}")

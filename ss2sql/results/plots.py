"""Pictures of results: paths over a plane, graphs of a search, heat maps, bars and lines."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import islice, pairwise
from typing import TYPE_CHECKING, Any, NoReturn, TypeAlias

import numpy as np

from ss2sql.errors import RepresentationError
from ss2sql.results import found_paths, package
from ss2sql.results.graph_plot import draw_graph
from ss2sql.results.show import cell
from ss2sql.runtime.paths import lengths_of
from ss2sql.runtime.rows import Row

if TYPE_CHECKING:
    from ss2sql.runtime.result import Result

KINDS = ("auto", "paths", "graph", "lengths", "heat", "bars", "line", "points")
MOST_PATHS = 1000
MOST_BARS = 40
FEW = 6  # paths that have a colour and a name each
BLUE, ORANGE, GREEN = "#3b6ea5", "#e4572e", "#2a9d5c"

Place: TypeAlias = Callable[[Row], Sequence[float]]
Draw: TypeAlias = Callable[[Any, int | None], str]  # on Axes, at most so many paths or bars; gives the title


def plot(result: Result, ax: Any, kind: str, most: int | None, title: str | None) -> Any:
    """Draws a result and gives the Axes: what `Result.plot` describes."""
    if kind not in KINDS:
        refuse(f"plot() knows no kind {kind!r}", f"the kinds are {', '.join(KINDS)}")
    pyplot = package("matplotlib.pyplot", "plot", "plot()")
    draw = _chosen(result, kind, own=ax is None)
    if ax is None:
        _, ax = pyplot.subplots(layout="constrained")
    heading = draw(ax, most)
    ax.set_title(heading if title is None else title)
    return ax


def _chosen(result: Result, kind: str, own: bool) -> Draw:
    """What draws the picture; `own`: on a figure of ours."""
    paths = found_paths(result)
    if paths is not None:
        place = _place(result.columns[2:], [row for path in islice(paths, 50) for row in path])
        if not paths:
            refuse("plot() found no path to draw", "the search has no result")
        if kind == "paths" or (kind == "auto" and place is not None):
            if place is None:
                refuse(
                    "plot() cannot find places in the rows",
                    "select a list of two or three numbers, or columns with the coordinates, and no other lists",
                )
            return lambda ax, most: _paths(result, paths, place, ax, most or MOST_PATHS)
        if kind in ("auto", "graph"):
            return lambda ax, most: draw_graph(result, ax, most, own)
        if kind == "lengths":
            return lambda ax, most: _lengths(result, paths, ax)
        refuse(f"plot() draws no search as {kind}", "the kinds for a search are paths, graph and lengths")
    if kind in ("auto", "heat") and isinstance(result.value, np.ndarray) and result.value.ndim == 2:
        return lambda ax, most: _heat(result, ax)
    return _flat(result, kind)


def refuse(message: str, *hints: str) -> NoReturn:
    raise RepresentationError("V001", message, hints=hints)


# --- paths ---------------------------------------------------------------------------------------------


def _place(columns: Sequence[str], rows: Sequence[Row]) -> tuple[Place, tuple[str, ...], bool] | None:
    """Where rows are: what finds it, the names of the axes, and whether they are of one unit.

    It is the only list of two or three numbers in the rows, or else two or three columns of numbers. Rows with other
    lists or dicts are nowhere: they are states of a puzzle, and the lists of two numbers in them its moves.
    """
    if not rows:
        return None
    indexes = range(len(columns))
    structured = [i for i in indexes if any(isinstance(row[i], (list, dict)) for row in rows)]
    if structured:
        (index, *others) = structured
        return None if others or not all(_is_point(row[index]) for row in rows) else (lambda row: row[index], (), True)
    numbers = [i for i in indexes if all(_is_number(row[i]) for row in rows)]
    if len(numbers) not in (2, 3):
        return None
    names = tuple(columns[i] for i in numbers)
    alike = tuple(name.lower()[-1:] for name in names[:2]) == ("x", "y")
    return lambda row: tuple(row[i] for i in numbers), names, alike


def _is_point(value: Any) -> bool:
    return isinstance(value, list) and len(value) in (2, 3) and all(map(_is_number, value))


def _is_number(value: Any) -> bool:
    return type(value) in (int, float)


def _paths(
    result: Result,
    paths: Sequence[Sequence[Row]],
    found: tuple[Place, tuple[str, ...], bool],
    ax: Any,
    most: int,
) -> str:
    """One line for each path; the first result lies on top, and so do the ends of all."""
    place, names, alike = found
    drawn = [np.array([place(row) for row in path], dtype=float) for path in islice(paths, most)]
    solid = getattr(ax, "name", "") == "3d" and all(line.shape[1] == 3 for line in drawn)
    width = 3 if solid else 2
    faint = max(0.04, min(0.6, 12 / len(drawn)))
    for number, line in reversed(list(enumerate(drawn, 1))):
        style = {"color": f"C{number - 1}", "alpha": 0.9, "lw": 2, "label": f"path {number}"}
        if len(drawn) > FEW:
            style = {"color": BLUE, "alpha": faint, "lw": 1.5}
            if number == 1:
                style = {"color": ORANGE, "lw": 2.5, "label": "path 1"}
        ax.plot(*line.T[:width], marker="o" if len(drawn) <= FEW else "", markersize=3, zorder=2, **style)
    starts, goals = (np.unique([line[end] for line in drawn], axis=0) for end in (0, -1))
    ax.scatter(*starts.T[:width], s=50, color=GREEN, edgecolor="white", zorder=3, label="first step")
    ax.scatter(*goals.T[:width], s=110, marker="*", color="black", edgecolor="white", zorder=4, label="last step")
    for axis, name in zip("xyz"[:width], names or "xyz", strict=False):
        getattr(ax, f"set_{axis}label")(name)
    if alike:
        ax.set_aspect("equal", adjustable="datalim")
    ax.grid(alpha=0.25)
    _legend(ax)
    return _counted(result, len(paths), len(drawn), [len(line) for line in drawn])


def _legend(ax: Any) -> None:
    """The names of the lines beside the picture, the first path first."""
    handles, labels = ax.get_legend_handles_labels()
    named = sorted(zip(labels, handles, strict=True), key=lambda pair: (not pair[0].startswith("path"), pair[0]))
    ax.legend([handle for _, handle in named], [label for label, _ in named], loc="upper left", bbox_to_anchor=(1, 1),
              frameon=False)  # fmt: skip


def _counted(result: Result, total: int, drawn: int, lengths: Sequence[int]) -> str:
    """A title: how many paths there are, how many are drawn, and how long these are."""
    least, greatest = min(lengths), max(lengths)
    steps = f"{least} step{'' if greatest == 1 else 's'}" if least == greatest else f"{least} to {greatest} steps"
    counted = f"{total} path{'' if total == 1 else 's'}" if drawn == total else f"the first {drawn} of {total} paths"
    status = "" if result.status == "complete" else f" ({result.status})"
    return f"{counted} of {steps}{status}"


def _lengths(result: Result, paths: Sequence[Sequence[Row]], ax: Any) -> str:
    counts = Counter(lengths_of(paths))
    bars = ax.bar(list(counts), list(counts.values()), color=BLUE)
    ax.bar_label(bars, padding=2)
    ax.xaxis.get_major_locator().set_params(integer=True)
    ax.set_xlabel("steps of a path")
    ax.set_ylabel("paths")
    ax.margins(y=0.1)
    ax.spines[["top", "right"]].set_visible(False)
    return _counted(result, len(paths), len(paths), list(counts))


# --- flat results --------------------------------------------------------------------------------------


def _heat(result: Result, ax: Any) -> str:
    value = result.value
    extent = getattr(value, "extent", None)
    marks = value.dtype == bool
    image = ax.imshow(
        np.asarray(value), origin="lower" if extent else "upper", extent=extent, cmap="Greys" if marks else "viridis"
    )
    name = result.columns[-1]
    if not marks:
        ax.figure.colorbar(image, ax=ax, label=name, shrink=0.9)
    ax.set_xlabel("m" if extent else "column")
    ax.set_ylabel("m" if extent else "row")
    return f"{name}, {value.shape[1]} x {value.shape[0]} cells"


def _flat(result: Result, kind: str) -> Draw:
    """Bars, lines or points, by the columns that there are."""
    columns, rows = result.columns, list(result)
    kinds = [{type(row[index]) for row in rows} - {type(None)} for index in range(len(columns))]
    numbers = [index for index, found in enumerate(kinds) if found and found <= {int, float}]
    labels = [index for index, found in enumerate(kinds) if index not in numbers]
    pointed = [
        index for index in labels if any(row[index] for row in rows) and all(_is_point(row[index]) for row in rows)
    ]
    if kind == "heat":
        refuse("plot() has no array of two dimensions to draw", "AS plane gives one")
    label = labels[0] if len(labels) == 1 else None
    if kind == "bars" or (kind == "auto" and label is not None and len(numbers) == 1 and not pointed):
        if len(numbers) == 1 and len(labels) <= 1:
            return lambda ax, most: _bars(columns, rows, label, numbers[0], ax, most or MOST_BARS)
    elif kind in ("auto", "points") and pointed:
        own = pointed[0]
        names = next((index for index in labels if index != own), None)
        return lambda ax, most: _points(("x", "y"), [row[own] for row in rows], _texts(rows, names), ax)
    elif numbers:
        xs = [row[numbers[0]] for row in rows]
        rising = None not in xs and all(a < b for a, b in pairwise(xs))
        if kind == "points" or (kind == "auto" and len(numbers) == 2 and (labels or not rising)):
            if len(numbers) >= 2:
                pair = numbers[:2]
                places = [[row[index] for index in pair] for row in rows]
                return lambda ax, most: _points([columns[i] for i in pair], places, _texts(rows, label), ax)
        elif kind in ("auto", "line") and (len(numbers) == 1 or rising):
            return lambda ax, most: _lines(columns, rows, numbers, ax)
    wanted = "" if kind == "auto" else f" as {kind}"
    refuse(
        f"plot() cannot draw the columns {', '.join(columns)}{wanted}",
        "it draws a label and a number as bars, numbers as lines or points, lists of two numbers as points",
    )


def _texts(rows: Sequence[Row], index: int | None) -> list[str]:
    return [] if index is None else [cell(row[index]) for row in rows]


def _bars(columns: Sequence[str], rows: Sequence[Row], label: int | None, number: int, ax: Any, most: int) -> str:
    shown = rows[:most]
    names = _texts(shown, label) or [str(index) for index in range(1, len(shown) + 1)]
    values = [row[number] or 0 for row in shown]
    bars = ax.barh(range(len(shown)), values, color=BLUE)
    ax.bar_label(bars, [cell(row[number]) for row in shown], padding=3)
    ax.set_yticks(range(len(shown)), [name if len(name) <= 24 else name[:23] + "…" for name in names])
    ax.invert_yaxis()
    ax.margins(x=0.12)
    ax.set_xlabel(columns[number])
    ax.spines[["top", "right"]].set_visible(False)
    by = f"{columns[number]} by {columns[label]}" if label is not None else columns[number]
    return by if len(shown) == len(rows) else f"{by}, the first {len(shown)} of {len(rows)} rows"


def _lines(columns: Sequence[str], rows: Sequence[Row], numbers: Sequence[int], ax: Any) -> str:
    first, *others = numbers
    xs = [row[first] for row in rows] if others else list(range(1, len(rows) + 1))
    for index in others or [first]:
        ys = [np.nan if row[index] is None else row[index] for row in rows]
        ax.plot(xs, ys, marker="o" if len(rows) <= 50 else "", markersize=4, label=columns[index],
                color=BLUE if len(numbers) <= 2 else None)  # fmt: skip
    names = [columns[index] for index in others or [first]]
    ax.set_xlabel(columns[first] if others else "row")
    ax.set_ylabel(names[0] if len(names) == 1 else "")
    if len(names) > 1:
        ax.legend(frameon=False)
    ax.grid(alpha=0.25)
    return f"{', '.join(names)} by {columns[first] if others else 'row'}"


def _points(names: Sequence[str], places: Sequence[Sequence[Any]], texts: Sequence[str], ax: Any) -> str:
    there = [index for index, place in enumerate(places) if None not in place]
    xs, ys = ([places[index][axis] for index in there] for axis in (0, 1))
    ax.scatter(xs, ys, color=BLUE, s=25, alpha=0.8, edgecolor="none")
    if texts and len(there) <= 30:
        for index in there:
            ax.annotate(texts[index], places[index][:2], xytext=(4, 4), textcoords="offset points", fontsize=8)
    ax.set_xlabel(names[0])
    ax.set_ylabel(names[1])
    if tuple(names) == ("x", "y"):
        ax.set_aspect("equal", adjustable="datalim")
    ax.grid(alpha=0.25)
    ax.margins(0.08)
    return f"{len(there)} point{'' if len(there) == 1 else 's'}"

"""The style of all plots: colours for colour-blind people too, titles, legends, errors; and paths as lines.

The colours are those of Okabe and Ito, https://jfly.uni-koeln.de/color/.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Any, NoReturn, TypeAlias

import numpy as np

from ss2sql.errors import RepresentationError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.rows import Row
from ss2sql.results import count_words, cut_text
from ss2sql.runtime.run.search_paths import measure_path_lengths

if TYPE_CHECKING:
    from ss2sql.results.result import Result


BLUE, ORANGE, GREEN, PURPLE, RED, SKY = "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9"
PALETTE = (BLUE, ORANGE, GREEN, PURPLE, RED, SKY)
PALE, FRAME, INK = "#e9eef4", "#444444", "black"
FEW = len(PALETTE)  # paths that have a colour and a name each


NO_PATHS = "paths are those of a query with CONNECT BY, and SELECT LAST keeps none: write SELECT without LAST"


def make_plot_error(message: str, *hints: str) -> NoReturn:
    raise RepresentationError("V001", message, hints=hints)


def escape_plot_label(text: str) -> str:
    """A name or a value with escaped dollars, which would enclose a formula."""
    return text.replace("$", r"\$")


def shorten_plot_label(text: str, most: int) -> str:
    """At most so many characters of a name or a value, with escaped dollars."""
    return escape_plot_label(cut_text(text, most, "…"))


def choose_style(number: int, total: int, wider: float) -> dict[str, Any]:
    """The style of a path's line: few paths have a colour each, of many only the first one.

    Few lines that may lie on each other become `wider`, so that the later ones are visible at the sides.
    """
    if total <= FEW:
        width = 1.8 + wider * (number - 1)
        return {"color": PALETTE[number - 1], "lw": width, "label": f"path {number}", "solid_capstyle": "round"}
    if number == 1:
        return {"color": RED, "lw": 2.5, "label": "path 1"}
    return {"color": BLUE, "alpha": max(0.04, min(0.6, 12 / total)), "lw": 1.5}


def draw_legend(ax: Any) -> None:
    """Draws the legend of the lines, beside the picture unless a map has its colours there."""
    handles, labels = ax.get_legend_handles_labels()
    named = dict(sorted(zip(labels, handles, strict=True), key=lambda pair: (not pair[0].startswith("path"), pair[0])))
    if ax.images:
        ax.legend(list(named.values()), list(named), loc="best", framealpha=0.85)
    else:
        corner = (-0.1, 1) if ax.name == "3d" else (1, 1)
        ax.legend(list(named.values()), list(named), loc="upper left", bbox_to_anchor=corner, frameon=False)


def hide_spines(ax: Any) -> None:
    ax.spines[["top", "right"]].set_visible(False)


def set_integer_ticks(axis: Any) -> None:
    from matplotlib.ticker import MaxNLocator

    axis.set_major_locator(MaxNLocator(nbins=6, integer=True))


def write_path_title(result: Result, total: int, lengths: Sequence[int]) -> str:
    """A title: how many paths there are, how many of them are drawn, and how long these are."""
    least, greatest = min(lengths), max(lengths)
    steps = count_words(least, "step") if least == greatest else f"{least} to {greatest} steps"
    return f"{count_drawn_paths(total, len(lengths))} of {steps}{describe_status(result)}"


def count_drawn_paths(total: int, drawn: int) -> str:
    return count_words(total, "path") if drawn == total else f"the first {drawn} of {total} paths"


def describe_status(result: Result) -> str:
    """The status for a title, unless the run is complete."""
    return "" if result.status == "complete" else f" ({result.status})"


# --- the paths of a search as lines over a plane, and how long they are
Found: TypeAlias = Sequence[Sequence[Row]]

MOST_PATHS = 1000
MOST_BARS = 100


@dataclass(frozen=True, slots=True)
class Coordinates:
    """The coordinates of rows: the function that reads them, the names of the axes, and whether these have one unit."""

    of: Callable[[Row], Sequence[float]]
    names: tuple[str, ...] = ()
    alike: bool = True


def find_coordinates(columns: Sequence[str], rows: Sequence[Row]) -> Coordinates | None:
    """The coordinates of rows; None where they have none.

    They are the only list of two or three numbers in the rows, or else two or three columns of numbers. Rows with other
    lists or dicts have none: they are states of a puzzle, and lists of two numbers in them are its moves.
    """
    if not rows:
        return None
    indexes = range(len(columns))
    structured = [i for i in indexes if any(isinstance(row[i], (list, dict)) for row in rows)]
    if structured:
        (index, *others) = structured
        return (
            None
            if others or not all(is_plot_point(row[index]) for row in rows)
            else Coordinates(lambda row: row[index])
        )
    numbers = [i for i in indexes if all(is_plot_number(row[i]) for row in rows)]
    if len(numbers) not in (2, 3):
        return None
    names = tuple(columns[i] for i in numbers)
    alike = tuple(name.lower()[-1:] for name in names[:2]) == ("x", "y")
    return Coordinates(lambda row: tuple(row[i] for i in numbers), names, alike)


def is_plot_point(value: Any) -> bool:
    return isinstance(value, list) and len(value) in (2, 3) and all(map(is_plot_number, value))


def is_plot_number(value: Any) -> bool:
    return type(value) in (int, float)


def draw_paths(result: Result, paths: Found, where: Coordinates, ax: Any, most: int | None) -> str:
    """Draws a line for each path over the contents of the Axes; the first one and all ends are on top."""
    drawn = [np.array([where.of(row) for row in path], dtype=float) for path in islice(paths, most or MOST_PATHS)]
    solid = getattr(ax, "name", "") == "3d" and all(line.shape[1] == 3 for line in drawn)
    width = 3 if solid else 2
    over = bool(ax.images)  # a map is there already: its labels and its area stay
    _draw_path_lines(ax, [line.T[:width] for line in drawn], wider=1.5)
    starts, goals = (np.unique([line[end] for line in drawn], axis=0) for end in (0, -1))
    ax.scatter(*starts.T[:width], s=55, color=GREEN, edgecolor="white", zorder=40, label="first step")
    ax.scatter(*goals.T[:width], s=120, marker="*", color=INK, edgecolor="white", zorder=41, label="last step")
    if not over:
        for axis, name in zip("xyz"[:width], where.names or "xyz", strict=False):
            getattr(ax, f"set_{axis}label")(escape_plot_label(name))
        if where.alike:
            ax.set_aspect("equal", adjustable="datalim")
        ax.grid(alpha=0.25)
    draw_legend(ax)
    return write_path_title(result, len(paths), [len(line) for line in drawn])


def _draw_path_lines(ax: Any, lines: Sequence[Any], wider: float) -> None:
    """Draws the lines, the first one on top, with a white border on a map, which may have their colours."""
    total = len(lines)
    for number, line in reversed(list(enumerate(lines, 1))):
        style = choose_style(number, total, wider)
        marks = {"marker": "o", "markersize": 4 + wider * (number - 1)} if total <= FEW else {}
        if ax.images:
            ax.plot(*line, color="white", lw=style["lw"] + 2, alpha=style.get("alpha"), zorder=2)
        ax.plot(*line, zorder=2 + 20 / number, **marks, **style)


def draw_lengths(result: Result, paths: Found, ax: Any) -> str:
    counts = Counter(measure_path_lengths(paths))
    if len(counts) <= MOST_BARS:
        ax.bar_label(ax.bar(list(counts), list(counts.values()), color=BLUE), padding=2)
    else:  # a bar takes 0.2 ms and 10 KB, and an endless search has a length for each path
        ax.hist(list(counts), MOST_BARS, weights=list(counts.values()), color=BLUE)
    set_integer_ticks(ax.xaxis)
    set_integer_ticks(ax.yaxis)
    ax.set_xlabel("steps of a path")
    ax.set_ylabel("paths")
    ax.margins(y=0.1)
    hide_spines(ax)
    return write_path_title(result, len(paths), [length for length, count in counts.items() for _ in range(count)])

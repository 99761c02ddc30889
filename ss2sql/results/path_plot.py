"""The paths of a search as lines over a plane, and how long they are."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.rows import Row
from ss2sql.results.plot_style import (
    BLUE,
    FEW,
    choose_style,
    draw_legend,
    escape_plot_label,
    hide_spines,
    mark_path_ends_in_plot,
    set_integer_ticks,
    write_path_title,
)
from ss2sql.runtime.run.search_paths import measure_path_lengths

if TYPE_CHECKING:
    from ss2sql.results.result import Result

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
    mark_path_ends_in_plot(ax, starts, goals, width)
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

"""Plots of results: the choice of a plot, and those of flat results: heat maps, bars, lines, points."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from datetime import UTC, date, datetime
from itertools import cycle, islice, pairwise
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from ss2sql.errors import require_package
from ss2sql.language import plan
from ss2sql.language.rows import Row
from ss2sql.results import count_words, get_result_paths, get_result_rows
from ss2sql.results.graph_plot import draw_graph, draw_tree
from ss2sql.results.plot_style import (
    BLUE,
    NO_PATHS,
    PALETTE,
    draw_lengths,
    draw_paths,
    escape_plot_label,
    find_coordinates,
    hide_spines,
    is_plot_point,
    make_plot_error,
    set_integer_ticks,
    shorten_plot_label,
)
from ss2sql.results.show import format_cell
from ss2sql.results.watching.animation import draw_search

if TYPE_CHECKING:
    from ss2sql.results.result import Result

SEARCH_KINDS = ("paths", "graph", "tree", "lengths", "search")
KINDS = ("auto", *SEARCH_KINDS, "heat", "bars", "line", "points")
MOST_BARS = 40
MOST_TEXT = 24  # characters beside a bar or a point
LOOKS = [
    (line, marker, colour) for line, marker in (("-", "o"), ("--", "s"), (":", "^")) for colour in PALETTE
]  # of lines and points, one after the other

Draw: TypeAlias = Callable[[Any, int | None], str]  # on Axes, at most so many paths or bars; gives the title
Series: TypeAlias = Sequence[tuple[str | None, Sequence[Row]]]  # groups by name; rows without groups by None


def plot_result(result: Result, ax: Any, kind: str, most: int | None, title: str | None) -> Any:
    """Draws a result and gives the Axes, see `Result.plot`."""
    if kind not in KINDS:
        make_plot_error(f"plot() knows no kind {kind!r}", f"the kinds are {', '.join(KINDS)}")
    pyplot = require_package("matplotlib.pyplot", "plot", "plot()")
    draw = _choose_drawing(result, kind, own=ax is None)
    if ax is None:
        _, ax = pyplot.subplots(layout="constrained")
    heading = draw(ax, most)
    ax.set_title(heading if title is None else title)
    return ax


def _choose_drawing(result: Result, kind: str, own: bool) -> Draw:
    """The function that draws the plot; `own`: on our own figure."""
    if kind == "search":
        return lambda ax, most: draw_search(result, ax, most, own)
    paths = get_result_paths(result)
    if paths is not None:
        return _choose_search_drawing(result, paths, kind, own)
    if kind in SEARCH_KINDS:
        make_plot_error(f"plot() draws {kind} of a search only", NO_PATHS)
    if kind in ("auto", "heat") and isinstance(result.value, np.ndarray) and result.value.ndim == 2:
        return lambda ax, most: _draw_heat_map(result, ax)
    return _choose_flat_drawing(result, kind, own)


def _choose_search_drawing(result: Result, paths: Sequence[Sequence[Row]], kind: str, own: bool) -> Draw:
    if not paths:
        make_plot_error("plot() found no path to draw", "the search has no result")
    where = find_coordinates(result.columns[2:], [row for path in islice(paths, 50) for row in path])
    if kind == "auto":
        kind = "graph" if where is None else "paths"
    match kind:
        case "paths":
            if where is None:
                return make_plot_error(
                    "plot() cannot find places in the rows",
                    "select a list of two or three numbers, or columns with the coordinates, and no other lists",
                )
            return lambda ax, most: draw_paths(result, paths, where, ax, most)
        case "graph":
            return lambda ax, most: draw_graph(result, ax, most, own)
        case "tree":
            return lambda ax, most: draw_tree(result, ax, most, own)
        case "lengths":
            return lambda ax, most: draw_lengths(result, paths, ax)
    return make_plot_error(f"plot() draws no search as {kind}", f"the kinds for a search are {', '.join(SEARCH_KINDS)}")


def _draw_heat_map(result: Result, ax: Any) -> str:
    value = result.value
    extent = getattr(value, "extent", None)
    marks = value.dtype == bool
    image = ax.imshow(
        np.asarray(value), origin="lower" if extent else "upper", extent=extent, cmap="Greys" if marks else "viridis"
    )
    name = escape_plot_label(result.columns[-1])
    if not marks:
        ax.figure.colorbar(image, ax=ax, label=name, shrink=0.9)
    across, up = _name_axes(result) if extent else ("column", "row")
    ax.set_xlabel(across)
    ax.set_ylabel(up)
    return f"{name}, {value.shape[1]} x {value.shape[0]} cells"


def _name_axes(result: Result) -> tuple[str, str]:
    """The names of the axes of an area: `AS plane` names its plane, other grids are on the floor."""
    for query in (query for statement in result.outline[-1:] for query in statement.queries):
        arguments = query.written.representation.arguments
        first = arguments[0] if arguments else None
        if isinstance(first, plan.Constant) and str(first.value).upper() in ("XZ", "YZ"):
            return f"{str(first.value)[0].lower()} in m", f"{str(first.value)[1].lower()} in m"
    return "x in m", "y in m"


def _choose_flat_drawing(result: Result, kind: str, own: bool) -> Draw:
    """The function that draws bars, lines or points, by the columns; `own`: on our own figure."""
    columns = list(map(escape_plot_label, result.columns))
    rows = list(get_result_rows(result))
    kinds = [{type(row[index]) for row in rows} - {type(None)} for index in range(len(columns))]
    numbers = [index for index, found in enumerate(kinds) if found and found <= {int, float}]
    labels = [index for index, found in enumerate(kinds) if index not in numbers]
    pointed = [
        index for index in labels if any(r[index] for r in rows) and all(is_plot_point(row[index]) for row in rows)
    ]
    if kind == "heat":
        make_plot_error("plot() has no array of two dimensions to draw", "AS plane gives one")
    times = _find_times(rows, labels) if numbers and not pointed and kind != "bars" else None
    if times is not None:  # they are what the numbers are drawn by
        time, rows = times
        labels.remove(time)
        numbers.insert(0, time)
    dated = times is not None
    series = _list_series(result, rows)
    label = labels[0] if len(labels) == 1 else None
    if kind == "bars" or (kind == "auto" and label is not None and len(numbers) == 1 and not pointed):
        if len(numbers) == 1 and len(labels) <= 1:
            return lambda ax, most: _draw_bars(columns, series, most or MOST_BARS, label, numbers[0], ax, own)
    elif kind in ("auto", "points") and pointed:
        place = pointed[0]
        names = next((index for index in labels if index != place), None)
        axes = f"x of {columns[place]}", f"y of {columns[place]}"
        left = f", without {', '.join(columns[index] for index in numbers)}" if numbers else ""
        return lambda ax, most: _draw_scatter_plot(axes, series, lambda row: row[place], names, ax) + left
    elif numbers:
        rising = all(
            None not in xs and all(a < b for a, b in pairwise(xs))
            for xs in ([row[numbers[0]] for row in part] for _, part in series)
        )
        if len(numbers) > 2 and ((kind == "points" and not labels) or (kind == "auto" and not rising)):
            return lambda ax, most: _draw_line_plot(columns, series, numbers, ax, dated, lines=False)
        named = bool(labels) and series[0][0] is None
        if kind == "points" or (kind == "auto" and len(numbers) == 2 and (named or not rising)):
            if len(numbers) >= 2:
                x, y, *_ = numbers
                return lambda ax, most: _draw_scatter_plot(
                    (columns[x], columns[y]), series, lambda row: (row[x], row[y]), label, ax, dated
                )
        elif kind in ("auto", "line") and (len(numbers) == 1 or rising):
            return lambda ax, most: _draw_line_plot(columns, series, numbers, ax, dated)
    wanted = "" if kind == "auto" else f" as {kind}"
    return make_plot_error(
        f"plot() cannot draw the columns {', '.join(result.columns)}{wanted}",
        "it draws a label and a number as bars, numbers as points, or as lines by a time or first number that ORDER BY "
        "makes rise, lists of two numbers as points",
    )


def _find_times(rows: Sequence[Row], labels: Sequence[int]) -> tuple[int, list[Row]] | None:
    """The first of these columns that has times, and the rows with days, as matplotlib counts them, in place of these.

    A time is an object of Python or, as columns of data frames have it, a text; those with a zone are drawn in UTC.
    """
    dates: Any = require_package("matplotlib.dates", "plot", "plot()")
    for index in labels:
        try:
            times = [datetime.fromisoformat(row[index]) if type(row[index]) is str else row[index] for row in rows]
            if not any(times) or not all(time is None or isinstance(time, date) for time in times):
                continue
            plain = [time.astimezone(UTC).replace(tzinfo=None) if getattr(time, "tzinfo", None) else time
                     for time in times]  # fmt: skip
        except (ValueError, OverflowError):
            continue
        days = [None if np.isnan(day) else day for day in dates.date2num(plain).tolist()]
        return index, [(*row[:index], day, *row[index + 1 :]) for row, day in zip(rows, days, strict=True)]
    return None


def _show_times(ax: Any) -> None:
    """Makes the lower axis, on which days are drawn, one of times."""
    dates: Any = require_package("matplotlib.dates", "plot", "plot()")
    locator = dates.AutoDateLocator()
    ax.xaxis.set_major_locator(locator)
    ax.xaxis.set_major_formatter(dates.ConciseDateFormatter(locator))
    limits = np.array(ax.get_xlim())
    possible = limits.clip(*dates.date2num([date.min, date.max]))
    if (limits != possible).any():  # the margin beside a far time
        ax.set_xlim(possible)


def _list_series(result: Result, rows: Sequence[Row]) -> Series:
    """The groups that GROUP BY makes of the rows, by their values; without such the rows, by None."""
    groups = None if result.answer is None else result.answer.rows.groups
    if groups is None:
        return [(None, rows)]
    return [(_name_group(value), [rows[position] for position in positions]) for value, positions in groups]


def _name_group(value: Any) -> str:
    values = value if isinstance(value, tuple) else (value,)
    return ", ".join(map(format_cell, values))


def _draw_bars(
    columns: Sequence[str], series: Series, most: int, label: int | None, number: int, ax: Any, own: bool
) -> str:
    """Draws bars; our own figure grows with them, on another one the text of many is small."""
    rows = [(name, row) for name, part in series for row in part]
    shown = [row for _, row in rows[:most]]
    if own:
        ax.figure.set_figheight(max(ax.figure.get_figheight(), 0.2 * len(shown)))  # inches
    names = [
        ": ".join(([] if name is None else [name]) + ([] if label is None else [format_cell(row[label])]))
        for name, row in rows[:most]
    ]
    if not any(names):
        names = [str(index) for index in range(1, len(shown) + 1)]
    values = [row[number] or 0 for row in shown]
    texts = [f"{row[number]:.6g}" if type(row[number]) is float else format_cell(row[number]) for row in shown]
    size = min(10.0, 0.8 * 72 * ax.bbox.height / ax.figure.dpi / max(1, len(shown)))  # points: lines stay apart
    bars = ax.barh(range(len(shown)), values, color=BLUE)
    ax.bar_label(bars, texts, padding=3, fontsize=size)
    ax.set_yticks(range(len(shown)), [shorten_plot_label(name, MOST_TEXT) for name in names], fontsize=size)
    ax.invert_yaxis()
    ax.margins(x=0.05 + 0.002 * size * max(map(len, texts), default=0))
    ax.set_xlabel(columns[number])
    if all(type(value) is int for value in values):
        set_integer_ticks(ax.xaxis)
    hide_spines(ax)
    by = f"{columns[number]} by {columns[label]}" if label is not None else columns[number]
    by += _count_groups(series)
    return by if len(shown) == len(rows) else f"{by}, the first {len(shown)} of {len(rows)} rows"


def _draw_line_plot(
    columns: Sequence[str], series: Series, numbers: Sequence[int], ax: Any, dated: bool, lines: bool = True
) -> str:
    """Draws the other columns of each group by the first one, as lines or as points."""
    first, *others = numbers
    looks = cycle(LOOKS)
    few = all(len(part) <= 50 for _, part in series)
    names = [columns[index] for index in others or [first]]

    def read_numbers(part: Sequence[Row], index: int) -> list[float]:
        return [np.nan if row[index] is None else row[index] for row in part]

    for value, part in series:
        group = None if value is None else shorten_plot_label(value, MOST_TEXT)
        xs = read_numbers(part, first) if others else list(range(1, len(part) + 1))
        for index in others or [first]:
            name = columns[index] if group is None else group if len(names) == 1 else f"{group}: {columns[index]}"
            line, marker, colour = next(looks)
            ax.plot(xs, read_numbers(part, index), linestyle=line if lines else "",
                    marker=marker if few or not lines else "", markersize=4, label=name, color=colour)  # fmt: skip
    ax.set_xlabel(columns[first] if others else "row")
    ax.set_ylabel(names[0] if len(names) == 1 else "")
    _draw_names(ax, len(series) * len(names))
    ax.grid(alpha=0.25)
    if dated:
        _show_times(ax)
    return f"{', '.join(names)} by {columns[first] if others else 'row'}{_count_groups(series)}"


def _draw_names(ax: Any, total: int) -> None:
    """Draws the legend of several lines or groups, if they all look different."""
    if 1 < total <= len(LOOKS):
        ax.legend(frameon=False)


def _count_groups(series: Series) -> str:
    return "" if series[0][0] is None else f", {count_words(len(series), 'group')}"


def _draw_scatter_plot(
    names: Sequence[str],
    series: Series,
    read_place: Callable[[Row], Sequence[Any]],
    label: int | None,
    ax: Any,
    dated: bool = False,
) -> str:
    """Draws points, those of each group in a look of their own, and the labels of a few."""
    there = [(name, [row for row in part if None not in read_place(row)]) for name, part in series]
    for (name, part), (_, marker, colour) in zip(there, cycle(LOOKS), strict=False):
        xs, ys = ([read_place(row)[axis] for row in part] for axis in (0, 1))
        ax.scatter(xs, ys, color=colour, marker=marker, s=25, alpha=0.8, edgecolor="none",
                   label=name and shorten_plot_label(name, MOST_TEXT))  # fmt: skip
    rows = [row for _, part in there for row in part]
    if label is not None and len(rows) <= 30:
        named: dict[tuple[Any, Any], list[str]] = {}  # what is at the same place shares one text
        for row in rows:
            named.setdefault(tuple(read_place(row)[:2]), []).append(format_cell(row[label]))
        for place, names_there in named.items():
            shown = shorten_plot_label(", ".join(dict.fromkeys(names_there)), MOST_TEXT)
            ax.annotate(shown, place, xytext=(4, 4), textcoords="offset points", fontsize=8)
    ax.set_xlabel(names[0])
    ax.set_ylabel(names[1])
    if [name.partition(" of ")[0] for name in names] == ["x", "y"] and not dated:
        ax.set_aspect("equal", adjustable="datalim")
    _draw_names(ax, len(series))
    ax.grid(alpha=0.25)
    ax.margins(0.08)
    if dated:
        _show_times(ax)
    return count_words(len(rows), "point") + _count_groups(series)

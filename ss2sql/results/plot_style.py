"""The style of all plots: colours for colour-blind people too, titles, legends, errors.

The colours are those of Okabe and Ito, https://jfly.uni-koeln.de/color/.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NoReturn

from ss2sql.errors import RepresentationError
from ss2sql.results import count_words

if TYPE_CHECKING:
    from ss2sql.results.result import Result

BLUE, ORANGE, GREEN, PURPLE, RED, SKY = "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9"
PALETTE = (BLUE, ORANGE, GREEN, PURPLE, RED, SKY)
PALE, FRAME, INK = "#e9eef4", "#444444", "black"
FEW = len(PALETTE)  # paths that have a colour and a name each


def make_plot_error(message: str, *hints: str) -> NoReturn:
    raise RepresentationError("V001", message, hints=hints)


def escape_plot_label(text: str) -> str:
    """A name or a value with escaped dollars, which would enclose a formula."""
    return text.replace("$", r"\$")


def cut_plot_label(text: str, most: int) -> str:
    return text if len(text) <= most else text[: most - 1] + "…"


def shorten_plot_label(text: str, most: int) -> str:
    """At most so many characters of a name or a value, with escaped dollars."""
    return escape_plot_label(cut_plot_label(text, most))


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


def mark_path_ends_in_plot(ax: Any, starts: Any, goals: Any, width: int) -> None:
    ax.scatter(*starts.T[:width], s=55, color=GREEN, edgecolor="white", zorder=40, label="first step")
    ax.scatter(*goals.T[:width], s=120, marker="*", color=INK, edgecolor="white", zorder=41, label="last step")


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

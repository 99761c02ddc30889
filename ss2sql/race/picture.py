"""A bar chart: the time of the best run of each strategy and engine."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ss2sql.race.cells import Cell
from ss2sql.race.heats import Heat
from ss2sql.race.sheet import milliseconds, title
from ss2sql.results import package
from ss2sql.results.looks import BLUE, ORANGE, RED, open_frame, short

COLOURS = {"database": BLUE, "native": ORANGE}
WIDE = 50  # the multiple of the fastest time above which the scale is logarithmic
MOST_TEXT = 75


def draw(heats: Sequence[Heat], path: Path) -> None:
    """Writes the chart, one field for each statement. Raises SessionError S003 without matplotlib."""
    package("matplotlib", "plot", "bench --plot").use("Agg")
    pyplot = package("matplotlib.pyplot", "plot", "bench --plot")
    raced = [heat for heat in heats if any(cell.best for cell in heat.cells)] or list(heats)
    heights = [1.0 + 0.3 * len(heat.cells) + 0.15 * len({cell.strategy for cell in heat.cells}) for heat in raced]
    figure, fields = pyplot.subplots(
        len(raced), 1, figsize=(10, sum(heights)), height_ratios=heights, layout="constrained", squeeze=False
    )
    for heat, (field,) in zip(raced, fields, strict=True):
        _field(heat, field)
    _legend([cell for heat in raced for cell in heat.cells], figure)
    figure.savefig(path, dpi=150)
    pyplot.close(figure)


def _field(heat: Heat, field: Any) -> None:
    places, marks = _places(heat.cells)
    times = [cell.best for cell in heat.cells if cell.best is not None]
    wide = bool(times) and max(times) > WIDE * min(times)
    left = min(times, default=1e-3) * 1000 / 2 if wide else 0
    if wide:
        field.set_xscale("log")
        field.xaxis.set_major_formatter("{x:g}")
    for cell, place in zip(heat.cells, places, strict=True):
        if cell.best is None:
            field.annotate(short(_reason(cell), MOST_TEXT), (left, place), (4, 0), textcoords="offset points",
                           va="center", fontsize=8, color=RED if cell.forbidden else "#777777",
                           style="italic")  # fmt: skip
            continue
        value = cell.best * 1000
        field.barh(place, value - left, left=left, height=0.85, color=COLOURS[cell.engine],
                   hatch="//" if cell.forbidden else None, edgecolor="white")  # fmt: skip
        field.annotate(_label(cell), (value, place), (4, 0), textcoords="offset points", va="center", fontsize=8,
                       color=RED if cell.forbidden else "black")  # fmt: skip
    field.set_yticks([place for place, _ in marks], [name for _, name in marks])
    field.set_ylim(max(places) + 0.8, min(places) - 0.8)
    field.set_xlim(left=left or None, right=max(times, default=1) * 1000 * (30 if wide else 1.6))
    field.set_xlabel("milliseconds of the best run" + (", logarithmic" if wide else ""))
    field.set_title(short(title(heat), 90), fontsize=10, loc="left")
    open_frame(field)
    field.tick_params(axis="y", length=0)


def _places(cells: Sequence[Cell]) -> tuple[list[float], list[tuple[float, str]]]:
    """The positions of the bars, grouped by strategy, and of the strategies' names."""
    places: list[float] = []
    of: dict[str, list[float]] = {}
    here = -1.0
    for cell in cells:
        here += 1.0 if cell.strategy in of else 1.5
        places.append(here)
        of.setdefault(cell.strategy, []).append(here)
    return places, [(sum(found) / len(found), short(name, 34)) for name, found in of.items()]


def _label(cell: Cell) -> str:
    """The time, and the answer where it differs."""
    assert cell.best is not None
    told = "" if cell.same else f", {cell.answer}"
    return f"{milliseconds(cell.best)} ms{short(told, MOST_TEXT)}"


def _reason(cell: Cell) -> str:
    return f"{cell.engine}: {cell.missing}"


def _legend(cells: Sequence[Cell], figure: Any) -> None:
    from matplotlib.patches import Patch

    engines = dict.fromkeys(cell.engine for cell in cells if cell.best is not None)
    if len(engines) > 1:
        figure.legend([Patch(color=COLOURS[name]) for name in engines], list(engines), frameon=False,
                      loc="outside lower right", ncols=2)  # fmt: skip

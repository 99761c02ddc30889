"""A bar chart: the time of the best run of each strategy and engine."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ss2sql.bench.report import format_milliseconds, format_title
from ss2sql.bench.results import BenchResult
from ss2sql.bench.runs import StatementRuns
from ss2sql.results import require_package
from ss2sql.results.plot_style import BLUE, ORANGE, RED, hide_spines, shorten

COLOURS = {"database": BLUE, "native": ORANGE}
WIDE = 50  # the multiple of the fastest time above which the scale is logarithmic
MOST_TEXT = 75


def draw_chart(all_runs: Sequence[StatementRuns], path: Path) -> None:
    """Writes the chart, one field for each statement. Raises SessionError S003 without matplotlib."""
    require_package("matplotlib", "plot", "bench --plot").use("Agg")
    pyplot = require_package("matplotlib.pyplot", "plot", "bench --plot")
    raced = [runs for runs in all_runs if any(result.best for result in runs.cells)] or list(all_runs)
    heights = [1.0 + 0.3 * len(runs.cells) + 0.15 * len({result.strategy for result in runs.cells}) for runs in raced]
    figure, fields = pyplot.subplots(
        len(raced), 1, figsize=(10, sum(heights)), height_ratios=heights, layout="constrained", squeeze=False
    )
    for runs, (field,) in zip(raced, fields, strict=True):
        _draw_statement_bars(runs, field)
    _draw_legend([result for runs in raced for result in runs.cells], figure)
    figure.savefig(path, dpi=150)
    pyplot.close(figure)


def _draw_statement_bars(runs: StatementRuns, field: Any) -> None:
    places, marks = _place_bars(runs.cells)
    times = [result.best for result in runs.cells if result.best is not None]
    wide = bool(times) and max(times) > WIDE * min(times)
    left = min(times, default=1e-3) * 1000 / 2 if wide else 0
    if wide:
        field.set_xscale("log")
        field.xaxis.set_major_formatter("{x:g}")
    for result, place in zip(runs.cells, places, strict=True):
        if result.best is None:
            field.annotate(shorten(_explain_missing(result), MOST_TEXT), (left, place), (4, 0),
                textcoords="offset points",
                           va="center", fontsize=8, color=RED if result.forbidden else "#777777",
                           style="italic")  # fmt: skip
            continue
        value = result.best * 1000
        field.barh(place, value - left, left=left, height=0.85, color=COLOURS[result.engine],
                   hatch="//" if result.forbidden else None, edgecolor="white")  # fmt: skip
        field.annotate(_format_bar_label(result), (value, place), (4, 0), textcoords="offset points", va="center",
                       fontsize=8, color=RED if result.forbidden else "black")  # fmt: skip
    field.set_yticks([place for place, _ in marks], [name for _, name in marks])
    field.set_ylim(max(places) + 0.8, min(places) - 0.8)
    field.set_xlim(left=left or None, right=max(times, default=1) * 1000 * (30 if wide else 1.6))
    field.set_xlabel("milliseconds of the best run" + (", logarithmic" if wide else ""))
    field.set_title(shorten(format_title(runs), 90), fontsize=10, loc="left")
    hide_spines(field)
    field.tick_params(axis="y", length=0)


def _place_bars(results: Sequence[BenchResult]) -> tuple[list[float], list[tuple[float, str]]]:
    """The positions of the bars, grouped by strategy, and of the strategies' names."""
    places: list[float] = []
    of: dict[str, list[float]] = {}
    ours = -1.0
    for result in results:
        ours += 1.0 if result.strategy in of else 1.5
        places.append(ours)
        of.setdefault(result.strategy, []).append(ours)
    return places, [(sum(found) / len(found), shorten(name, 34)) for name, found in of.items()]


def _format_bar_label(result: BenchResult) -> str:
    """The time, and the answer where it differs."""
    assert result.best is not None
    told = "" if result.same else f", {result.answer}"
    return f"{format_milliseconds(result.best)} ms{shorten(told, MOST_TEXT)}"


def _explain_missing(result: BenchResult) -> str:
    return f"{result.engine}: {result.missing}"


def _draw_legend(results: Sequence[BenchResult], figure: Any) -> None:
    from matplotlib.patches import Patch

    engines = dict.fromkeys(result.engine for result in results if result.best is not None)
    if len(engines) > 1:
        figure.legend([Patch(color=COLOURS[name]) for name in engines], list(engines), frameon=False,
                      loc="outside lower right", ncols=2)  # fmt: skip

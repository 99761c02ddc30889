"""The report of a comparison: a table for people, data, and a bar chart."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import apsw

from ss2sql.bench.compare import SAME
from ss2sql.bench.results import BenchResult, BenchRules
from ss2sql.bench.runs import StatementRuns
from ss2sql.errors import require_package
from ss2sql.results.plot_style import BLUE, ORANGE, RED, hide_spines, shorten_plot_label

if TYPE_CHECKING:
    from rich.console import Console


MOST_TEXT = 90  # characters of a statement above its table


def format_race_title(runs: StatementRuns) -> str:
    """The place and the beginning of the statement."""
    text = runs.text if len(runs.text) <= MOST_TEXT else runs.text[: MOST_TEXT - 3] + "..."
    return f"{runs.tree.span.place}  {text}"


def compute_timing_ratios(results: Sequence[BenchResult]) -> list[float | None]:
    fastest = min((result.best for result in results if result.best is not None), default=None)
    return [result.best / fastest if result.best is not None and fastest else None for result in results]


def print_runs(runs: StatementRuns, settings: BenchRules, console: Console) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    grouped = any(result.rows is not None and result.paths is None for result in runs.cells)
    counted = "rows" if grouped or runs.search is None else "paths"
    first = "strategy" if runs.search else ""
    heads = [first, "engine", "best ms", "median", "ratio", counted, "steps", "calls"]
    table = Table(box=SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0))
    for number, head in enumerate([*heads, *(["MB"] if settings.memory else [])]):
        table.add_column(head, justify="left" if number < 2 else "right", no_wrap=number > 0)
    table.add_column("answer", min_width=12)
    before = None
    for number, (result, ratio) in enumerate(zip(runs.cells, compute_timing_ratios(runs.cells), strict=True)):
        name = "" if result.strategy == before else result.strategy
        style = "bold red" if result.forbidden else "dim" if result.missing else ""
        answer = _format_answer(result, None if name else runs.cells[number - 1])
        table.add_row(
            *map(Text, (name, result.engine, *_format_timings(result, ratio, settings.memory), answer)), style=style
        )
        before = result.strategy
    console.print(format_race_title(runs), markup=False, highlight=False, no_wrap=True, overflow="ellipsis")
    console.print(table)
    for line in (*_describe_fastest(runs), *_list_skipped_runs(runs.cells), *runs.notes):
        console.print(line, markup=False, highlight=False)


def _describe_fastest(runs: StatementRuns) -> list[str]:
    """The fastest with the same answer, and its speedup over the script as written."""
    same = [result for result in runs.cells if result.same and result.best]
    if len(same) < 2:
        return []
    winner, written = (
        min(found, key=lambda result: result.best or 0)
        for found in (same, [result for result in same if result.strategy == same[0].strategy])
    )
    gain = ""
    if winner is not written:
        gain = f", {(written.best or 0) / (winner.best or 1):.1f} times as fast as {written.name}"
    elif winner.strategy == runs.cells[0].strategy != "":
        gain = ", as it is written"
    return [f"Fastest with the same answer: {winner.name}{gain}."]


def _list_skipped_runs(results: Sequence[BenchResult]) -> list[str]:
    places: dict[str, list[str]] = {}
    for result in results:
        if result.missing is not None:
            places.setdefault(result.missing, []).append(result.name)
    return [f"Not run: {', '.join(found)}: {reason}." for reason, found in places.items()]


def _format_timings(result: BenchResult, ratio: float | None, memory: bool) -> list[str]:
    if result.best is None or result.middle is None or ratio is None:
        return [""] * (7 if memory else 6)
    rows = result.rows if result.paths is None else result.paths
    found = [
        format_milliseconds(result.best),
        format_milliseconds(result.middle),
        f"{ratio:.1f}" if ratio < 100 else f"{ratio:,.0f}",
        f"{rows:,}",
        f"{result.steps:,}" if result.steps else "",
        f"{sum(result.calls.values()):,}" if result.calls else "",
    ]
    return [*found, "" if result.memory is None else f"{result.memory / 1e6:.1f}"] if memory else found


def _format_answer(result: BenchResult, above: BenchResult | None) -> str:
    """The answer in a few words, unless the same strategy has it in the row above."""
    if above is not None and result.answer == above.answer and len(result.answer) > len(SAME.words):
        return f"as {above.engine}"
    return "FORBIDDEN: " * result.forbidden + result.answer or ("not run" if result.missing else "")


def format_milliseconds(seconds: float) -> str:
    value = seconds * 1000
    return f"{value:,.0f}" if value >= 1000 else f"{value:.3g}" if value >= 0.01 else f"{value:.4f}"


def collect_race_report(all_runs: Sequence[StatementRuns], settings: BenchRules) -> dict[str, Any]:
    from ss2sql import __version__

    machine = {
        "ss2sql": __version__, "python": platform.python_version(), "sqlite": apsw.sqlite_lib_version(),
        "machine": platform.machine(), "system": platform.system(),
    }  # fmt: skip
    statements = [
        {
            "place": runs.tree.span.place,
            "text": runs.tree.span.text,
            "reference": runs.reference,
            "notes": runs.notes,
            "cells": [
                result.as_dict() | {"ratio": ratio}
                for result, ratio in zip(runs.cells, compute_timing_ratios(runs.cells), strict=True)
            ],
        }
        for runs in all_runs
    ]
    return {"on": machine, "repeat": settings.repeat, "timeout": settings.timeout, "statements": statements}


# --- a bar chart: the time of the best run of each strategy and engine
COLOURS = {"database": BLUE, "native": ORANGE}
WIDE = 50  # the multiple of the fastest time above which the scale is logarithmic
MOST_LABEL = 75


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
        _draw_timing_bars(runs, field)
    _draw_timing_legend([result for runs in raced for result in runs.cells], figure)
    figure.savefig(path, dpi=150)
    pyplot.close(figure)


def _draw_timing_bars(runs: StatementRuns, field: Any) -> None:
    places, marks = _place_bars(runs.cells)
    times = [result.best for result in runs.cells if result.best is not None]
    wide = bool(times) and max(times) > WIDE * min(times)
    left = min(times, default=1e-3) * 1000 / 2 if wide else 0
    if wide:
        field.set_xscale("log")
        field.xaxis.set_major_formatter("{x:g}")
    for result, place in zip(runs.cells, places, strict=True):
        if result.best is None:
            field.annotate(shorten_plot_label(f"{result.engine}: {result.missing}", MOST_LABEL), (left, place), (4, 0),
                textcoords="offset points",
                           va="center", fontsize=8, color=RED if result.forbidden else "#777777",
                           style="italic")  # fmt: skip
            continue
        value = result.best * 1000
        field.barh(place, value - left, left=left, height=0.85, color=COLOURS[result.engine],
                   hatch="//" if result.forbidden else None, edgecolor="white")  # fmt: skip
        told = "" if result.same else shorten_plot_label(f", {result.answer}", MOST_LABEL)
        field.annotate(f"{format_milliseconds(result.best)} ms{told}", (value, place), (4, 0), va="center",
                       textcoords="offset points",
                       fontsize=8, color=RED if result.forbidden else "black")  # fmt: skip
    field.set_yticks([place for place, _ in marks], [name for _, name in marks])
    field.set_ylim(max(places) + 0.8, min(places) - 0.8)
    field.set_xlim(left=left or None, right=max(times, default=1) * 1000 * (30 if wide else 1.6))
    field.set_xlabel("milliseconds of the best run" + (", logarithmic" if wide else ""))
    field.set_title(shorten_plot_label(format_race_title(runs), 90), fontsize=10, loc="left")
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
    return places, [(sum(found) / len(found), shorten_plot_label(name, 34)) for name, found in of.items()]


def _draw_timing_legend(results: Sequence[BenchResult], figure: Any) -> None:
    from matplotlib.patches import Patch

    engines = dict.fromkeys(result.engine for result in results if result.best is not None)
    if len(engines) > 1:
        figure.legend([Patch(color=COLOURS[name]) for name in engines], list(engines), frameon=False,
                      loc="outside lower right", ncols=2)  # fmt: skip

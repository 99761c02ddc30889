"""The report of a comparison: a table for people, and data."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import apsw

from ss2sql.bench.runs import SAME, BenchResult, BenchRules, StatementRuns

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


def print_runs(runs: StatementRuns, console: Console) -> None:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    grouped = any(result.rows is not None and result.paths is None for result in runs.cells)
    counted = "rows" if grouped or runs.search is None else "paths"
    first = "strategy" if runs.search else ""
    heads = [first, "engine", "best ms", "median", "ratio", counted, "steps", "calls"]
    table = Table(box=SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0))
    for number, head in enumerate(heads):
        table.add_column(head, justify="left" if number < 2 else "right", no_wrap=number > 0)
    table.add_column("answer", min_width=12)
    before = None
    for number, (result, ratio) in enumerate(zip(runs.cells, compute_timing_ratios(runs.cells), strict=True)):
        name = "" if result.strategy == before else result.strategy
        style = "bold red" if result.forbidden else "dim" if result.missing else ""
        answer = _format_answer(result, None if name else runs.cells[number - 1])
        table.add_row(*map(Text, (name, result.engine, *_format_timings(result, ratio), answer)), style=style)
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


def _format_timings(result: BenchResult, ratio: float | None) -> list[str]:
    if result.best is None or result.middle is None or ratio is None:
        return [""] * 6
    rows = result.rows if result.paths is None else result.paths
    return [
        format_milliseconds(result.best),
        format_milliseconds(result.middle),
        f"{ratio:.1f}" if ratio < 100 else f"{ratio:,.0f}",
        f"{rows:,}",
        f"{result.steps:,}" if result.steps else "",
        f"{sum(result.calls.values()):,}" if result.calls else "",
    ]


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

"""The report of a comparison, as a table for people and as data."""

from __future__ import annotations

import platform
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import apsw

from ss2sql.race.cells import Cell, Rules
from ss2sql.race.heats import Heat
from ss2sql.race.promises import SAME

if TYPE_CHECKING:
    from rich.console import Console

MOST_TEXT = 90  # characters of a statement above its table


def title(heat: Heat) -> str:
    """The place and the beginning of the statement."""
    text = heat.text if len(heat.text) <= MOST_TEXT else heat.text[: MOST_TEXT - 3] + "..."
    return f"{heat.tree.span.place}  {text}"


def ratios(cells: Sequence[Cell]) -> list[float | None]:
    """The ratio of each best run to the fastest one."""
    fastest = min((cell.best for cell in cells if cell.best is not None), default=None)
    return [cell.best / fastest if cell.best is not None and fastest else None for cell in cells]


def show(heat: Heat, rules: Rules, console: Console) -> None:
    """Prints the table of one statement with its notes."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table
    from rich.text import Text

    grouped = any(cell.rows is not None and cell.paths is None for cell in heat.cells)
    counted = "rows" if grouped or heat.search is None else "paths"
    first = "strategy" if heat.search else ""
    heads = [first, "engine", "best ms", "median", "ratio", counted, "steps", "calls"]
    table = Table(box=SIMPLE_HEAD, show_edge=False, pad_edge=False, padding=(0, 1, 0, 0))
    for number, head in enumerate([*heads, *(["MB"] if rules.memory else [])]):
        table.add_column(head, justify="left" if number < 2 else "right", no_wrap=number > 0)
    table.add_column("answer", min_width=12)
    before = None
    for number, (cell, ratio) in enumerate(zip(heat.cells, ratios(heat.cells), strict=True)):
        name = "" if cell.strategy == before else cell.strategy
        style = "bold red" if cell.forbidden else "dim" if cell.missing else ""
        answer = _answer(cell, None if name else heat.cells[number - 1])
        table.add_row(*map(Text, (name, cell.engine, *_figures(cell, ratio, rules.memory), answer)), style=style)
        before = cell.strategy
    console.print(title(heat), markup=False, highlight=False, no_wrap=True, overflow="ellipsis")
    console.print(table)
    for line in (*_summary(heat), *_reasons(heat.cells), *heat.notes):
        console.print(line, markup=False, highlight=False)


def _summary(heat: Heat) -> list[str]:
    """The fastest with the same answer, and its speedup over the script as written."""
    same = [cell for cell in heat.cells if cell.same and cell.best]
    if len(same) < 2:
        return []
    winner, written = (
        min(found, key=lambda cell: cell.best or 0)
        for found in (same, [cell for cell in same if cell.strategy == same[0].strategy])
    )
    gain = ""
    if winner is not written:
        gain = f", {(written.best or 0) / (winner.best or 1):.1f} times as fast as {written.name}"
    elif winner.strategy == heat.cells[0].strategy != "":
        gain = ", as it is written"
    return [f"Fastest with the same answer: {winner.name}{gain}."]


def _reasons(cells: Sequence[Cell]) -> list[str]:
    """The reasons for missing results, one line each."""
    places: dict[str, list[str]] = {}
    for cell in cells:
        if cell.missing is not None:
            places.setdefault(cell.missing, []).append(cell.name)
    return [f"Not run: {', '.join(found)}: {reason}." for reason, found in places.items()]


def _figures(cell: Cell, ratio: float | None, memory: bool) -> list[str]:
    if cell.best is None or cell.middle is None or ratio is None:
        return [""] * (7 if memory else 6)
    rows = cell.rows if cell.paths is None else cell.paths
    found = [
        milliseconds(cell.best),
        milliseconds(cell.middle),
        f"{ratio:.1f}" if ratio < 100 else f"{ratio:,.0f}",
        f"{rows:,}",
        f"{cell.steps:,}" if cell.steps else "",
        f"{sum(cell.calls.values()):,}" if cell.calls else "",
    ]
    return [*found, "" if cell.memory is None else f"{cell.memory / 1e6:.1f}"] if memory else found


def _answer(cell: Cell, above: Cell | None) -> str:
    """The answer in a few words, unless the same strategy has it in the row above."""
    if above is not None and cell.answer == above.answer and len(cell.answer) > len(SAME.words):
        return f"as {above.engine}"
    return "FORBIDDEN: " * cell.forbidden + cell.answer or ("not run" if cell.missing else "")


def milliseconds(seconds: float) -> str:
    value = seconds * 1000
    return f"{value:,.0f}" if value >= 1000 else f"{value:.3g}" if value >= 0.01 else f"{value:.4f}"


def outcome(heats: Sequence[Heat], rules: Rules) -> dict[str, Any]:
    """All measurements, for JSON."""
    from ss2sql import __version__

    machine = {
        "ss2sql": __version__, "python": platform.python_version(), "sqlite": apsw.sqlite_lib_version(),
        "machine": platform.machine(), "system": platform.system(),
    }  # fmt: skip
    statements = [
        {
            "place": heat.tree.span.place,
            "text": heat.tree.span.text,
            "reference": heat.reference,
            "notes": heat.notes,
            "cells": [
                cell.as_dict() | {"ratio": ratio} for cell, ratio in zip(heat.cells, ratios(heat.cells), strict=True)
            ],
        }
        for heat in heats
    ]
    return {"on": machine, "repeat": rules.repeat, "timeout": rules.timeout, "statements": statements}

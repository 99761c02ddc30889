"""Results as text and as HTML: at most so many rows, each on one line; the paths of a search drawn as paths."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import date, time
from html import escape
from io import StringIO
from itertools import islice
from typing import TYPE_CHECKING, Any

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.rows import Row
from ss2sql.language.values import format_value as written
from ss2sql.results import count_words, cut_text, get_result_paths, get_result_rows

if TYPE_CHECKING:
    from rich.console import Console

    from ss2sql.results.result import Result

MOST_ROWS = 20
MOST_WIDE = 120  # characters of a table, however wide the terminal is
REPR_WIDE = 100
MOST_TEXT = 200  # characters of a cell, however wide the table is
MOST_STEP = 60  # characters of a step of a path
LEAST_WIDE = 8  # characters that a column keeps when its neighbours need room
HTML_WIDE, HTML_COLUMNS = 200, 30
FRAME = 3  # characters that a column needs beside its text


@dataclass(frozen=True, slots=True)
class Sheet:
    """The cells of a table as strings; `right` marks columns of numbers, `caption` describes what is not shown."""

    headings: tuple[str, ...]
    rows: list[tuple[str, ...]]
    right: tuple[bool, ...]
    caption: str


def print_result(result: Result, most: int, console: Console, noted: bool = True) -> None:
    """Prints the table with its caption, and the notes if `noted`."""
    from rich.cells import cell_len
    from rich.table import Table
    from rich.text import Text

    wide = min(console.width, MOST_WIDE)
    arrow = " -> " if console.options.ascii_only else " → "
    made = make_result_sheet(result, most, wide, arrow)
    naturals = [max(map(cell_len, column)) for column in zip(made.headings, *made.rows, strict=True)]
    widths = _fit_widths(naturals, wide - 1 - FRAME * len(made.headings))
    table = Table()
    for heading, width, right in zip(made.headings, widths, made.right, strict=True):
        table.add_column(
            Text(heading), no_wrap=True, overflow="ellipsis", max_width=width, justify="right" if right else "left"
        )
    for row in made.rows:
        table.add_row(*map(Text, row))
    console.print(table)
    lines = [made.caption, *(f"note: {note}" for note in result.notes if noted)]
    for line in lines:
        console.print(line, markup=False, highlight=False)


def format_result_text(result: Result, most: int = MOST_ROWS) -> str:
    """The table as `repr` shows it."""
    from rich.console import Console

    # In a notebook rich would publish its output, whatever its destination.
    console = Console(width=REPR_WIDE, color_system=None, record=True, file=StringIO(), force_jupyter=False)
    print_result(result, most, console)
    return console.export_text().rstrip()


def format_html(result: Result, most: int = MOST_ROWS) -> str:
    """The table as notebooks show it."""
    made = make_result_sheet(result, most, HTML_WIDE, " → ", HTML_COLUMNS)
    aligned = [f' style="text-align: {"right" if right else "left"}"' for right in made.right]
    # Notebooks would show what is between two dollars as a formula.
    lines = ['<table class="ss2sql tex2jax_ignore mathjax_ignore">', "<thead><tr>"]
    lines += [f"<th{style}>{escape(name)}</th>" for name, style in zip(made.headings, aligned, strict=True)]
    lines.append("</tr></thead>\n<tbody>")
    for row in made.rows:
        cells = (f"<td{style}>{escape(cell)}</td>" for cell, style in zip(row, aligned, strict=True))
        lines.append(f"<tr>{''.join(cells)}</tr>")
    lines.append(f"</tbody>\n</table>\n<small>{escape(made.caption)}</small>")
    lines += [f"<br><small>note: {escape(note)}</small>" for note in result.notes]
    return "\n".join(lines)


def make_result_sheet(result: Result, most: int, wide: int, arrow: str, most_columns: int | None = None) -> Sheet:
    """The table of a result, with no more columns than have room.

    A path of a search is one line. Where a line would have to omit steps although all paths together have at most
    `most` steps, there is one line for each step.
    """
    paths = get_result_paths(result)
    if paths is not None:
        made = _make_path_sheet(result, paths, most, wide, arrow)
        if made is not None:
            return made
    table = list(islice(get_result_rows(result), most))
    count, room = len(result.columns), most_columns or max(2, (wide - 1) // (LEAST_WIDE + FRAME))
    # None stands for the columns between the first ones and the last.
    chosen: list[int | None] = [*range(count)] if count <= room else [*range(room - 2), None, count - 1]
    headings = tuple("…" if index is None else format_cell(result.columns[index]) for index in chosen)
    rows = [tuple("…" if index is None else format_cell(row[index]) for index in chosen) for row in table]
    kinds = [
        {type(row[index]) for row in table if row[index] is not None} if index is not None else () for index in chosen
    ]
    right = tuple(kind in ({int}, {float}, {int, float}) for kind in kinds)
    hidden = len(result.columns) - len(chosen) + 1 if None in chosen else 0
    return Sheet(headings, rows, right, _write_caption(result, len(table), "", hidden))


def _make_path_sheet(result: Result, paths: Sequence[Sequence[Row]], most: int, wide: int, arrow: str) -> Sheet | None:
    """The paths, one per line; None where one line per step is better."""
    first = list(islice(paths, most))
    number = len(str(len(first)))
    room = wide - 1 - 2 * FRAME - max(number, len("path"))
    drawn = [_format_path(path, room, arrow) for path in first]
    if None in drawn and len(first) == len(paths) and sum(map(len, first)) <= most:
        return None
    rows: list[tuple[str, ...]] = [
        (str(index), _shorten_shown_path(path, room, arrow) if line is None else line)
        for index, (path, line) in enumerate(zip(first, drawn, strict=True), 1)
    ]
    heading = _join_within_width(list(map(format_cell, result.columns[2:])))
    return Sheet(("path", heading), rows, (True, False), _write_caption(result, len(first), "paths ", 0))


def _format_path(path: Sequence[Row], room: int, arrow: str) -> str | None:
    """The whole path as one line, None where it is too long."""
    from rich.cells import cell_len

    if len(path) * (1 + len(arrow)) > room + len(arrow):
        return None
    line = arrow.join(map(_format_step, path))
    return line if cell_len(line) <= room and "..." not in line else None


def _shorten_shown_path(path: Sequence[Row], room: int, arrow: str) -> str:
    """The path without the middle steps that do not fit; the last step is always shown."""
    from rich.cells import cell_len

    most = min(len(path) - 1, room // (1 + len(arrow)))
    line = ""
    for kept in range(most, 0, -1):
        ahead, left = kept // 2, len(path) - kept
        shown = [
            *map(_format_step, path[:ahead]),
            f"… {left} more …",
            *map(_format_step, path[len(path) - kept + ahead :]),
        ]
        line = arrow.join(shown)
        if cell_len(line) <= room:
            return line
    return line or _format_step(path[-1])


def _format_step(row: Row) -> str:
    """The value of a row, or its values in parentheses."""
    return _join_within_width([cut_text(format_cell(value), MOST_STEP) for value in row])


def _join_within_width(texts: Sequence[str]) -> str:
    return texts[0] if len(texts) == 1 else f"({', '.join(texts)})"


def format_cell(value: Any) -> str:
    """A value as a string of one line, with control characters escaped."""
    if isinstance(value, (date, time)):
        return value.isoformat()
    if not isinstance(value, str):
        return written(value, MOST_TEXT)
    return cut_text(value, MOST_TEXT) if value.isprintable() else written(value, MOST_TEXT)


def _write_caption(result: Result, shown: int, unit: str, hidden: int) -> str:
    """The line under the table: the numbers of rows and paths, what is not shown, and the engine."""
    total, paths = len(result), get_result_paths(result)
    parts = [count_words(total, "row")]
    if paths is not None:
        parts.insert(0, count_words(len(paths), "path"))
    if shown < (len(paths) if paths is not None and unit else total):
        parts.append(f"the first {shown} {unit}shown")
    if hidden:
        parts.append(f"{len(result.columns) - hidden} of {len(result.columns)} columns shown")
    parts.append(result.engine)
    if result.status != "complete":
        parts.append(result.status)
    made: Any = None if result.answer is None else result.answer.made
    return ", ".join(parts) + (_describe_map(made) if hasattr(made, "extent") and made.size else "")


def _describe_map(value: Any) -> str:
    """What AS plane and its like made of the rows."""
    rows, columns = value.shape
    left, right, lower, upper = value.extent
    area = f"from [{left:g}, {lower:g}] to [{right:g}, {upper:g}]"
    return f"; a map of {columns} x {rows} cells {area}, values {value.min()} to {value.max()}"


def _fit_widths(naturals: Sequence[int], room: int) -> list[int]:
    """Widths that fit into the room: the widest columns shrink to a common width."""
    cap = max(naturals)
    while cap > 1 and sum(min(natural, cap) for natural in naturals) > room:
        cap -= 1
    return [max(1, min(natural, cap)) for natural in naturals]

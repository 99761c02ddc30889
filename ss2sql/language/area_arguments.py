"""The arguments of representations over an area: what they have to be, and the error that shows how AS is written."""

from __future__ import annotations

from math import isfinite
from typing import Any, NoReturn

from ss2sql.errors import RepresentationError
from ss2sql.language.values import format_value

MAX_CELLS = 16_000_000  # as many numbers take 128 MB
_AREA = "(0.3, 0.1), or (0.3, 0.1, [[0, 0], [16, 12]]): height, edge of a cell, and area in metres"
_USAGE = {
    "plane": 'write AS plane("XY", [-5, -5], [100, 100, 0.1], 3): corner, 100 x 100 cells of 0.1 m, blur in cells',
    "occupancygrid": f"write AS occupancygrid{_AREA}",
    "sensorgrid": f"write AS sensorgrid{_AREA}",
}


def refuse_argument(form: str, message: str, *hints: str) -> NoReturn:
    """Raises the error of a representation, whose place is that of AS. Without hints it shows how it is called."""
    raise RepresentationError("V001", f"AS {form} {message}", hints=hints or (_USAGE[form],))


def check_number(form: str, what: str, value: Any, above: float = float("-inf")) -> float:
    """An argument that has to be a number, and larger than `above`."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not isfinite(value) or not value > above:
        limit = f" above {above:g}" if isfinite(above) else ""
        refuse_argument(form, f"needs {what}, a number{limit}, not {format_value(value)}")
    return float(value)


def check_numbers(form: str, what: str, value: Any, count: int) -> list[float]:
    """An argument that has to be a list of numbers."""
    if not isinstance(value, list) or len(value) != count:
        refuse_argument(form, f"needs {what}, a list of {count} numbers, not {format_value(value)}")
    return [check_number(form, what, part) for part in value]


def check_area_cells(form: str, columns: float, rows: float, *hints: str) -> None:
    """Raises where a grid would be too large."""
    if columns * rows > MAX_CELLS:
        hint = f"choose larger cells: {MAX_CELLS:,} are possible"
        refuse_argument(form, f"would have {columns:.0f} x {rows:.0f} cells", hint, *hints)

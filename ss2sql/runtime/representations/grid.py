"""What the representations over an area give: an array that knows where it lies."""

from __future__ import annotations

from collections.abc import Sequence
from math import isfinite
from typing import Any, NoReturn

import numpy as np

from ss2sql.errors import RepresentationError
from ss2sql.runtime.values import show

MOST_CELLS = 16_000_000  # as many numbers take 128 MB


class Grid(np.ndarray[Any, Any]):
    """A NumPy array of two dimensions with a place in the world.

    `grid[row, column]` is the cell whose lower corner is `origin[0] + column * cell` along the first axis of its plane
    and `origin[1] + row * cell` along the second: rows go up. `origin` and `cell`, the edge of a cell, are in metres.
    What is cut out of a grid, or computed from it, has lost its place.
    """

    origin: tuple[float, float]
    cell: float

    def __new__(cls, cells: Any, origin: Sequence[float], cell: float) -> Grid:
        grid = np.asarray(cells).view(cls)
        grid.origin = (float(origin[0]), float(origin[1]))
        grid.cell = float(cell)
        return grid

    @property
    def extent(self) -> tuple[float, float, float, float]:
        """Left, right, lower and upper end: `imshow(grid, origin="lower", extent=grid.extent)`."""
        (x, y), (rows, columns) = self.origin, self.shape
        return x, x + columns * self.cell, y, y + rows * self.cell

    def centres(self) -> tuple[Any, Any]:
        """The middles of the columns along the first axis, and of the rows along the second."""
        rows, columns = self.shape
        return (
            self.origin[0] + (np.arange(columns) + 0.5) * self.cell,
            self.origin[1] + (np.arange(rows) + 0.5) * self.cell,
        )

    def index(self, x: float, y: float) -> tuple[int, int] | None:
        """Row and column of the cell that a point lies in; None outside of the grid."""
        row, column = int((y - self.origin[1]) // self.cell), int((x - self.origin[0]) // self.cell)
        return (row, column) if 0 <= row < self.shape[0] and 0 <= column < self.shape[1] else None

    def __reduce__(self) -> tuple[Any, ...]:
        return Grid, (np.asarray(self), self.origin, self.cell)


_AREA = "(0.3, 0.1), or (0.3, 0.1, [[0, 0], [16, 12]]): height, edge of a cell, and area in metres"
_USAGE = {
    "plane": 'write AS plane("XY", [-5, -5], [100, 100, 0.1], 3): corner, 100 x 100 cells of 0.1 m, blur in cells',
    "occupancygrid": f"write AS occupancygrid{_AREA}",
    "sensorgrid": f"write AS sensorgrid{_AREA}",
}


def refuse(form: str, message: str, *hints: str) -> NoReturn:
    """Raises the error of a representation, whose place is that of AS. Without hints it shows how it is called."""
    raise RepresentationError("V001", f"AS {form} {message}", hints=hints or (_USAGE[form],))


def number(form: str, what: str, value: Any, above: float = float("-inf")) -> float:
    """An argument that has to be a number, and larger than `above`."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not isfinite(value) or not value > above:
        limit = f" above {above:g}" if isfinite(above) else ""
        refuse(form, f"needs {what}, a number{limit}, not {show(value)}")
    return float(value)


def numbers(form: str, what: str, value: Any, count: int) -> list[float]:
    """An argument that has to be a list of numbers."""
    if not isinstance(value, list) or len(value) != count:
        refuse(form, f"needs {what}, a list of {count} numbers, not {show(value)}")
    return [number(form, what, part) for part in value]


def check_cells(form: str, columns: float, rows: float) -> None:
    """Raises where a grid would be too large."""
    if columns * rows > MOST_CELLS:
        hint = f"choose larger cells: {MOST_CELLS:,} are possible"
        refuse(form, f"would have {columns:.0f} x {rows:.0f} cells", hint)

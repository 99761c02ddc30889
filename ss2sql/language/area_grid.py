"""What the representations over an area give: an array that knows where it lies."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np


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

"""`AS plane("XY", [x, y], [width, height, resolution], blur)`: the values of the rows, added up where they are.

The arguments are the paper's: the plane, the starting point (the lower corner, in metres), how many cells there are and
the edge of a cell in metres, and optionally the blur, in cells.
"""

from __future__ import annotations

from math import ceil
from typing import TYPE_CHECKING, Any

from ss2sql.language.cancellation import Check
from ss2sql.language.rows import (
    Table,
    check_area_cells,
    check_number,
    check_numbers,
    refuse_argument,
    request_hidden_columns,
)
from ss2sql.language.values import format_value
from ss2sql.vtables.contract import Element

if TYPE_CHECKING:
    from ss2sql.language.area_grid import Grid

AXES = {"XY": (0, 1), "XZ": (0, 2), "YZ": (1, 2)}
SPREAD_REACH = 3  # standard deviations at which the blur ends
MAX_BLUR = 10_000  # cells; no grid whose rows and columns are of one length has more than 4,000 of them in a row


@request_hidden_columns("elements")
def as_plane(table: Table, plane: Any, start: Any, size: Any, blur: Any = 0) -> Grid:
    """The values of the rows, added up in the cells of a grid, whose rows lie along the second axis.

    Args:
        table: the last column is what is added up, None counts nothing. The place is the first list of numbers or the
            first element of a world before it; where there is none, it is that of the element the columns read.
        plane: "XY", "XZ" or "YZ".
        start: the lower corner of the grid in this plane, in metres.
        size: the number of columns, the number of rows, and the edge of a cell in metres.
        blur: the standard deviation of a Gaussian, in cells, that values are spread with, at most 10,000. What is
            spread beyond the border is lost.
    """
    import numpy as np  # takes 50 ms to load, which only who asks for a plane pays

    from ss2sql.language.area_grid import Grid

    axes = AXES.get(plane.upper()) if isinstance(plane, str) else None
    if axes is None:
        refuse_argument("plane", f"needs a plane XY, XZ or YZ, not {format_value(plane)}")
    origin = check_numbers("plane", "the lower corner", start, 2)
    width, height, edge = check_numbers("plane", "width, height and resolution", size, 3)
    check_number("plane", "the edge of a cell", edge, above=0)
    columns, rows = (_count_plane_cells(cells, edge) for cells in (width, height))
    check_area_cells("plane", columns, rows)
    spread = check_number("plane", "a blur in cells", blur)
    if not 0 <= spread <= MAX_BLUR:
        refuse_argument("plane", f"needs a blur of 0 to {MAX_BLUR:,} cells, not {format_value(blur)}")
    points, values = _find_points(table, axes)
    with np.errstate(over="ignore"):
        places = np.floor((points - origin) / edge)
    inside = ((places >= 0) & (places < (columns, rows))).all(axis=1)
    at = places[inside].astype(np.int64)
    cells = (
        np.bincount(at[:, 1] * columns + at[:, 0], values[inside], columns * rows).astype(float).reshape(rows, columns)
    )
    cells = blur_grid_cells(cells, spread, table.check)
    if not np.isfinite(cells).all():
        refuse_argument(
            "plane", "has values that add up to more than a float holds", "divide them: SELECT pos, mass / 1000"
        )
    return Grid(cells, origin, edge)


def _count_plane_cells(cells: float, edge: float) -> int:
    if cells < 1 or cells != int(cells):
        count = ceil(cells / edge)
        hint = f"for {cells:g} m write {count}, the number of cells of {edge:g} m" if cells > 0 else "write 1 or more"
        refuse_argument("plane", f"needs width and height as whole numbers of cells, not {cells:g}", hint)
    return int(cells)


def _find_points(table: Table, axes: tuple[int, int]) -> tuple[Any, Any]:
    """Where the rows are in the plane, and their values."""
    import numpy as np

    points: list[tuple[float, float]] = []
    values: list[float] = []
    for index, row in enumerate(table.rows):
        value = row[-1]
        if value is None:
            continue
        if not isinstance(value, (bool, int, float)):
            hint = "the last column of SELECT has to be a number, such as mass or linearVelocity(this, 2)"
            refuse_argument(
                "plane", f"cannot add up {format_value(value)}, the '{table.columns[-1]}' of row {index + 1}", hint
            )
        values.append(float(value))
        points.append(_find_plane_point(table, index, axes))
    return np.array(points, dtype=float).reshape(-1, 2), np.array(values, dtype=float)


def _find_plane_point(table: Table, index: int, axes: tuple[int, int]) -> tuple[float, float]:
    """Where a row is: its first list or element, else the element that the columns read."""
    candidates = (*table.rows[index][:-1], *(table.hidden[index] if table.hidden else ()))
    place = next((value for value in candidates if isinstance(value, (list, Element))), None)
    if isinstance(place, Element):
        place = getattr(place, "pos", None)
    if not isinstance(place, (list, tuple)):
        hints = ("select it before the value: SELECT pos, mass", "or an element of a world: SELECT b.this, b.mass")
        refuse_argument("plane", f"does not know where row {index + 1} is", *hints)
    if len(place) not in (2, 3) or len(place) <= axes[1] or not all(type(part) in (int, float) for part in place):
        wanted = "[x, y] or [x, y, z]" if axes == (0, 1) else "[x, y, z]"
        hint = "the place is the first list in SELECT before the value: SELECT pos, mass"
        refuse_argument("plane", f"needs a place {wanted} in row {index + 1}, not {format_value(place)}", hint)
    return place[axes[0]], place[axes[1]]


def blur_grid_cells(cells: Any, spread: float, check: Check | None = None) -> Any:
    """The cells, each spread over its neighbours.

    Row by row and then column by column, since a Gaussian is a product: 38 additions of the whole grid for a spread
    of 3 cells, which take 0.3 ms for 100 x 100 cells. `check` is called after each of them.
    """
    import numpy as np

    reach = ceil(SPREAD_REACH * spread)
    if reach == 0:
        return cells
    with np.errstate(over="ignore"):
        weights = np.exp(-0.5 * (np.arange(-reach, reach + 1) / spread) ** 2)
    weights /= weights.sum()
    for _ in range(2):  # turned over each time, so that both axes have their turn
        total = np.zeros_like(cells)
        farthest = min(reach, len(cells) - 1)
        for offset in range(-farthest, farthest + 1):
            target = slice(max(offset, 0), len(cells) + min(offset, 0))
            total[target] += weights[reach + offset] * cells[max(-offset, 0) : len(cells) - max(offset, 0)]
            if check is not None:
                check()
        cells = total.T
    return np.ascontiguousarray(cells)

"""`AS occupancygrid(z, cell, area)` and `AS sensorgrid(z, cell, area)`: what bodies occupy, what sensors see.

A cell is occupied where a body reaches into its square at the height z, beyond touching its edge, so a wall that is
thinner than the cells stays closed for path planning. The shape itself is tested, not its bounding box: Bullet tests
whether a thin plate of the size of the cell meets the body. Plates of 2 x 2, 4 x 4 ... cells come first: where they
meet nothing, their cells are free.

A sensor sees a cell if the middle of the cell, at the height z, is within its range and its angle, and if nothing
stands between the two: no body of the world, selected or not, except the sensor's own. A middle on a surface, such as
the floor, is seen.
"""

from __future__ import annotations

from math import ceil, dist
from typing import TYPE_CHECKING, Any

import numpy as np

from ss2sql.language.area_arguments import check_area_cells, check_number, check_numbers, refuse_argument
from ss2sql.language.area_grid import Grid
from ss2sql.language.cancellation import ITEMS_PER_CHECK, Check
from ss2sql.language.rows import Table
from ss2sql.language.values import format_value
from ss2sql.vtables.contract import Element
from ss2sql.vtables.pybullet.bodies import measure_box
from ss2sql.vtables.pybullet.client import Box, unite_boxes
from ss2sql.vtables.pybullet.collision import ShapeCache, are_in_cone, find_first_hits

if TYPE_CHECKING:
    pass


FAR = 1000.0  # metres: bodies with larger boxes, such as endless planes, do not extend an area


def list_selected_bodies(world: Any, form: str, table: Table) -> list[int]:
    """The ids of the selected bodies, each once, in the order of the rows.

    They are the elements in the columns of SELECT; where there are none, those of the first source.
    """
    selected = [value for row in table.rows for value in row if isinstance(value, Element)]
    selected = selected or [value for row in table.hidden for value in row if isinstance(value, Element)]
    if table.rows and not selected:
        refuse_argument(form, "finds no bodies in these rows", "select them: SELECT obj FROM the world")
    for element in selected:
        if element.world.source is not world.source:
            refuse_argument(
                form, f"cannot mix worlds: {element!r} belongs to another one", "ask for the bodies of one world"
            )
    world.check()
    found = dict.fromkeys(world.find_body(element.key) for element in selected)
    return list(found)


def find_selected_world(world: Any, table: Table) -> Any:
    """The world that the selected elements belong to; `world` where there are none."""
    values = (value for rows in (table.rows, table.hidden) for row in rows for value in row)
    return next((value.world for value in values if isinstance(value, Element)), world)


def resolve_area(world: Any, form: str, cell: Any, area: Any) -> tuple[list[float], float, int, int]:
    """The lower corner of a grid, the edge of its cells, its columns and its rows.

    Without an area it is that of the scene, else the box around all bodies of the world. It may extend one cell more.
    """
    edge = check_number(form, "the edge of a cell", cell, above=0)
    if area is None:
        low, high = (list(corner[:2]) for corner in measure_bounds(world))
    else:
        if not isinstance(area, list) or len(area) != 2:
            refuse_argument(form, f"needs an area [[x, y], [x, y]], not {format_value(area)}")
        low, high = (check_numbers(form, "an area [[x, y], [x, y]]", corner, 2) for corner in area)
        if low[0] >= high[0] or low[1] >= high[1]:
            refuse_argument(form, f"needs the lower corner of the area first, unlike {format_value(area)}")
    counts = [(high[axis] - low[axis]) / edge for axis in (0, 1)]
    check_area_cells(form, *counts)
    columns, rows = (ceil(count - 1e-9) for count in counts)
    return low, edge, columns, rows


def measure_bounds(world: Any) -> Box:
    """The lowest and the highest corner of a scene; for other clients those of all bodies."""
    known: Box | None = getattr(world.scene, "bounds", None)
    if known is not None:
        return known
    boxes = [measure_box(world, body) for body in world.list_ids()]
    boxes = [box for box in boxes if dist(*box) < FAR]
    return unite_boxes(boxes) if boxes else ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


GAP = 1e-3  # parts of a cell by which plates are smaller than cells, so that touching a cell is not occupying it
THIN = 1e-3  # the thickness of plates, in parts of their edge
PLATES_PER_CHECK = 64  # plates tested between two checks of whether the run has to end; each takes 3 to 100 us

Ranges = tuple[range, range]  # of columns and of rows


def make_occupancy_grid(world: Any, table: Table, z: Any, cell: Any, area: Any) -> Grid:
    world = find_selected_world(world, table)
    bodies = list_selected_bodies(world, "occupancygrid", table)
    height = check_number("occupancygrid", "the height z", z)
    origin, edge, columns, rows = resolve_area(world, "occupancygrid", cell, area)
    grid = Grid(np.zeros((rows, columns), dtype=bool), origin, edge)
    for body in bodies:
        low, high = measure_box(world, body)
        if low[2] - edge <= height <= high[2] + edge:
            ranges = _find_covered_cells((low, high), origin, edge, columns, rows)
            _mark_occupied_cells(world, grid, body, height, ranges, table.check)
    return grid


def _mark_occupied_cells(
    world: Any, grid: Grid, body: int, height: float, ranges: Ranges, check: Check | None
) -> None:  # fmt: skip
    """Marks the cells that a body occupies, from the largest plate, over the cells in these ranges, to single cells.

    Where a plate meets nothing its cells are free: an endless floor below the plates takes a few of them.
    """
    covered, across = ranges
    cells, (x, y), edge = np.asarray(grid), grid.origin, grid.cell
    level = max(len(covered), len(across)).bit_length()
    plates = _make_grid_plates(world, edge, level + 1)
    closest = world.calls.getClosestPoints
    waiting = [(level, covered.start, across.start)]
    tested = 0
    while waiting:
        level, column, row = waiting.pop()
        if column not in covered or row not in across or (level == 0 and cells[row, column]):
            continue
        tested += 1
        if check is not None and tested % PLATES_PER_CHECK == 0:
            check()
        size = 2**level
        middle = (x + (column + size / 2) * edge, y + (row + size / 2) * edge, height)
        plate = plates[level]
        if not closest(bodyA=-1, bodyB=body, distance=0.0, collisionShapeA=plate, collisionShapePositionA=middle):
            continue
        if level == 0:
            cells[row, column] = True
            continue
        half = size // 2
        waiting += [(level - 1, column + a, row + b) for a in (0, half) for b in (0, half)]


def _make_grid_plates(world: Any, edge: float, count: int) -> list[int]:
    """The shapes of plates of 1, 2, 4 ... cells along their edges, made once for each size."""
    stock: ShapeCache = world.__dict__.setdefault("plates", ShapeCache(world.calls))
    stock.clear_after_reset()
    sizes = [((side - GAP) * edge, (side - GAP) * edge, THIN * side * edge) for side in (2**n for n in range(count))]
    return [stock.get_shape(-1, -1, 0, (-1, -1, world.calls.GEOM_BOX, size, b"")) for size in sizes]


def _find_covered_cells(box: Box, origin: list[float], edge: float, columns: int, rows: int) -> Ranges:
    """The columns and rows that the box around a body covers."""
    (x1, y1, _), (x2, y2, _) = box
    ranges = []
    for low, high, start, count in ((x1, x2, origin[0], columns), (y1, y2, origin[1], rows)):
        first, last = (low - start) / edge - GAP, (high - start) / edge + GAP
        ranges.append(range(int(max(0.0, min(first, count))), int(max(0.0, min(last + 1, count)))))
    covered, across = ranges
    return covered, across


# --- `AS sensorgrid(z, cell, area)`, also `sensormap`: how many of the selected sensors see each cell
NEAR = 1e-4  # metres before the end of a ray where a hit counts as the surface that was aimed at


def make_sensor_grid(world: Any, table: Table, z: Any, cell: Any, area: Any) -> Grid:
    world = find_selected_world(world, table)
    bodies = list_selected_bodies(world, "sensorgrid", table)
    for body in bodies:
        if body not in world.sensors:
            refuse_argument(
                "sensorgrid", f"was given '{world.name_of(body)}', which is no sensor", "add WHERE isSensor(this)"
            )
    height = check_number("sensorgrid", "the height z", z)
    origin, edge, columns, rows = resolve_area(world, "sensorgrid", cell, area)
    grid = Grid(np.zeros((rows, columns), dtype=np.int64), origin, edge)
    xs, ys = grid.centres()
    seen = np.asarray(grid).reshape(-1)
    for first in range(0, len(seen), ITEMS_PER_CHECK):
        places = np.arange(first, min(first + ITEMS_PER_CHECK, len(seen)))
        points = np.stack([xs[places % columns], ys[places // columns], np.full(len(places), height)], axis=1)
        for body in bodies:
            if table.check is not None:
                table.check()
            sensor = world.sensors[body]
            selected = np.flatnonzero(are_in_cone(sensor, points))
            seen[first + selected[_find_cells_sensor_sees(world, body, sensor, points[selected])]] += 1
    return grid


def _find_cells_sensor_sees(world: Any, body: int, sensor: Any, ends: Any) -> Any:
    """For each point whether a ray from the sensor reaches it."""
    hits, fractions = find_first_hits(world, body, sensor.position, ends)
    lengths = np.linalg.norm(ends - np.asarray(sensor.position, dtype=float), axis=1)
    return (hits < 0) | ((1 - fractions) * lengths <= NEAR)

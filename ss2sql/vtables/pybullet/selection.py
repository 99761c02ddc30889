"""The selected bodies and the area of a representation."""

from __future__ import annotations

from math import ceil, dist
from typing import Any

from ss2sql.language.area_arguments import check_cells, check_number, check_numbers, refuse_argument
from ss2sql.language.representation_table import Table
from ss2sql.language.values import format_value
from ss2sql.vtables.contract import Element
from ss2sql.vtables.pybullet.bodies import measure_box
from ss2sql.vtables.pybullet.poses import Box, unite_boxes

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
    check_cells(form, *counts)
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

"""`AS sensorgrid(z, cell, area)`, also `sensormap`: how many of the selected sensors see each cell.

A sensor sees a cell if the middle of the cell, at the height z, is within its range and its angle, and if nothing
stands between the two: no body of the world, selected or not, except the sensor's own. A middle on a surface, such as
the floor, is seen.
"""

from __future__ import annotations

from math import cos, hypot, radians
from typing import Any

import numpy as np

from ss2sql.language.area_arguments import check_number, refuse_argument
from ss2sql.language.area_grid import Grid
from ss2sql.language.representation_table import Table
from ss2sql.vtables.pybullet.contact_tables import MOST_RAYS
from ss2sql.vtables.pybullet.selection import list_selected_bodies, resolve_area

NEAR = 1e-4  # metres before the end of a ray where a hit counts as the surface that was aimed at
BEHIND = 1e-4  # metres after the surface of the sensor's own body where a ray continues: it misses shapes it starts in
LAYERS = 16  # of its own body that a ray passes at most


def make_sensor_grid(world: Any, table: Table, z: Any, cell: Any, area: Any) -> Grid:
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
    points = np.stack([*(axis.ravel() for axis in np.meshgrid(xs, ys)), np.full(rows * columns, height)], axis=1)
    seen = np.asarray(grid).reshape(-1)
    for body in bodies:
        sensor = world.sensors[body]
        selected = np.flatnonzero(_is_in_cone(sensor, points))
        seen[selected[_find_visible(world, body, sensor, points[selected])]] += 1
    return grid


def _is_in_cone(sensor: Any, points: Any) -> Any:
    away = points - np.asarray(sensor.position, dtype=float)
    distance = np.linalg.norm(away, axis=1)
    direction = np.asarray(sensor.direction, dtype=float) / hypot(*sensor.direction)
    return (distance <= sensor.range) & (away @ direction >= distance * cos(radians(sensor.angle / 2)))


def _find_visible(world: Any, body: int, sensor: Any, ends: Any) -> Any:
    """For each point whether a ray from the sensor reaches it."""
    found = np.zeros(len(ends), dtype=bool)
    starts = np.broadcast_to(np.asarray(sensor.position, dtype=float), ends.shape).copy()
    waiting = np.arange(len(ends))
    for _ in range(LAYERS):
        hits, fractions = _cast_rays(world, starts[waiting], ends[waiting])
        directions = ends[waiting] - starts[waiting]
        lengths = np.linalg.norm(directions, axis=1)
        found[waiting] = (hits < 0) | ((1 - fractions) * lengths <= NEAR)
        own = (hits == body) & ~found[waiting]
        if not own.any():
            break
        on = (fractions[own] + BEHIND / lengths[own])[:, None]
        starts[waiting[own]] += directions[own] * on
        waiting = waiting[own]
    return found


def _cast_rays(world: Any, starts: Any, ends: Any) -> tuple[Any, Any]:
    """The first body on each ray, -1 for none, and the part of the ray before it. A ray takes 1 us."""
    hits = np.full(len(ends), -1)
    fractions = np.ones(len(ends))
    for first in range(0, len(ends), MOST_RAYS):
        part = slice(first, first + MOST_RAYS)
        for ray, hit in enumerate(world.calls.rayTestBatch(starts[part].tolist(), ends[part].tolist()), first):
            hits[ray], fractions[ray] = hit[0], hit[2]
    return hits, fractions

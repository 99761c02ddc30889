"""`AS sensorgrid(z, cell, area)`, also `sensormap`: how many of the selected sensors see each cell.

A sensor sees a cell if the middle of the cell, at the height z, is within its range and its angle, and if nothing
stands between the two: no body of the world, selected or not, except the sensor's own. A middle on a surface, such as
the floor, is seen.
"""

from __future__ import annotations

from math import cos, hypot, radians
from typing import Any

import numpy as np

from ss2sql.runtime.representations.arguments import number, refuse
from ss2sql.runtime.representations.base import Table
from ss2sql.runtime.representations.grid import Grid
from ss2sql.vtables.pybullet.pairs import MOST_RAYS
from ss2sql.vtables.pybullet.selected import area_of, bodies_in

NEAR = 1e-4  # metres before the end of a ray where a hit counts as the surface that was aimed at
BEHIND = 1e-4  # metres after the surface of the sensor's own body where a ray continues: it misses shapes it starts in
LAYERS = 16  # of its own body that a ray passes at most


def coverage(world: Any, table: Table, z: Any, cell: Any, area: Any) -> Grid:
    bodies = bodies_in(world, "sensorgrid", table)
    for body in bodies:
        if body not in world.sensors:
            refuse("sensorgrid", f"was given '{world.name_of(body)}', which is no sensor", "add WHERE isSensor(this)")
    height = number("sensorgrid", "the height z", z)
    origin, edge, columns, rows = area_of(world, "sensorgrid", cell, area)
    grid = Grid(np.zeros((rows, columns), dtype=np.int64), origin, edge)
    xs, ys = grid.centres()
    points = np.stack([*(axis.ravel() for axis in np.meshgrid(xs, ys)), np.full(rows * columns, height)], axis=1)
    seen = np.asarray(grid).reshape(-1)
    for body in bodies:
        sensor = world.sensors[body]
        chosen = np.flatnonzero(_in_cone(sensor, points))
        seen[chosen[_open(world, body, sensor, points[chosen])]] += 1
    return grid


def _in_cone(sensor: Any, points: Any) -> Any:
    away = points - np.asarray(sensor.position, dtype=float)
    distance = np.linalg.norm(away, axis=1)
    direction = np.asarray(sensor.direction, dtype=float) / hypot(*sensor.direction)
    return (distance <= sensor.range) & (away @ direction >= distance * cos(radians(sensor.angle / 2)))


def _open(world: Any, body: int, sensor: Any, ends: Any) -> Any:
    """For each point whether a ray from the sensor reaches it."""
    found = np.zeros(len(ends), dtype=bool)
    starts = np.broadcast_to(np.asarray(sensor.position, dtype=float), ends.shape).copy()
    waiting = np.arange(len(ends))
    for _ in range(LAYERS):
        hits, fractions = _cast(world, starts[waiting], ends[waiting])
        ways = ends[waiting] - starts[waiting]
        lengths = np.linalg.norm(ways, axis=1)
        found[waiting] = (hits < 0) | ((1 - fractions) * lengths <= NEAR)
        own = (hits == body) & ~found[waiting]
        if not own.any():
            break
        on = (fractions[own] + BEHIND / lengths[own])[:, None]
        starts[waiting[own]] += ways[own] * on
        waiting = waiting[own]
    return found


def _cast(world: Any, starts: Any, ends: Any) -> tuple[Any, Any]:
    """The first body on each ray, -1 for none, and the part of the ray before it. A ray takes 1 us."""
    hits = np.full(len(ends), -1)
    fractions = np.ones(len(ends))
    for first in range(0, len(ends), MOST_RAYS):
        part = slice(first, first + MOST_RAYS)
        for ray, hit in enumerate(world.calls.rayTestBatch(starts[part].tolist(), ends[part].tolist()), first):
            hits[ray], fractions[ray] = hit[0], hit[2]
    return hits, fractions

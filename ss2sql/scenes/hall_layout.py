"""The plan of the scene `hall`: a floor of 16 x 12 m with four rooms. Lengths are in metres, the origin is a corner.

Inner walls and the middles of doors have whole coordinates, so a robot that moves by half metres has to use the doors.
"""

from __future__ import annotations

from ss2sql.vtables.pybullet.solids import Colour, Vector

Spot = tuple[float, float]

WIDTH, DEPTH, HEIGHT, THICKNESS = 16.0, 12.0, 1.6, 0.2  # the last two those of walls
COLUMN_HEIGHT = 2.0

START: Spot = (4.0, 3.0)
TARGET: Spot = (10.0, 9.0)
PLACES: dict[str, Spot] = {
    "start": START, "target": TARGET, "store": (3.0, 10.0), "workshop": (14.0, 3.0), "gate": (6.0, 6.0),
}  # fmt: skip

WALLS: tuple[tuple[Spot, Spot], ...] = (
    ((0, 0), (16, 0)), ((0, 12), (16, 12)), ((0, 0), (0, 12)), ((16, 0), (16, 12)),
    ((0, 6), (5, 6)), ((7, 6), (12.3, 6)), ((13.7, 6), (16, 6)),  # doors at (6, 6), which is a gate, and at (13, 6)
    ((8, 6), (8, 8.3)), ((8, 9.7), (8, 12)),  # a door at (8, 9)
    ((11, 0), (11, 1.3)), ((11, 2.7), (11, 6)),  # a door at (11, 2)
)  # fmt: skip
COLUMNS: tuple[Spot, ...] = ((2.0, 4.6), (8.5, 4.5), (8.5, 1.5), (4.0, 8.5), (12.0, 9.5), (14.5, 8.0))
SHELVES: tuple[Spot, ...] = ((0.8, 0.8), (1.9, 0.8), (0.8, 11.2), (1.9, 11.2))
TABLES: tuple[Spot, ...] = ((7.1, 7.25), (14.6, 0.85), (10.0, 11.2))
MACHINES: tuple[tuple[Spot, Vector], ...] = (((14.6, 10.6), (1.8, 1.3, 1.4)), ((5.0, 10.9), (1.6, 1.0, 1.2)))
TANKS: tuple[Spot, ...] = ((12.4, 11.2), (15.2, 5.2))
CONVEYOR: tuple[Spot, Vector] = ((4.0, 4.5), (2.6, 0.5, 0.6))
CRATES = 13  # three of them on the conveyor, the others at random places
BARRELS = 4

# These paths stay free for every seed: the short one through two doors, and the long one round the other side.
WAYS: tuple[tuple[Spot, ...], ...] = (
    ((4, 3), (5, 3), (6, 4), (6, 8), (7, 9), (10, 9)),
    ((4, 3), (5, 3), (6, 2), (12, 2), (13, 3), (13, 7), (11, 9), (10, 9)),
    ((6, 6), (6, 9), (5, 10), (3, 10)),
    ((12, 2), (13, 3), (14, 3)),
)

# Sensors hang on walls: their places and where they look, and how far.
SENSORS: tuple[tuple[Vector, Vector, float], ...] = (
    ((0.2, 3.0, 1.4), (1.0, 0.0, -0.3), 5.0),
    ((10.8, 4.0, 1.4), (-1.0, 0.0, -0.3), 5.0),
    ((6.0, 11.8, 1.4), (0.0, -1.0, -0.3), 6.0),
    ((8.2, 7.0, 1.4), (1.0, 0.5, -0.3), 5.0),
    ((15.8, 7.0, 1.4), (-1.0, 0.3, -0.3), 5.0),
    ((13.0, 0.2, 1.4), (0.0, 1.0, -0.3), 6.0),
)
SENSOR_ANGLE = 70.0

FLOOR: Colour = (0.87, 0.87, 0.85)
WALL: Colour = (0.62, 0.71, 0.82)
COLUMN: Colour = (0.78, 0.8, 0.82)
MACHINE: Colour = (0.35, 0.6, 0.42)
TANK: Colour = (0.55, 0.75, 0.72)
BELT: Colour = (0.28, 0.3, 0.33)
BARREL: Colour = (0.2, 0.42, 0.7)
SENSOR: Colour = (0.85, 0.15, 0.2)
GOAL: Colour = (0.15, 0.7, 0.3)
WOOD: tuple[Colour, ...] = ((0.76, 0.58, 0.36), (0.68, 0.5, 0.3), (0.82, 0.66, 0.44), (0.6, 0.44, 0.27))

"""The scene `hall`: a factory floor with rooms, doors and obstacles, and a mobile robot that stands in it.

Inner walls and the middles of doors have whole coordinates, so a robot that moves by half metres has to use the doors.
"""

from __future__ import annotations

from itertools import pairwise
from math import dist, hypot, pi
from typing import Any, ClassVar

from ss2sql.errors import require_package
from ss2sql.package_data import find_package_file
from ss2sql.vtables.pybullet.client import import_pybullet
from ss2sql.vtables.pybullet.scene import Box, Colour, Cylinder, Scene, Sensor, Vector, View

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


ROBOT = "YouBot"
CLEARANCE = 0.45  # between the free paths and the nearest obstacle: half the diagonal of the robot is 0.35


class Hall(Scene):
    """A factory floor of 16 x 12 m; `places` names its points, `robot` is the id of the robot."""

    bounds = ((0.0, 0.0, 0.0), (WIDTH, DEPTH, HEIGHT))
    views: ClassVar[dict[str, View]] = {
        "south": View((8.0, -10.5, 24.0), (8.0, 5.5, 0.0), 28.4),
        "top": View((8.0, 6.0, 23.0), (8.0, 6.0, 0.0), 32.0, (0.0, 1.0, 0.0)),
        "start": View((0.6, -0.8, 5.2), (6.2, 5.4, 0.0), 55.0),
    }

    def __init__(self, seed: int, client: Any = None) -> None:
        super().__init__(seed, client)
        self.client.setGravity(0, 0, -9.81)
        self.client.setAdditionalSearchPath(require_package("pybullet_data", "sim", "a scene").getDataPath())
        self.places |= PLACES
        self._taken: list[tuple[Spot, float, float]] = []  # middle, half width, half depth
        self._build_walls()
        self._add_furniture()
        self._add_movable_bodies()
        self._add_sensors()
        self.robot = self._add_robot()

    def _build_walls(self) -> None:
        self.add("floor", Box(WIDTH, DEPTH, 0.1), (WIDTH / 2, DEPTH / 2, -0.05), FLOOR)
        self.outlines = [((x, 0.0, 0.0), (x, DEPTH, 0.0)) for x in range(1, int(WIDTH))]
        self.outlines += [((0.0, y, 0.0), (WIDTH, y, 0.0)) for y in range(1, int(DEPTH))]
        for (x1, y1), (x2, y2) in WALLS:
            # Walls along y end where those along x begin, so that no two surfaces coincide.
            shape = (x2 - x1 + THICKNESS, THICKNESS) if y1 == y2 else (THICKNESS, y2 - y1)
            self._add_box("wall", ((x1 + x2) / 2, (y1 + y2) / 2), (*shape, HEIGHT), WALL)
        for spot in COLUMNS:
            self._add_cylinder("column", spot, 0.2, COLUMN_HEIGHT, COLUMN)

    def _add_furniture(self) -> None:
        for spot in SHELVES:
            (shelf,) = self.client.loadSDF("kiva_shelf/model.sdf")
            self._place_body(shelf, "shelf", spot, (0.46, 0.44))
        for spot in TABLES:
            self._place_body(self.client.loadURDF("table/table.urdf", useFixedBase=True), "table", spot, (0.75, 0.5))
        for spot, size in MACHINES:
            self._add_box("machine", spot, size, MACHINE)
        for spot in TANKS:
            self._add_cylinder("tank", spot, 0.5, 1.5, TANK)

    def _add_movable_bodies(self) -> None:
        """Adds the movable bodies: crates on the conveyor, then crates and barrels at random places."""
        (x, y), (length, depth, height) = CONVEYOR
        self._add_box("conveyor", (x, y), (length, depth, height), BELT)
        for number in range(3):
            self._add_crate((x + (number - 1) * 0.85 + self.random.uniform(-0.1, 0.1), y), 0.35, height)
        for _ in range(CRATES - 3):
            size = self.random.uniform(0.5, 0.9)
            self._add_crate(self._find_spot(size * 0.71), size, 0.0)
        for _ in range(BARRELS):
            self._add_cylinder("barrel", self._find_spot(0.29), 0.29, 0.88, BARREL, 30.0)

    def _add_sensors(self) -> None:
        for position, direction, far in SENSORS:
            body = self.add(self.next_name("sensor"), Box(0.14, 0.14, 0.14), position, SENSOR)
            length = hypot(*direction)
            unit = (direction[0] / length, direction[1] / length, direction[2] / length)
            self.sensors[body] = Sensor(position, unit, far, SENSOR_ANGLE)

    def _add_robot(self) -> int:
        x, y = TARGET
        self.add("target", Cylinder(0.35, 0.02), (x, y, 0.01), GOAL, touchable=False)
        exact = import_pybullet().URDF_USE_IMPLICIT_CYLINDER  # otherwise Bullet turns cylinders into meshes
        robot = self.client.loadURDF(str(find_package_file("ss2sql.scenes", "youbot.urdf")), (*START, 0.0), flags=exact)
        return self.adopt(robot, ROBOT)

    def _add_crate(self, spot: Spot, size: float, height: float) -> None:
        turned = (0.0, 0.0, self.random.uniform(-pi / 12, pi / 12))
        colour = self.random.choice(WOOD)
        mass = 150.0 * size**3
        self.add(self.next_name("crate"), Box(size, size, size), (*spot, height + size / 2), colour, mass, turned)

    def _add_box(self, kind: str, spot: Spot, size: Vector, colour: Vector) -> None:
        self.add(self.next_name(kind), Box(*size), (*spot, size[2] / 2), colour)
        self._taken.append((spot, size[0] / 2, size[1] / 2))

    def _add_cylinder(
        self, kind: str, spot: Spot, radius: float, height: float, colour: Vector, mass: float = 0.0
    ) -> None:
        self.add(self.next_name(kind), Cylinder(radius, height), (*spot, height / 2), colour, mass)
        self._taken.append((spot, radius, radius))

    def _place_body(self, body: int, kind: str, spot: Spot, half: Spot) -> None:
        """Moves a body from a file to its place."""
        (_, _, z), turned = self.client.getBasePositionAndOrientation(body)
        self.client.resetBasePositionAndOrientation(body, (*spot, z), turned)
        self.adopt(body, self.next_name(kind))
        self._taken.append((spot, *half))

    def _find_spot(self, radius: float) -> Spot:
        """A random place for something of this radius, away from the free paths and everything else."""
        while True:
            x = self.random.uniform(radius + 0.2, WIDTH - radius - 0.2)
            y = self.random.uniform(radius + 0.2, DEPTH - radius - 0.2)
            if self._is_unoccupied((x, y), radius):
                self._taken.append(((x, y), radius, radius))
                return x, y

    def _is_unoccupied(self, spot: Spot, radius: float) -> bool:
        for (x, y), width, depth in self._taken:
            if abs(spot[0] - x) < radius + width + 0.05 and abs(spot[1] - y) < radius + depth + 0.05:
                return False
        legs = [leg for path in WAYS for leg in pairwise(path)]
        return all(_measure_hall_distance(spot, *leg) > radius + CLEARANCE for leg in legs)


def _measure_hall_distance(spot: Spot, start: Spot, end: Spot) -> float:
    """From a point to a straight line between two others."""
    (x, y), (x1, y1), (x2, y2) = spot, start, end
    along = ((x - x1) * (x2 - x1) + (y - y1) * (y2 - y1)) / dist(start, end) ** 2
    along = max(0.0, min(1.0, along))
    return dist(spot, (x1 + along * (x2 - x1), y1 + along * (y2 - y1)))


def hall(seed: int = 0, client: Any = None) -> Hall:
    """A factory floor with four rooms, doors, obstacles, sensors and the robot `YouBot`.

    The seed moves crates and barrels; a path from `places["start"]` to `places["target"]` always stays free. It builds
    in a simulation of its own, or in `client`, which it empties.
    """
    return Hall(seed, client)

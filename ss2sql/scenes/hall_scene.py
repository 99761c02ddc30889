"""The scene `hall`: a factory floor with rooms, doors and obstacles, and a mobile robot that stands in it."""

from __future__ import annotations

from itertools import pairwise
from math import dist, hypot, pi
from typing import Any, ClassVar

from ss2sql.package_data import find_file
from ss2sql.scenes import hall_layout
from ss2sql.scenes.hall_layout import Spot
from ss2sql.vtables.pybullet.pybullet_loader import import_pybullet, require_sim_package
from ss2sql.vtables.pybullet.scene import Scene, Sensor, View
from ss2sql.vtables.pybullet.solids import Box, Cylinder, Vector

ROBOT = "YouBot"
CLEARANCE = 0.45  # between the free paths and the nearest obstacle: half the diagonal of the robot is 0.35


class Hall(Scene):
    """A factory floor of 16 x 12 m; `places` names its points, `robot` is the id of the robot."""

    bounds = ((0.0, 0.0, 0.0), (hall_layout.WIDTH, hall_layout.DEPTH, hall_layout.HEIGHT))
    views: ClassVar[dict[str, View]] = {
        "south": View((8.0, -10.5, 24.0), (8.0, 5.5, 0.0), 28.4),
        "top": View((8.0, 6.0, 23.0), (8.0, 6.0, 0.0), 32.0, (0.0, 1.0, 0.0)),
        "start": View((0.6, -0.8, 5.2), (6.2, 5.4, 0.0), 55.0),
    }

    def __init__(self, seed: int, client: Any = None) -> None:
        super().__init__(seed, client)
        self.client.setGravity(0, 0, -9.81)
        self.client.setAdditionalSearchPath(require_sim_package("pybullet_data").getDataPath())
        self.places |= hall_layout.PLACES
        self._taken: list[tuple[Spot, float, float]] = []  # middle, half width, half depth
        self._build_walls()
        self._add_furniture()
        self._add_movable_bodies()
        self._add_sensors()
        self.robot = self._add_robot()

    def _build_walls(self) -> None:
        self.add(
            "floor",
            Box(hall_layout.WIDTH, hall_layout.DEPTH, 0.1),
            (hall_layout.WIDTH / 2, hall_layout.DEPTH / 2, -0.05),
            hall_layout.FLOOR,
        )
        self.outlines = [((x, 0.0, 0.0), (x, hall_layout.DEPTH, 0.0)) for x in range(1, int(hall_layout.WIDTH))]
        self.outlines += [((0.0, y, 0.0), (hall_layout.WIDTH, y, 0.0)) for y in range(1, int(hall_layout.DEPTH))]
        for (x1, y1), (x2, y2) in hall_layout.WALLS:
            # Walls along y end where those along x begin, so that no two surfaces coincide.
            shape = (
                (x2 - x1 + hall_layout.THICKNESS, hall_layout.THICKNESS)
                if y1 == y2
                else (hall_layout.THICKNESS, y2 - y1)
            )
            self._add_box("wall", ((x1 + x2) / 2, (y1 + y2) / 2), (*shape, hall_layout.HEIGHT), hall_layout.WALL)
        for spot in hall_layout.COLUMNS:
            self._add_cylinder("column", spot, 0.2, hall_layout.COLUMN_HEIGHT, hall_layout.COLUMN)

    def _add_furniture(self) -> None:
        for spot in hall_layout.SHELVES:
            (shelf,) = self.client.loadSDF("kiva_shelf/model.sdf")
            self._place_body(shelf, "shelf", spot, (0.46, 0.44))
        for spot in hall_layout.TABLES:
            self._place_body(self.client.loadURDF("table/table.urdf", useFixedBase=True), "table", spot, (0.75, 0.5))
        for spot, size in hall_layout.MACHINES:
            self._add_box("machine", spot, size, hall_layout.MACHINE)
        for spot in hall_layout.TANKS:
            self._add_cylinder("tank", spot, 0.5, 1.5, hall_layout.TANK)

    def _add_movable_bodies(self) -> None:
        """Adds the movable bodies: crates on the conveyor, then crates and barrels at random places."""
        (x, y), (length, depth, height) = hall_layout.CONVEYOR
        self._add_box("conveyor", (x, y), (length, depth, height), hall_layout.BELT)
        for number in range(3):
            self._add_crate((x + (number - 1) * 0.85 + self.random.uniform(-0.1, 0.1), y), 0.35, height)
        for _ in range(hall_layout.CRATES - 3):
            size = self.random.uniform(0.5, 0.9)
            self._add_crate(self._find_spot(size * 0.71), size, 0.0)
        for _ in range(hall_layout.BARRELS):
            self._add_cylinder("barrel", self._find_spot(0.29), 0.29, 0.88, hall_layout.BARREL, 30.0)

    def _add_sensors(self) -> None:
        for position, direction, far in hall_layout.SENSORS:
            body = self.add(self.next_name("sensor"), Box(0.14, 0.14, 0.14), position, hall_layout.SENSOR)
            length = hypot(*direction)
            unit = (direction[0] / length, direction[1] / length, direction[2] / length)
            self.sensors[body] = Sensor(position, unit, far, hall_layout.SENSOR_ANGLE)

    def _add_robot(self) -> int:
        x, y = hall_layout.TARGET
        self.add("target", Cylinder(0.35, 0.02), (x, y, 0.01), hall_layout.GOAL, touchable=False)
        exact = import_pybullet().URDF_USE_IMPLICIT_CYLINDER  # otherwise Bullet turns cylinders into meshes
        robot = self.client.loadURDF(
            str(find_file("ss2sql.scenes", "youbot.urdf")), (*hall_layout.START, 0.0), flags=exact
        )
        return self.adopt(robot, ROBOT)

    def _add_crate(self, spot: Spot, size: float, height: float) -> None:
        turned = (0.0, 0.0, self.random.uniform(-pi / 12, pi / 12))
        colour = self.random.choice(hall_layout.WOOD)
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
            x = self.random.uniform(radius + 0.2, hall_layout.WIDTH - radius - 0.2)
            y = self.random.uniform(radius + 0.2, hall_layout.DEPTH - radius - 0.2)
            if self._is_unoccupied((x, y), radius):
                self._taken.append(((x, y), radius, radius))
                return x, y

    def _is_unoccupied(self, spot: Spot, radius: float) -> bool:
        for (x, y), width, depth in self._taken:
            if abs(spot[0] - x) < radius + width + 0.05 and abs(spot[1] - y) < radius + depth + 0.05:
                return False
        legs = [leg for path in hall_layout.WAYS for leg in pairwise(path)]
        return all(_measure_distance(spot, *leg) > radius + CLEARANCE for leg in legs)


def _measure_distance(spot: Spot, start: Spot, end: Spot) -> float:
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

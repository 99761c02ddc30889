"""The parts of a robot as shapes that can be tested at any pose without moving the robot."""

from __future__ import annotations

from collections.abc import Iterable
from math import dist
from random import random
from typing import Any, NamedTuple

from ss2sql.errors import ExecutionError
from ss2sql.vtables.pybullet.bodies import KINDS
from ss2sql.vtables.pybullet.bounding_boxes import (
    ShapeExtent,
    measure_corners_extent,
    measure_extent,
    measure_link_reach,
)
from ss2sql.vtables.pybullet.forward_kinematics import get_link_poses
from ss2sql.vtables.pybullet.poses import UPRIGHT, Box, Point, Pose, Rotation, compose, to_local, to_world, unite_boxes
from ss2sql.vtables.schema import world_error

ORIGIN: Point = (0.0, 0.0, 0.0)
MOST_TURNS = 1000  # cached orientations of one robot, each about 6 kB


class Part(NamedTuple):
    """A shape of a robot, where it is as seen from the robot's base, but turned as in the world, and its reach."""

    shape: int
    place: Point
    turn: Rotation
    reach: Point


class Robot:
    """The parts of a body for one orientation of its base, and the box around them relative to the base."""

    def __init__(self, turn: Rotation, parts: Iterable[tuple[int, ShapeExtent, Pose]]) -> None:
        self.turn = turn
        self._shapes = tuple(parts)
        self.parts = tuple(Part(shape, place, o, extent.measure_reach(o)) for shape, extent, (place, o) in self._shapes)
        self.box = unite_boxes([_make_reach_box(part.place, part.reach) for part in self.parts] or [(ORIGIN, ORIGIN)])
        self._turned: dict[Rotation, Robot] = {turn: self}

    def turn_base(self, turn: Rotation) -> Robot:
        """The same robot with another orientation of its base."""
        known = self._turned.get(turn)
        if known is None:
            if len(self._turned) >= MOST_TURNS:
                self._turned.clear()
            _, offset = to_local((ORIGIN, self.turn), (ORIGIN, UPRIGHT))
            more = ORIGIN, compose(turn, offset)  # from the one orientation to the other
            parts = [(shape, extent, to_world(more, pose)) for shape, extent, pose in self._shapes]
            known = self._turned[turn] = Robot(turn, parts)
        return known


def _make_reach_box(place: Point, reach: Point) -> Box:
    (x, y, z), (a, b, c) = place, reach
    return (x - a, y - b, z - c), (x + a, y + b, z + c)


class ShapeCache:
    """A cache of shapes in a simulator. Bullet keeps shapes until it is reset, so equal ones are made once.

    After a reset their numbers mean other shapes, or none. To detect that, the first one is a sphere of a random
    radius: as long as two of them have the right distance, all others are valid.
    """

    def __init__(self, calls: Any) -> None:
        self._calls = calls
        self._made: dict[Any, int] = {}
        self.extents: dict[int, ShapeExtent | None] = {}  # of each shape; None for files
        self._radius = 0.0
        self._sphere = -1

    def clear_after_reset(self) -> None:
        """Clears the cache if the simulation was reset."""
        if self._sphere >= 0 and self._is_valid():
            return
        self._made.clear()
        self.extents.clear()
        self._radius = 0.1 + random() / 10
        self._sphere = self._calls.createCollisionShape(self._calls.GEOM_SPHERE, radius=self._radius)

    def _is_valid(self) -> bool:
        try:
            found = self._calls.getClosestPoints(
                bodyA=-1, bodyB=-1, distance=1.0, collisionShapeA=self._sphere, collisionShapeB=self._sphere,
                collisionShapePositionA=(0.0, 0.0, 0.0), collisionShapePositionB=(1.0, 0.0, 0.0),
            )  # fmt: skip
        except self._calls.error:
            return False
        return bool(found) and abs(found[0][8] - (1 - 2 * self._radius)) < 1e-12

    def get_shape(self, body: int, link: int, number: int, data: Any) -> int:
        """The shape for a part of a body."""
        calls, (a, b, c), file = self._calls, data[3], data[4]
        kind = KINDS.get(data[2])
        key = (kind, a, b, c, file)
        known = self._made.get(key)
        if known is not None:
            return known
        make = calls.createCollisionShape
        match kind:
            case "sphere":
                made = make(calls.GEOM_SPHERE, radius=a)
            case "box":
                made = make(calls.GEOM_BOX, halfExtents=(a / 2, b / 2, c / 2))
            case "cylinder":
                made = make(calls.GEOM_CYLINDER, radius=b, height=a)
            case "capsule":
                made = make(calls.GEOM_CAPSULE, radius=b, height=a)
            case "mesh":
                return self._make_mesh(body, link, number, key)
            case _:
                raise _make_unmovable_error(body, f"it is a {kind or 'shape that PyBullet does not describe'}")
        return self._keep_shape(key, made, measure_extent(kind, data[3]))

    def _make_mesh(self, body: int, link: int, number: int, key: Any) -> int:
        calls, (_, *scale, file) = self._calls, key
        if file != b"unknown_file":
            made = calls.createCollisionShape(calls.GEOM_MESH, fileName=file.decode(), meshScale=scale)
            return self._keep_shape(key, made, None)
        _, corners = calls.getMeshData(body, link, collisionShapeIndex=number)  # as seen from the link
        if corners in self._made:
            return self._made[corners]
        made = calls.createCollisionShape(calls.GEOM_MESH, vertices=corners)
        return self._keep_shape(corners, made, measure_corners_extent(corners))

    def _keep_shape(self, key: Any, made: int, extent: ShapeExtent | None) -> int:
        if made < 0:
            raise world_error("PyBullet cannot make a shape", "see what it has written to the standard output")
        self._made[key] = made
        self.extents[made] = extent
        return made


def _make_unmovable_error(body: int, reason: str) -> ExecutionError:
    return world_error(f"bodies[{body}] cannot be tried at other places: {reason}")


def build_robot(world: Any, stock: ShapeCache, body: int) -> Robot:
    """The parts of a body, as it is now."""
    poses = get_link_poses(world, body)
    base = poses[-1]
    parts = []
    if world.shapes.is_soft(body):
        raise _make_unmovable_error(body, "it is soft")
    for link, number, data in world.shapes.read_shapes(body):
        pose = poses[link]
        if data[5] is None:
            raise _make_unmovable_error(body, f"PyBullet does not tell how the capsules of its link {link} lie")
        if data[4] != b"unknown_file":  # others consist of corners, which are relative to the link
            pose = to_world(pose, (data[5], data[6]))
        shape = stock.get_shape(body, link, number, data)
        extent = stock.extents[shape]
        if extent is None:
            reach = measure_link_reach(world, body, link, world.calls.getAABB(body, link))
            extent = ShapeExtent(ball=reach + dist(pose[0], poses[link][0]))
        place, turn = pose
        parts.append((shape, extent, (_subtract_points(place, base[0]), turn)))
    return Robot(base[1], parts)


def _subtract_points(point: Point, other: Point) -> Point:
    return point[0] - other[0], point[1] - other[1], point[2] - other[2]

"""The functions of bodies that PyBullet implements, and collision tests of a robot at any pose without moving it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import repeat
from math import cos, dist, hypot, radians
from typing import Any

import numpy as np

from ss2sql.vtables.body_functions import BodyWorld, Quaternion, Vector, make_parameter_error, read_numbers
from ss2sql.vtables.contract import Element, function
from ss2sql.vtables.pybullet.bodies import measure_box
from ss2sql.vtables.pybullet.links import read_link_pose
from ss2sql.vtables.pybullet.poses import Box
from ss2sql.vtables.pybullet.robot_parts import SLACK, Robot, ShapeCache, Surroundings, build_robot


class BodyFunctions(BodyWorld):
    """The functions of a PyBullet world. A body is given by its element, its id or its name."""

    calls: Any
    sensors: Mapping[int, Any]

    def list_ids(self) -> list[int]:
        """The ids of all bodies, in their order. PyBullet shuffles them when bodies die."""
        ask, places = self.calls.get_numbered_call("getBodyUniqueId"), range(self.calls.getNumBodies())
        return sorted(map(ask, places, repeat(self.calls.number)))

    def read_positions(self) -> tuple[list[int], Any]:
        ids, where = self.list_ids(), self.calls.getBasePositionAndOrientation
        return ids, np.array([where(body)[0] for body in ids], dtype=float).reshape(len(ids), 3)

    def find_point(self, value: Any) -> Sequence[float]:
        """A point, given by coordinates, by a body or by a link."""
        if isinstance(value, (list, Element)):
            return super().find_point(value)
        known = self.memory.get("places")  # in a query that moves nothing
        if known is not None and type(value) is int and value in known.at:
            return known.at[value]  # type: ignore[no-any-return]
        return read_link_pose(self, (self.find_body(value), value[1] if isinstance(value, tuple) else -1))[0]

    def find_box(self, name: str, value: Any) -> Any:
        """A box, given by two opposite corners, or by a body with a box around it."""
        if isinstance(value, (list, Element)):
            return super().find_box(name, value)
        found: Box = measure_box(self, self.find_body(value))
        return found

    def read_pose(self, body: int) -> Any:
        """Where a body is, and how it is turned; a tenth of the time that its columns take."""
        return self.calls.getBasePositionAndOrientation(body)

    def put_body(self, body: int, position: Vector, turn: Quaternion) -> None:
        """Moves a body to a pose, where it stands still: PyBullet forgets its velocity."""
        self.calls.resetBasePositionAndOrientation(body, position, turn)

    @function
    def isSensing(self, sensor: Any, body: Any) -> bool:  # noqa: N802 - the paper's word
        """Whether a sensor sees a body: the middle of one of its links is in range, in its cone, and not hidden."""
        eye = self.sensors.get(self.find_body(sensor))
        if eye is None:
            raise make_parameter_error("isSensing", "a sensor", sensor)
        wanted = self.find_body(body)
        for link in range(-1, self.calls.getNumJoints(wanted)):
            low, high = self.calls.getAABB(wanted, link)
            middle = tuple((a + b) / 2 for a, b in zip(low, high, strict=True))
            if _is_in_cone(eye, middle) and self._is_open(eye.position, middle, wanted):
                return True
        return False

    def _is_open(self, start: Any, end: Any, wanted: int) -> bool:
        hit = self.calls.rayTest(start, end)[0][0]
        return hit in (-1, wanted)  # -1: a body without a shape, or hollow there, is seen if nothing hides it


def _is_in_cone(eye: Any, point: Any) -> bool:
    away = dist(eye.position, point)
    if away > eye.range:
        return False
    if away == 0:
        return True
    size = hypot(*eye.direction)
    along = sum((p - e) * d for p, e, d in zip(point, eye.position, eye.direction, strict=True))
    return bool(along / away / size >= cos(radians(eye.angle / 2)))


# --- collision tests of a robot with everything else, at any pose, without moving anything
class CollisionFunctions(BodyFunctions):
    """The functions that test for collisions."""

    _shape_cache: ShapeCache | None = None

    @function
    def collision(self, one: Any, other: Any = None, margin: Any = 0.0) -> bool:
        """Whether a body would collide at a pose [x, y], [x, y, z] or seven numbers; nothing moves.

        A body in place of the pose: whether these two collide now. Nothing at all: whether it collides with any, now.
        Bodies collide where they come nearer than `margin`, in m: 0 counts what just touches, -0.001 lets it touch.
        """
        near = _check_margin("collision", margin)
        body = self.find_body(one)
        if other is None:
            return self.is_touching(body, near)
        if isinstance(other, list):
            return self.would_touch(body, *self.find_pose("collision", body, other), near)
        return self.do_touch(body, self.find_body(other), near)

    @function("volatile")
    def checkCollision(self, body: Any, margin: Any = 0.0) -> bool:  # noqa: N802 - the paper's word
        """Whether a body collides with any other where it is now, after all `move`s; `margin` as in `collision`."""
        return self.is_touching(self.find_body(body), _check_margin("checkCollision", margin))

    def measure_gap(self, one: int, other: int) -> float:
        """The shortest distance between the surfaces of two bodies."""
        points = self.calls.getClosestPoints(one, other, 1e6)
        return min((point[8] for point in points), default=float("inf"))

    def do_touch(self, one: int, other: int, margin: float = 0.0) -> bool:
        """Whether two bodies come nearer than a margin."""
        return one != other and bool(self.calls.getClosestPoints(one, other, margin))

    def is_touching(self, body: int, margin: float = 0.0) -> bool:
        """Whether a body comes nearer to any other than a margin."""
        around = self._get_surroundings()
        return any(self.do_touch(body, other[0], margin) for other in around.find_near(around.boxes[body], margin))

    def would_touch(self, body: int, position: Vector, turn: Quaternion, margin: float = 0.0) -> bool:
        """Whether a part of a body, put to a pose, comes nearer to any other body than a margin.

        Only bodies and parts with boxes near each other are tested. PyBullet's own search would miss bodies that the
        last step has moved.
        """
        closest = self.calls.getClosestPoints
        robot = self._get_robot(body).turn_base(turn)
        x, y, z = position
        (ax, ay, az), (bx, by, bz) = robot.box
        whole = (ax + x, ay + y, az + z), (bx + x, by + y, bz + z)
        others = [other for other in self._get_surroundings().find_near(whole, margin) if other[0] != body]
        if not others:
            return False
        far = max(margin, 0.0) + SLACK
        for shape, (px, py, pz), own, (a, b, c) in robot.parts:
            place = px, py, pz = px + x, py + y, pz + z
            a, b, c = a + far, b + far, c + far
            for other, ax, ay, az, bx, by, bz in others:
                if ax > px + a or px - a > bx or ay > py + b or py - b > by or az > pz + c or pz - c > bz:
                    continue
                if closest(
                    bodyA=-1, bodyB=other, distance=margin, collisionShapeA=shape, collisionShapePositionA=place,
                    collisionShapeOrientationA=own,
                ):  # fmt: skip
                    return True
        return False

    def _get_surroundings(self) -> Surroundings:
        known = self.memory
        if "surroundings" not in known:
            known["surroundings"] = Surroundings(self)
        return known["surroundings"]  # type: ignore[no-any-return]

    def _get_robot(self, body: int) -> Robot:
        known = self.memory.setdefault("robots", {})
        if body not in known:
            known[body] = build_robot(self, self._get_shape_cache(), body)
        return known[body]  # type: ignore[no-any-return]

    def _get_shape_cache(self) -> ShapeCache:
        if self._shape_cache is None:
            self._shape_cache = ShapeCache(self.calls)
        self._shape_cache.clear_after_reset()
        return self._shape_cache


def _check_margin(name: str, value: Any) -> float:
    found = read_numbers([value], 1)
    if found is None:
        raise make_parameter_error(name, "a margin in metres", value)
    return found[0]

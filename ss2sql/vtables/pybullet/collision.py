"""Collision tests of a robot with everything else, at any pose, without moving anything."""

from __future__ import annotations

from typing import Any

from ss2sql.vtables.body_columns import Quaternion, Vector
from ss2sql.vtables.body_functions import make_parameter_error, read_numbers
from ss2sql.vtables.contract import function
from ss2sql.vtables.pybullet.bounding_boxes import SLACK, Surroundings
from ss2sql.vtables.pybullet.bullet_functions import BodyFunctions
from ss2sql.vtables.pybullet.robot_parts import Robot, ShapeCache, build_robot


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

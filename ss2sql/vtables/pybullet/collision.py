"""Collisions of a robot with everything else, at any pose, without anything being moved."""

from __future__ import annotations

from typing import Any

from ss2sql.vtables.base import function
from ss2sql.vtables.bodies import Vector
from ss2sql.vtables.body_world import Quaternion, numbers, wrong
from ss2sql.vtables.pybullet.functions import Functions
from ss2sql.vtables.pybullet.parts import Stock, robot_of


class Collisions(Functions):
    """The functions that test for collisions."""

    _stock: Stock | None = None

    @function
    def collision(self, one: Any, other: Any = None, margin: Any = 0.0) -> bool:
        """Whether a body would collide at a pose [x, y], [x, y, z] or seven numbers; nothing moves.

        A body in place of the pose: whether these two collide now. Nothing at all: whether it collides with any, now.
        Bodies collide where they come nearer than `margin`, in m: 0 counts what just touches, -0.001 lets it touch.
        """
        near = _margin("collision", margin)
        body = self.body(one)
        if other is None:
            return self.touching(body, near)
        if isinstance(other, list):
            return self.would_touch(body, *self.place("collision", body, other), near)
        return self.meets(body, self.body(other), near)

    @function("volatile")
    def checkCollision(self, body: Any, margin: Any = 0.0) -> bool:  # noqa: N802 - the paper's word
        """Whether a body collides with any other where it is now, after all `move`s; `margin` as in `collision`."""
        return self.touching(self.body(body), _margin("checkCollision", margin))

    def gap(self, one: int, other: int) -> float:
        """The shortest way between the surfaces of two bodies."""
        points = self.calls.getClosestPoints(one, other, 1e6)
        return min((point[8] for point in points), default=float("inf"))

    def meets(self, one: int, other: int, margin: float = 0.0) -> bool:
        """Whether two bodies come nearer than a margin."""
        return one != other and bool(self.calls.getClosestPoints(one, other, margin))

    def touching(self, body: int, margin: float = 0.0) -> bool:
        """Whether a body comes nearer to any other than a margin."""
        return any(self.meets(body, other, margin) for other in self.ids())

    def would_touch(self, body: int, position: Vector, turn: Quaternion, margin: float = 0.0) -> bool:
        """Whether a part of a body, put to a pose, comes nearer to any other body than a margin.

        Most bodies are far away, which a sphere around the robot shows with one call each. PyBullet's own search for
        what is near would miss what the last step has moved.
        """
        closest = self.calls.getClosestPoints
        robot = robot_of(self, self._shapes(), body)
        parts = robot.at((position, turn))
        for other in self.ids():
            if other == body or not closest(
                bodyA=-1, bodyB=other, distance=max(margin, 0.0), collisionShapeA=robot.around,
                collisionShapePositionA=position,
            ):  # fmt: skip
                continue
            for shape, (place, own) in parts:
                if closest(
                    bodyA=-1, bodyB=other, distance=margin, collisionShapeA=shape, collisionShapePositionA=place,
                    collisionShapeOrientationA=own,
                ):  # fmt: skip
                    return True
        return False

    def _shapes(self) -> Stock:
        if self._stock is None:
            self._stock = Stock(self.calls)
        self._stock.check()
        return self._stock


def _margin(name: str, value: Any) -> float:
    found = numbers([value], 1)
    if found is None:
        raise wrong(name, "a margin in metres", value)
    return found[0]

"""Bounding boxes of bodies and shapes, which exclude distant ones from tests.

PyBullet's own boxes fit, but those of links are one step old, unlike the shapes that it collides with.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import hypot, sqrt
from typing import Any, NamedTuple

from ss2sql.vtables.pybullet.forward_kinematics import get_link_poses
from ss2sql.vtables.pybullet.links import read_link_pose
from ss2sql.vtables.pybullet.poses import Box, Point, Rotation, unite_boxes

SLACK = 1e-3  # metres: shapes made of corners reach this far beyond them


class ShapeExtent(NamedTuple):
    """How far a shape reaches from its middle: a box, to which a ball is added, and a disc that looks along z."""

    box: Point = (0.0, 0.0, 0.0)
    ball: float = 0.0
    disc: float = 0.0

    def measure_reach(self, turn: Rotation) -> Point:
        """Its reach along x, y and z when it is turned."""
        (a, b, c), ball, disc = self
        x, y, z, w = turn
        right, up, away = 2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)  # where the z axis looks
        return (
            ball
            + abs(1 - 2 * (y * y + z * z)) * a
            + abs(2 * (x * y - w * z)) * b
            + abs(right) * c
            + disc * sqrt(max(0.0, 1 - right * right)),
            ball
            + abs(2 * (x * y + w * z)) * a
            + abs(1 - 2 * (x * x + z * z)) * b
            + abs(up) * c
            + disc * sqrt(max(0.0, 1 - up * up)),
            ball
            + abs(2 * (x * z - w * y)) * a
            + abs(2 * (y * z + w * x)) * b
            + abs(away) * c
            + disc * sqrt(max(0.0, 1 - away * away)),
        )


def measure_extent(kind: str, size: Any) -> ShapeExtent:
    """The extent of a sphere, box, cylinder or capsule with PyBullet's measures."""
    a, b, c = size
    match kind:
        case "sphere":
            return ShapeExtent(ball=a)
        case "box":
            return ShapeExtent((a / 2, b / 2, c / 2))
        case "cylinder":
            return ShapeExtent((0.0, 0.0, a / 2), disc=b)
        case _:  # a capsule
            return ShapeExtent((0.0, 0.0, a / 2), ball=b)


def measure_corners_extent(corners: Iterable[Point]) -> ShapeExtent:
    """The extent of a mesh."""
    x, y, z = (max(map(abs, values)) for values in zip(*corners, strict=True))
    return ShapeExtent((x, y, z), ball=SLACK)


def measure_link_reach(world: Any, body: int, link: int, box: Box) -> float:
    """The radius of a sphere around all shapes of a link, whose middle is the link's centre of mass, by its box."""
    (x, y, z), _ = read_link_pose(world, (body, link))
    (ax, ay, az), (bx, by, bz) = box
    return hypot(max(x - ax, bx - x), max(y - ay, by - y), max(z - az, bz - z))


def measure_solid_box(world: Any, body: int) -> Box:
    """A box around all that PyBullet collides with: links by their joints, and links as it shows them."""
    calls = world.calls
    base: Box = calls.getAABB(body, -1)
    if not calls.getNumJoints(body):
        return base
    boxes = [base]
    for link, ((x, y, z), _) in get_link_poses(world, body).items():
        if link >= 0:
            box = calls.getAABB(body, link)
            boxes.append(box)
            reach = measure_link_reach(world, body, link, box)
            boxes.append(((x - reach, y - reach, z - reach), (x + reach, y + reach, z + reach)))
    return unite_boxes(boxes)


class Surroundings:
    """The boxes around all bodies at one moment. Finding those near a robot takes 3 us among 55 of them."""

    def __init__(self, world: Any) -> None:
        self.boxes = {body: measure_solid_box(world, body) for body in world.list_ids()}
        self._flat = [(body, *low, *high) for body, (low, high) in self.boxes.items()]

    def find_near(self, box: Box, margin: float) -> list[tuple[int, float, float, float, float, float, float]]:
        """The bodies whose boxes are closer to this one than a margin, each with its box."""
        far = max(margin, 0.0) + SLACK
        (ax, ay, az), (bx, by, bz) = box
        ax, ay, az, bx, by, bz = ax - far, ay - far, az - far, bx + far, by + far, bz + far
        return [
            one
            for one in self._flat
            if one[1] <= bx and ax <= one[4] and one[2] <= by and ay <= one[5] and one[3] <= bz and az <= one[6]
        ]

"""The collision shapes of links, read from PyBullet only where that is safe.

`getCollisionShapeData` takes a capsule that an MJCF file defines by its two ends (`fromto`) for another kind of shape,
reads foreign memory, and mostly crashes the process. No other function has this fault. So the capsules of these files
are taken from the visual shapes: MJCF uses the same shape for both, and attaches each link to a joint with a special
name. The collision shapes of a body of unknown origin are measured first.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from math import dist, sqrt
from typing import Any

from ss2sql.vtables.pybullet.bounding_boxes import ShapeExtent
from ss2sql.vtables.pybullet.links import SOFT, read_link_pose
from ss2sql.vtables.pybullet.poses import Point, to_local

CAPSULE = 7  # PyBullet's GEOM_CAPSULE
MJCF_JOINT = re.compile(rb"jointfix_\d+_\d+")  # PyBullet's joint for every link with shapes of an MJCF file
MARGIN = 0.04  # m, by which Bullet makes the box around a capsule of two ends larger, if it is a part of a shape
NEAR = 1e-4  # the tolerance of comparisons of boxes, as a part of the shape
BLIND = 1e-3  # a part of what directions add to a box; smaller parts are ignored
ORIGIN: Point = (0.0, 0.0, 0.0)

# A shape as from getCollisionShapeData, with two Nones for an unknown pose.
Shape = tuple[Any, ...]


class CollisionShapes:
    """The shapes of a world's bodies."""

    def __init__(self, world: Any) -> None:
        self._world, self._client = world, world.calls.number
        self._dynamics = world.calls.get_numbered_call("getDynamicsInfo")
        self._touched = world.calls.get_numbered_call("getCollisionShapeData")
        self._seen = world.calls.get_numbered_call("getVisualShapeData")

    def is_soft(self, body: int) -> bool:
        """Whether a body is soft, so that PyBullet knows little but its position."""
        return self._dynamics(body, -1, self._client)[10] == SOFT  # type: ignore[no-any-return]

    def read_shapes(self, body: int) -> list[tuple[int, int, Shape]]:
        """The collision shapes of a body: link, number within the link, and PyBullet's data; none for soft bodies.

        The data's own body and link are wrong from the second shape of a link on.
        """
        self._world.check_body(body)  # PyBullet writes warnings about bodies that are gone
        if self.is_soft(body):
            return []
        links = range(-1, self._world.calls.getNumJoints(body))
        seen = self._seen(body, 0, self._client)
        for shape in seen:
            if shape[2] == CAPSULE:
                return [(link, n, s) for link in links for n, s in enumerate(self._read_shapes(body, link, seen))]
        ask, client = self._touched, self._client
        return [(link, n, shape) for link in links for n, shape in enumerate(ask(body, link, client))]

    def read_link_shapes(self, body: int, link: int) -> Sequence[Shape]:
        """The collision shapes of one link."""
        self._world.check_body(body)
        return () if self.is_soft(body) else self._read_shapes(body, link, self._seen(body, 0, self._client))

    def _read_shapes(self, body: int, link: int, seen: Sequence[Shape]) -> Sequence[Shape]:
        visible = [shape for shape in seen if shape[1] == link]
        if _is_safe_to_read(self._world, body, link, visible):
            return self._touched(body, link, self._client)  # type: ignore[no-any-return]
        return [(*shape[:5], None, None) for shape in visible]


def _is_safe_to_read(world: Any, body: int, link: int, visible: Sequence[Shape]) -> bool:
    """Whether it is safe to read the collision shapes of a link with these visual shapes."""
    if not any(shape[2] == CAPSULE for shape in visible):
        return True
    if link >= 0 and not MJCF_JOINT.fullmatch(world.calls.getJointInfo(body, link)[1]):
        return True
    if len(visible) > 1:
        return False
    measured = _Measured(world, body, link, visible[0])
    return measured.is_plain() or (link < 0 and not measured.can_have_ends())


class _Measured:
    """A link with one visual capsule, and the box around its collision shapes."""

    def __init__(self, world: Any, body: int, link: int, capsule: Shape) -> None:
        calls = world.calls
        self.length, self.radius, _ = capsule[3]
        info = calls.getDynamicsInfo(body, link)
        self.margin = info[11]
        low, high = calls.getAABB(body, link)
        self.half = tuple((b - a) / 2 for a, b in zip(low, high, strict=True))
        at, self.turn = to_local((info[3], info[4]), (capsule[5], capsule[6]))  # as seen from the centre of mass
        self.own = read_link_pose(world, (body, link))[1]
        self.alone = dist(at, ORIGIN) < NEAR and abs(self.turn[3]) > 1 - NEAR**2  # else it is part of a compound shape
        self.near = NEAR * (self.length + self.radius + MARGIN)

    def is_plain(self) -> bool:
        """Whether its collision shape is this capsule alone, along its own z axis, without Bullet's margin."""
        margin = self.margin
        if self.alone:
            if abs(margin - self.radius) > self.near:
                return False
            margin = 0.0
        box = self._measure_half_edges((self.radius, self.radius, self.radius + self.length / 2))
        return all(abs(a + margin - b) < self.near for a, b in zip(box, self.half, strict=True))

    def can_have_ends(self) -> bool:
        """Whether its collision shape could be a capsule between two ends, of this length in any direction."""
        import numpy as np

        adds = np.transpose([self._measure_half_edges(axis) for axis in ((1, 0, 0), (0, 1, 0), (0, 0, 1))])
        sizes, (*_, blind) = np.linalg.svd(adds)[1:]
        single, near = sizes[2] > BLIND * sizes[0], self.near  # else the box is the same for many directions
        for inner, outer in ((self.margin, 0.0), (MARGIN, self.margin)):  # by itself, or put into another shape
            box = np.array(self.half) - outer - adds.sum(axis=1) * (self.radius + inner)  # around half its axis
            along = np.linalg.pinv(adds, rcond=BLIND) @ box
            if not single:
                near = 20 * self.near
                rest = sqrt(max(0.0, (self.length / 2) ** 2 - along @ along)) * blind
            for half in (along,) if single else (along + rest, along - rest):
                fits = np.abs(adds @ half - box).max() < near and half.min() > -near
                if fits and abs(np.linalg.norm(half) - self.length / 2) < 5 * near:
                    return True
        return False

    def _measure_half_edges(self, half: Point) -> Point:
        """Half the edges of the box around a box that is turned as the capsule is."""
        return ShapeExtent(ShapeExtent(half).measure_reach(self.turn)).measure_reach(self.own)

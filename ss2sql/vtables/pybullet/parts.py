"""The parts of a robot as shapes that can be tried at any place, without anything being moved."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil, dist, hypot, inf, log
from random import random
from typing import Any

from ss2sql.vtables.pybullet.bodies import KINDS, shapes_of
from ss2sql.vtables.pybullet.frames import Frame, inside, seen_from
from ss2sql.vtables.pybullet.links import frame_of
from ss2sql.vtables.pybullet.posture import posture
from ss2sql.vtables.schema import failure

GROWTH = 1.2  # the spheres around robots have radii that are powers of it, so that few are made


@dataclass(frozen=True, slots=True)
class Robot:
    """What a body consists of as it is now: shapes and their frames, and a sphere around them all."""

    base: Frame
    parts: tuple[tuple[int, Frame], ...]
    around: int

    def at(self, base: Frame) -> list[tuple[int, Frame]]:
        """The shapes as they would be with the base somewhere else."""
        (x, y, z), turn = base
        (ox, oy, oz), old = self.base
        if turn == old:
            x, y, z = x - ox, y - oy, z - oz
            return [(shape, ((px + x, py + y, pz + z), own)) for shape, ((px, py, pz), own) in self.parts]
        return [(shape, inside(base, seen_from(self.base, frame))) for shape, frame in self.parts]


class Stock:
    """Shapes that were made in a simulator. Bullet keeps them until it is reset, so equal ones are made once.

    A reset leaves numbers behind that mean other shapes, or none. So the first one is a sphere of a random radius: as
    long as two of them keep the right distance, all others are still what they were.
    """

    def __init__(self, calls: Any) -> None:
        self._calls = calls
        self._made: dict[Any, int] = {}
        self.reach: dict[int, float] = {}  # the radius of the sphere around a shape; inf for files
        self._radius = 0.0
        self._sphere = -1

    def check(self) -> None:
        """Begins anew where the simulation was reset."""
        if self._sphere >= 0 and self._is_valid():
            return
        self._made.clear()
        self.reach.clear()
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

    def sphere(self, radius: float) -> int:
        """A sphere that is at least as large."""
        larger = GROWTH ** ceil(log(max(radius, 1e-3), GROWTH))
        known = self._made.get(larger)
        if known is None:
            made = self._calls.createCollisionShape(self._calls.GEOM_SPHERE, radius=larger)
            return self._keep(larger, made, larger)
        return known

    def shape(self, body: int, link: int, number: int, data: Any) -> int:
        """A shape that is equal to a part of a body."""
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
                return self._mesh(body, link, number, key)
            case _:
                reason = f"it is a {kind or 'shape that PyBullet does not describe'}"
                raise failure(f"bodies[{body}] cannot be tried at other places: {reason}")
        return self._keep(key, made, _reach(kind, data[3]))

    def _mesh(self, body: int, link: int, number: int, key: Any) -> int:
        calls, (_, *scale, file) = self._calls, key
        if file != b"unknown_file":
            made = calls.createCollisionShape(calls.GEOM_MESH, fileName=file.decode(), meshScale=scale)
            return self._keep(key, made, inf)
        _, corners = calls.getMeshData(body, link, collisionShapeIndex=number)  # as seen from the link
        if corners in self._made:
            return self._made[corners]
        made = calls.createCollisionShape(calls.GEOM_MESH, vertices=corners)
        return self._keep(corners, made, max(map(hypot, *zip(*corners, strict=True))))

    def _keep(self, key: Any, made: int, reach: float) -> int:
        if made < 0:
            raise failure("PyBullet cannot make a shape", "see what it has written to the standard output")
        self._made[key] = made
        self.reach[made] = reach
        return made


def robot_of(world: Any, stock: Stock, body: int) -> Robot:
    """The parts of a body, as it is now."""
    base: Frame = world.calls.getBasePositionAndOrientation(body)
    frames = posture(world.calls, body, base)
    parts = []
    reach = 0.0
    for link, number, data in shapes_of(world, body):
        frame = frames[link]
        if data[4] != b"unknown_file":  # those are made of corners, which are given as the link sees them
            frame = inside(frame, (data[5], data[6]))
        shape = stock.shape(body, link, number, data)
        parts.append((shape, frame))
        around = stock.reach[shape]
        if around == inf:
            reach = max(reach, dist(base[0], frames[link][0]) + _reach_by_box(world, body, link))
        else:
            reach = max(reach, dist(base[0], frame[0]) + around)
    return Robot(base, tuple(parts), stock.sphere(reach))


def _reach(kind: str | None, size: Any) -> float:
    """The radius of the sphere around a shape."""
    a, b, c = size
    match kind:
        case "sphere":
            return float(a)
        case "box":
            return hypot(a, b, c) / 2
        case "cylinder":
            return hypot(a / 2, b)
        case _:  # a capsule
            return float(a / 2 + b)


def _reach_by_box(world: Any, body: int, link: int) -> float:
    """The same for all shapes of a link together, around its centre of mass, from where PyBullet shows it."""
    middle, _ = frame_of(world, (body, link))
    low, high = world.calls.getAABB(body, link)
    return hypot(*(max(m - a, b - m) for a, b, m in zip(low, high, middle, strict=True)))

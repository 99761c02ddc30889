"""Collision tests of a robot at any pose without moving it: its parts as shapes, and what PyBullet implements itself.

PyBullet's own boxes fit, but those of links are one step old, unlike the shapes that it collides with.

`getCollisionShapeData` takes a capsule that an MJCF file defines by its two ends (`fromto`) for another kind of shape,
reads foreign memory, and mostly crashes the process. No other function has this fault. So the capsules of these files
are taken from the visual shapes: MJCF uses the same shape for both, and attaches each link to a joint with a special
name. The collision shapes of a body of unknown origin are measured first.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from itertools import islice, repeat
from math import cos, dist, hypot, radians, sqrt
from random import random
from typing import Any, NamedTuple

import numpy as np

from ss2sql.errors import ExecutionError
from ss2sql.vtables.body_functions import BodyWorld, Quaternion, Vector, make_parameter_error
from ss2sql.vtables.contract import Element, function
from ss2sql.vtables.pybullet.bullet_tables import SOFT, has_untold_shape, measure_box, measure_link_box, read_link_pose
from ss2sql.vtables.pybullet.client import (
    UPRIGHT,
    Box,
    Point,
    Pose,
    Rotation,
    compose_pose_turns,
    convert_pose_to_local,
    convert_pose_to_world,
    get_link_poses,
    rotate_point,
    unite_boxes,
)
from ss2sql.vtables.pybullet.scene import KINDS, make_solid, measure_half_edges, read_bullet_shape, read_corners
from ss2sql.vtables.schema import world_error

SLACK = 1e-3  # metres: shapes made of corners reach this far beyond them


def turn_box(turn: Rotation, half: Point) -> Point:
    """Half the edges of the box around a turned box."""
    edges = [rotate_point(turn, edge) for edge in np.diag(half).tolist()]
    x, y, z = np.abs(edges).sum(axis=0).tolist()
    return x, y, z


def measure_link_reach(world: Any, body: int, link: int, box: Box) -> Point:
    """Half the edges of a cube around all shapes of a link, whose middle is its centre of mass, from the link's box."""
    (x, y, z), _ = read_link_pose(world, (body, link))
    (ax, ay, az), (bx, by, bz) = box
    radius = hypot(max(x - ax, bx - x), max(y - ay, by - y), max(z - az, bz - z))
    return radius, radius, radius


def measure_solid_box(world: Any, body: int) -> Box:
    """A box around all that PyBullet collides with: links by their joints, and links as it shows them."""
    calls = world.calls
    base: Box = calls.getAABB(body, -1)
    if not calls.getNumJoints(body):
        return base
    boxes = [base]
    for link, (place, _) in get_link_poses(world, body).items():
        if link >= 0:
            box = calls.getAABB(body, link)
            boxes.append(box)
            boxes.append(_make_collision_box(place, measure_link_reach(world, body, link, box)))
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


# --- the collision shapes of links, read from PyBullet only where that is safe
CAPSULE = 7  # PyBullet's GEOM_CAPSULE
MJCF_JOINT = re.compile(rb"jointfix_\d+_\d+")  # PyBullet's joint for every link with shapes of an MJCF file
MARGIN = 0.04  # m, by which Bullet makes the box around a capsule of two ends larger, if it is a part of a shape
NEAR = 1e-4  # the tolerance of comparisons of boxes, as a part of the shape
BLIND = 1e-3  # a part of what directions add to a box; smaller parts are ignored
ORIGIN: Point = (0.0, 0.0, 0.0)
NOWHERE: Box = (ORIGIN, ORIGIN)

# A shape as from getCollisionShapeData, with two Nones for an unknown pose.
Shape = tuple[Any, ...]


class CollisionShapes:
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
    measured = _MeasuredLink(world, body, link, visible[0])
    return measured.is_plain() or (link < 0 and not measured.can_have_ends())


class _MeasuredLink:
    """A link with one visual capsule, and the box around its collision shapes."""

    def __init__(self, world: Any, body: int, link: int, capsule: Shape) -> None:
        calls = world.calls
        self.length, self.radius, _ = capsule[3]
        info = calls.getDynamicsInfo(body, link)
        self.margin = info[11]
        low, high = calls.getAABB(body, link)
        self.half = tuple((b - a) / 2 for a, b in zip(low, high, strict=True))
        at, self.turn = convert_pose_to_local(
            (info[3], info[4]), (capsule[5], capsule[6])
        )  # as seen from the centre of mass
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
        return turn_box(self.own, turn_box(self.turn, half))


# --- the parts of a robot as shapes that can be tested at any pose without moving the robot
MOST_TURNS = 1000  # cached orientations of one robot, each about 6 kB


class Part(NamedTuple):
    """A shape of a robot, where it is as seen from the robot's base, but turned as in the world.

    `half` are half the edges of a box around it along its own axes, `reach` those along the axes of the world.
    """

    shape: int
    place: Point
    turn: Rotation
    half: Point
    reach: Point


def make_part(shape: int, pose: Pose, half: Point) -> Part:
    place, turn = pose
    return Part(shape, place, turn, half, turn_box(turn, half))


class Robot:
    """The parts of a body for one orientation of its base, and the box around them relative to the base."""

    def __init__(self, turn: Rotation, parts: Iterable[Part]) -> None:
        self.turn = turn
        self.parts = tuple(parts)
        self.box = unite_boxes([_make_collision_box(part.place, part.reach) for part in self.parts] or [NOWHERE])
        self._turned: dict[Rotation, Robot] = {turn: self}

    def turn_base(self, turn: Rotation) -> Robot:
        """The same robot with another orientation of its base."""
        known = self._turned.get(turn)
        if known is None:
            if len(self._turned) >= MOST_TURNS:
                self._turned.clear()
            _, offset = convert_pose_to_local((ORIGIN, self.turn), (ORIGIN, UPRIGHT))
            more = ORIGIN, compose_pose_turns(turn, offset)  # from the one orientation to the other
            turned = [convert_pose_to_world(more, (part.place, part.turn)) for part in self.parts]
            parts = zip(self.parts, turned, strict=True)
            known = self._turned[turn] = Robot(turn, [make_part(part.shape, pose, part.half) for part, pose in parts])
        return known


def _make_collision_box(place: Point, reach: Point) -> Box:
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
        self.halves: dict[int, Point | None] = {}  # half the edges of the box around each shape; None for files
        self._radius = 0.0
        self._sphere = -1

    def clear_after_reset(self) -> None:
        if self._sphere >= 0 and self._is_valid():
            return
        self._made.clear()
        self.halves.clear()
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
        kind, size, file = KINDS.get(data[2]), data[3], data[4]
        corners = read_corners(self._calls, body, link, number, data)
        key: Any = corners or (kind, *size, file)
        known = self._made.get(key)
        if known is not None:
            return known
        part = read_bullet_shape(data[2], size, file, corners)
        if part is None or kind is None or kind == "plane":
            raise _make_unmovable_error(body, f"it is a {kind or 'shape that PyBullet does not describe'}")
        made: int = self._calls.createCollisionShape(**part)
        if made < 0:
            raise world_error("PyBullet cannot make a shape", "see what it has written to the standard output")
        solid = make_solid(data[2], size)
        if solid is not None:
            self.halves[made] = measure_half_edges(solid)
        elif corners:
            x, y, z = (np.abs(corners).max(axis=0) + SLACK).tolist()
            self.halves[made] = x, y, z
        else:
            self.halves[made] = None
        self._made[key] = made
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
        if data[5] is None:
            raise _make_unmovable_error(body, f"PyBullet does not tell how the capsules of its link {link} lie")
        pose = convert_pose_to_world(poses[link], (data[5], data[6]))
        shape = stock.get_shape(body, link, number, data)
        half = stock.halves[shape]
        if half is None:
            away = dist(pose[0], poses[link][0])
            a, b, c = measure_link_reach(world, body, link, world.calls.getAABB(body, link))
            half = a + away, b + away, c + away
        (x, y, z), turn = pose
        parts.append(make_part(shape, ((x - base[0][0], y - base[0][1], z - base[0][2]), turn), half))
    if not parts and has_untold_shape(world, body):
        raise _make_unmovable_error(body, "it is a terrain, whose shape PyBullet does not tell")
    return Robot(base[1], parts)


class BulletFunctions(BodyWorld):
    """The functions of a PyBullet world. A body is given by its element, its id or its name."""

    calls: Any
    sensors: Mapping[int, Any]
    _shape_cache: ShapeCache | None = None

    def list_ids(self) -> list[int]:
        """The ids of all bodies, in their order. PyBullet shuffles them when bodies die."""
        ask, places = self.calls.get_numbered_call("getBodyUniqueId"), range(self.calls.getNumBodies())
        return sorted(map(ask, places, repeat(self.calls.number)))

    def read_positions(self) -> tuple[list[int], Any]:
        ids, where = self.list_ids(), self.calls.getBasePositionAndOrientation
        return ids, np.array([where(body)[0] for body in ids], dtype=float).reshape(len(ids), 3)

    def read_point(self, value: Any) -> Sequence[float]:
        """A point, given by coordinates, by a body or by a link."""
        if isinstance(value, (list, Element)):
            return super().read_point(value)
        return read_link_pose(self, (self.find_body(value), value[1] if isinstance(value, tuple) else -1))[0]

    def find_box(self, name: str, value: Any) -> Any:
        """A box, given by two opposite corners, or by a body or a link with a box around it."""
        if isinstance(value, tuple):
            return measure_link_box(self, (self.find_body(value), value[1]))
        return super().find_box(name, value)

    def measure_box(self, body: int) -> Box:
        return measure_box(self, body)  # PyBullet's own boxes are one step old

    def read_pose(self, body: int) -> Any:
        """Where a body is, and how it is turned; a tenth of the time that its columns take."""
        return self.calls.getBasePositionAndOrientation(body)

    def put_body(self, body: int, position: Vector, turn: Quaternion) -> None:
        """Moves a body to a pose, where it stands still: PyBullet forgets its velocity."""
        self.calls.resetBasePositionAndOrientation(body, position, turn)

    @function
    def isSensing(self, sensor: Any, body: Any) -> bool:  # noqa: N802 - the paper's word
        """Whether a sensor sees a body: the middle of one of its links is in range, in its cone, and not hidden.

        The body that the sensor is mounted on hides nothing.
        """
        given = self.find_body(sensor)
        eye = self.sensors.get(given)
        if eye is None:
            known = ", ".join(self.read_column(one, "name") for one in islice(self.sensors, 5))
            hint = f"sensors are {known}; isSensor tells them" if known else "no body of this world has a sensor"
            raise make_parameter_error("isSensing", "a sensor", self.read_column(given, "name")).with_hint(hint)
        wanted = self.find_body(body)
        for link in range(-1, self.calls.getNumJoints(wanted)):
            low, high = self.calls.getAABB(wanted, link)
            middle = tuple((a + b) / 2 for a, b in zip(low, high, strict=True))
            # -1: a body without a shape, or hollow there, is seen if nothing hides it.
            if are_in_cone(eye, [middle])[0] and find_first_hits(self, given, eye.position, [middle])[0] in (
                -1,
                wanted,
            ):
                return True
        return False

    # --- collision tests of a robot with everything else, at any pose, without moving anything

    def measure_gap(self, one: int, other: int) -> float:
        points = self.calls.getClosestPoints(one, other, 1e6)
        return min((point[8] for point in points), default=float("inf"))

    def do_touch(self, one: int, other: int, margin: float = 0.0) -> bool:
        return one != other and bool(self.calls.getClosestPoints(one, other, margin))

    def is_touching(self, body: int, margin: float = 0.0) -> bool:
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
        for shape, (px, py, pz), own, _, (a, b, c) in robot.parts:
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


def are_in_cone(sensor: Any, points: Any) -> Any:
    """Whether points are within the range and the angle of a sensor."""
    away = np.asarray(points, dtype=float) - np.asarray(sensor.position, dtype=float)
    distance = np.linalg.norm(away, axis=1)
    direction = np.asarray(sensor.direction, dtype=float) / hypot(*sensor.direction)
    return (distance <= sensor.range) & (away @ direction >= distance * cos(radians(sensor.angle / 2)))


def find_first_hits(world: Any, own: int, start: Sequence[float], ends: Any) -> tuple[Any, Any]:
    """The first body on each ray but the own one, -1 for none, and the part of the ray before it. A ray takes 1 us.

    Where the own body comes first, all hits of the ray are looked at: PyBullet gives them by number, in no order.
    """
    targets = np.asarray(ends, dtype=float)

    def cast_rays(rays: Any, **options: int) -> tuple[Any, Any]:
        found = world.calls.rayTestBatch([start] * len(rays), targets[rays].tolist(), **options)
        return np.array([hit[0] for hit in found], dtype=int), np.array([hit[2] for hit in found], dtype=float)

    bodies, fractions = cast_rays(np.arange(len(targets)))
    waiting, number = np.flatnonzero(bodies == own), 0
    bodies[waiting], fractions[waiting] = -1, 1.0
    while len(waiting):
        hit, before = cast_rays(waiting, reportHitNumber=number)
        first = (hit >= 0) & (hit != own) & (before < fractions[waiting])
        bodies[waiting[first]], fractions[waiting[first]] = hit[first], before[first]
        waiting, number = waiting[hit >= 0], number + 1
    return bodies, fractions

"""Joints, the shapes that links collide with, the cameras of a scene; contacts, what is near, what rays hit."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import dist
from typing import Any, ClassVar

import numpy as np

from ss2sql.language.cancellation import iterate_checked
from ss2sql.vtables.body_functions import PAIR, VECTOR, make_parameter_error, read_body_numbers
from ss2sql.vtables.contract import Column, Gone, Table, TableFunction, Where
from ss2sql.vtables.pybullet.bodies import KINDS, BodyPartTable, Key, get_volume, list_demanded_bodies, read_link_pose
from ss2sql.vtables.pybullet.client import convert_pose_to_world

TYPES = {0: "revolute", 1: "prismatic", 2: "spherical", 3: "planar", 4: "fixed"}  # PyBullet's JOINT_...


class BulletJoints(BodyPartTable):
    """One row for each joint. It moves the link that has its number."""

    name = "joints"
    text = "the joints of all bodies; a joint moves the link that has its number"
    columns = (
        Column("body", int, text="the id of its body", filter="="),
        Column("number", int, text="PyBullet's number of the joint, and of the link that it moves", filter="="),
        Column("name", str),
        Column("type", str, text="revolute, prismatic, spherical, planar or fixed"),
        Column("link", str, text="the name of the link that it moves"),
        Column("parent", int, text="the number of the link that it hangs on, -1 for the base"),
        Column("axis", VECTOR, text="around which it turns or along which it slides"),
        Column("lower", float | None, "rad or m", "how far it can go down; None without an end"),
        Column("upper", float | None, "rad or m", "how far it can go up; None without an end"),
        Column("maxForce", float, "Nm or N", "of its motor, by its file"),
        Column("maxVelocity", float, "rad/s or m/s", "by its file"),
        Column("damping", float),
        Column("friction", float),
        Column("angle", float, "rad or m", "how far it is turned, or slid"),
        Column("speed", float, "rad/s or m/s", "how fast it turns or slides"),
        Column("motor", float, "Nm or N", "what its motor did in the last step"),
    )
    groups: ClassVar[Mapping[str, str]] = {
        "read_numbers": "body number",
        "read_build": "name type link parent axis lower upper maxForce maxVelocity damping friction",
        "read_state": "angle speed motor",
    }

    def read_build(self, key: Key) -> tuple[Any, ...]:
        info = self.call_simulator(self.world.calls.getJointInfo, key)
        lower, upper = (info[8], info[9]) if info[8] <= info[9] else (None, None)  # upside down: no ends
        if info[2] in (0, 1) and lower == upper == 0.0:
            lower = upper = None
        name, link = info[1].decode(errors="replace"), info[12].decode(errors="replace")
        kind = TYPES.get(info[2], "other")
        return (name, kind, link, info[16], info[13], lower, upper, info[10], info[11], info[6], info[7])

    def read_state(self, key: Key) -> tuple[float, float, float]:
        angle, speed, _, motor = self.call_simulator(self.world.calls.getJointState, key)
        return angle, speed, motor


ShapeKey = tuple[int, int, int]


class BulletShapes(Table):
    """One row for each collision shape."""

    name = "shapes"
    text = "the collision shapes of all links; what can be seen may look otherwise"
    columns = (
        Column("body", int, text="the id of its body", filter="="),
        Column("link", int, text="the number of its link, -1 for the base"),
        Column("number", int, text="its number within the link"),
        Column("type", str, text="sphere box capsule cylinder plane mesh"),
        Column("radius", float | None, "m", "of spheres, capsules and cylinders"),
        Column("length", float | None, "m", "of capsules without their ends, and of cylinders"),
        Column("size", list | None, "m", "the edges of boxes along their own axes; of meshes the scale"),
        Column("normal", list | None, text="of planes"),
        Column("file", str | None, text="of meshes, where they were read from one"),
        Column("volume", float | None, "m3", "None for meshes and planes"),
        Column("pos", list | None, "m", "where it is; None where PyBullet does not tell it: see Limits"),
        Column("quat", list | None, text="how it is turned: a quaternion x, y, z, w; None where pos is"),
    )
    groups: ClassVar[Mapping[str, str]] = {
        "read_numbers": "body link number",
        "read_shape": "type radius length size normal file volume",
        "read_pose": "pos quat",
    }

    def keys(self, where: Where) -> list[ShapeKey]:
        world = self.world
        return [
            (body, link, n)
            for body in list_demanded_bodies(world, where)
            for link, n, _ in world.shapes.read_shapes(body)
        ]

    def read_numbers(self, key: ShapeKey) -> ShapeKey:
        self._get_shape(key)
        return key

    def read_shape(self, key: ShapeKey) -> tuple[Any, ...]:
        shape = self._get_shape(key)
        kind, (a, b, c), file = KINDS.get(shape[2], "mesh"), shape[3], shape[4].decode(errors="replace")
        radius = a if kind == "sphere" else b if kind in ("capsule", "cylinder") else None
        length = a if kind in ("capsule", "cylinder") else None
        size = [a, b, c] if kind in ("box", "mesh") else None
        normal = [a, b, c] if kind == "plane" else None
        return kind, radius, length, size, normal, file if file not in ("", "unknown_file") else None, get_volume(shape)

    def read_pose(self, key: ShapeKey) -> Any:
        shape = self._get_shape(key)
        if shape[5] is None:
            return None, None
        return convert_pose_to_world(read_link_pose(self.world, key[:2]), (shape[5], shape[6]))

    def _get_shape(self, key: ShapeKey) -> Any:
        found = self.world.shapes.read_link_shapes(key[0], key[1])
        if key[2] >= len(found):
            raise Gone("its body has other shapes now")
        return found[key[2]]


# --- the cameras of a scene, and what they see
WIDTH, HEIGHT = 160, 120  # pixels of the pictures that show which bodies are visible
NEAR, FAR = 0.05, 1000.0  # metres


class Cameras(Table):
    """One row for each view of a scene; a client by itself has none."""

    name, key = "cameras", "name"
    text = "the views of a scene; a client that belongs to none has no cameras"
    columns = (
        Column("name", str, filter="="),
        Column("eye", VECTOR, "m", "where it is"),
        Column("target", VECTOR, "m", "the point that it looks at"),
        Column("up", VECTOR, text="the direction that is up in its pictures"),
        Column("angle", float, "deg", "how much it sees, from bottom to top"),
        Column("sees", list, text="the ids of the bodies in its picture"),
    )
    groups: ClassVar[Mapping[str, str]] = {"read_view": "eye target up angle", "read_sensed": "sees"}

    def keys(self, where: Where) -> list[str]:
        return [name for name in self._get_views() if where.allows("name", name)]

    def read_view(self, key: str) -> tuple[Any, ...]:
        view = self._get_view(key)
        return view.eye, view.target, view.up, view.angle

    def read_sensed(self, key: str) -> list[int]:
        calls, view = self.world.calls, self._get_view(key)
        looking = calls.computeViewMatrix(view.eye, view.target, view.up)
        seeing = calls.computeProjectionMatrixFOV(view.angle, WIDTH / HEIGHT, NEAR, FAR)
        renderer = calls.ER_TINY_RENDERER
        *_, seen = calls.getCameraImage(WIDTH, HEIGHT, looking, seeing, renderer=renderer)
        return [int(body) for body in np.unique(np.asarray(seen)) if body >= 0]  # tuples where PyBullet lacks NumPy

    def _get_views(self) -> dict[str, Any]:
        return getattr(self.world.scene, "views", {})

    def _get_view(self, key: str) -> Any:
        if key not in self._get_views():
            raise Gone
        return self._get_views()[key]


# --- tables with parameters: what touches, what is near, what a ray hits
MOST_RAYS = 16_383  # in one call; from one more on PyBullet loses some

_PAIR = (
    *PAIR,
    Column("linkA", int, text="the number of the link of a, -1 for the base"),
    Column("linkB", int, text="the number of the link of b"),
    Column("pointA", VECTOR, "m", "the point on a"),
    Column("pointB", VECTOR, "m", "the point on b"),
    Column("normal", VECTOR, text="the direction from b to a"),
    Column("distance", float, "m", "between the surfaces; below 0 where they reach into each other"),
)


class BulletContacts(TableFunction):
    name = "contacts"
    text = "where bodies touched in the last step: all, those of body a, or those between a and b"
    columns = (*_PAIR, Column("normalForce", float, "N", "how strongly they press"))

    def rows(self, a: Any = None, b: Any = None) -> Iterator[tuple[Any, ...]]:
        world = self.world
        chosen = {name: world.find_body(body) for name, body in (("bodyA", a), ("bodyB", b)) if body is not None}
        for point in world.calls.getContactPoints(**chosen) or ():
            yield (*_make_contact_row(world, point), point[9])


class BulletClosest(TableFunction):
    name = "closest"
    text = "where links of a and b are nearest to each other, if they are within a distance; None stands for all bodies"
    columns = _PAIR

    def rows(self, a: Any, b: Any, distance: float) -> Iterator[tuple[Any, ...]]:
        world = self.world
        if read_body_numbers([distance], 1) is None:
            raise make_parameter_error("closest", "a distance in metres", distance)
        for one, other in world.iterate_pairs(a, b):
            for point in world.calls.getClosestPoints(one, other, distance) or ():
                yield _make_contact_row(world, point)


def _make_contact_row(world: Any, point: Any) -> tuple[Any, ...]:
    _, a, b, link_a, link_b, point_a, point_b, normal, distance, *_ = point
    return world.get_element(a), world.get_element(b), a, b, link_a, link_b, point_a, point_b, normal, distance


class Rays(TableFunction):
    name = "rays"
    text = "what rays hit first, between points or lists of points; a ray that hits nothing has no row"
    columns = (
        Column("ray", int, text="the number of the ray, from 0"),
        Column("body", object, text="what it hits"),
        Column("id", int, text="the id of the body"),
        Column("link", int, text="the number of the link, -1 for the base"),
        Column("pos", VECTOR, "m", "where it hits"),
        Column("normal", VECTOR, text="the direction in which the surface looks there"),
        Column("distance", float, "m", "from its start; rays from inside of a shape do not see this shape"),
    )

    def rows(self, start: Any, end: Any) -> Iterator[tuple[Any, ...]]:
        world = self.world
        starts, ends = _read_ray_points(world, start), _read_ray_points(world, end)
        if len(starts) != len(ends):
            if 1 not in (len(starts), len(ends)):
                raise make_parameter_error("rays", "as many starts as ends", f"{len(starts)} and {len(ends)}")
            starts, ends = starts * max(1, len(ends)), ends * max(1, len(starts))
        for first in range(0, len(starts), MOST_RAYS):
            part = slice(first, first + MOST_RAYS)
            for number, hit in enumerate(world.calls.rayTestBatch(starts[part], ends[part]), first):
                body, link, _, pos, normal = hit[:5]
                if body >= 0:
                    yield number, world.get_element(body), body, link, pos, normal, dist(starts[number], pos)


def _read_ray_points(world: Any, value: Any) -> list[tuple[float, ...]]:
    if isinstance(value, list) and (not value or isinstance(value[0], list)):
        return [_read_ray_point(point) for point in iterate_checked(value)]
    return [_read_ray_point(value if isinstance(value, list) else world.find_point(value))]


def _read_ray_point(value: Any) -> tuple[float, ...]:
    point = read_body_numbers(value, 3)
    if point is None:
        raise make_parameter_error("rays", "points [x, y, z]", value)
    return point

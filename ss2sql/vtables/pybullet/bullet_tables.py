"""The tables of PyBullet: bodies, the principal one, their links, joints and shapes; cameras, contacts, what rays hit.

PyBullet's own search, `getOverlappingObjects`, misses bodies: those without collision shapes, those with a centre
outside of their shape, and, until the next step, those that the last step moved. So positions are compared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import repeat
from math import dist
from typing import Any, ClassVar

import numpy as np

from ss2sql.language.cancellation import iterate_checked
from ss2sql.vtables.body_functions import (
    FAR,
    PAIR,
    PLACES,
    SHAPE,
    SPIN,
    VECTOR,
    VELOCITY,
    list_body_shape_columns,
    make_body_columns,
    make_parameter_error,
    read_body_numbers,
)
from ss2sql.vtables.contract import Column, Element, Gone, Table, TableFunction, Where
from ss2sql.vtables.pybullet.client import Box as Bounds
from ss2sql.vtables.pybullet.client import (
    Pose,
    convert_pose_to_world,
    rotate_point,
    unite_boxes,
)
from ss2sql.vtables.pybullet.scene import KINDS, get_volume

Key = tuple[int, int]

UNSURE = (float | None, float | None, float | None)
UNKNOWN = ((None, None, None), (None, None, None))  # the velocities of soft bodies
SOFT = 3  # PyBullet's number for soft bodies in getDynamicsInfo


class BodyPartTable(Table):
    """A table whose keys are a body and a number within it."""

    first = 0  # the first number

    def keys(self, where: Where) -> list[Key]:
        return [
            (body, number)
            for body in list_demanded_bodies(self.world, where)
            for number in range(self.first, self.world.calls.getNumJoints(body))
            if where.allows("number", number)
        ]

    def read_numbers(self, key: Key) -> Key:
        """The group of the columns `body` and `number`."""
        self.check_key(key)
        return key

    def check_key(self, key: Key) -> None:
        """Raises Gone for a missing body or link, for which the simulator often answers as if it were empty."""
        self.world.check_body(key[0])
        if key[1] >= self.world.calls.getNumJoints(key[0]):
            raise Gone("its body has fewer links now")

    def call_simulator(self, function: Any, key: Key, *more: Any) -> Any:
        """The result of a function of the simulator; raises Gone for a missing body or link."""
        self.check_key(key)
        return function(key[0], key[1], *more)


def list_demanded_bodies(world: Any, where: Where) -> list[int]:
    wanted = where.equal("body")
    if wanted is None:
        return world.list_ids()  # type: ignore[no-any-return]
    return [int(wanted)] if wanted == int(wanted) and world.has_body(int(wanted)) else []


class BulletLinks(BodyPartTable):
    """One row for each link. The base is the link -1; a body without joints has no other.

    PyBullet's poses of all links but the base are one step old.
    """

    name = "links"
    text = "the links of all bodies; the base of a body is its link -1"
    first = -1
    columns = (
        Column("body", int, text="the id of its body", filter="="),
        Column("number", int, text="PyBullet's number of the link, -1 for the base", filter="="),
        Column("name", str),
        Column("parent", int | None, text="the number of the link that it hangs on; None for the base"),
        Column("x", float, "m", "where its centre of mass is"),
        Column("y", float, "m"),
        Column("z", float, "m"),
        Column("pos", VECTOR, "m", "x, y and z"),
        Column("quat", (*VECTOR, float), text="how it is turned: a quaternion x, y, z, w"),
        Column("velocity", UNSURE, "m/s", "of soft bodies three times None"),
        Column("angularVelocity", UNSURE, "rad/s", "of soft bodies three times None"),
        Column("mass", float | None, "kg", "None of soft bodies"),
        Column("friction", float | None, text="sideways; None of soft bodies"),
        Column("aabb", (VECTOR, VECTOR), "m", "the box around it: lowest and highest corner"),
        Column("colour", list | None, text="red, green, blue and opacity, from 0 to 1; None if it cannot be seen"),
    )
    groups: ClassVar[Mapping[str, str]] = {
        "read_numbers": "body number",
        "read_names": "name parent",
        "read_pose": "x y z pos quat",
        "read_velocity": "velocity angularVelocity",
        "read_mass": "mass friction",
        "read_box": "aabb",
        "read_color": "colour",
    }

    def read_names(self, key: Key) -> tuple[str, int | None]:
        if key[1] < 0:
            return self.call_simulator(lambda body, _: self.world.calls.getBodyInfo(body), key)[0].decode(
                errors="replace"
            ), None
        info = self.call_simulator(self.world.calls.getJointInfo, key)
        return info[12].decode(errors="replace"), info[16]

    def read_pose(self, key: Key) -> tuple[Any, ...]:
        self.check_key(key)
        pos, quat = read_link_pose(self.world, key)
        return (*pos, pos, quat)

    def read_velocity(self, key: Key) -> Any:
        if key[1] < 0:
            if self.call_simulator(self.world.calls.getDynamicsInfo, key)[10] == SOFT:
                return UNKNOWN
            return self.world.calls.getBaseVelocity(key[0])
        return self.call_simulator(self.world.calls.getLinkState, key, 1)[6:8]

    def read_mass(self, key: Key) -> tuple[float | None, float | None]:
        info = self.call_simulator(self.world.calls.getDynamicsInfo, key)
        return (None, None) if info[10] == SOFT else (info[0], info[1])

    def read_box(self, key: Key) -> Bounds:
        self.check_key(key)
        return measure_link_box(self.world, key)

    def read_color(self, key: Key) -> Any:
        seen = self.call_simulator(lambda body, _: self.world.calls.getVisualShapeData(body), key)
        return next((list(shape[7]) for shape in seen if shape[1] == key[1]), None)


def read_link_pose(world: Any, key: Key) -> Pose:
    """Where the centre of mass of a link is, and how it is turned."""
    body, link = key
    if link < 0:
        return world.calls.getBasePositionAndOrientation(body)  # type: ignore[no-any-return]
    state = world.calls.getLinkState(body, link)
    return state[0], state[1]


def measure_link_box(world: Any, key: Key) -> Bounds:
    """The box around a link. That of an endless plane along two axes ends at its front, unlike PyBullet's."""
    body, link = key
    low, high = world.calls.getAABB(body, link)
    if high[2] < FAR:
        return low, high
    shapes = world.shapes.read_link_shapes(body, link)
    if len(shapes) == 1 and shapes[0][2] == world.calls.GEOM_PLANE:
        _, _, _, normal, _, *local = shapes[0]
        place, turn = convert_pose_to_world(read_link_pose(world, key), (local[0], local[1]))
        front = rotate_point(turn, normal)
        axis = max(range(3), key=lambda number: abs(front[number]))
        if abs(front[axis]) > 1 - 1e-12:
            end = high if front[axis] > 0 else low
            ended = (*end[:axis], place[axis], *end[axis + 1 :])
            return (low, ended) if end is high else (ended, high)
    return low, high


# --- the table of bodies
FIXED = 4  # PyBullet's JOINT_FIXED


class BulletBodies(Table):
    """One row for each body. Positions are those of its centre of mass, as PyBullet gives them.

    PyBullet does not know velocity, mass, friction, restitution, shape and volume of a soft body: these are None. Its
    functions would return the numbers of the body of the call before.
    """

    name, key = "bodies", "id"
    text = "the bodies, in the order of their ids, which go to others after their death"
    columns = (
        *make_body_columns(without="force torque", unknown=f"type mass {VELOCITY} {SPIN}"),
        Column("force", list | None, "N", "what the scene pushes it with; None where no scene tells"),
        Column("torque", list | None, "Nm", "what the scene turns it with; None where no scene tells"),
        Column("friction", float | None, "", "of its base, sideways"),
        Column("restitution", float | None, "", "of its base: how much it bounces"),
        Column("colour", list | None, "", "red, green, blue and opacity, from 0 to 1; None if it cannot be seen"),
    )
    places = PLACES
    blocks: ClassVar[Mapping[str, str]] = {
        "read_names": "name",
        "read_poses": "pos(x=posX y=posY z=posZ) quat(qx qy qz qw)",
        "read_velocities": "velocity=linearVelocity(vx vy vz) angularVelocity(wx wy wz)",
        "read_masses": "mass hasBody friction restitution",
        "are_sensing": "isSensor",
    }
    groups: ClassVar[Mapping[str, str]] = {
        "read_angles": "rot",
        "read_pose": "pose",
        "read_box": "aabb",
        "read_volume": "volume",
        "read_forces": "force torque",
        "read_color": "colour",
        "read_shape": f"{SHAPE} isRobot isEnabled",
        "read_element": "obj",
    }

    def __init__(self, world: Any) -> None:
        super().__init__(world)
        self.calls = world.calls
        self.error = world.calls.error  # PyBullet's exception, mostly for bodies that are gone
        self._client = world.calls.number
        self._where = world.calls.get_numbered_call("getBasePositionAndOrientation")
        self._velocity = world.calls.get_numbered_call("getBaseVelocity")
        self._dynamics = world.calls.get_numbered_call("getDynamicsInfo")
        self._joints = world.calls.get_numbered_call("getNumJoints")
        self._info = world.calls.get_numbered_call("getBodyInfo")

    def keys(self, where: Where) -> Sequence[int]:
        return self.world.filter_bodies(where)  # type: ignore[no-any-return]

    def read_names(self, keys: Sequence[int]) -> list[str]:
        return self._ask_simulator(self.world.name_of if self.world.names else self._read_name, keys)

    def read_poses(self, keys: Sequence[int]) -> list[Any]:
        return self._ask_simulator(self._where, keys, repeat(self._client))

    def read_velocities(self, keys: Sequence[int]) -> list[Any]:
        return self._ask_simulator(self._read_velocity, keys)

    def read_masses(self, keys: Sequence[int]) -> list[Any]:
        return self._ask_simulator(self._read_mass, keys)

    def _ask_simulator(self, function: Callable[..., Any], keys: Sequence[int], *more: Any) -> list[Any]:
        """What the function gives for each key. Raises Gone in place of the simulator's error where a body is gone."""
        try:
            return list(map(function, keys, *more))
        except self.error:
            for key in keys:
                self.world.check_body(key)
            raise

    def _read_name(self, key: int) -> str:
        return self._info(key, self._client)[1].decode(errors="replace") or f"body_{key}"

    def _read_velocity(self, key: int) -> Any:
        client = self._client
        return UNKNOWN if self._dynamics(key, -1, client)[10] == SOFT else self._velocity(key, client)

    def _read_mass(self, key: int) -> tuple[Any, ...]:
        info, client = self._dynamics, self._client
        base = info(key, -1, client)
        if base[10] == SOFT:
            return None, True, None, None
        mass = base[0]
        for link in range(self._joints(key, client)):
            mass += info(key, link, client)[0]
        return mass, mass > 0, base[1], base[5]

    def are_sensing(self, keys: Sequence[int]) -> list[bool]:
        sensors = self.world.sensors
        for key in keys:
            self.world.check_body(key)
        return [key in sensors for key in keys]

    def read_angles(self, key: int) -> Any:
        return self.calls.getEulerFromQuaternion(self.read_poses([key])[0][1])

    def read_pose(self, key: int) -> Any:
        ((pos, quat),) = self.read_poses([key])
        return (*pos, *quat)

    def read_box(self, key: int) -> Bounds:
        return measure_box(self.world, key)

    def read_volume(self, key: int) -> float | None:
        total = 0.0
        for _, _, shape in self.world.shapes.read_shapes(key):
            volume = get_volume(shape)
            if volume is None:
                return None
            total += volume
        return total if total or not has_untold_shape(self.world, key) else None

    def read_forces(self, key: int) -> tuple[Any, Any]:
        self.world.check_body(key)
        scene = self.world.scene
        if scene is None:
            return None, None
        return list(scene.forces.get(key, (0.0, 0.0, 0.0))), [0.0, 0.0, 0.0]  # scenes push at the centre of mass

    def read_color(self, key: int) -> Any:
        self.world.check_body(key)  # PyBullet takes a missing body for an invisible one
        seen = self.calls.getVisualShapeData(key)
        return list(seen[0][7]) if seen else None

    def read_shape(self, key: int) -> tuple[Any, ...]:
        kind = self._find_kind(key)
        joints = range(self.calls.getNumJoints(key))
        robot = kind is not None and any(self.calls.getJointInfo(key, joint)[2] != FIXED for joint in joints)
        return *list_body_shape_columns(kind), robot, kind != "ghost"

    def _find_kind(self, key: int) -> str | None:
        """The kind of the shape; None of a soft body."""
        shapes = self.world.shapes.read_shapes(key)
        kinds = {KINDS.get(shape[2], "mesh") for _, _, shape in shapes}
        if len(shapes) == 1 or (kinds == {"mesh"} and not self.calls.getNumJoints(key)):  # files: PyBullet splits them
            return kinds.pop()
        if shapes:
            return "compound"
        if self.world.shapes.is_soft(key):
            return None
        return "terrain" if has_untold_shape(self.world, key) else "ghost"

    def read_element(self, key: int) -> Element:
        self.world.check_body(key)
        return self.element(key)


def measure_box(world: Any, body: int) -> Bounds:
    calls = world.calls
    world.check_body(body)
    boxes = [measure_link_box(world, (body, link)) for link in range(-1, calls.getNumJoints(body))]
    return unite_boxes(boxes)


EMPTY = 0.01  # metres: boxes around links without shapes have smaller diagonals, but not 0 in bodies from files


def has_untold_shape(world: Any, body: int) -> bool:
    """Whether a body for which PyBullet lists no shapes has one: it is a height field, or soft."""
    calls = world.calls
    links = range(-1, calls.getNumJoints(body))
    return world.shapes.is_soft(body) or any(dist(*calls.getAABB(body, link)) > EMPTY for link in links)


# --- joints, the shapes that links collide with, the cameras of a scene; contacts, what is near, what rays hit
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
        low, high, force, velocity = self.world.read_joint_ends(*key)
        lower, upper = (low, high) if low <= high else (None, None)  # upside down: no ends
        if info[2] in (0, 1) and lower == upper == 0.0:
            lower = upper = None
        name, link = info[1].decode(errors="replace"), info[12].decode(errors="replace")
        kind = TYPES.get(info[2], "other")
        return (name, kind, link, info[16], info[13], lower, upper, force, velocity, info[6], info[7])

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
        Column("pos", list | None, "m", "where it is; None where PyBullet does not tell it, as of some MJCF files"),
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
NEAREST, FARTHEST = 0.05, 1000.0  # metres that a camera sees


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
        seeing = calls.computeProjectionMatrixFOV(view.angle, WIDTH / HEIGHT, NEAREST, FARTHEST)
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
        Column("body", Element, text="what it hits"),
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

"""The bodies of a simulation, the principal table, and their links.

PyBullet's own search, `getOverlappingObjects`, misses bodies: those without collision shapes, those with a centre
outside of their shape, and, until the next step, those that the last step moved. So positions are compared.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import repeat
from math import dist
from typing import Any, ClassVar, TypeAlias

from ss2sql.vtables.body_functions import (
    AXES,
    FAR,
    PLACES,
    SHAPE,
    SPIN,
    VECTOR,
    VELOCITY,
    list_body_shape_columns,
    make_body_columns,
)
from ss2sql.vtables.contract import Column, Element, Gone, Table, Where
from ss2sql.vtables.pybullet.client import Box as Bounds
from ss2sql.vtables.pybullet.client import (
    Point,
    Pose,
    convert_pose_to_world,
    invert_rotation,
    rotate_point,
    unite_boxes,
)
from ss2sql.vtables.pybullet.scene import (
    Box,
    Capsule,
    Cylinder,
    Plane,
    Solid,
    Sphere,
    describe_shape,
    measure_volume,
)

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


# --- the table of bodies, and their shapes
KINDS = {2: "sphere", 3: "box", 4: "cylinder", 5: "mesh", 6: "plane", 7: "capsule", 9: "terrain"}  # PyBullet's GEOM_...
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

    def keys(self, where: Where) -> list[int]:
        world = self.world
        wanted = where.equal("id")
        if wanted is not None:
            key = int(wanted)
            found = [key] if wanted == key and world.has_body(key) else []
        elif where.keys().isdisjoint(AXES):
            found = world.list_ids()
        else:
            found = world.filter_by_position(where)
        name = where.equal("name")
        return found if name is None else [body for body in found if world.name_of(body) == name]

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


def make_solid(kind: int, size: Sequence[float]) -> Solid | None:
    """The solid with PyBullet's measures; None for meshes and other shapes."""
    a, b, c = size
    match KINDS.get(kind):
        case "sphere":
            return Sphere(a)
        case "box":
            return Box(a, b, c)
        case "capsule":
            return Capsule(b, a)
        case "cylinder":
            return Cylinder(b, a)
        case "plane":
            return Plane((a, b, c), SIDE)
        case _:
            return None


def get_volume(shape: Any) -> float | None:
    solid = make_solid(shape[2], shape[3])
    return None if solid is None else measure_volume(solid)


SIDE = 10.0  # metres: the edge of the squares that represent endless planes in pictures
UNNAMED = (b"", b"unknown_file")  # the files of meshes that were built from points
Part: TypeAlias = dict[str, Any]  # the keywords of a shape for PyBullet


def read_corners(calls: Any, body: int, link: int, number: int, data: Any) -> tuple[Point, ...]:
    """The corners of a mesh that was built from points, as seen from the mesh; none for other shapes.

    PyBullet gives them as seen from the centre of mass of the link.
    """
    if KINDS.get(data[2]) != "mesh" or data[4] not in UNNAMED:
        return ()
    _, corners = calls.getMeshData(body, link, collisionShapeIndex=number)
    (px, py, pz), back = data[5], invert_rotation(data[6])
    return tuple(rotate_point(back, (x - px, y - py, z - pz)) for x, y, z in corners)


def read_bullet_shape(kind: int, size: Sequence[float], file: bytes, corners: Sequence[Any]) -> Part | None:
    """A shape from PyBullet's data; None where these are incomplete."""
    solid = make_solid(kind, size)
    if solid is not None:
        return describe_shape(solid)
    if KINDS.get(kind) != "mesh":
        return None
    if file not in UNNAMED:
        return {"shapeType": kind, "fileName": file.decode(), "meshScale": list(size)}
    return {"shapeType": kind, "vertices": corners} if corners else None

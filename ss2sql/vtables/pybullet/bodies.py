"""The bodies of a simulation, the principal table.

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
    PLACES,
    SHAPE,
    SPIN,
    VELOCITY,
    list_body_shape_columns,
    make_body_columns,
)
from ss2sql.vtables.contract import Column, Element, Table, Where
from ss2sql.vtables.pybullet.links import SOFT, UNKNOWN, measure_link_box
from ss2sql.vtables.pybullet.poses import Box as Bounds
from ss2sql.vtables.pybullet.poses import Point, invert_rotation, rotate_point, unite_boxes
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

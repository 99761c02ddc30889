"""The bodies of a simulation, the principal table.

PyBullet's own search, `getOverlappingObjects`, misses bodies: those without collision shapes, those with a centre
outside of their shape, and, until the next step, those that the last step moved. So positions are compared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import repeat
from math import pi
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
from ss2sql.vtables.pybullet.links import SOFT, UNKNOWN
from ss2sql.vtables.pybullet.poses import Box, unite_boxes

KINDS = {2: "sphere", 3: "box", 4: "cylinder", 5: "mesh", 6: "plane", 7: "capsule", 9: "terrain"}  # PyBullet's GEOM_...
_TYPES = (*KINDS.values(), "compound", "ghost")
FORM_ROWS = {
    (kind, robot): (*list_body_shape_columns(kind), robot, kind != "ghost")
    for kind in _TYPES
    for robot in (False, True)
}
SINGLE_ROWS: dict[int, tuple[Any, ...]] = {  # of bodies with one shape
    number: FORM_ROWS[kind, False] for number, kind in KINDS.items()
}
SOFT_ROW = (*list_body_shape_columns(None), False, True)
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
        try:
            if self.world.names:
                return list(map(self.world.name_of, keys))
            info, client = self._info, self._client
            return [info(key, client)[1].decode(errors="replace") or f"body_{key}" for key in keys]
        except self.error as error:
            raise self._explain_refusal(keys, error) from None

    def read_poses(self, keys: Sequence[int]) -> list[Any]:
        try:
            return list(map(self._where, keys, repeat(self._client)))
        except self.error as error:
            raise self._explain_refusal(keys, error) from None

    def read_velocities(self, keys: Sequence[int]) -> list[Any]:
        info, velocity, client = self._dynamics, self._velocity, self._client
        try:
            return [UNKNOWN if info(key, -1, client)[10] == SOFT else velocity(key, client) for key in keys]
        except self.error as error:
            raise self._explain_refusal(keys, error) from None

    def read_masses(self, keys: Sequence[int]) -> list[Any]:
        info, joints, client = self._dynamics, self._joints, self._client
        rows: list[tuple[Any, ...]] = []
        try:
            for key in keys:
                base = info(key, -1, client)
                if base[10] == SOFT:
                    rows.append((None, True, None, None))
                    continue
                mass = base[0]
                for link in range(joints(key, client)):
                    mass += info(key, link, client)[0]
                rows.append((mass, mass > 0, base[1], base[5]))
        except self.error as error:
            raise self._explain_refusal(keys, error) from None
        return rows

    def are_sensing(self, keys: Sequence[int]) -> list[bool]:
        sensors = self.world.sensors
        for key in keys:
            self.world.check_body(key)
        return [key in sensors for key in keys]

    def _explain_refusal(self, keys: Sequence[int], error: Exception) -> Exception:
        """Why the simulator refused: a body is gone, or something else."""
        for key in keys:
            self.world.check_body(key)
        return error

    def read_angles(self, key: int) -> Any:
        return self.calls.getEulerFromQuaternion(self.read_poses([key])[0][1])

    def read_pose(self, key: int) -> Any:
        ((pos, quat),) = self.read_poses([key])
        return (*pos, *quat)

    def read_box(self, key: int) -> Box:
        return measure_box(self.world, key)

    def read_volume(self, key: int) -> float | None:
        total = 0.0
        for _, _, shape in self.world.shapes.read_shapes(key):
            volume = get_volume(shape)
            if volume is None:
                return None
            total += volume
        return total if total or not (self.world.shapes.is_soft(key) or self._is_terrain(key)) else None

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
        calls = self.calls
        shapes = self.world.shapes.read_shapes(key)
        joints = range(calls.getNumJoints(key))
        if not joints and len(shapes) == 1:
            return SINGLE_ROWS[shapes[0][2][2]]
        robot = any(calls.getJointInfo(key, joint)[2] != FIXED for joint in joints)
        kinds = {KINDS.get(shape[2], "mesh") for _, _, shape in shapes}
        if len(shapes) == 1 or (kinds == {"mesh"} and not joints):  # PyBullet splits meshes of files
            return FORM_ROWS[kinds.pop(), robot]
        if shapes:
            return FORM_ROWS["compound", robot]
        if self.world.shapes.is_soft(key):
            return SOFT_ROW
        return FORM_ROWS["terrain" if self._is_terrain(key) else "ghost", robot]

    def read_element(self, key: int) -> Element:
        self.world.check_body(key)
        return self.element(key)

    def _is_terrain(self, key: int) -> bool:
        """Whether a body is a height field: PyBullet lists no shapes, but a box with a size."""
        low, high = measure_box(self.world, key)
        return low != high


def measure_box(world: Any, body: int) -> Box:
    calls = world.calls
    world.check_body(body)
    boxes = [calls.getAABB(body, link) for link in range(-1, calls.getNumJoints(body))]
    return unite_boxes(boxes)


def get_volume(shape: Any) -> float | None:
    a, b, c = shape[3]
    match KINDS.get(shape[2]):
        case "sphere":
            return 4 / 3 * pi * float(a) ** 3
        case "box":
            return float(a * b * c)
        case "cylinder":
            return pi * float(b * b * a)
        case "capsule":
            return pi * float(b * b * a) + 4 / 3 * pi * float(b) ** 3
        case _:
            return None


UNNAMED = (b"", b"unknown_file")  # the files of meshes that were built from points
Part: TypeAlias = dict[str, Any]  # the keywords of a shape for PyBullet


def read_bullet_shape(kind: int, size: Sequence[float], file: bytes, corners: Sequence[Any]) -> Part | None:
    """A shape from PyBullet's data; None where these are incomplete."""
    a, b, c = size
    match KINDS.get(kind):
        case "sphere":
            return {"shapeType": kind, "radius": a}
        case "box":
            return {"shapeType": kind, "halfExtents": [a / 2, b / 2, c / 2]}
        case "capsule" | "cylinder":
            return {"shapeType": kind, "radius": b, "height": a}
        case "plane":
            return {"shapeType": kind, "planeNormal": [a, b, c]}
        case "mesh" if file not in UNNAMED:
            return {"shapeType": kind, "fileName": file.decode(), "meshScale": [a, b, c]}
        case "mesh" if corners:
            return {"shapeType": kind, "vertices": corners}
        case _:
            return None

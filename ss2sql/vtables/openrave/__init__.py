"""OpenRAVE as a world: `ss.attach("space", env)` for an `openravepy.Environment`.

It uses the documented interface of openravepy, in the spelling that the versions from 0.9 on have in common.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from typing import Any, ClassVar

import numpy as np

from ss2sql.errors import ExecutionError
from ss2sql.vtables.body_functions import (  # fmt: skip
    PLACES,
    POSITION,
    ROTATION,
    SHAPE,
    SPIN,
    VELOCITY,
    BodyWorld,
    Closest,
    Near,
    Overlaps,
    Posed,
    Quaternion,
    Vector,
    clip_body_corner,
    compute_solid_volume,
    make_body_columns,
    make_gone_error,
    refuse_margin,
)
from ss2sql.vtables.contract import Column, Table, Where

_SHAPES = {"sphere": "sphere", "box": "box", "cylinder": "cylinder", "trimesh": "mesh"}
_LINK_COLUMNS = f"{POSITION} {ROTATION} rot pose {SHAPE} {VELOCITY} {SPIN} mass volume aabb isEnabled".split()


class _OpenRaveSolids(Posed):
    """What bodies and their links have in common: `things` of OpenRAVE with a pose and geometries."""

    SOLIDS: ClassVar[dict[str, str]] = {
        **Posed.PLACED, "read_name": "name", "read_mass": "mass", "read_volume": "volume", "read_box": "aabb",
        "is_touchable": "isEnabled",
    }  # fmt: skip
    world: OpenRaveWorld

    @abstractmethod
    def get_part(self, key: Any) -> Any:
        """The body or link with a key."""

    @abstractmethod
    def list_geometries(self, key: Any) -> list[Any]:
        """Its shapes."""

    @abstractmethod
    def read_motion(self, key: Any) -> list[float]:
        """Its velocity and its spin, three numbers each."""

    def read_name(self, key: Any) -> str:
        return str(self.get_part(key).GetName())

    def read_kind(self, key: Any) -> str:
        kinds = [name_shape(geometry) for geometry in self.list_geometries(key)]
        return "ghost" if not kinds else kinds[0] if len(kinds) == 1 else "compound"

    def read_position(self, key: Any) -> Vector:
        return _read_openrave_pose(self.get_part(key))[0]

    def read_turn(self, key: Any) -> Quaternion:
        return _read_openrave_pose(self.get_part(key))[1]

    def read_velocity(self, key: Any) -> Vector:
        x, y, z = self.read_motion(key)[:3]
        return x, y, z

    def read_spin(self, key: Any) -> Vector:
        x, y, z = self.read_motion(key)[3:]
        return x, y, z

    def read_volume(self, key: Any) -> float | None:
        volumes = [_compute_volume(geometry) for geometry in self.list_geometries(key)]
        known = [volume for volume in volumes if volume is not None]
        return sum(known) if len(known) == len(volumes) else None

    def read_box(self, key: Any) -> tuple[Vector, Vector]:
        found = self.get_part(key).ComputeAABB()
        middle, half = np.asarray(found.pos()), np.asarray(found.extents())
        return clip_body_corner(middle - half), clip_body_corner(middle + half)

    def is_touchable(self, key: Any) -> bool:
        return bool(self.get_part(key).IsEnabled())


class OpenRaveBodies(_OpenRaveSolids):
    name, key = "bodies", "id"
    text = "the bodies of the environment, robots among them"
    columns = make_body_columns(without="force torque hasBody")
    places = PLACES
    groups: ClassVar[Mapping[str, str]] = {
        **_OpenRaveSolids.SOLIDS, "read_element": "obj", "is_robot": "isRobot", "is_sensing": "isSensor",
    }  # fmt: skip

    def keys(self, where: Where) -> Iterable[int]:
        return self.world.filter_bodies(where)

    def get_part(self, key: Any) -> Any:
        return self.world.get_body(key)

    def list_geometries(self, key: Any) -> list[Any]:
        return [geometry for link in self.world.get_body(key).GetLinks() for geometry in link.GetGeometries()]

    def read_element(self, key: int) -> Any:
        self.get_part(key)  # which must exist
        return self.element(key)

    def read_motion(self, key: Any) -> list[float]:
        # The first link carries the body's pose.
        return list(map(float, self.world.get_body(key).GetLinkVelocities()[0]))

    def read_mass(self, key: int) -> float:
        return float(sum(link.GetMass() for link in self.world.get_body(key).GetLinks()))

    def is_robot(self, key: int) -> bool:
        return bool(self.world.get_body(key).IsRobot())

    def is_sensing(self, key: int) -> bool:
        body = self.world.get_body(key)
        return bool(body.IsRobot() and len(body.GetAttachedSensors()))


class OpenRaveLinks(_OpenRaveSolids):
    name = "links"
    text = "the rigid parts that bodies consist of"
    columns = (
        Column("body", int, "", "the id of its body"),
        Column("number", int, "", "its number within the body, from 0 on"),
        Column("name", str, "", "its name"),
        *(replace(column, filter="") for column in make_body_columns() if column.name in _LINK_COLUMNS),
    )
    groups: ClassVar[Mapping[str, str]] = {**_OpenRaveSolids.SOLIDS, "read_owner": "body number"}

    def keys(self, where: Where) -> Iterable[tuple[int, int]]:
        return self.world.number_parts("GetLinks")

    def get_part(self, key: tuple[int, int]) -> Any:
        return _get_link_or_joint(self.world.get_body(key[0]).GetLinks(), "link", key)

    def list_geometries(self, key: tuple[int, int]) -> list[Any]:
        return list(self.get_part(key).GetGeometries())

    def read_owner(self, key: tuple[int, int]) -> tuple[int, int]:
        self.get_part(key)  # which must exist
        return key

    def read_motion(self, key: Any) -> list[float]:
        return list(map(float, self.get_part(key).GetVelocity()))

    def read_mass(self, key: tuple[int, int]) -> float:
        return float(self.get_part(key).GetMass())


class OpenRaveJoints(Table):
    name = "joints"
    text = "the joints by which links move"
    columns = (
        Column("body", int, "", "the id of its body"),
        Column("name", str, "", "its name"),
        Column("type", str, "", "as OpenRAVE calls it: revolute, prismatic"),
        Column("angle", float | None, "rad or m", "how far it is turned, or slid; None where that is several numbers"),
        Column("speed", float | None, "rad/s or m/s", "how fast it turns or slides"),
        Column("lower", float | None, "rad or m", "how far it can go down"),
        Column("upper", float | None, "rad or m", "how far it can go up"),
    )
    groups: ClassVar[Mapping[str, str]] = {
        "read_owner": "body", "read_name_and_type": "name type", "read_state": "angle speed",
        "read_limits": "lower upper",
    }  # fmt: skip
    world: OpenRaveWorld

    def keys(self, where: Where) -> Iterable[tuple[int, int]]:
        return self.world.number_parts("GetJoints")

    def get_joint(self, key: tuple[int, int]) -> Any:
        return _get_link_or_joint(self.world.get_body(key[0]).GetJoints(), "joint", key)

    def read_owner(self, key: tuple[int, int]) -> int:
        self.get_joint(key)  # which must exist
        return key[0]

    def read_name_and_type(self, key: tuple[int, int]) -> tuple[str, str]:
        joint = self.get_joint(key)
        return str(joint.GetName()), joint.GetType().name.lower()

    def read_state(self, key: tuple[int, int]) -> tuple[float | None, float | None]:
        joint = self.get_joint(key)
        return _unwrap_openrave_value(joint.GetValues()), _unwrap_openrave_value(joint.GetVelocities())

    def read_limits(self, key: tuple[int, int]) -> tuple[float | None, float | None]:
        lower, upper = self.get_joint(key).GetLimits()
        return _unwrap_openrave_value(lower), _unwrap_openrave_value(upper)


class OpenRaveWorld(BodyWorld):
    """OpenRAVE: the bodies of an environment, their links and joints.

    Args:
        source: the `openravepy.Environment`.
    """

    tables = (OpenRaveBodies, OpenRaveLinks, OpenRaveJoints, Closest, Near, Overlaps)

    def __init__(self, source: Any) -> None:
        super().__init__(source)
        self.environment = source

    @property
    def time(self) -> float:
        return float(self.environment.GetSimulationTime()) / 1e6  # OpenRAVE counts microseconds

    def list_bodies(self) -> list[Any]:
        """All bodies, in the order of their numbers."""
        return sorted(self.environment.GetBodies(), key=lambda body: int(body.GetEnvironmentId()))

    def list_ids(self) -> list[int]:
        return [int(body.GetEnvironmentId()) for body in self.list_bodies()]

    def number_parts(self, method: str) -> list[tuple[int, int]]:
        """The number of a body and a number from 0 on for each of its parts, which this method gives."""
        bodies = self.list_bodies()
        return [(int(b.GetEnvironmentId()), number) for b in bodies for number in range(len(getattr(b, method)()))]

    def get_body(self, key: Any) -> Any:
        """The body with a number. Raises Gone where there is none."""
        found = self.environment.GetBodyFromEnvironmentId(key)
        if found is None:
            raise make_gone_error("body", key)
        return found

    def read_positions(self) -> tuple[list[int], Any]:
        found = self.list_bodies()
        points = [_read_openrave_pose(body)[0] for body in found]
        return self.list_ids(), np.array(points, float).reshape(len(found), 3)

    def do_touch(self, one: int, other: int, margin: float = 0.0) -> bool:
        if margin:
            return super().do_touch(one, other, margin)
        return bool(self.environment.CheckCollision(self.get_body(one), self.get_body(other)))

    def is_touching(self, body: int, margin: float = 0.0) -> bool:
        refuse_margin(margin, "OpenRAVE")
        return bool(self.environment.CheckCollision(self.get_body(body)))

    def would_touch(self, body: int, position: Vector, turn: Quaternion, margin: float = 0.0) -> bool:
        refuse_margin(margin, "OpenRAVE")
        found = self.get_body(body)
        with found:  # OpenRAVE restores its pose at the end
            self.put_body(body, position, turn)
            return bool(self.environment.CheckCollision(found))

    def measure_gap(self, one: int, other: int) -> float:
        """Measured by the environment's collision checker, if that can."""
        openravepy, checker = import_module("openravepy"), self.environment.GetCollisionChecker()
        before, report = checker.GetCollisionOptions(), openravepy.CollisionReport()
        if not checker.SetCollisionOptions(openravepy.CollisionOptions.Distance):
            checker.SetCollisionOptions(before)
            hints = ('env.SetCollisionChecker(openravepy.RaveCreateCollisionChecker(env, "pqp"))',)
            raise ExecutionError("X007", "the collision checker of the environment measures no distances", hints=hints)
        try:
            touch = self.environment.CheckCollision(self.get_body(one), self.get_body(other), report)
            return 0.0 if touch else float(report.minDistance)
        finally:
            checker.SetCollisionOptions(before)

    def put_body(self, body: int, position: Vector, turn: Quaternion) -> None:
        x, y, z, w = turn
        self.get_body(body).SetTransform(np.array([w, x, y, z, *position]))


def _read_openrave_pose(part: Any) -> tuple[Vector, Quaternion]:
    """Where a body or a link is, and how it is turned: x, y, z, w. OpenRAVE begins with the real part."""
    w, qx, qy, qz, x, y, z = map(float, part.GetTransformPose())
    return (x, y, z), (qx, qy, qz, w)


def name_shape(geometry: Any) -> str:
    return _SHAPES.get(geometry.GetType().name.lower(), "ghost")


def _compute_volume(geometry: Any) -> float | None:
    kind, size = name_shape(geometry), []
    match kind:
        case "sphere":
            size = [geometry.GetSphereRadius()]
        case "box":
            size = [2 * extent for extent in geometry.GetBoxExtents()]
        case "cylinder":
            size = [geometry.GetCylinderRadius(), geometry.GetCylinderHeight()]
    return compute_solid_volume(kind, *map(float, size))


def _unwrap_openrave_value(values: Any) -> float | None:
    return float(values[0]) if len(values) == 1 else None


def _get_link_or_joint(parts: Sequence[Any], what: str, key: tuple[int, int]) -> Any:
    if key[1] >= len(parts):
        raise make_gone_error(what, key)
    return parts[key[1]]

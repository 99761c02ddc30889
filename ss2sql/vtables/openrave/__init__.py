"""OpenRAVE as a world: `ss.attach("space", env)` for an `openravepy.Environment`.

It uses the documented interface of openravepy, in the spelling that the versions from 0.9 on have in common. Poses
may come as matrices or, after `openravepy.options.SetReturnTransformQuaternions(True)`, as quaternion and position.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from importlib import import_module
from math import pi
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ss2sql.errors import ExecutionError
from ss2sql.vtables.body_columns import (  # fmt: skip
    PLACES,
    POSITION,
    ROTATION,
    SHAPE,
    SPIN,
    VELOCITY,
    Quaternion,
    Vector,
    clip_to_finite,
    make_body_columns,
    make_gone_error,
)
from ss2sql.vtables.body_functions import BodyWorld, Closest, Near, Overlaps
from ss2sql.vtables.contract import Column, Table, Where
from ss2sql.vtables.pose_columns import Posed

_SHAPES = {"sphere": "sphere", "box": "box", "cylinder": "cylinder", "trimesh": "mesh"}
_LINK_COLUMNS = f"{POSITION} {ROTATION} rot pose {SHAPE} {VELOCITY} {SPIN} mass volume aabb isEnabled".split()


class _Solids(Posed):
    """What bodies and their links have in common: `things` of OpenRAVE with a pose and geometries."""

    SOLIDS: ClassVar[dict[str, str]] = {
        **Posed.PLACED, "called": "name", "weight": "mass", "size": "volume", "box": "aabb", "touchable": "isEnabled",
    }  # fmt: skip
    world: OpenRaveWorld

    @abstractmethod
    def thing(self, key: Any) -> Any:
        """The body or link with a key."""

    @abstractmethod
    def geometries(self, key: Any) -> list[Any]:
        """Its shapes."""

    @abstractmethod
    def motion(self, key: Any) -> list[float]:
        """Its velocity and its spin, three numbers each."""

    def called(self, key: Any) -> str:
        return str(self.thing(key).GetName())

    def kind_of(self, key: Any) -> str:
        kinds = [shape_of(geometry) for geometry in self.geometries(key)]
        return "ghost" if not kinds else kinds[0] if len(kinds) == 1 else "compound"

    def position_of(self, key: Any) -> Vector:
        return pose(self.thing(key).GetTransform())[1]

    def turn_of(self, key: Any) -> Quaternion:
        w, x, y, z = pose(self.thing(key).GetTransform())[0]
        return x, y, z, w

    def velocity_of(self, key: Any) -> Vector:
        x, y, z = self.motion(key)[:3]
        return x, y, z

    def spin_of(self, key: Any) -> Vector:
        x, y, z = self.motion(key)[3:]
        return x, y, z

    def size(self, key: Any) -> float | None:
        volumes = [_volume(geometry) for geometry in self.geometries(key)]
        known = [volume for volume in volumes if volume is not None]
        return sum(known) if len(known) == len(volumes) else None

    def box(self, key: Any) -> tuple[Vector, Vector]:
        found = self.thing(key).ComputeAABB()
        middle, half = np.asarray(found.pos()), np.asarray(found.extents())
        return clip_to_finite(middle - half), clip_to_finite(middle + half)

    def touchable(self, key: Any) -> bool:
        return bool(self.thing(key).IsEnabled())


class Bodies(_Solids):
    name, key = "bodies", "id"
    text = "the bodies of the environment, robots among them"
    columns = make_body_columns(without="force torque hasBody")
    places = PLACES
    groups: ClassVar[Mapping[str, str]] = {
        **_Solids.SOLIDS, "itself": "obj", "robot": "isRobot", "sensing": "isSensor",
    }  # fmt: skip

    def keys(self, where: Where) -> Iterable[int]:
        number, name = where.equal("id"), where.equal("name")
        if not where.keys().isdisjoint("xyz"):
            allowed = set(self.world.filter_by_position(where))
            found = [body for body in self.world.all() if body.GetEnvironmentId() in allowed]
        else:
            found = self.world.all()
        for body in found:
            known = int(body.GetEnvironmentId())
            if number in (None, known) and name in (None, str(body.GetName())):
                yield known

    def thing(self, key: Any) -> Any:
        return self.world.thing(key)

    def geometries(self, key: Any) -> list[Any]:
        return [geometry for link in self.world.thing(key).GetLinks() for geometry in link.GetGeometries()]

    def itself(self, key: int) -> Any:
        self.thing(key)  # which must exist
        return self.element(key)

    def motion(self, key: Any) -> list[float]:
        return _floats(self.world.thing(key).GetLinkVelocities()[0])  # the first link carries the body's pose

    def weight(self, key: int) -> float:
        return float(sum(link.GetMass() for link in self.world.thing(key).GetLinks()))

    def robot(self, key: int) -> bool:
        return bool(self.world.thing(key).IsRobot())

    def sensing(self, key: int) -> bool:
        body = self.world.thing(key)
        return bool(body.IsRobot() and len(body.GetAttachedSensors()))


class Links(_Solids):
    name = "links"
    text = "the rigid parts that bodies consist of"
    columns = (
        Column("body", int, "", "the id of its body"),
        Column("number", int, "", "its number within the body, from 0 on"),
        Column("name", str, "", "its name"),
        *(replace(column, filter="") for column in make_body_columns() if column.name in _LINK_COLUMNS),
    )
    groups: ClassVar[Mapping[str, str]] = {**_Solids.SOLIDS, "owner": "body number"}

    def keys(self, where: Where) -> Iterable[tuple[int, int]]:
        for body in self.world.all():
            for number in range(len(body.GetLinks())):
                yield int(body.GetEnvironmentId()), number

    def thing(self, key: tuple[int, int]) -> Any:
        return _part(self.world.thing(key[0]).GetLinks(), "link", key)

    def geometries(self, key: tuple[int, int]) -> list[Any]:
        return list(self.thing(key).GetGeometries())

    def owner(self, key: tuple[int, int]) -> tuple[int, int]:
        self.thing(key)  # which must exist
        return key

    def motion(self, key: Any) -> list[float]:
        return _floats(self.thing(key).GetVelocity())

    def weight(self, key: tuple[int, int]) -> float:
        return float(self.thing(key).GetMass())


class Joints(Table):
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
        "owner": "body", "kind": "name type", "state": "angle speed", "limits": "lower upper",
    }  # fmt: skip
    world: OpenRaveWorld

    def keys(self, where: Where) -> Iterable[tuple[int, int]]:
        for body in self.world.all():
            for number in range(len(body.GetJoints())):
                yield int(body.GetEnvironmentId()), number

    def joint(self, key: tuple[int, int]) -> Any:
        return _part(self.world.thing(key[0]).GetJoints(), "joint", key)

    def owner(self, key: tuple[int, int]) -> int:
        self.joint(key)  # which must exist
        return key[0]

    def kind(self, key: tuple[int, int]) -> tuple[str, str]:
        joint = self.joint(key)
        return str(joint.GetName()), joint.GetType().name.lower()

    def state(self, key: tuple[int, int]) -> tuple[float | None, float | None]:
        joint = self.joint(key)
        return _single(joint.GetValues()), _single(joint.GetVelocities())

    def limits(self, key: tuple[int, int]) -> tuple[float | None, float | None]:
        lower, upper = self.joint(key).GetLimits()
        return _single(lower), _single(upper)


class OpenRaveWorld(BodyWorld):
    """OpenRAVE: the bodies of an environment, their links and joints.

    Args:
        source: the `openravepy.Environment`.
    """

    tables = (Bodies, Links, Joints, Closest, Near, Overlaps)
    serves: ClassVar[Sequence[str]] = (
        "openravepy.openravepy_int.Environment",
        "openravepy._openravepy_.openravepy_int.Environment",
        "openravepy._openravepy_0_9.openravepy_int.Environment",
        "openravepy_int.Environment",
    )

    def __init__(self, source: Any) -> None:
        super().__init__(source)
        self.environment = source

    @property
    def time(self) -> float:
        return float(self.environment.GetSimulationTime()) / 1e6  # OpenRAVE counts microseconds

    def all(self) -> list[Any]:
        """All bodies, in the order of their numbers."""
        return sorted(self.environment.GetBodies(), key=lambda body: int(body.GetEnvironmentId()))

    def thing(self, key: Any) -> Any:
        """The body with a number. Raises Gone where there is none."""
        found = self.environment.GetBodyFromEnvironmentId(key)
        if found is None:
            raise make_gone_error("body", key)
        return found

    def positions(self) -> tuple[list[int], Any]:
        found = self.all()
        points = [pose(body.GetTransform())[1] for body in found]
        return [int(body.GetEnvironmentId()) for body in found], np.array(points, float).reshape(len(found), 3)

    def meets(self, one: int, other: int) -> bool:
        return bool(self.environment.CheckCollision(self.thing(one), self.thing(other)))

    def touching(self, body: int) -> bool:
        return bool(self.environment.CheckCollision(self.thing(body)))

    def would_touch(self, body: int, position: Vector, turn: Quaternion) -> bool:
        found = self.thing(body)
        with found:  # OpenRAVE restores its pose at the end
            self.put(body, position, turn)
            return bool(self.environment.CheckCollision(found))

    def gap(self, one: int, other: int) -> float:
        """Measured by the environment's collision checker, if that can."""
        openravepy, checker = import_module("openravepy"), self.environment.GetCollisionChecker()
        before, report = checker.GetCollisionOptions(), openravepy.CollisionReport()
        if not checker.SetCollisionOptions(openravepy.CollisionOptions.Distance):
            checker.SetCollisionOptions(before)
            hints = ('env.SetCollisionChecker(openravepy.RaveCreateCollisionChecker(env, "pqp"))',)
            raise ExecutionError("X007", "the collision checker of the environment measures no distances", hints=hints)
        try:
            touch = self.environment.CheckCollision(self.thing(one), self.thing(other), report)
            return 0.0 if touch else float(report.minDistance)
        finally:
            checker.SetCollisionOptions(before)

    def put(self, body: int, position: Vector, turn: Quaternion) -> None:
        x, y, z, w = turn
        self.thing(body).SetTransform(np.array([w, x, y, z, *position]))


def pose(transform: Any) -> tuple[tuple[float, ...], Vector]:
    """The quaternion of a transform, the real part first, and its position."""
    values = np.asarray(transform, float)
    is_list = values.shape == (7,)
    x, y, z = (values[4:] if is_list else values[:3, 3]).tolist()
    return tuple(values[:4].tolist()) if is_list else _quaternion(values[:3, :3]), (x, y, z)


def _quaternion(matrix: NDArray[Any]) -> tuple[float, ...]:
    """The quaternion of a rotation matrix, from its largest part, which rounding affects least."""
    xx, yy, zz = np.diag(matrix)
    squares = np.array([1 + xx + yy + zz, 1 + xx - yy - zz, 1 - xx + yy - zz, 1 - xx - yy + zz])
    a, b, c = matrix[2, 1] - matrix[1, 2], matrix[0, 2] - matrix[2, 0], matrix[1, 0] - matrix[0, 1]
    d, e, f = matrix[0, 1] + matrix[1, 0], matrix[0, 2] + matrix[2, 0], matrix[1, 2] + matrix[2, 1]
    largest = int(np.argmax(squares))
    found = np.array(
        [[squares[0], a, b, c], [a, squares[1], d, e], [b, d, squares[2], f], [c, e, f, squares[3]]][largest]
    )
    return tuple((found / np.linalg.norm(found)).tolist())


def shape_of(geometry: Any) -> str:
    """The shape of a geometry of a link."""
    return _SHAPES.get(geometry.GetType().name.lower(), "ghost")


def _volume(geometry: Any) -> float | None:
    match shape_of(geometry):
        case "sphere":
            return float(4 / 3 * pi * geometry.GetSphereRadius() ** 3)
        case "box":
            return float(8 * np.prod(geometry.GetBoxExtents()))
        case "cylinder":
            return float(pi * geometry.GetCylinderRadius() ** 2 * geometry.GetCylinderHeight())
    return None


def _floats(values: Any) -> list[float]:
    return [float(value) for value in values]


def _single(values: Any) -> float | None:
    return float(values[0]) if len(values) == 1 else None


def _part(parts: Sequence[Any], what: str, key: tuple[int, int]) -> Any:
    if key[1] >= len(parts):
        raise make_gone_error(what, key)
    return parts[key[1]]

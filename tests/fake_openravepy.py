"""A stand-in for the documented interface of openravepy, as far as the adapter uses it: boxes, spheres, and links.

Bodies stand still, and boxes are not turned when collisions are looked for. It is no simulator, only as much of one
as it takes to run the adapter where OpenRAVE cannot be installed.
"""

# ruff: noqa: N802, N815 - the names are OpenRAVE's

from __future__ import annotations

from collections.abc import Callable
from enum import Enum, IntFlag
from math import dist
from typing import Any

import numpy as np

GeometryType = Enum("GeometryType", ["Box", "Sphere", "Cylinder", "Trimesh"])
JointType = Enum("JointType", ["Revolute", "Spherical"])


class CollisionOptions(IntFlag):
    Distance = 1
    Contacts = 4


class CollisionReport:
    minDistance = 1e20


def gives(get: Callable[[Any], Any]) -> Any:
    """A method without arguments."""
    return lambda self: get(self)


class AABB:
    def __init__(self, pos: Any, extents: Any) -> None:
        self.middle, self.half = np.array(pos, float), np.array(extents, float)

    pos = gives(lambda box: box.middle)
    extents = gives(lambda box: box.half)


def matrix(pose: Any) -> Any:
    """The 4 x 4 matrix of a pose [qw, qx, qy, qz, x, y, z]."""
    w, x, y, z = pose[:4] / np.linalg.norm(pose[:4])
    found = np.eye(4)
    found[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    found[:3, 3] = pose[4:]
    return found


class Geometry:
    def __init__(self, kind: Any, *size: float) -> None:
        self.kind, self.size = kind, size

    GetType = gives(lambda geometry: geometry.kind)
    GetSphereRadius = GetCylinderRadius = gives(lambda geometry: geometry.size[0])
    GetBoxExtents = gives(lambda geometry: np.array(geometry.size))
    GetCylinderHeight = gives(lambda geometry: geometry.size[1])


class Link:
    def __init__(self, name: str, mass: float, geometry: Geometry, offset: Any = (0, 0, 0)) -> None:
        self.name, self.mass, self.geometry, self.offset = name, mass, geometry, np.array(offset, float)
        self.velocity = np.zeros(6)
        self.body: Any = None

    GetName = gives(lambda link: link.name)
    GetMass = gives(lambda link: link.mass)
    GetGeometries = gives(lambda link: [link.geometry])
    GetVelocity = gives(lambda link: link.velocity)
    IsEnabled = gives(lambda link: True)

    GetTransform = gives(lambda link: matrix(link.GetTransformPose()))

    def GetTransformPose(self) -> Any:
        found = self.body.GetTransformPose()
        found[4:] += self.body.GetTransform()[:3, :3] @ self.offset
        return found

    def ComputeAABB(self) -> AABB:
        transform = self.GetTransform()
        half = self.geometry.size * 3 if self.geometry.kind is GeometryType.Sphere else self.geometry.size
        if self.geometry.kind is GeometryType.Box:
            half = np.abs(transform[:3, :3]) @ half
        return AABB(transform[:3, 3], half)


class Joint:
    def __init__(self, name: str, kind: Any, values: list[float]) -> None:
        self.name, self.kind, self.values = name, kind, values

    GetName = gives(lambda joint: joint.name)
    GetType = gives(lambda joint: joint.kind)
    GetValues = gives(lambda joint: np.array(joint.values))
    GetVelocities = gives(lambda joint: np.zeros(len(joint.values)))
    GetLimits = gives(lambda joint: (np.full(len(joint.values), -1.0), np.full(len(joint.values), 2.0)))


class KinBody:
    def __init__(self, name: str, links: list[Link], joints: list[Joint] | None = None, robot: bool = False) -> None:
        self.name, self.links, self.joints, self.robot = name, links, joints or [], robot
        self.pose, self.number = np.eye(7)[0], 0
        self._saved: list[Any] = []
        for link in links:
            link.body = self

    GetEnvironmentId = gives(lambda body: body.number)
    GetName = gives(lambda body: body.name)
    GetTransform = gives(lambda body: matrix(body.pose))
    GetTransformPose = gives(lambda body: body.pose.copy())
    GetLinks = gives(lambda body: list(body.links))
    GetJoints = gives(lambda body: list(body.joints))
    GetLinkVelocities = gives(lambda body: np.array([link.GetVelocity() for link in body.links]))
    IsRobot = gives(lambda body: body.robot)
    GetAttachedSensors = gives(lambda body: ["laser"] if body.robot else [])
    IsEnabled = gives(lambda body: True)
    __enter__ = gives(lambda body: body._saved.append(body.pose))

    def __exit__(self, *error: object) -> None:
        self.pose = self._saved.pop()

    def SetTransform(self, pose: Any) -> None:
        self.pose = np.array(pose, float)

    def ComputeAABB(self) -> AABB:
        boxes = [link.ComputeAABB() for link in self.links]
        low = np.min([box.pos() - box.extents() for box in boxes], axis=0)
        high = np.max([box.pos() + box.extents() for box in boxes], axis=0)
        return AABB((low + high) / 2, (high - low) / 2)


def between(one: Link, other: Link) -> float:
    """The distance of boxes along the axes, and of spheres."""
    first, second = (link.GetTransform()[:3, 3] for link in (one, other))
    half, radius = np.zeros(3), 0.0
    for link in (one, other):
        if link.geometry.kind is GeometryType.Sphere:
            radius += link.geometry.size[0]
        else:
            half += link.geometry.size
    return dist(np.maximum(np.abs(first - second) - half, 0), (0, 0, 0)) - radius


class CollisionChecker:
    def __init__(self) -> None:
        self.options = 0
        self.measures = True

    GetCollisionOptions = gives(lambda checker: checker.options)

    def SetCollisionOptions(self, options: int) -> bool:
        self.options = int(options)
        return self.measures or not options & CollisionOptions.Distance


class Environment:
    def __init__(self) -> None:
        self.bodies: list[KinBody] = []
        self.births = self.microseconds = 0
        self.checker = CollisionChecker()

    GetBodies = gives(lambda environment: list(reversed(environment.bodies)))
    GetSimulationTime = gives(lambda environment: environment.microseconds)
    GetCollisionChecker = gives(lambda environment: environment.checker)

    def Add(self, body: KinBody) -> None:
        self.births += 1
        body.number = self.births
        self.bodies.append(body)

    def Remove(self, body: KinBody) -> None:
        self.bodies.remove(body)

    def GetBodyFromEnvironmentId(self, number: int) -> KinBody | None:
        return next((body for body in self.bodies if body.number == number), None)

    def CheckCollision(
        self, body: KinBody, other: KinBody | None = None, report: CollisionReport | None = None
    ) -> bool:
        others = [other] if other is not None else [one for one in self.bodies if one is not body]
        least = min(between(a, b) for one in others for a in body.links for b in one.links)
        if report is not None and self.checker.options & CollisionOptions.Distance:
            report.minDistance = max(least, 0.0)
        return least <= 0


Environment.__module__ = "openravepy.openravepy_int"  # where the real one is

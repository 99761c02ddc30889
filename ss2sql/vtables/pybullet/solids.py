"""The solids of scenes, as Bullet's collision shapes and as meshes that look round in pictures."""

from __future__ import annotations

from collections.abc import Iterable
from math import hypot, pi
from typing import Any

import numpy as np

from ss2sql.fast_dataclasses import dataclass
from ss2sql.vtables.pybullet.client import import_pybullet

Vector = tuple[float, float, float]
Colour = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Sphere:
    radius: float


@dataclass(frozen=True, slots=True)
class Box:
    """A box of these edge lengths."""

    x: float
    y: float
    z: float


@dataclass(frozen=True, slots=True)
class Cylinder:
    radius: float
    length: float


@dataclass(frozen=True, slots=True)
class Capsule:
    """A cylinder with half a sphere at both ends; `length` is that of the cylinder."""

    radius: float
    length: float


@dataclass(frozen=True, slots=True)
class Plane:
    """The half space under an endless plane; pictures show a square of it, only from its front."""

    normal: Vector
    side: float


Solid = Sphere | Box | Cylinder | Capsule | Plane


def measure_reach(solid: Solid) -> float:
    """The radius of a sphere around a solid."""
    match solid:
        case Sphere(radius):
            return radius
        case Box(x, y, z):
            return hypot(x, y, z) / 2
        case Cylinder(radius, length):
            return hypot(radius, length / 2)
        case Capsule(radius, length):
            return radius + length / 2
        case Plane():
            return float("inf")


def make_collision_shape(client: Any, solid: Solid) -> int:
    bullet = import_pybullet()
    match solid:
        case Sphere(radius):
            return int(client.createCollisionShape(bullet.GEOM_SPHERE, radius=radius))
        case Box(x, y, z):
            return int(client.createCollisionShape(bullet.GEOM_BOX, halfExtents=(x / 2, y / 2, z / 2)))
        case Cylinder(radius, length):
            return int(client.createCollisionShape(bullet.GEOM_CYLINDER, radius=radius, height=length))
        case Capsule(radius, length):
            return int(client.createCollisionShape(bullet.GEOM_CAPSULE, radius=radius, height=length))
        case Plane(normal):
            return int(client.createCollisionShape(bullet.GEOM_PLANE, planeNormal=normal))


def make_visual_shape(client: Any, solid: Solid, colour: Colour) -> int:
    """The visual shape of a solid: a mesh, since Bullet's own round shapes have a dozen corners."""
    bullet, rgba = import_pybullet(), (*colour, 1.0)
    if isinstance(solid, Box):
        half = (solid.x / 2, solid.y / 2, solid.z / 2)
        return int(client.createVisualShape(bullet.GEOM_BOX, halfExtents=half, rgbaColor=rgba))
    vertices, normals, indices = (
        _make_square(solid) if isinstance(solid, Plane) else _revolve_outline(_make_outline(solid))
    )
    return int(
        client.createVisualShape(
            bullet.GEOM_MESH, vertices=vertices, normals=normals, indices=indices, rgbaColor=rgba,
            specularColor=(0.2, 0.2, 0.2),
        )
    )  # fmt: skip


Mesh = tuple[list[list[float]], list[list[float]], list[int]]
Outline = list[tuple[float, float, float, float]]


def _make_outline(solid: Sphere | Cylinder | Capsule) -> Outline:
    """Half the cross section of a round solid from top to bottom: radius and height, then the normal."""
    match solid:
        case Cylinder(radius, length):
            top, bottom = length / 2, -length / 2
            return [
                (0.0, top, 0.0, 1.0), (radius, top, 0.0, 1.0), (radius, top, 1.0, 0.0),
                (radius, bottom, 1.0, 0.0), (radius, bottom, 0.0, -1.0), (0.0, bottom, 0.0, -1.0),
            ]  # fmt: skip
        case Sphere(radius):
            return _make_arc(radius, 0.0, np.linspace(0, pi, 13 if radius > 0.1 else 9))
        case Capsule(radius, length):
            upper = _make_arc(radius, length / 2, np.linspace(0, pi / 2, 7))
            return upper + _make_arc(radius, -length / 2, np.linspace(pi / 2, pi, 7))


def _make_arc(radius: float, height: float, angles: Iterable[float]) -> Outline:
    normals = [(float(np.sin(angle)), float(np.cos(angle))) for angle in angles]
    return [(radius * x, height + radius * z, x, z) for x, z in normals]


def _revolve_outline(outline: Outline) -> Mesh:
    """The solid of revolution of an outline around the z axis."""
    slices = 2 * len(outline) if len(outline) > 6 else 24
    angles = np.linspace(0, 2 * pi, slices + 1)
    radius, height, normal_radius, normal_height = np.array(outline).T[:, :, None]
    across, up = np.cos(angles), np.sin(angles)
    level = np.ones_like(angles)
    vertices = np.stack((radius * across, radius * up, height * level), axis=-1).reshape(-1, 3)
    normals = np.stack((normal_radius * across, normal_radius * up, normal_height * level), axis=-1).reshape(-1, 3)
    corner = (np.arange(len(outline) - 1)[:, None] * (slices + 1) + np.arange(slices)).ravel()
    below = corner + slices + 1
    indices = np.stack((corner, below, corner + 1, corner + 1, below, below + 1), axis=-1).ravel()
    return vertices.tolist(), normals.tolist(), indices.tolist()


def _make_square(plane: Plane) -> Mesh:
    normal = np.array(plane.normal)
    first = np.roll(normal, 1)  # at right angles to it: the planes of scenes follow the axes
    second = np.cross(normal, first)
    half = plane.side / 2
    corners = [half * (a * first + b * second) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return [corner.tolist() for corner in corners], [normal.tolist()] * 4, [0, 1, 2, 0, 2, 3]

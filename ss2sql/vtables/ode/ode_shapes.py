"""The geoms of ODE: their shapes, their sizes, and where they are."""

from __future__ import annotations

from math import pi
from typing import Any

import numpy as np

from ss2sql.errors import ExecutionError
from ss2sql.vtables.body_columns import Quaternion, Vector
from ss2sql.vtables.ode import convex_distance

_SHAPES = {
    "GeomSphere": "sphere", "GeomBox": "box", "GeomCapsule": "capsule", "GeomCCylinder": "capsule",
    "GeomCylinder": "cylinder", "GeomPlane": "plane", "GeomTriMesh": "mesh", "GeomHeightfield": "terrain",
    "GeomRay": "ray",
}  # fmt: skip
_SOLIDS = ("sphere", "box", "capsule", "cylinder")


def name_shape(geom: Any) -> str:
    """The kind of a geom's shape; of a GeomTransform that of the geom in it."""
    kind = type(geom).__name__
    if kind == "GeomTransform":
        inner = geom.getGeom()
        return "ghost" if inner is None else name_shape(inner)
    return _SHAPES.get(kind, "ghost")


def read_geom_size(geom: Any) -> tuple[float, ...]:
    """Radius, edges, or radius and length."""
    match name_shape(geom):
        case "sphere":
            return (geom.getRadius(),)
        case "box":
            return tuple(geom.getLengths())
        case _:
            return tuple(geom.getParams())


def read_position(geom: Any) -> Vector:
    """Where a geom is; of a plane the point next to the origin."""
    if geom.placeable():
        position: Vector = geom.getPosition()
        return position
    (a, b, c), offset = geom.getParams()
    return a * offset, b * offset, c * offset


def read_turn(geom: Any) -> Quaternion:
    """How a geom is turned: x, y, z, w. ODE's quaternions begin with the real part."""
    if not geom.placeable():
        return 0.0, 0.0, 0.0, 1.0
    w, x, y, z = geom.getQuaternion()
    return x, y, z, w


def compute_volume(geom: Any) -> float | None:
    """The volume of a geom, if it has one that can be computed."""
    if type(geom).__name__ == "GeomTransform":
        return None if geom.getGeom() is None else compute_volume(geom.getGeom())
    match name_shape(geom), read_geom_size(geom) if name_shape(geom) in _SOLIDS else ():
        case "sphere", (radius,):
            return 4 / 3 * pi * radius**3
        case "box", (x, y, z):
            return x * y * z
        case "capsule", (radius, length):
            return 4 / 3 * pi * radius**3 + pi * radius**2 * length
        case "cylinder", (radius, length):
            return pi * radius**2 * length
    return None


def make_convex(geom: Any) -> convex_distance.Convex:
    """A geom as a solid whose distances can be computed."""
    kind = name_shape(geom)
    axes, place = np.array(geom.getRotation()).reshape(3, 3), np.array(geom.getPosition())
    if type(geom).__name__ == "GeomTransform":
        geom = geom.getGeom()
        place = place + axes @ np.array(geom.getPosition())
        axes = axes @ np.array(geom.getRotation()).reshape(3, 3)
    if kind not in _SOLIDS:
        raise ExecutionError("X007", f"the distance of a {kind} cannot be computed", hints=("ask for `contacts`",))
    return convex_distance.make_convex(kind, read_geom_size(geom), place.tolist(), axes)

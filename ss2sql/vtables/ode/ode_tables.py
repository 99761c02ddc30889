"""The tables of ODE, its geoms, and the distance of convex solids.

A solid is a core (a point, a line, a box or a disc that is drawn out to a cylinder) with a layer of constant thickness
around it. The distance of two cores is found by the method of Gilbert, Johnson and Keerthi: the point of their
Minkowski difference that is nearest to the origin, approximated by simplices.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from ss2sql.errors import ExecutionError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.vtables.body_functions import (
    PAIR,
    PLACES,
    VECTOR,
    Posed,
    Quaternion,
    RequestedPairs,
    Vector,
    clip_body_corner,
    compute_solid_volume,
    make_body_columns,
)
from ss2sql.vtables.contract import Column, TableFunction, Where

if TYPE_CHECKING:
    from ss2sql.vtables.ode import OdeWorld


Array = NDArray[np.float64]
PRECISION = 1e-12  # of the squared distance, relative; cores that are nearer than 1e-9 touch
MOST_ROUNDS = 200  # cylinders need up to 30


@dataclass(frozen=True, slots=True)
class Convex:
    """A solid in space. `axes` has its axes as columns, `half` the half edges of the core along them.

    With `disc` the core is round: `disc` is its radius, and only the third number of `half` counts.
    """

    centre: Array
    axes: Array
    half: Array
    layer: float = 0.0
    disc: float = 0.0

    def find_support_point(self, direction: Array) -> Array:
        """The support point of the core: the furthest one in a direction."""
        along = direction @ self.axes
        local = np.where(along >= 0, self.half, -self.half)
        if self.disc:
            across = float(np.hypot(along[0], along[1]))
            local[:2] = along[:2] * (self.disc / across) if across > 0 else (self.disc, 0.0)
        found: Array = self.centre + self.axes @ local
        return found


def make_convex(kind: str, size: Sequence[float], centre: Sequence[float], axes: Array) -> Convex:
    """A sphere (radius), box (three edges), capsule or cylinder (radius, length along the third axis)."""
    place = np.asarray(centre, float)
    match kind:
        case "sphere":
            return Convex(place, axes, np.zeros(3), layer=size[0])
        case "box":
            return Convex(place, axes, np.asarray(size, float) / 2)
        case "capsule":
            return Convex(place, axes, np.array([0.0, 0.0, size[1] / 2]), layer=size[0])
        case "cylinder":
            return Convex(place, axes, np.array([0.0, 0.0, size[1] / 2]), disc=size[0])
    raise ValueError(f"a {kind} has no distance that could be computed")


def measure_geom_distance(one: Convex, other: Convex) -> float:
    """The shortest distance of two solids; 0 where the cores touch, less where only the layers overlap."""
    return _measure_core_distance(one, other) - one.layer - other.layer


def measure_distance_to_plane(one: Convex, normal: Sequence[float], offset: float) -> float:
    """How far a solid is above the plane of all points with `normal @ point == offset`."""
    up = np.asarray(normal, float)
    return float(one.find_support_point(-up) @ up) - offset - one.layer


def _measure_core_distance(one: Convex, other: Convex) -> float:
    nearest = one.find_support_point(other.centre - one.centre) - other.find_support_point(one.centre - other.centre)
    simplex = [nearest]
    for _ in range(MOST_ROUNDS):
        square = float(nearest @ nearest)
        if square < 1e-18:
            return 0.0
        point = one.find_support_point(-nearest) - other.find_support_point(nearest)
        if square - float(nearest @ point) <= PRECISION * square or any(np.array_equal(point, p) for p in simplex):
            break  # nothing lies nearer to the origin in this direction
        nearest, simplex = _find_nearest_point([*simplex, point])
        if len(simplex) == 4:
            return 0.0  # the origin lies inside a tetrahedron
    return float(np.sqrt(nearest @ nearest))


def _find_nearest_point(points: list[Array]) -> tuple[Array, list[Array]]:
    """The point of a simplex nearest to the origin, and the corners that it lies between."""
    best, corners = points[-1], points[-1:]
    least = float(best @ best)
    for count in range(1, len(points) + 1):
        for chosen in combinations(points, count):
            found = _project_origin(chosen)
            if found is not None and float(found @ found) < least:
                best, corners, least = found, list(chosen), float(found @ found)
    return best, corners


def _project_origin(points: tuple[Array, ...]) -> Array | None:
    """The foot of the perpendicular from the origin, if it lies between the points."""
    first = points[0]
    if len(points) == 1:
        return first
    edges = np.array([point - first for point in points[1:]])
    gram = edges @ edges.T
    if abs(np.linalg.det(gram)) < 1e-14 * float(np.prod(np.diag(gram))) or not np.all(np.diag(gram)):
        return None  # the points lie in a line, or in a plane: fewer of them suffice
    weights = np.linalg.solve(gram, -edges @ first)
    if np.any(weights < 0) or weights.sum() > 1:
        return None
    foot: Array = first + weights @ edges
    return foot


# --- the geoms of ODE: their shapes, their sizes, and where they are
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
    kind = name_shape(geom)
    return compute_solid_volume(kind, *read_geom_size(geom)) if kind in _SOLIDS else None


def shape_geom(geom: Any) -> Convex:
    """A geom as a solid whose distances can be computed."""
    kind = name_shape(geom)
    axes, place = np.array(geom.getRotation()).reshape(3, 3), np.array(geom.getPosition())
    if type(geom).__name__ == "GeomTransform":
        geom = geom.getGeom()
        place = place + axes @ np.array(geom.getPosition())
        axes = axes @ np.array(geom.getRotation()).reshape(3, 3)
    if kind not in _SOLIDS:
        raise ExecutionError("X007", f"the distance of a {kind} cannot be computed", hints=("ask for `contacts`",))
    return make_convex(kind, read_geom_size(geom), place.tolist(), axes)


STILL = (0.0, 0.0, 0.0)


class OdeBodies(Posed):
    name, key = "bodies", "id"
    text = "the geoms of the space, with what their bodies add"
    columns = make_body_columns(without="isRobot isSensor")
    places = PLACES
    groups: ClassVar[Mapping[str, str]] = {
        **Posed.PLACED, "read_name": "name", "read_element": "obj", "read_force": "force", "read_torque": "torque",
        "read_mass": "mass", "read_volume": "volume", "read_box": "aabb", "is_touchable": "isEnabled",
        "is_movable": "hasBody",
    }  # fmt: skip
    world: OdeWorld

    def keys(self, where: Where) -> Iterable[int]:
        return self.world.filter_bodies(where)

    def get_geom(self, key: Any) -> Any:
        return self.world.get_geom(key)

    def read_name(self, key: int) -> str:
        """The attribute `name` of the geom, or of its body; else its shape and number."""
        geom = self.get_geom(key)
        body = geom.getBody()
        name = getattr(geom, "name", None) or (None if body is None else getattr(body, "name", None))
        return str(name) if name else f"{name_shape(geom)}_{key}"

    def read_element(self, key: int) -> Any:
        self.get_geom(key)  # raises Gone
        return self.element(key)

    def read_kind(self, key: Any) -> str:
        return name_shape(self.get_geom(key))

    def read_position(self, key: Any) -> Vector:
        return read_position(self.get_geom(key))

    def read_turn(self, key: Any) -> Quaternion:
        return read_turn(self.get_geom(key))

    def read_velocity(self, key: Any) -> Vector:
        return self._read_from_body(key, "getLinearVel")

    def read_spin(self, key: Any) -> Vector:
        return self._read_from_body(key, "getAngularVel")

    def read_force(self, key: int) -> Vector:
        return self._read_from_body(key, "getForce")

    def read_torque(self, key: int) -> Vector:
        return self._read_from_body(key, "getTorque")

    def _read_from_body(self, key: int, method: str) -> Vector:
        body = self.get_geom(key).getBody()
        return STILL if body is None else getattr(body, method)()

    def read_mass(self, key: int) -> float:
        body = self.get_geom(key).getBody()
        return 0.0 if body is None else float(body.getMass().mass)

    def read_volume(self, key: int) -> float | None:
        return compute_volume(self.get_geom(key))

    def read_box(self, key: int) -> tuple[Vector, Vector]:
        low_x, high_x, low_y, high_y, low_z, high_z = self.get_geom(key).getAABB()
        return clip_body_corner((low_x, low_y, low_z)), clip_body_corner((high_x, high_y, high_z))

    def is_touchable(self, key: int) -> bool:
        return bool(self.get_geom(key).isEnabled())

    def is_movable(self, key: int) -> bool:
        return self.get_geom(key).getBody() is not None


class OdeContacts(TableFunction):
    name = "contacts"
    text = "where bodies touch, as ode.collide finds it: all, those of body a, or those between a and b"
    columns = (
        *PAIR,
        Column("pos", VECTOR, "m", "where they touch"),
        Column("normal", VECTOR, "", "the direction from b to a"),
        Column("distance", float, "m", "between the surfaces: 0, or less where they reach into each other"),
    )
    world: OdeWorld

    def rows(self, a: Any = None, b: Any = None) -> Iterator[tuple[Any, ...]]:
        world = self.world
        requested, element = RequestedPairs(world, a, b), world.bodies.element
        for one, other in world.list_near_pairs():
            pair = requested.order_pair(one, other)
            if pair is not None:
                for contact in world.list_contacts(*pair):
                    place, normal, depth, _, _ = contact.getContactGeomParams()
                    yield (*map(element, pair), *pair, place, normal, -depth)

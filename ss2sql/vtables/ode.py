"""ODE, the Open Dynamics Engine, as a world: `ss.attach("space", space)` for an `ode.Space` of Debian's python3-pyode.

A space holds geoms, the shapes; most of them belong to a body, which has mass and velocity. There is no list of bodies
in ODE, so a row of the principal table is a geom with what its body adds, as in the paper. Neither have numbers in ODE:
each geom gets one when it is first seen, which it keeps as long as it lives.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from importlib import import_module
from math import inf, pi
from typing import Any, ClassVar
from weakref import WeakKeyDictionary, WeakValueDictionary

import numpy as np

from ss2sql.errors import ExecutionError
from ss2sql.vtables import convex
from ss2sql.vtables.base import Column, Table, TableFunction, Where
from ss2sql.vtables.bodies import (
    PLACES,
    POSITION,
    ROTATION,
    SHAPE,
    SPIN,
    VECTOR,
    VELOCITY,
    Vector,
    body_columns,
    euler,
    finite,
    gone,
    position_row,
    rotation_row,
    shape_row,
    spin_row,
    velocity_row,
)  # fmt: skip
from ss2sql.vtables.body_world import PAIR, BodyWorld, Closest, Near, Overlaps, Quaternion

STILL = (0.0, 0.0, 0.0)
UPRIGHT = (1.0, 0.0, 0.0, 0.0)  # a quaternion of ODE, the real part first
_SHAPES = {
    "GeomSphere": "sphere", "GeomBox": "box", "GeomCapsule": "capsule", "GeomCCylinder": "capsule",
    "GeomCylinder": "cylinder", "GeomPlane": "plane", "GeomTriMesh": "mesh", "GeomHeightfield": "terrain",
    "GeomRay": "ray",
}  # fmt: skip


_COPIED = ("GeomSphere", "GeomBox", "GeomCapsule", "GeomCCylinder", "GeomCylinder")


class Numbers:
    """The numbers of the geoms of one space. It keeps no geom alive: ODE destroys one when Python forgets it."""

    def __init__(self) -> None:
        self.by_geom: WeakKeyDictionary[Any, int] = WeakKeyDictionary()
        self.by_number: WeakValueDictionary[int, Any] = WeakValueDictionary()
        self.next = 1

    def of(self, geom: Any) -> int:
        """The number of a geom."""
        known = self.by_geom.get(geom)
        if known is None:
            known = self.by_geom[geom] = self.next
            self.by_number[known] = geom
            self.next += 1
        return known


_numbers: WeakKeyDictionary[Any, Numbers] = WeakKeyDictionary()  # two sessions that attach a space see the same numbers


def shape_of(geom: Any) -> str:
    """The kind of a geom's shape; of a GeomTransform that of the geom in it."""
    kind = type(geom).__name__
    if kind == "GeomTransform":
        inner = geom.getGeom()
        return "ghost" if inner is None else shape_of(inner)
    return _SHAPES.get(kind, "ghost")


def size_of(geom: Any) -> tuple[float, ...]:
    """Radius, edges, or radius and length."""
    match shape_of(geom):
        case "sphere":
            return (geom.getRadius(),)
        case "box":
            return tuple(geom.getLengths())
        case _:
            return tuple(geom.getParams())


class Bodies(Table):
    name, key = "bodies", "id"
    text = "the geoms of the space, with what their bodies add"
    columns = body_columns(without="isRobot isSensor")
    places = PLACES
    groups: ClassVar[Mapping[str, str]] = {
        "called": "name", "itself": "obj", "shape": SHAPE, "place": POSITION, "turn": ROTATION, "angles": "rot",
        "speed": VELOCITY, "spin": SPIN, "pushed": "force", "turned": "torque", "weight": "mass", "size": "volume",
        "box": "aabb", "touchable": "isEnabled", "movable": "hasBody", "pose": "pose",
    }  # fmt: skip
    world: OdeWorld

    def keys(self, where: Where) -> Iterable[int]:
        number, name = where.equal("id"), where.equal("name")
        if number is not None:
            return [int(number)] if self.world.holds(number) else []
        found = sorted(self.world.found()) if where.keys().isdisjoint("xyz") else self.world.within_ranges(where)
        return found if name is None else [key for key in found if self.called(key) == name]

    def geom(self, key: Any) -> Any:
        return self.world.geom(key)

    def called(self, key: int) -> str:
        """The attribute `name` of the geom, or of its body; else its shape and number."""
        geom = self.geom(key)
        body = geom.getBody()
        given = getattr(geom, "name", None) or (None if body is None else getattr(body, "name", None))
        return str(given) if given else f"{shape_of(geom)}_{key}"

    def itself(self, key: int) -> Any:
        self.geom(key)  # which must exist
        return self.element(key)

    def shape(self, key: int) -> tuple[Any, ...]:
        return shape_row(shape_of(self.geom(key)))

    def place(self, key: int) -> tuple[Any, ...]:
        return position_row(*_position(self.geom(key)))

    def turn(self, key: int) -> tuple[Any, ...]:
        w, x, y, z = _quaternion(self.geom(key))
        return rotation_row(x, y, z, w)

    def angles(self, key: int) -> Vector:
        w, x, y, z = _quaternion(self.geom(key))
        return euler(x, y, z, w)

    def speed(self, key: int) -> tuple[Any, ...]:
        return velocity_row(self._of_body(key, "getLinearVel"))

    def spin(self, key: int) -> tuple[Any, ...]:
        return spin_row(self._of_body(key, "getAngularVel"))

    def pushed(self, key: int) -> Vector:
        return self._of_body(key, "getForce")

    def turned(self, key: int) -> Vector:
        return self._of_body(key, "getTorque")

    def _of_body(self, key: int, method: str) -> Vector:
        body = self.geom(key).getBody()
        return STILL if body is None else getattr(body, method)()

    def weight(self, key: int) -> float:
        body = self.geom(key).getBody()
        return 0.0 if body is None else float(body.getMass().mass)

    def size(self, key: int) -> float | None:
        return _volume(self.geom(key))

    def box(self, key: int) -> tuple[Vector, Vector]:
        low_x, high_x, low_y, high_y, low_z, high_z = self.geom(key).getAABB()
        return finite((low_x, low_y, low_z)), finite((high_x, high_y, high_z))

    def touchable(self, key: int) -> bool:
        return bool(self.geom(key).isEnabled())

    def pose(self, key: int) -> tuple[float, ...]:
        geom = self.geom(key)
        w, x, y, z = _quaternion(geom)
        return (*_position(geom), x, y, z, w)

    def movable(self, key: int) -> bool:
        return self.geom(key).getBody() is not None


class Contacts(TableFunction):
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
        wanted = [None if body is None else world.body(body) for body in (a, b)]
        for pair in world.near():
            for one, other in (pair, pair[::-1]):
                if wanted[0] in (None, one) and wanted[1] in (None, other):
                    elements = world.bodies.element(one), world.bodies.element(other)
                    for contact in world.touches(one, other):
                        place, normal, depth, _, _ = contact.getContactGeomParams()
                        yield (*elements, one, other, place, normal, -depth)
                    break


class OdeWorld(BodyWorld):
    """ODE: the geoms of a space and their bodies, and where they touch.

    Args:
        source: the `ode.Space`, of any kind; spaces within it belong to it.
        clock: gives the seconds of simulation, for `ode.World` keeps no time.
    """

    tables = (Bodies, Contacts, Closest, Near, Overlaps)
    serves: ClassVar[Sequence[str]] = ("ode.SpaceBase",)

    def __init__(self, source: Any, clock: Callable[[], float] | None = None) -> None:
        super().__init__(source)
        self.space = source
        self.clock = clock
        self.numbers = _numbers.setdefault(source, Numbers())

    @property
    def time(self) -> float | None:
        return None if self.clock is None else self.clock()

    # --- geoms by their numbers ------------------------------------------------------------------------

    def found(self) -> dict[int, Any]:
        """All geoms, by number. ODE changes their order in every step, so it is the numbers that order them."""
        walked = list(_walk(self.space))
        return {self.numbers.of(geom): geom for geom in reversed(walked)}  # a space gives its youngest geom first

    def geom(self, key: Any) -> Any:
        """The geom with a number. Raises Gone where it is none of this space any more."""
        geom = self.numbers.by_number.get(key)
        if geom is None or not self._holds(geom):
            raise gone("geom", key)
        return geom

    def holds(self, number: Any) -> bool:
        """Whether there is a geom with this number."""
        geom = self.numbers.by_number.get(number)
        if geom is None:
            return number in self.found()  # which may see it for the first time
        return self._holds(geom)

    def _holds(self, geom: Any) -> bool:
        # What getSpace says stays the same when a geom is removed, and of spaces within a space it is None.
        return bool(self.space.query(geom) or any(space.query(geom) for space in _spaces(self.space)))

    # --- collisions ------------------------------------------------------------------------------------

    def near(self) -> list[tuple[int, int]]:
        """The pairs of geoms whose boxes overlap and which may touch, ordered by number."""
        collide2, of = import_module("ode").collide2, self.numbers.of
        self.found()  # geoms that are new get their numbers in the order in which they were made
        pairs = set()

        def note(_: object, one: Any, other: Any) -> None:
            if one.isSpace() or other.isSpace():
                collide2(one, other, None, note)
            else:
                first, second = of(one), of(other)
                pairs.add((min(first, second), max(first, second)))

        for space in [self.space, *_spaces(self.space)]:
            space.collide(None, note)
        return sorted(pairs)

    def touches(self, one: int, other: int) -> list[Any]:
        """The contacts of two geoms."""
        found: list[Any] = import_module("ode").collide(self.geom(one), self.geom(other))
        return found

    def positions(self) -> tuple[list[int], Any]:
        found = self.found()
        ids = sorted(found)
        return ids, np.array([_position(found[number]) for number in ids], float).reshape(len(ids), 3)

    def touching(self, body: int) -> bool:
        self.geom(body)  # which must exist
        return any(body in pair and self.touches(*pair) for pair in self.near())

    def would_touch(self, body: int, position: Vector, turn: Quaternion) -> bool:
        """Tried out with a copy of the geom, for moving the geom itself would wake up its body."""
        ode, geom = import_module("ode"), self.geom(body)
        kind = type(geom).__name__
        if kind not in _COPIED:
            raise ExecutionError("X007", f"the pose of a {shape_of(geom)} cannot be tried out")
        size = (geom.getLengths(),) if kind == "GeomBox" else size_of(geom)
        copy = getattr(ode, kind)(None, *size)
        x, y, z, w = turn
        copy.setPosition(position)
        copy.setQuaternion((w, x, y, z))
        owner = geom.getBody()
        for other in self.found().values():
            mine = other is geom or (owner is not None and other.getBody() is owner)
            if not mine and other.isEnabled() and _may_touch(geom, other) and ode.collide(copy, other):
                return True
        return False

    def meets(self, one: int, other: int) -> bool:
        return bool(self.touches(one, other))

    def gap(self, one: int, other: int) -> float:
        """Exact for spheres, boxes, capsules, cylinders and planes; ODE itself knows only whether geoms touch.

        It is 0 where they touch, and infinite between two planes.
        """
        if self.touches(one, other):
            return 0.0
        first, second = self.geom(one), self.geom(other)
        if shape_of(first) == "plane":
            first, second = second, first
        if shape_of(first) == "plane":
            return inf
        if shape_of(second) == "plane":
            return convex.distance_to_plane(_solid(first), *second.getParams())
        return convex.distance(_solid(first), _solid(second))

    def put(self, body: int, position: Vector, turn: Quaternion) -> None:
        geom = self.geom(body)
        if not geom.placeable():
            raise ExecutionError("X007", f"the {shape_of(geom)} {self.column(body, 'name')} cannot be moved")
        x, y, z, w = turn
        moved = geom if geom.getBody() is None else geom.getBody()
        moved.setPosition(position)
        moved.setQuaternion((w, x, y, z))


def _walk(space: Any) -> Iterator[Any]:
    """The geoms of a space and of the spaces in it."""
    for geom in space:
        if geom.isSpace():
            yield from _walk(geom)
        else:
            yield geom


def _spaces(space: Any) -> Iterator[Any]:
    """The spaces in a space."""
    for geom in space:
        if geom.isSpace():
            yield geom
            yield from _spaces(geom)


def _may_touch(one: Any, other: Any) -> bool:
    """Whether the categories of two geoms let them collide, by the rule of ODE."""
    forth = one.getCategoryBits() & other.getCollideBits()
    back = other.getCategoryBits() & one.getCollideBits()
    return bool(forth or back)


def _position(geom: Any) -> Vector:
    """Where a geom is; of a plane the point next to the origin."""
    if geom.placeable():
        position: Vector = geom.getPosition()
        return position
    (a, b, c), offset = geom.getParams()
    return a * offset, b * offset, c * offset


def _quaternion(geom: Any) -> tuple[float, float, float, float]:
    if not geom.placeable():
        return UPRIGHT
    found: tuple[float, float, float, float] = geom.getQuaternion()
    return found


def _volume(geom: Any) -> float | None:
    if type(geom).__name__ == "GeomTransform":
        return None if geom.getGeom() is None else _volume(geom.getGeom())
    match shape_of(geom), size_of(geom) if shape_of(geom) in ("sphere", "box", "capsule", "cylinder") else ():
        case "sphere", (radius,):
            return 4 / 3 * pi * radius**3
        case "box", (x, y, z):
            return x * y * z
        case "capsule", (radius, length):
            return 4 / 3 * pi * radius**3 + pi * radius**2 * length
        case "cylinder", (radius, length):
            return pi * radius**2 * length
    return None


def _solid(geom: Any) -> convex.Convex:
    """A geom as a solid whose distances can be computed."""
    kind = shape_of(geom)
    axes, place = np.array(geom.getRotation()).reshape(3, 3), np.array(geom.getPosition())
    if type(geom).__name__ == "GeomTransform":
        geom = geom.getGeom()
        place = place + axes @ np.array(geom.getPosition())
        axes = axes @ np.array(geom.getRotation()).reshape(3, 3)
    if kind not in ("sphere", "box", "capsule", "cylinder"):
        raise ExecutionError("X007", f"the distance of a {kind} cannot be computed", hints=("ask for `contacts`",))
    return convex.solid(kind, size_of(geom), place.tolist(), axes)

"""ODE, the Open Dynamics Engine, as a world: `ss.attach("space", space)` for an `ode.Space` of Debian's python3-pyode.

A space holds geoms, the shapes; most of them belong to a body, which has mass and velocity. There is no list of bodies
in ODE, so a row of the principal table is a geom with its body's columns, as in the paper. ODE has no numbers for them:
each geom gets one when it is first seen, for its lifetime.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from math import inf
from typing import Any, ClassVar
from weakref import WeakKeyDictionary, WeakValueDictionary

import numpy as np

from ss2sql.errors import ExecutionError
from ss2sql.vtables.body_columns import Quaternion, Vector, make_gone_error
from ss2sql.vtables.body_functions import BodyWorld, Closest, Near, Overlaps
from ss2sql.vtables.ode import convex_distance
from ss2sql.vtables.ode.ode_shapes import position_of, shape_of, size_of, solid_of
from ss2sql.vtables.ode.ode_tables import Bodies, Contacts

_COPIED = ("GeomSphere", "GeomBox", "GeomCapsule", "GeomCCylinder", "GeomCylinder")


class GeomNumbers:
    """The numbers of the geoms of one space, by weak references: ODE destroys a geom when Python frees it."""

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


_numbers: WeakKeyDictionary[Any, GeomNumbers] = WeakKeyDictionary()  # shared by all sessions


class OdeWorld(BodyWorld):
    """ODE: the geoms of a space and their bodies, and where they touch.

    Args:
        source: the `ode.Space`, of any kind; spaces within it belong to it.
        clock: gives the seconds of simulation, since `ode.World` has no clock.
    """

    tables = (Bodies, Contacts, Closest, Near, Overlaps)
    serves: ClassVar[Sequence[str]] = ("ode.SpaceBase",)

    def __init__(self, source: Any, clock: Callable[[], float] | None = None) -> None:
        super().__init__(source)
        self.space = source
        self.clock = clock
        self.numbers = _numbers.setdefault(source, GeomNumbers())

    @property
    def time(self) -> float | None:
        return None if self.clock is None else self.clock()

    def found(self) -> dict[int, Any]:
        """All geoms, ordered by number, since ODE changes their order in every step."""
        walked = list(_walk_geoms(self.space))
        return {self.numbers.of(geom): geom for geom in reversed(walked)}  # a space lists its newest geom first

    def geom(self, key: Any) -> Any:
        """The geom with a number. Raises Gone where it is none of this space any more."""
        geom = self.numbers.by_number.get(key)
        if geom is None or not self._holds(geom):
            raise make_gone_error("geom", key)
        return geom

    def holds(self, number: Any) -> bool:
        """Whether there is a geom with this number."""
        geom = self.numbers.by_number.get(number)
        if geom is None:
            return number in self.found()  # a new geom gets its number here
        return self._holds(geom)

    def _holds(self, geom: Any) -> bool:
        # getSpace is stale for a removed geom, and None for spaces within a space.
        return bool(self.space.query(geom) or any(space.query(geom) for space in _list_spaces(self.space)))

    def near(self) -> list[tuple[int, int]]:
        """The pairs of geoms whose boxes overlap and which may touch, ordered by number."""
        collide2, of = import_module("ode").collide2, self.numbers.of
        self.found()  # new geoms get their numbers in the order of their creation
        pairs = set()

        def note(_: object, one: Any, other: Any) -> None:
            if one.isSpace() or other.isSpace():
                collide2(one, other, None, note)
            else:
                first, second = of(one), of(other)
                pairs.add((min(first, second), max(first, second)))

        for space in [self.space, *_list_spaces(self.space)]:
            space.collide(None, note)
        return sorted(pairs)

    def touches(self, one: int, other: int) -> list[Any]:
        """The contacts of two geoms."""
        found: list[Any] = import_module("ode").collide(self.geom(one), self.geom(other))
        return found

    def positions(self) -> tuple[list[int], Any]:
        found = self.found()
        ids = sorted(found)
        return ids, np.array([position_of(found[number]) for number in ids], float).reshape(len(ids), 3)

    def touching(self, body: int) -> bool:
        self.geom(body)  # raises Gone
        return any(body in pair and self.touches(*pair) for pair in self.near())

    def would_touch(self, body: int, position: Vector, turn: Quaternion) -> bool:
        """Tests the pose with a copy of the geom, since moving the geom itself would wake up its body."""
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
        """Exact for spheres, boxes, capsules, cylinders and planes; ODE itself only tests whether geoms touch.

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
            return convex_distance.measure_distance_to_plane(solid_of(first), *second.getParams())
        return convex_distance.measure_distance(solid_of(first), solid_of(second))

    def put(self, body: int, position: Vector, turn: Quaternion) -> None:
        geom = self.geom(body)
        if not geom.placeable():
            raise ExecutionError("X007", f"the {shape_of(geom)} {self.column(body, 'name')} cannot be moved")
        x, y, z, w = turn
        moved = geom if geom.getBody() is None else geom.getBody()
        moved.setPosition(position)
        moved.setQuaternion((w, x, y, z))


def _walk_geoms(space: Any) -> Iterator[Any]:
    """The geoms of a space and of the spaces in it."""
    for geom in space:
        if geom.isSpace():
            yield from _walk_geoms(geom)
        else:
            yield geom


def _list_spaces(space: Any) -> Iterator[Any]:
    """The spaces in a space."""
    for geom in space:
        if geom.isSpace():
            yield geom
            yield from _list_spaces(geom)


def _may_touch(one: Any, other: Any) -> bool:
    """Whether the categories of two geoms let them collide, by ODE's rule."""
    forth = one.getCategoryBits() & other.getCollideBits()
    back = other.getCategoryBits() & one.getCollideBits()
    return bool(forth or back)

"""ODE, the Open Dynamics Engine, as a world: `ss.attach("space", space)` for an `ode.Space` of Debian's python3-pyode.

A space holds geoms, the shapes; most of them belong to a body, which has mass and velocity. There is no list of bodies
in ODE, so a row of the principal table is a geom with its body's columns, as in the paper. ODE has no numbers for them:
each geom gets one when it is first seen, for its lifetime.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from importlib import import_module
from math import inf
from typing import Any
from weakref import WeakKeyDictionary, WeakValueDictionary

import numpy as np

from ss2sql.errors import ExecutionError
from ss2sql.vtables.body_functions import (
    BodyWorld,
    Closest,
    Near,
    Overlaps,
    Quaternion,
    Vector,
    make_gone_error,
    refuse_margin,
)
from ss2sql.vtables.ode.ode_tables import (
    OdeBodies,
    OdeContacts,
    measure_distance_to_plane,
    measure_geom_distance,
    name_shape,
    read_geom_size,
    read_position,
    shape_geom,
)

_COPIED = ("GeomSphere", "GeomBox", "GeomCapsule", "GeomCCylinder", "GeomCylinder")


class GeomNumbers:
    """The numbers of the geoms of one space, by weak references: ODE destroys a geom when Python frees it."""

    def __init__(self) -> None:
        self.by_geom: WeakKeyDictionary[Any, int] = WeakKeyDictionary()
        self.by_number: WeakValueDictionary[int, Any] = WeakValueDictionary()
        self.next = 1

    def get_number(self, geom: Any) -> int:
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

    tables = (OdeBodies, OdeContacts, Closest, Near, Overlaps)

    def __init__(self, source: Any, clock: Callable[[], float] | None = None) -> None:
        super().__init__(source)
        self.space = source
        self.clock = clock
        self.numbers = _numbers.setdefault(source, GeomNumbers())

    @property
    def time(self) -> float | None:
        return None if self.clock is None else self.clock()

    def find_geoms(self) -> dict[int, Any]:
        """All geoms, ordered by number, since ODE changes their order in every step."""
        walked = [geom for geom in _walk_space(self.space) if not geom.isSpace()]
        return {self.numbers.get_number(geom): geom for geom in reversed(walked)}  # a space lists its newest geom first

    def get_geom(self, key: Any) -> Any:
        """The geom with a number. Raises Gone where it is none of this space any more."""
        geom = self.numbers.by_number.get(key)
        if geom is None or not self._is_in_space(geom):
            raise make_gone_error("geom", key)
        return geom

    def list_ids(self) -> list[int]:
        return sorted(self.find_geoms())

    def has_body(self, body: int) -> bool:
        geom = self.numbers.by_number.get(body)
        return body in self.find_geoms() if geom is None else self._is_in_space(geom)  # a new geom gets its number

    def _is_in_space(self, geom: Any) -> bool:
        # getSpace is stale for a removed geom, and None for spaces within a space.
        return bool(self.space.query(geom) or any(space.query(geom) for space in self._list_spaces()))

    def _list_spaces(self) -> list[Any]:
        return [geom for geom in _walk_space(self.space) if geom.isSpace()]

    def list_near_pairs(self) -> list[tuple[int, int]]:
        """The pairs of geoms whose boxes overlap and which may touch, ordered by number."""
        collide2, of = import_module("ode").collide2, self.numbers.get_number
        self.find_geoms()  # new geoms get their numbers in the order of their creation
        pairs = set()

        def note_pair(_: object, one: Any, other: Any) -> None:
            if one.isSpace() or other.isSpace():
                collide2(one, other, None, note_pair)
            else:
                first, second = of(one), of(other)
                pairs.add((min(first, second), max(first, second)))

        for space in [self.space, *self._list_spaces()]:
            space.collide(None, note_pair)
        return sorted(pairs)

    def list_contacts(self, one: int, other: int) -> list[Any]:
        found: list[Any] = import_module("ode").collide(self.get_geom(one), self.get_geom(other))
        return found

    def read_positions(self) -> tuple[list[int], Any]:
        found = self.find_geoms()
        ids = sorted(found)
        return ids, np.array([read_position(found[number]) for number in ids], float).reshape(len(ids), 3)

    def is_touching(self, body: int, margin: float = 0.0) -> bool:
        refuse_margin(margin, "ODE")
        self.get_geom(body)  # raises Gone
        return any(body in pair and self.list_contacts(*pair) for pair in self.list_near_pairs())

    def would_touch(self, body: int, position: Vector, turn: Quaternion, margin: float = 0.0) -> bool:
        """Tests the pose with a copy of the geom, since moving the geom itself would wake up its body."""
        refuse_margin(margin, "ODE")
        ode, geom = import_module("ode"), self.get_geom(body)
        kind = type(geom).__name__
        if kind not in _COPIED:
            raise ExecutionError("X007", f"the pose of a {name_shape(geom)} cannot be tried out")
        size = (geom.getLengths(),) if kind == "GeomBox" else read_geom_size(geom)
        copy = getattr(ode, kind)(None, *size)
        x, y, z, w = turn
        copy.setPosition(position)
        copy.setQuaternion((w, x, y, z))
        owner = geom.getBody()
        for other in self.find_geoms().values():
            mine = other is geom or (owner is not None and other.getBody() is owner)
            if not mine and other.isEnabled() and _can_touch(geom, other) and ode.collide(copy, other):
                return True
        return False

    def do_touch(self, one: int, other: int, margin: float = 0.0) -> bool:
        return super().do_touch(one, other, margin) if margin else bool(self.list_contacts(one, other))

    def measure_gap(self, one: int, other: int) -> float:
        """Exact for spheres, boxes, capsules, cylinders and planes; ODE itself only tests whether geoms touch.

        It is 0 where they touch, and infinite between two planes.
        """
        if self.list_contacts(one, other):
            return 0.0
        first, second = self.get_geom(one), self.get_geom(other)
        if name_shape(first) == "plane":
            first, second = second, first
        if name_shape(first) == "plane":
            return inf
        if name_shape(second) == "plane":
            return measure_distance_to_plane(shape_geom(first), *second.getParams())
        return measure_geom_distance(shape_geom(first), shape_geom(second))

    def put_body(self, body: int, position: Vector, turn: Quaternion) -> None:
        geom = self.get_geom(body)
        if not geom.placeable():
            raise ExecutionError("X007", f"the {name_shape(geom)} {self.read_column(body, 'name')} cannot be moved")
        x, y, z, w = turn
        moved = geom if geom.getBody() is None else geom.getBody()
        moved.setPosition(position)
        moved.setQuaternion((w, x, y, z))


def _walk_space(space: Any) -> Iterator[Any]:
    """The geoms and the spaces in a space, and in those."""
    for geom in space:
        yield geom
        if geom.isSpace():
            yield from _walk_space(geom)


def _can_touch(one: Any, other: Any) -> bool:
    """Whether the categories of two geoms let them collide, by ODE's rule."""
    forth = one.getCategoryBits() & other.getCollideBits()
    back = other.getCategoryBits() & one.getCollideBits()
    return bool(forth or back)

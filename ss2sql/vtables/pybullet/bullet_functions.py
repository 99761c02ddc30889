"""The functions of bodies that PyBullet implements itself; the others are those of all worlds of bodies."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import repeat
from math import cos, dist, hypot, radians
from typing import Any

import numpy as np

from ss2sql.vtables.body_columns import Quaternion, Vector
from ss2sql.vtables.body_functions import BodyWorld, make_parameter_error
from ss2sql.vtables.contract import Element, function
from ss2sql.vtables.pybullet.bodies import measure_box
from ss2sql.vtables.pybullet.links import read_link_pose
from ss2sql.vtables.pybullet.poses import Box


class BodyFunctions(BodyWorld):
    """The functions of a PyBullet world. A body is given by its element, its id or its name."""

    calls: Any
    sensors: Mapping[int, Any]

    def list_ids(self) -> list[int]:
        """The ids of all bodies, in their order. PyBullet shuffles them when bodies die."""
        ask, places = self.calls.get_numbered_call("getBodyUniqueId"), range(self.calls.getNumBodies())
        return sorted(map(ask, places, repeat(self.calls.number)))

    def read_positions(self) -> tuple[list[int], Any]:
        ids, where = self.list_ids(), self.calls.getBasePositionAndOrientation
        return ids, np.array([where(body)[0] for body in ids], dtype=float).reshape(len(ids), 3)

    def find_point(self, value: Any) -> Sequence[float]:
        """A point, given by coordinates, by a body or by a link."""
        if isinstance(value, (list, Element)):
            return super().find_point(value)
        known = self.memory.get("places")  # in a query that moves nothing
        if known is not None and type(value) is int and value in known.at:
            return known.at[value]  # type: ignore[no-any-return]
        return read_link_pose(self, (self.find_body(value), value[1] if isinstance(value, tuple) else -1))[0]

    def find_box(self, name: str, value: Any) -> Any:
        """A box, given by two opposite corners, or by a body with a box around it."""
        if isinstance(value, (list, Element)):
            return super().find_box(name, value)
        found: Box = measure_box(self, self.find_body(value))
        return found

    def read_pose(self, body: int) -> Any:
        """Where a body is, and how it is turned; a tenth of the time that its columns take."""
        return self.calls.getBasePositionAndOrientation(body)

    def put_body(self, body: int, position: Vector, turn: Quaternion) -> None:
        """Moves a body to a pose, where it stands still: PyBullet forgets its velocity."""
        self.calls.resetBasePositionAndOrientation(body, position, turn)

    @function
    def isSensing(self, sensor: Any, body: Any) -> bool:  # noqa: N802 - the paper's word
        """Whether a sensor sees a body: the middle of one of its links is in range, in its cone, and not hidden."""
        eye = self.sensors.get(self.find_body(sensor))
        if eye is None:
            raise make_parameter_error("isSensing", "a sensor", sensor)
        wanted = self.find_body(body)
        for link in range(-1, self.calls.getNumJoints(wanted)):
            low, high = self.calls.getAABB(wanted, link)
            middle = tuple((a + b) / 2 for a, b in zip(low, high, strict=True))
            if _is_in_cone(eye, middle) and self._is_open(eye.position, middle, wanted):
                return True
        return False

    def _is_open(self, start: Any, end: Any, wanted: int) -> bool:
        hit = self.calls.rayTest(start, end)[0][0]
        return hit in (-1, wanted)  # -1: a body without a shape, or hollow there, is seen if nothing hides it


def _is_in_cone(eye: Any, point: Any) -> bool:
    away = dist(eye.position, point)
    if away > eye.range:
        return False
    if away == 0:
        return True
    size = hypot(*eye.direction)
    along = sum((p - e) * d for p, e, d in zip(point, eye.position, eye.direction, strict=True))
    return bool(along / away / size >= cos(radians(eye.angle / 2)))

"""A spatial index of bodies for one query, so that neighbours are found without the simulator.

PyBullet's own search, `getOverlappingObjects`, misses bodies: those without collision shapes, those with a centre
outside of their shape, and, until the next step, those that the last step moved.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from math import dist, floor
from typing import Any

import numpy as np

from ss2sql.vtables.body_columns import FAR

AXES = ("x", "y", "z")
MOST = 60  # bodies in cells: a test of each takes 0.1 us
SIDES = 1e-6, 1e9  # metres: the limits of the width of cells
SLACK = 1e-6  # metres and parts: distances from two formulas differ by less


class SpatialIndex:
    """The ids and positions of all bodies at one moment. Finding neighbours takes 4 us among 1,000.

    Small boxes are looked up in cells as wide as the first requested box, others in arrays.
    """

    def __init__(self, world: Any) -> None:
        where, number = world.calls.get_numbered_call("getBasePositionAndOrientation"), world.calls.number
        self.ids: list[int] = world.list_ids()
        self._points = [where(body, number)[0] for body in self.ids]
        self.at = dict(zip(self.ids, self._points, strict=True))
        points = np.array(self._points, dtype=float).reshape(len(self.ids), 3)
        self._order = np.argsort(points[:, 0], kind="stable")  # along x, where a range contains few of them
        self._axes = points[self._order].T.copy()
        self._along = self._axes[0].tolist()
        self._numbers = np.array(self.ids, dtype=np.int64)
        self._side = 0.0  # of the cells, once there are any
        self._cells: dict[tuple[int, int, int], list[int]] = {}

    def _fill_cells(self, side: float) -> None:
        self._side = side
        for place, (x, y, z) in enumerate(self._points):
            if abs(x) + abs(y) + abs(z) <= FAR:  # which is false where one is NaN
                self._cells.setdefault((floor(x / side), floor(y / side), floor(z / side)), []).append(place)

    def _find_in_cells(self, *ranges: tuple[float, float]) -> list[int] | None:
        """The same as `_find_within`; None for a large box or many bodies in it, where arrays take 15 us."""
        (ax, bx), (ay, by), (az, bz) = ranges
        widest = max(bx - ax, by - ay, bz - az)
        if not (SIDES[0] <= widest <= SIDES[1] and max(map(abs, (ax, ay, az))) <= 1e6 * widest):
            return None
        if not self._side:
            self._fill_cells(widest)
        side, cells = self._side, self._cells
        if widest > 2 * side:
            return None
        found: list[int] = []
        for i in range(floor(ax / side), floor(bx / side) + 1):
            for j in range(floor(ay / side), floor(by / side) + 1):
                for k in range(floor(az / side), floor(bz / side) + 1):
                    found += cells.get((i, j, k), ())
        if len(found) > MOST:
            return None
        points = self._points
        inside = []
        for place in found:
            x, y, z = points[place]
            if ax <= x <= bx and ay <= y <= by and az <= z <= bz:
                inside.append(place)
        inside.sort()
        return inside

    def _find_within(self, *ranges: tuple[float, float]) -> Any:
        """The places in `ids` of the bodies within ranges, in their order."""
        part = slice(bisect_left(self._along, ranges[0][0]), bisect_right(self._along, ranges[0][1]))
        order = self._order[part]
        found = np.ones(len(order), dtype=bool)
        for values, (low, high) in zip(self._axes[:, part], ranges, strict=False):
            if low != float("-inf"):
                found &= values >= low
            if high != float("inf"):
                found &= values <= high
        return np.sort(order[found])

    def find_between(self, *ranges: tuple[float, float]) -> list[int]:
        """The bodies whose x, y and z lie within ranges, ends included."""
        found = self._find_in_cells(*ranges)
        if found is None:
            return self._numbers[self._find_within(*ranges)].tolist()  # type: ignore[no-any-return]
        return [self.ids[place] for place in found]

    def find_near(self, point: tuple[float, ...], radius: float) -> list[int]:
        """The bodies whose centres are at most this far from a point; one of two numbers is on the floor plan."""
        reach = radius + SLACK * (1 + abs(radius) + max(map(abs, point)))
        ranges = ((value - reach, value + reach) for value in point)
        size, points, ids = len(point), self._points, self.ids
        found = self._find_within(*ranges).tolist()
        return [ids[place] for place in found if dist(points[place][:size], point) <= radius]


def get_spatial_index(world: Any) -> SpatialIndex:
    """The index of the running query, made at the first request."""
    known = world.memory
    if "places" not in known:
        known["places"] = SpatialIndex(world)
    return known["places"]  # type: ignore[no-any-return]

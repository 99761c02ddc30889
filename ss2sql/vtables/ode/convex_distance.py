"""The distance of convex solids, for simulators that only test whether solids touch.

A solid is a core (a point, a line, a box or a disc that is drawn out to a cylinder) with a layer of constant thickness
around it. The distance of two cores is found by the method of Gilbert, Johnson and Keerthi: the point of their
Minkowski difference that is nearest to the origin, approximated by simplices.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ss2sql.fast_dataclasses import dataclass

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


def measure_distance(one: Convex, other: Convex) -> float:
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

"""Lines and dots over a picture, hidden by what stands before them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from itertools import pairwise
from math import isfinite, log

import numpy as np
from numpy.typing import NDArray

from ss2sql.errors import SessionError
from ss2sql.scenes.camera import Camera, Floats

Point = Sequence[float]  # x and y, or x, y and z
ABOVE = 0.06  # metres over the floor, for points without z
HIDDEN = 0.3  # the strength of a hidden line
SLACK = 0.08  # metres of tolerance before a surface hides a line


def make_point(point: Point) -> tuple[float, float, float]:
    try:
        x, y, z = (*map(float, point), ABOVE)[:3]
        if not isfinite(x + y + z):
            raise ValueError
    except (TypeError, ValueError) as reason:
        raise SessionError(
            "S002", f"{point!r} is not a point", hints=("points are lists of x and y, or of x, y and z",)
        ) from reason
    return x, y, z


def draw_lines(
    distance: Floats, camera: Camera, paths: Iterable[Sequence[Point]], width: float, hidden: float = HIDDEN
) -> Floats:
    """The coverage of each pixel by paths. Segments that many paths share are drawn once, and stronger."""
    pieces: Counter[tuple[tuple[float, float, float], ...]] = Counter()
    for path in paths:
        points = [make_point(point) for point in path]
        pieces.update(tuple(sorted(pair)) for pair in pairwise(points) if pair[0] != pair[1])
    if not pieces:
        return np.zeros(distance.shape, np.float32)
    ends = np.array(list(pieces))
    most = max(pieces.values())
    strength = np.array([1.0 if most == 1 else 0.6 + 0.4 * log(n) / log(most) for n in pieces.values()])
    along, strengths = _sample_points(ends, strength, camera)
    return _widen_pixels(_stamp_points(distance, camera, along, strengths, hidden), width)


def draw_dots(distance: Floats, camera: Camera, points: Iterable[Point], width: float) -> Floats:
    """The coverage of each pixel by round dots at points."""
    places = {make_point(point) for point in points}
    if not places:
        return np.zeros(distance.shape, np.float32)
    return _widen_pixels(_stamp_points(distance, camera, np.array(sorted(places)), np.ones(len(places)), HIDDEN), width)


def _sample_points(
    ends: NDArray[np.float64], strength: NDArray[np.float64], camera: Camera
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Points along segments (n x 2 x 3), close enough for every pixel, and the strength of each."""
    column, row, distance = camera.project_points(ends.reshape(-1, 3))
    seen = (distance > camera.near).reshape(-1, 2).all(axis=1)
    ends, strength = ends[seen], strength[seen]
    length = np.hypot(np.diff(column.reshape(-1, 2)[seen]), np.diff(row.reshape(-1, 2)[seen]))[:, 0]
    counts = np.ceil(length * 1.5).astype(int) + 1
    piece = np.repeat(np.arange(len(counts)), counts)
    part = (np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)) / np.maximum(counts[piece] - 1, 1)
    start, end = ends[piece, 0], ends[piece, 1]
    return start + (end - start) * part[:, None], strength[piece]


def _stamp_points(
    distance: Floats, camera: Camera, points: NDArray[np.float64], strength: NDArray[np.float64], hidden: float
) -> Floats:
    """One pixel for each point, weaker where something stands before it."""
    height, width = distance.shape
    column, row, away = camera.project_points(points)
    inside = (away > camera.near) & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    x, y = column[inside].astype(int), row[inside].astype(int)
    occluded = away[inside] > distance[y, x] + SLACK
    covered = np.zeros(distance.shape, np.float32)
    np.maximum.at(covered, (y, x), np.where(occluded, hidden, 1.0) * strength[inside])
    return covered


def _widen_pixels(covered: Floats, width: float) -> Floats:
    radius = int(width / 2)
    padded = np.pad(covered, radius)
    height, across = covered.shape
    wide = covered.copy()
    for down in range(-radius, radius + 1):
        for right in range(-radius, radius + 1):
            if down * down + right * right <= width * width / 4:
                part = padded[radius + down : radius + down + height, radius + right : radius + right + across]
                np.maximum(wide, part, out=wide)
    return wide

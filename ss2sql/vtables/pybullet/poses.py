"""Points and rotations: a turn is a quaternion (x, y, z, w), a pose a point and a turn."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

Point: TypeAlias = tuple[float, float, float]
Rotation: TypeAlias = tuple[float, float, float, float]
Pose: TypeAlias = tuple[Point, Rotation]
Box: TypeAlias = tuple[Point, Point]

UPRIGHT: Rotation = (0.0, 0.0, 0.0, 1.0)


def rotate_point(turn: Sequence[float], point: Sequence[float]) -> Point:
    """A point, rotated around the origin."""
    x, y, z, w = turn
    px, py, pz = point
    tx, ty, tz = 2 * (y * pz - z * py), 2 * (z * px - x * pz), 2 * (x * py - y * px)
    return px + w * tx + y * tz - z * ty, py + w * ty + z * tx - x * tz, pz + w * tz + x * ty - y * tx


def compose(first: Sequence[float], second: Sequence[float]) -> Rotation:
    """One turn after another: `second` first, as with matrices."""
    ax, ay, az, aw = first
    bx, by, bz, bw = second
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def to_world(pose: Pose, local: Pose) -> Pose:
    """A pose relative to another one, as a pose of the world."""
    (x, y, z), turn = pose
    dx, dy, dz = rotate_point(turn, local[0])
    return (x + dx, y + dy, z + dz), compose(turn, local[1])


def to_local(pose: Pose, other: Pose) -> Pose:
    """A pose of the world, relative to another one: the inverse of `inside`."""
    (x, y, z), (a, b, c, w) = pose
    back = (-a, -b, -c, w)
    (px, py, pz), turn = other
    return rotate_point(back, (px - x, py - y, pz - z)), compose(back, turn)


def unite_boxes(boxes: Sequence[Any]) -> Box:
    """The box around boxes, each of which is its lowest and its highest corner."""
    if len(boxes) == 1:
        return boxes[0]  # type: ignore[no-any-return]
    lows, highs = zip(*boxes, strict=True)
    (ax, ay, az), (bx, by, bz) = map(min, zip(*lows, strict=True)), map(max, zip(*highs, strict=True))
    return (ax, ay, az), (bx, by, bz)

"""Points and rotations: a turn is a quaternion (x, y, z, w), a pose a point and a turn; and forward kinematics.

PyBullet's poses of links, also those for collisions, are one step old until something is reset; recomputing them would
change the results of other queries. So they are computed here, to within 1e-14 m of Bullet's own.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import cos, sin
from typing import Any, TypeAlias

Point: TypeAlias = tuple[float, float, float]
Rotation: TypeAlias = tuple[float, float, float, float]
Pose: TypeAlias = tuple[Point, Rotation]
Box: TypeAlias = tuple[Point, Point]

UPRIGHT: Rotation = (0.0, 0.0, 0.0, 1.0)


def rotate_point(turn: Sequence[float], point: Sequence[float]) -> Point:
    x, y, z, w = turn
    px, py, pz = point
    tx, ty, tz = 2 * (y * pz - z * py), 2 * (z * px - x * pz), 2 * (x * py - y * px)
    return px + w * tx + y * tz - z * ty, py + w * ty + z * tx - x * tz, pz + w * tz + x * ty - y * tx


def compose_pose_turns(first: Sequence[float], second: Sequence[float]) -> Rotation:
    """One turn after another: `second` first, as with matrices."""
    ax, ay, az, aw = first
    bx, by, bz, bw = second
    return (
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
        aw * bw - ax * bx - ay * by - az * bz,
    )


def convert_pose_to_world(pose: Pose, local: Pose) -> Pose:
    """A pose relative to another one, as a pose of the world."""
    (x, y, z), turn = pose
    dx, dy, dz = rotate_point(turn, local[0])
    return (x + dx, y + dy, z + dz), compose_pose_turns(turn, local[1])


def convert_pose_to_local(pose: Pose, other: Pose) -> Pose:
    """A pose of the world, relative to another one: the inverse of `inside`."""
    (x, y, z), (a, b, c, w) = pose
    back = (-a, -b, -c, w)
    (px, py, pz), turn = other
    return rotate_point(back, (px - x, py - y, pz - z)), compose_pose_turns(back, turn)


def unite_boxes(boxes: Sequence[Any]) -> Box:
    """The box around boxes, each of which is its lowest and its highest corner."""
    if len(boxes) == 1:
        return boxes[0]  # type: ignore[no-any-return]
    lows, highs = zip(*boxes, strict=True)
    (ax, ay, az), (bx, by, bz) = map(min, zip(*lows, strict=True)), map(max, zip(*highs, strict=True))
    return (ax, ay, az), (bx, by, bz)


# --- forward kinematics: the poses of a robot's links from the angles of its joints
def compute_link_poses(calls: Any, body: int, base: Pose) -> dict[int, Pose]:
    """The poses of the centres of mass of all links, by their numbers; the base is -1."""
    poses: dict[int, Pose] = {-1: base}
    for joint in range(calls.getNumJoints(body)):
        state = calls.getLinkState(body, joint)
        poses[joint] = _compute_pose(calls, body, joint, poses, state)
    return poses


def get_link_poses(world: Any, body: int) -> dict[int, Pose]:
    """The same for a body's present state, computed once in a query: a robot with nine joints takes 130 us."""
    known = world.memory.setdefault("postures", {})
    if body not in known:
        known[body] = compute_link_poses(world.calls, body, world.calls.getBasePositionAndOrientation(body))
    return known[body]  # type: ignore[no-any-return]


def _compute_pose(calls: Any, body: int, joint: int, poses: dict[int, Pose], state: Any) -> Pose:
    info = calls.getJointInfo(body, joint)
    kind, axis, pivot, parent = info[2], info[13], info[14], info[16]
    middle = rotate_point(invert_rotation(state[3]), state[2])  # of the link, as seen from its joint
    turn: Rotation = UPRIGHT
    match kind:
        case 0:  # JOINT_REVOLUTE
            half = calls.getJointState(body, joint)[0] / 2
            turn = (axis[0] * sin(half), axis[1] * sin(half), axis[2] * sin(half), cos(half))
        case 1:  # JOINT_PRISMATIC
            offset = calls.getJointState(body, joint)[0]
            middle = (middle[0] + axis[0] * offset, middle[1] + axis[1] * offset, middle[2] + axis[2] * offset)
        case 2:  # JOINT_SPHERICAL
            turn = calls.getJointStateMultiDof(body, joint)[0]
        case 4:  # JOINT_FIXED
            pass
        case _:  # as PyBullet shows it
            return state[0], state[1]
    return convert_pose_to_world(
        convert_pose_to_world(poses[parent], (pivot, invert_rotation(info[15]))), (rotate_point(turn, middle), turn)
    )


def invert_rotation(turn: Any) -> Rotation:
    x, y, z, w = turn
    return -x, -y, -z, w

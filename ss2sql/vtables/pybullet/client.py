"""PyBullet on demand, calls of it, and poses: importing this module does not import PyBullet, which may be missing.

A turn is a quaternion (x, y, z, w), a pose a point and a turn. PyBullet's poses of links, also those for collisions,
are one step old until something is reset; recomputing them would change the results of other queries. So they are
computed here, to within 1e-14 m of Bullet's own.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cache, partial
from inspect import isbuiltin
from math import cos, sin
from typing import Any, TypeAlias
from uuid import uuid4

from ss2sql.errors import require_package


@cache
def import_pybullet() -> Any:
    return require_package("pybullet", "sim", "PyBullet's world or scene")


@cache
def _make_client_type() -> Any:
    bullet = import_pybullet()
    base: Any = require_package("pybullet_utils.bullet_client", "sim", "a scene").BulletClient

    class Client(base):  # type: ignore[misc]
        """A BulletClient without a window.

        It connects itself, because BulletClient passes options to Bullet, which then writes `argv[0]=`
        to the standard output.
        """

        def __init__(self) -> None:
            self._shapes: dict[int, int] = {}
            self._pid = os.getpid()
            self._client = bullet.connect(bullet.DIRECT)

    return Client


def start_bullet() -> Any:
    """A new simulation without a window, a `pybullet_utils.bullet_client.BulletClient`."""
    return _make_client_type()()


# --- calls of the simulator
class NumberedClient:
    """A `BulletClient` for a client that is known by its number alone; it never disconnects it."""

    def __init__(self, number: int) -> None:
        self._client = number

    def __getattr__(self, name: str) -> Any:
        attribute = getattr(import_pybullet(), name)
        return partial(attribute, physicsClientId=self._client) if isbuiltin(attribute) else attribute


def get_client_number(client: Any) -> int:
    """The number by which PyBullet knows a client; -1 once it has been disconnected."""
    return int(client._client)


class Calls:
    """The functions and constants of a client, each looked up once: `BulletClient` takes 3 us for each look-up."""

    def __init__(self, client: Any) -> None:
        self._client = client
        self.number = get_client_number(client)

    def __getattr__(self, name: str) -> Any:
        found = getattr(self._client, name)
        setattr(self, name, found)
        return found

    def get_numbered_call(self, name: str) -> Callable[..., Any]:
        """A function that takes `number` as its last argument, by its position.

        A call takes 0.2 to 0.4 us less than with the keyword, which clients use.
        """
        found = getattr(self, name)
        if isinstance(found, partial) and not found.args and found.keywords == {"physicsClientId": self.number}:
            return found.func
        return lambda *arguments: found(*arguments[:-1])


class BodyNotes(Mapping[int, Any]):
    """What the user says of bodies, by their ids. It ends with its body, although a later body may get the same id.

    PyBullet keeps a mark with each body, as its user data, and drops it with the body.
    """

    def __init__(self, calls: Calls, notes: Mapping[int, Any]) -> None:
        self._notes = dict(notes)
        self._mark = f"ss2sql {uuid4()}"
        self._client = calls.number
        self._find_mark = calls.get_numbered_call("getUserDataId")
        for body in self._notes:
            calls.addUserData(body, self._mark, "")

    def __getitem__(self, body: int) -> Any:
        note = self._notes[body]
        if self._find_mark(body, self._mark, -1, -1, self._client) < 0:
            raise KeyError(body)
        return note

    def __iter__(self) -> Iterator[int]:
        return (body for body in self._notes if body in self)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def __bool__(self) -> bool:
        """Whether any was given: to count those that are left takes a call for each."""
        return bool(self._notes)


# --- points and rotations, and forward kinematics
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
def get_link_poses(world: Any, body: int) -> dict[int, Pose]:
    """The poses of the centres of mass of all links, by their numbers; the base is -1.

    They are computed once in a query: a robot with nine joints takes 130 us.
    """
    known: dict[int, dict[int, Pose]] = world.memory.setdefault("postures", {})
    if body not in known:
        calls = world.calls
        poses = known[body] = {-1: calls.getBasePositionAndOrientation(body)}
        for joint in range(calls.getNumJoints(body)):
            poses[joint] = _compute_pose(calls, body, joint, poses)
    return known[body]


def _compute_pose(calls: Any, body: int, joint: int, poses: dict[int, Pose]) -> Pose:
    info, state = calls.getJointInfo(body, joint), calls.getLinkState(body, joint)
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

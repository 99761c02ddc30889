"""The links of bodies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ss2sql.vtables.body_functions import FAR, VECTOR
from ss2sql.vtables.contract import Column, Gone, Table, Where
from ss2sql.vtables.pybullet.poses import Box, Pose, convert_pose_to_world, rotate_point

Key = tuple[int, int]

UNSURE = (float | None, float | None, float | None)
UNKNOWN = ((None, None, None), (None, None, None))  # the velocities of soft bodies
SOFT = 3  # PyBullet's number for soft bodies in getDynamicsInfo


class BodyPartTable(Table):
    """A table whose keys are a body and a number within it."""

    first = 0  # the first number

    def keys(self, where: Where) -> list[Key]:
        return [
            (body, number)
            for body in list_demanded_bodies(self.world, where)
            for number in range(self.first, self.world.calls.getNumJoints(body))
            if where.allows("number", number)
        ]

    def read_numbers(self, key: Key) -> Key:
        """The group of the columns `body` and `number`."""
        self.check_key(key)
        return key

    def check_key(self, key: Key) -> None:
        """Raises Gone for a missing body or link, for which the simulator often answers as if it were empty."""
        self.world.check_body(key[0])
        if key[1] >= self.world.calls.getNumJoints(key[0]):
            raise Gone("its body has fewer links now")

    def call_simulator(self, function: Any, key: Key, *more: Any) -> Any:
        """The result of a function of the simulator; raises Gone for a missing body or link."""
        self.check_key(key)
        return function(key[0], key[1], *more)


def list_demanded_bodies(world: Any, where: Where) -> list[int]:
    wanted = where.equal("body")
    if wanted is None:
        return world.list_ids()  # type: ignore[no-any-return]
    return [int(wanted)] if wanted == int(wanted) and world.has_body(int(wanted)) else []


class BulletLinks(BodyPartTable):
    """One row for each link. The base is the link -1; a body without joints has no other.

    PyBullet's poses of all links but the base are one step old.
    """

    name = "links"
    text = "the links of all bodies; the base of a body is its link -1"
    first = -1
    columns = (
        Column("body", int, text="the id of its body", filter="="),
        Column("number", int, text="PyBullet's number of the link, -1 for the base", filter="="),
        Column("name", str),
        Column("parent", int | None, text="the number of the link that it hangs on; None for the base"),
        Column("x", float, "m", "where its centre of mass is"),
        Column("y", float, "m"),
        Column("z", float, "m"),
        Column("pos", VECTOR, "m", "x, y and z"),
        Column("quat", (*VECTOR, float), text="how it is turned: a quaternion x, y, z, w"),
        Column("velocity", UNSURE, "m/s", "of soft bodies three times None"),
        Column("angularVelocity", UNSURE, "rad/s", "of soft bodies three times None"),
        Column("mass", float | None, "kg", "None of soft bodies"),
        Column("friction", float | None, text="sideways; None of soft bodies"),
        Column("aabb", (VECTOR, VECTOR), "m", "the box around it: lowest and highest corner"),
        Column("colour", list | None, text="red, green, blue and opacity, from 0 to 1; None if it cannot be seen"),
    )
    groups: ClassVar[Mapping[str, str]] = {
        "read_numbers": "body number",
        "read_names": "name parent",
        "read_pose": "x y z pos quat",
        "read_velocity": "velocity angularVelocity",
        "read_mass": "mass friction",
        "read_box": "aabb",
        "read_color": "colour",
    }

    def read_names(self, key: Key) -> tuple[str, int | None]:
        if key[1] < 0:
            return self.call_simulator(lambda body, _: self.world.calls.getBodyInfo(body), key)[0].decode(
                errors="replace"
            ), None
        info = self.call_simulator(self.world.calls.getJointInfo, key)
        return info[12].decode(errors="replace"), info[16]

    def read_pose(self, key: Key) -> tuple[Any, ...]:
        self.check_key(key)
        pos, quat = read_link_pose(self.world, key)
        return (*pos, pos, quat)

    def read_velocity(self, key: Key) -> Any:
        if key[1] < 0:
            if self.call_simulator(self.world.calls.getDynamicsInfo, key)[10] == SOFT:
                return UNKNOWN
            return self.world.calls.getBaseVelocity(key[0])
        return self.call_simulator(self.world.calls.getLinkState, key, 1)[6:8]

    def read_mass(self, key: Key) -> tuple[float | None, float | None]:
        info = self.call_simulator(self.world.calls.getDynamicsInfo, key)
        return (None, None) if info[10] == SOFT else (info[0], info[1])

    def read_box(self, key: Key) -> Box:
        self.check_key(key)
        return measure_link_box(self.world, key)

    def read_color(self, key: Key) -> Any:
        seen = self.call_simulator(lambda body, _: self.world.calls.getVisualShapeData(body), key)
        return next((list(shape[7]) for shape in seen if shape[1] == key[1]), None)


def read_link_pose(world: Any, key: Key) -> Pose:
    """Where the centre of mass of a link is, and how it is turned."""
    body, link = key
    if link < 0:
        return world.calls.getBasePositionAndOrientation(body)  # type: ignore[no-any-return]
    state = world.calls.getLinkState(body, link)
    return state[0], state[1]


def measure_link_box(world: Any, key: Key) -> Box:
    """The box around a link. That of an endless plane along two axes ends at its front, unlike PyBullet's."""
    body, link = key
    low, high = world.calls.getAABB(body, link)
    if high[2] < FAR:
        return low, high
    shapes = world.shapes.read_link_shapes(body, link)
    if len(shapes) == 1 and shapes[0][2] == world.calls.GEOM_PLANE:
        _, _, _, normal, _, *local = shapes[0]
        place, turn = convert_pose_to_world(read_link_pose(world, key), (local[0], local[1]))
        front = rotate_point(turn, normal)
        axis = max(range(3), key=lambda number: abs(front[number]))
        if abs(front[axis]) > 1 - 1e-12:
            end = high if front[axis] > 0 else low
            ended = (*end[:axis], place[axis], *end[axis + 1 :])
            return (low, ended) if end is high else (ended, high)
    return low, high

"""The links of bodies."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ss2sql.vtables.body_columns import VECTOR
from ss2sql.vtables.contract import Column, Gone, Table, Where
from ss2sql.vtables.pybullet.poses import Box, Pose

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

    def numbers(self, key: Key) -> Key:
        """The group of the columns `body` and `number`."""
        self.alive(key)
        return key

    def alive(self, key: Key) -> None:
        """Raises Gone for a missing body or link, for which the simulator often answers as if it were empty."""
        self.world.present(key[0])
        if key[1] >= self.world.calls.getNumJoints(key[0]):
            raise Gone("its body has fewer links now")

    def ask(self, function: Any, key: Key, *more: Any) -> Any:
        """The result of a function of the simulator; raises Gone for a missing body or link."""
        self.alive(key)
        return function(key[0], key[1], *more)


def list_demanded_bodies(world: Any, where: Where) -> list[int]:
    """The bodies that meet a condition on the column `body`."""
    wanted = where.equal("body")
    if wanted is None:
        return world.ids()  # type: ignore[no-any-return]
    return [int(wanted)] if wanted == int(wanted) and world.has(int(wanted)) else []


class Links(BodyPartTable):
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
        "numbers": "body number",
        "called": "name parent",
        "place": "x y z pos quat",
        "movement": "velocity angularVelocity",
        "matter": "mass friction",
        "around": "aabb",
        "look": "colour",
    }

    def called(self, key: Key) -> tuple[str, int | None]:
        if key[1] < 0:
            return self.ask(lambda body, _: self.world.calls.getBodyInfo(body), key)[0].decode(errors="replace"), None
        info = self.ask(self.world.calls.getJointInfo, key)
        return info[12].decode(errors="replace"), info[16]

    def place(self, key: Key) -> tuple[Any, ...]:
        self.alive(key)
        pos, quat = read_link_pose(self.world, key)
        return (*pos, pos, quat)

    def movement(self, key: Key) -> Any:
        if key[1] < 0:
            if self.ask(self.world.calls.getDynamicsInfo, key)[10] == SOFT:
                return UNKNOWN
            return self.world.calls.getBaseVelocity(key[0])
        return self.ask(self.world.calls.getLinkState, key, 1)[6:8]

    def matter(self, key: Key) -> tuple[float | None, float | None]:
        info = self.ask(self.world.calls.getDynamicsInfo, key)
        return (None, None) if info[10] == SOFT else (info[0], info[1])

    def around(self, key: Key) -> Box:
        return self.ask(self.world.calls.getAABB, key)  # type: ignore[no-any-return]

    def look(self, key: Key) -> Any:
        seen = self.ask(lambda body, _: self.world.calls.getVisualShapeData(body), key)
        return next((list(shape[7]) for shape in seen if shape[1] == key[1]), None)


def read_link_pose(world: Any, key: Key) -> Pose:
    """Where the centre of mass of a link is, and how it is turned."""
    body, link = key
    if link < 0:
        return world.calls.getBasePositionAndOrientation(body)  # type: ignore[no-any-return]
    state = world.calls.getLinkState(body, link)
    return state[0], state[1]

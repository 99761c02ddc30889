"""The joints of robots and other bodies with several links."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ss2sql.vtables.body_columns import VECTOR
from ss2sql.vtables.contract import Column
from ss2sql.vtables.pybullet.links import BodyPartTable, Key

TYPES = {0: "revolute", 1: "prismatic", 2: "spherical", 3: "planar", 4: "fixed"}  # PyBullet's JOINT_...


class BulletJoints(BodyPartTable):
    """One row for each joint. It moves the link that has its number."""

    name = "joints"
    text = "the joints of all bodies; a joint moves the link that has its number"
    columns = (
        Column("body", int, text="the id of its body", filter="="),
        Column("number", int, text="PyBullet's number of the joint, and of the link that it moves", filter="="),
        Column("name", str),
        Column("type", str, text="revolute, prismatic, spherical, planar or fixed"),
        Column("link", str, text="the name of the link that it moves"),
        Column("parent", int, text="the number of the link that it hangs on, -1 for the base"),
        Column("axis", VECTOR, text="around which it turns or along which it slides"),
        Column("lower", float | None, "rad or m", "how far it can go down; None without an end"),
        Column("upper", float | None, "rad or m", "how far it can go up; None without an end"),
        Column("maxForce", float, "Nm or N", "of its motor, by its file"),
        Column("maxVelocity", float, "rad/s or m/s", "by its file"),
        Column("damping", float),
        Column("friction", float),
        Column("angle", float, "rad or m", "how far it is turned, or slid"),
        Column("speed", float, "rad/s or m/s", "how fast it turns or slides"),
        Column("motor", float, "Nm or N", "what its motor did in the last step"),
    )
    groups: ClassVar[Mapping[str, str]] = {
        "read_numbers": "body number",
        "read_build": "name type link parent axis lower upper maxForce maxVelocity damping friction",
        "read_state": "angle speed motor",
    }

    def read_build(self, key: Key) -> tuple[Any, ...]:
        info = self.call_simulator(self.world.calls.getJointInfo, key)
        lower, upper = (info[8], info[9]) if info[8] <= info[9] else (None, None)  # upside down: no ends
        if info[2] in (0, 1) and lower == upper == 0.0:
            lower = upper = None
        name, link = info[1].decode(errors="replace"), info[12].decode(errors="replace")
        kind = TYPES.get(info[2], "other")
        return (name, kind, link, info[16], info[13], lower, upper, info[10], info[11], info[6], info[7])

    def read_state(self, key: Key) -> tuple[float, float, float]:
        angle, speed, _, motor = self.call_simulator(self.world.calls.getJointState, key)
        return angle, speed, motor

"""The columns that worlds of bodies share: names, types, and columns that are computed from others.

Simulators provide different columns. A name that two of them have means the same in both, so a query runs over either.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from math import atan2, copysign, pi, sqrt
from typing import Any

from ss2sql.vtables.contract import Column, Gone

VECTOR = (float, float, float)
FAR = 1e30  # where the boxes of endless bodies end
RANGE = "< <= > >="

PLACES = {"this": "x y z", "pos": "x y z"}  # for Table.places

# The columns of groups that one call of a simulator gives, in the order of the functions below.
POSITION = "x y z posX posY posZ pos"
ROTATION = "qx qy qz qw quat"
VELOCITY = "vx vy vz velocity linearVelocity"
SPIN = "wx wy wz angularVelocity"
SHAPE = "type isSphere isBox isCapsule isCylinder isPlane isMesh"

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # x, y, z, w

_COLUMNS = (
    Column("id", int, "", "the number of the body", "="),
    Column("name", str, "", "its name", "="),
    Column("obj", object, "", "the body itself, what `this` is"),
    Column(
        "type",
        str,
        "",
        "sphere box capsule cylinder plane mesh terrain, compound of several, or ghost: without a shape",
    ),
    Column("x", float, "m", "the position", RANGE),
    Column("y", float, "m", "the position", RANGE),
    Column("z", float, "m", "the position", RANGE),
    Column("posX", float, "m", "x"),
    Column("posY", float, "m", "y"),
    Column("posZ", float, "m", "z"),
    Column("pos", VECTOR, "m", "the position, [x, y, z]"),
    Column("qx", float, "", "the orientation as a quaternion"),
    Column("qy", float, "", "the orientation as a quaternion"),
    Column("qz", float, "", "the orientation as a quaternion"),
    Column("qw", float, "", "the orientation as a quaternion, the real part"),
    Column("quat", (float, float, float, float), "", "the orientation as a quaternion, [qx, qy, qz, qw]"),
    Column("rot", VECTOR, "rad", "the orientation as roll, pitch and yaw"),
    Column("pose", (*VECTOR, *VECTOR, float), "m", "pos and quat in one list of seven"),
    Column("vx", float, "m/s", "the velocity"),
    Column("vy", float, "m/s", "the velocity"),
    Column("vz", float, "m/s", "the velocity"),
    Column("velocity", VECTOR, "m/s", "the velocity, [vx, vy, vz]"),
    Column("linearVelocity", VECTOR, "m/s", "the velocity, [vx, vy, vz]"),
    Column("wx", float, "rad/s", "the angular velocity"),
    Column("wy", float, "rad/s", "the angular velocity"),
    Column("wz", float, "rad/s", "the angular velocity"),
    Column("angularVelocity", VECTOR, "rad/s", "the angular velocity, [wx, wy, wz]"),
    Column("force", VECTOR, "N", "the force that is applied from outside"),
    Column("torque", VECTOR, "Nm", "the torque that is applied from outside"),
    Column("mass", float, "kg", "the mass"),
    Column("volume", float | None, "m3", "the volume of its shapes; None where it has no end or is not known"),
    Column("aabb", (VECTOR, VECTOR), "m", "the box around it along the axes: two opposite corners"),
    Column("isSphere", bool, "", "whether its shape is a sphere"),
    Column("isBox", bool, "", "whether its shape is a box"),
    Column("isCapsule", bool, "", "whether its shape is a capsule"),
    Column("isCylinder", bool, "", "whether its shape is a cylinder"),
    Column("isPlane", bool, "", "whether its shape is a plane"),
    Column("isMesh", bool, "", "whether its shape is a mesh"),
    Column("isRobot", bool, "", "whether it is a robot, or a part of one"),
    Column("isSensor", bool, "", "whether a sensor is mounted on it"),
    Column("isEnabled", bool, "", "whether anything can collide with it"),
    Column("hasBody", bool, "", "whether it has mass and can move: walls and the like stand still"),
)


def make_body_columns(without: str = "", unknown: str = "") -> tuple[Column, ...]:
    """The columns of bodies except `without`; those in `unknown` may be None."""
    left_out, optional = without.split(), unknown.split()
    return tuple(
        replace(column, type=_make_optional(column.type)) if column.name in optional else column
        for column in _COLUMNS
        if column.name not in left_out
    )


def _make_optional(declared: Any) -> Any:
    return tuple(map(_make_optional, declared)) if isinstance(declared, tuple) else declared | None


def shape_row(shape: str | None) -> tuple[Any, ...]:
    """The columns of SHAPE."""
    return shape, *(shape == known for known in ("sphere", "box", "capsule", "cylinder", "plane", "mesh"))


def compute_euler_angles(x: float, y: float, z: float, w: float) -> Vector:
    """Roll, pitch and yaw of a quaternion. Where the pitch is a right angle the roll is 0."""
    sine = 2 * (w * y - z * x)
    if abs(sine) > 1 - 1e-12:
        return 0.0, copysign(pi / 2, sine), -copysign(2.0, sine) * atan2(x, w)
    roll = atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    yaw = atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return roll, atan2(sine, sqrt((1 - sine) * (1 + sine))), yaw


def clip_to_finite(values: Iterable[float]) -> Vector:
    """A corner of a box, with infinite coordinates replaced by FAR."""
    x, y, z = (max(-FAR, min(FAR, float(value))) for value in values)
    return x, y, z


def make_gone_error(what: str, key: Any) -> Gone:
    """The error for a key without an element."""
    return Gone(f"no {what} has the id {key!r}")

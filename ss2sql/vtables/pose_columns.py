"""Tables of things with a pose and a velocity: the columns that follow from these, one thing at a time.

Simulators that hold arrays compute the same columns from whole arrays.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, ClassVar

from ss2sql.vtables.body_columns import SHAPE, Quaternion, Vector, compute_euler_angles, shape_row
from ss2sql.vtables.contract import Table


class Posed(Table, ABC):
    """A derived class declares `groups = {**PLACED, ...}` with the groups that it adds."""

    PLACED: ClassVar[dict[str, str]] = {
        "read_shape": SHAPE, "compute_angles": "rot", "read_pose": "pose",
        "read_position": "pos(x=posX y=posY z=posZ)", "read_turn": "quat(qx qy qz qw)",
        "read_velocity": "velocity=linearVelocity(vx vy vz)", "read_spin": "angularVelocity(wx wy wz)",
    }  # fmt: skip

    @abstractmethod
    def read_kind(self, key: Any) -> str:
        """Its shape."""

    @abstractmethod
    def read_position(self, key: Any) -> Vector:
        """Where it is."""

    @abstractmethod
    def read_turn(self, key: Any) -> Quaternion:
        """How it is turned: x, y, z, w."""

    @abstractmethod
    def read_velocity(self, key: Any) -> Vector:
        """How fast it moves."""

    @abstractmethod
    def read_spin(self, key: Any) -> Vector:
        """How fast it turns."""

    def read_shape(self, key: Any) -> tuple[Any, ...]:
        return shape_row(self.read_kind(key))

    def compute_angles(self, key: Any) -> Vector:
        return compute_euler_angles(*self.read_turn(key))

    def read_pose(self, key: Any) -> tuple[float, ...]:
        return (*self.read_position(key), *self.read_turn(key))

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
        "shape": SHAPE, "angles": "rot", "pose": "pose",
        "position_of": "pos(x=posX y=posY z=posZ)", "turn_of": "quat(qx qy qz qw)",
        "velocity_of": "velocity=linearVelocity(vx vy vz)", "spin_of": "angularVelocity(wx wy wz)",
    }  # fmt: skip

    @abstractmethod
    def kind_of(self, key: Any) -> str:
        """Its shape."""

    @abstractmethod
    def position_of(self, key: Any) -> Vector:
        """Where it is."""

    @abstractmethod
    def turn_of(self, key: Any) -> Quaternion:
        """How it is turned: x, y, z, w."""

    @abstractmethod
    def velocity_of(self, key: Any) -> Vector:
        """How fast it moves."""

    @abstractmethod
    def spin_of(self, key: Any) -> Vector:
        """How fast it turns."""

    def shape(self, key: Any) -> tuple[Any, ...]:
        return shape_row(self.kind_of(key))

    def angles(self, key: Any) -> Vector:
        return compute_euler_angles(*self.turn_of(key))

    def pose(self, key: Any) -> tuple[float, ...]:
        return (*self.position_of(key), *self.turn_of(key))

"""The bodies of a simulation, the principal table."""

from __future__ import annotations

from collections.abc import Mapping
from math import pi
from typing import Any, ClassVar

from ss2sql.vtables.base import Column, Element, Table, Where
from ss2sql.vtables.bodies import (
    POSITION,
    ROTATION,
    SHAPE,
    SPIN,
    VELOCITY,
    body_columns,
    position_row,
    rotation_row,
    shape_row,
    spin_row,
    velocity_row,
)
from ss2sql.vtables.pybullet.frames import Box, union
from ss2sql.vtables.pybullet.places import AXES, places

KINDS = {2: "sphere", 3: "box", 4: "cylinder", 5: "mesh", 6: "plane", 7: "capsule", 9: "terrain"}  # PyBullet's GEOM_...
_TYPES = (*KINDS.values(), "compound", "robot", "ghost")
FORM_ROWS = {kind: (*shape_row(kind), kind == "robot", kind != "ghost") for kind in _TYPES}
FIXED = 4  # PyBullet's JOINT_FIXED


class Bodies(Table):
    """One row for each body. Positions are those of its centre of mass, as PyBullet gives them."""

    name, key = "bodies", "id"
    text = "the bodies, in the order of their ids, which go to others after their death"
    columns = (
        *body_columns(without="force torque"),
        Column("force", list | None, "N", "what the scene pushes it with; None where no scene tells"),
        Column("torque", list | None, "Nm", "what the scene turns it with; None where no scene tells"),
        Column("friction", float, "", "of its base, sideways"),
        Column("restitution", float, "", "of its base: how much it bounces"),
        Column("colour", list | None, "", "red, green, blue and opacity, from 0 to 1; None if it cannot be seen"),
    )
    groups: ClassVar[Mapping[str, str]] = {
        "called": "name",
        "place": POSITION,
        "turn": ROTATION,
        "angles": "rot",
        "pose": "pose",
        "around": "aabb",
        "movement": f"{VELOCITY} {SPIN}",
        "matter": "mass hasBody friction restitution",
        "size": "volume",
        "push": "force torque",
        "look": "colour",
        "form": f"{SHAPE} isRobot isEnabled",
        "sensing": "isSensor",
        "itself": "obj",
    }

    def __init__(self, world: Any) -> None:
        super().__init__(world)
        self.calls = world.calls
        self.error = world.calls.error  # what PyBullet raises, above all for bodies that are gone

    def keys(self, where: Where) -> list[int]:
        world = self.world
        wanted = where.equal("id")
        if wanted is not None:
            found = [int(wanted)] if wanted == int(wanted) and world.has(int(wanted)) else []
        elif where.keys().isdisjoint(AXES):
            found = world.ids()
        else:
            found = places(world).between(*((where.low(axis), where.high(axis)) for axis in AXES))
        name = where.equal("name")
        return found if name is None else [body for body in found if world.name_of(body) == name]

    # --- groups ----------------------------------------------------------------------------------------

    def called(self, key: int) -> str:
        try:
            return self.world.name_of(key)  # type: ignore[no-any-return]
        except self.error as error:
            raise self._reason(key, error) from None

    def place(self, key: int) -> tuple[Any, ...]:
        return position_row(*self._frame(key)[0])

    def turn(self, key: int) -> tuple[Any, ...]:
        return rotation_row(*self._frame(key)[1])

    def angles(self, key: int) -> Any:
        return self.calls.getEulerFromQuaternion(self._frame(key)[1])

    def pose(self, key: int) -> Any:
        pos, quat = self._frame(key)
        return (*pos, *quat)

    def _frame(self, key: int) -> Any:
        try:
            return self.calls.getBasePositionAndOrientation(key)
        except self.error as error:
            raise self._reason(key, error) from None

    def around(self, key: int) -> Box:
        return box_of(self.world, key)

    def movement(self, key: int) -> tuple[Any, ...]:
        try:
            velocity, spin = self.calls.getBaseVelocity(key)
        except self.error as error:
            raise self._reason(key, error) from None
        return *velocity_row(velocity), *spin_row(spin)

    def matter(self, key: int) -> tuple[Any, ...]:
        info = self.calls.getDynamicsInfo
        try:
            base = info(key, -1)
            mass = base[0]
            for link in range(self.calls.getNumJoints(key)):
                mass += info(key, link)[0]
        except self.error as error:
            raise self._reason(key, error) from None
        return mass, mass > 0, base[1], base[5]

    def size(self, key: int) -> float | None:
        total = 0.0
        for _, _, shape in shapes_of(self.world, key):
            volume = volume_of(shape)
            if volume is None:
                return None
            total += volume
        return total if total or not self._is_terrain(key) else None

    def push(self, key: int) -> tuple[Any, Any]:
        self.world.present(key)
        scene = self.world.scene
        if scene is None:
            return None, None
        return list(scene.forces.get(key, (0.0, 0.0, 0.0))), [0.0, 0.0, 0.0]  # scenes push at the centre of mass

    def look(self, key: int) -> Any:
        self.world.present(key)  # what is gone is only invisible to PyBullet
        seen = self.calls.getVisualShapeData(key)
        return list(seen[0][7]) if seen else None

    def form(self, key: int) -> tuple[Any, ...]:
        return FORM_ROWS[self._kind(key)]

    def sensing(self, key: int) -> bool:
        self.world.present(key)
        return key in self.world.sensors

    def itself(self, key: int) -> Element:
        self.world.present(key)
        return self.element(key)

    def _kind(self, key: int) -> str:
        calls = self.calls
        joints = calls.getNumJoints(key)
        if any(calls.getJointInfo(key, joint)[2] != FIXED for joint in range(joints)):
            return "robot"
        found = shapes_of(self.world, key)
        kinds = {KINDS.get(shape[2], "mesh") for _, _, shape in found}
        if len(found) == 1 or kinds == {"mesh"}:  # PyBullet takes meshes of files apart
            return kinds.pop()
        if found:
            return "compound"
        return "terrain" if self._is_terrain(key) else "ghost"

    def _is_terrain(self, key: int) -> bool:
        """Of height fields PyBullet gives no shapes, but a box; the box of what cannot be touched has no size."""
        low, high = box_of(self.world, key)
        return low != high

    def _reason(self, key: int, error: Exception) -> Exception:
        """Why the simulator refused: the body is gone, or something else."""
        self.world.present(key)
        return error


def box_of(world: Any, body: int) -> Box:
    """The box around a body and its links."""
    calls = world.calls
    world.present(body)
    boxes = [calls.getAABB(body, link) for link in range(-1, calls.getNumJoints(body))]
    return union(boxes)


def shapes_of(world: Any, body: int) -> list[tuple[int, int, Any]]:
    """The collision shapes of a body: link, number within the link, and what PyBullet tells of it.

    What it tells of body and link is wrong from the second shape of a link on.
    """
    calls = world.calls
    world.present(body)  # PyBullet writes warnings about bodies that are gone
    return [
        (link, number, shape)
        for link in range(-1, calls.getNumJoints(body))
        for number, shape in enumerate(calls.getCollisionShapeData(body, link))
    ]


def volume_of(shape: Any) -> float | None:
    """The volume of a collision shape."""
    a, b, c = shape[3]
    match KINDS.get(shape[2]):
        case "sphere":
            return 4 / 3 * pi * float(a) ** 3
        case "box":
            return float(a * b * c)
        case "cylinder":
            return pi * float(b * b * a)
        case "capsule":
            return pi * float(b * b * a) + 4 / 3 * pi * float(b) ** 3
        case _:
            return None

"""Copies of PyBullet's shapes in another simulation."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

from ss2sql.vtables.pybullet.bodies import KINDS
from ss2sql.vtables.pybullet.poses import Pose
from ss2sql.vtables.pybullet.solids import Box, Capsule, Cylinder, Plane, Solid, Sphere

UNNAMED = (b"", b"unknown_file")  # the files of meshes that were built from points
MOST_PARTS = 16  # of one shape: PyBullet leaves out those beyond
SIDE = 10.0  # metres: the edge of the squares that represent endless planes in pictures

Part: TypeAlias = dict[str, Any]  # the keywords of a shape for PyBullet


def read_bullet_shape(kind: int, size: Sequence[float], file: bytes, corners: Sequence[Any]) -> Part | None:
    """A shape from PyBullet's data; None where these are incomplete."""
    a, b, c = size
    match KINDS.get(kind):
        case "sphere":
            return {"shapeType": kind, "radius": a}
        case "box":
            return {"shapeType": kind, "halfExtents": [a / 2, b / 2, c / 2]}
        case "capsule" | "cylinder":
            return {"shapeType": kind, "radius": b, "height": a}
        case "plane":
            return {"shapeType": kind, "planeNormal": [a, b, c]}
        case "mesh" if file not in UNNAMED:
            return {"shapeType": kind, "fileName": file.decode(), "meshScale": [a, b, c]}
        case "mesh" if corners:
            return {"shapeType": kind, "vertices": corners}
        case _:
            return None


def make_solid(kind: int, size: Sequence[float]) -> Solid | None:
    """A shape as one of the solids of scenes."""
    a, b, c = size
    match KINDS.get(kind):
        case "sphere":
            return Sphere(a)
        case "box":
            return Box(a, b, c)
        case "capsule":
            return Capsule(b, a)
        case "cylinder":
            return Cylinder(b, a)
        case "plane":
            return Plane((a, b, c), SIDE)
        case _:
            return None


class ShapeCopier:
    """Makes shapes in a simulation, each from its parts and their poses."""

    def __init__(self, client: Any) -> None:
        self.client = client

    def copy_collision_shapes(self, parts: list[tuple[Part, Pose]]) -> list[int]:
        """Collision shapes, as few as PyBullet allows for the parts."""
        one, several = self.client.createCollisionShape, self.client.createCollisionShapeArray
        plain = [part for part in parts if "vertices" not in part[0]]
        some = [plain[first : first + MOST_PARTS] for first in range(0, len(plain), MOST_PARTS)]
        some += [[part] for part in parts if "vertices" in part[0]]
        return [self._create_shape(group, "collision", one, several) for group in some]

    def copy_visual_shape(self, parts: list[tuple[Part, Pose]]) -> int:
        """A visual shape, -1 without parts; PyBullet shows the first MOST_PARTS parts."""
        parts = [({_VISUAL.get(name, name): value for name, value in part.items()}, pose) for part, pose in parts]
        return self._create_shape(parts, "visual", self.client.createVisualShape, self.client.createVisualShapeArray)

    @staticmethod
    def _create_shape(parts: list[tuple[Part, Pose]], word: str, one: Any, several: Any) -> int:
        if not parts:
            return -1
        places = [pose[0] for _, pose in parts]
        turns = [pose[1] for _, pose in parts]
        if len(parts) == 1:
            placed = {f"{word}FramePosition": places[0], f"{word}FrameOrientation": turns[0]}
            return int(one(**parts[0][0], **placed))
        # PyBullet reads every list for each shape, whether its kind needs the entry or not.
        lists = {
            plural: [part.get(name, part.get(_VISUAL.get(name, name), default)) for part, _ in parts]
            for name, plural, default in _LISTS
        }
        return int(several(**lists, **{f"{word}FramePositions": places, f"{word}FrameOrientations": turns}))


_VISUAL = {"height": "length"}  # words of createCollisionShape that createVisualShape has others for
_LISTS: tuple[tuple[str, str, Any], ...] = (
    ("shapeType", "shapeTypes", None),
    ("radius", "radii", 1.0),
    ("halfExtents", "halfExtents", [1.0, 1.0, 1.0]),
    ("height", "lengths", 1.0),
    ("fileName", "fileNames", ""),
    ("meshScale", "meshScales", [1.0, 1.0, 1.0]),
    ("planeNormal", "planeNormals", [0.0, 0.0, 1.0]),
)

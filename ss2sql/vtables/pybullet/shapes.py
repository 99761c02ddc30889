"""The shapes that links collide with."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ss2sql.vtables.contract import Column, Gone, Table, Where
from ss2sql.vtables.pybullet.bodies import KINDS, get_volume
from ss2sql.vtables.pybullet.links import list_demanded_bodies, read_link_pose
from ss2sql.vtables.pybullet.poses import to_world

Key = tuple[int, int, int]


class BulletShapes(Table):
    """One row for each collision shape."""

    name = "shapes"
    text = "the collision shapes of all links; what can be seen may look otherwise"
    columns = (
        Column("body", int, text="the id of its body", filter="="),
        Column("link", int, text="the number of its link, -1 for the base"),
        Column("number", int, text="its number within the link"),
        Column("type", str, text="sphere box capsule cylinder plane mesh"),
        Column("radius", float | None, "m", "of spheres, capsules and cylinders"),
        Column("length", float | None, "m", "of capsules without their ends, and of cylinders"),
        Column("size", list | None, "m", "the edges of boxes along their own axes; of meshes the scale"),
        Column("normal", list | None, text="of planes"),
        Column("file", str | None, text="of meshes, where they were read from one"),
        Column("volume", float | None, "m3", "None for meshes and planes"),
        Column("pos", list | None, "m", "where it is; None where PyBullet does not tell it: see Limits"),
        Column("quat", list | None, text="how it is turned: a quaternion x, y, z, w; None where pos is"),
    )
    groups: ClassVar[Mapping[str, str]] = {
        "read_numbers": "body link number",
        "read_shape": "type radius length size normal file volume",
        "read_pose": "pos quat",
    }

    def keys(self, where: Where) -> list[Key]:
        world = self.world
        return [
            (body, link, n)
            for body in list_demanded_bodies(world, where)
            for link, n, _ in world.shapes.read_shapes(body)
        ]

    def read_numbers(self, key: Key) -> Key:
        self._get_shape(key)
        return key

    def read_shape(self, key: Key) -> tuple[Any, ...]:
        shape = self._get_shape(key)
        kind, (a, b, c), file = KINDS.get(shape[2], "mesh"), shape[3], shape[4].decode(errors="replace")
        radius = a if kind == "sphere" else b if kind in ("capsule", "cylinder") else None
        length = a if kind in ("capsule", "cylinder") else None
        size = [a, b, c] if kind in ("box", "mesh") else None
        normal = [a, b, c] if kind == "plane" else None
        return kind, radius, length, size, normal, file if file not in ("", "unknown_file") else None, get_volume(shape)

    def read_pose(self, key: Key) -> Any:
        shape = self._get_shape(key)
        if shape[5] is None:
            return None, None
        return to_world(read_link_pose(self.world, key[:2]), (shape[5], shape[6]))

    def _get_shape(self, key: Key) -> Any:
        found = self.world.shapes.read_link_shapes(key[0], key[1])
        if key[2] >= len(found):
            raise Gone("its body has other shapes now")
        return found[key[2]]

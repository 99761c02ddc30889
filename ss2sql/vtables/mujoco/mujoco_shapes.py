"""The geometry of MuJoCo's shapes: kinds, volumes and boxes, for all of them at once."""

from __future__ import annotations

from functools import cached_property
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ss2sql.vtables.body_columns import FAR

Array = NDArray[Any]

PLANE, HFIELD, SPHERE, CAPSULE, ELLIPSOID, CYLINDER, BOX, MESH = range(8)
KINDS: Array = np.array(
    ["plane", "terrain", "sphere", "capsule", "ellipsoid", "cylinder", "box", "mesh", "sdf"], dtype=object
)


class MuJoCoShapes:
    """The shapes of a model, where they are now."""

    def __init__(self, model: Any, data: Any) -> None:
        self.model = model
        self.data = data

    @cached_property
    def touchable_bodies(self) -> Array:
        """Whether anything can collide with a body."""
        model = self.model
        touches = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        found: Array = np.bincount(model.geom_bodyid[touches], minlength=model.nbody) > 0
        return found

    @cached_property
    def solid_shapes(self) -> Array:
        """Whether a shape counts for its body: it can touch others, or the body has none that can."""
        model = self.model
        touches = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        found: Array = touches | ~self.touchable_bodies[model.geom_bodyid]
        return found

    def list_body_kinds(self) -> Array:
        """The kind of the only shape of each body, else `compound` or `ghost`."""
        model, solid = self.model, self.solid_shapes
        counts = np.bincount(model.geom_bodyid[solid], minlength=model.nbody)
        kinds = np.where(counts > 1, "compound", "ghost").astype(object)
        single = solid & (counts[model.geom_bodyid] == 1)
        kinds[model.geom_bodyid[single]] = KINDS[model.geom_type[single]]
        return kinds

    def measure_volumes(self) -> Array:
        """In m³; NaN for shapes without an end."""
        kind = self.model.geom_type
        a, b, c = self.model.geom_size.T
        ball, rod = 4 / 3 * np.pi * a**3, np.pi * a**2 * 2 * b
        known: Array = np.select(
            [kind == SPHERE, kind == BOX, kind == CAPSULE, kind == CYLINDER, kind == ELLIPSOID],
            [ball, 8 * a * b * c, ball + rod, rod, 4 / 3 * np.pi * a * b * c],
            np.nan,
        )
        meshes = np.flatnonzero(kind == MESH)
        known[meshes] = [self.mesh_volumes[mesh] for mesh in self.model.geom_dataid[meshes]]
        return known

    @cached_property
    def mesh_volumes(self) -> list[float]:
        """The volume of each mesh: the sum of the pyramids from the origin to its faces."""
        model, found = self.model, []
        for mesh in range(model.nmesh):
            points, faces = model.mesh_vertadr[mesh], model.mesh_faceadr[mesh]
            corners = model.mesh_vert[points : points + model.mesh_vertnum[mesh]].astype(float)
            first, second, third = corners[model.mesh_face[faces : faces + model.mesh_facenum[mesh]]].transpose(1, 0, 2)
            found.append(abs(float(np.einsum("ij,ij->", first, np.cross(second, third)))) / 6)
        return found

    def measure_body_volumes(self) -> Array:
        """The sum of the volumes of their shapes."""
        model, solid = self.model, self.solid_shapes
        found: Array = np.bincount(
            model.geom_bodyid[solid], weights=self.measure_volumes()[solid], minlength=model.nbody
        )
        return found

    def measure_boxes(self) -> Array:
        """The two corners of the box around each shape: an array of (shape, corner, axis)."""
        model, data = self.model, self.data
        kind, size = model.geom_type, model.geom_size
        axes = data.geom_xmat.reshape(-1, 3, 3)
        local = model.geom_aabb
        centre = data.geom_xpos + np.einsum("gij,gj->gi", axes, local[:, :3])
        upright = axes[:, :, 2]
        radius, length = size[:, :1], size[:, 1:2] * np.abs(upright)
        half = np.select(
            [(kind == wanted)[:, None] for wanted in (SPHERE, CAPSULE, CYLINDER, ELLIPSOID, PLANE)],
            [
                radius, radius + length, radius * np.sqrt(np.clip(1 - upright**2, 0, None)) + length,
                np.linalg.norm(axes * size[:, None, :], axis=2), np.full_like(centre, FAR),
            ],
            np.einsum("gij,gj->gi", np.abs(axes), local[:, 3:]),
        )  # fmt: skip
        middle = np.where((kind == PLANE)[:, None], data.geom_xpos, centre)
        boxes = np.stack((middle - half, middle + half), axis=1)
        self._bound_planes(boxes)
        found: Array = np.clip(boxes, -FAR, FAR)
        return found

    def _bound_planes(self, boxes: Array) -> None:
        """Ends the box of a plane along two axes at its front."""
        for plane in np.flatnonzero(self.model.geom_type == PLANE):
            normal = self.data.geom_xmat[plane].reshape(3, 3)[:, 2]
            axis = int(np.argmax(np.abs(normal)))
            if abs(normal[axis]) > 1 - 1e-12:
                boxes[plane, 1 if normal[axis] > 0 else 0, axis] = self.data.geom_xpos[plane, axis]

    def measure_body_boxes(self) -> Array:
        """The boxes around their shapes; around the origin of a body without one."""
        model, solid = self.model, self.solid_shapes
        low, high = self.data.xpos.copy(), self.data.xpos.copy()
        bare = np.bincount(model.geom_bodyid[solid], minlength=model.nbody) == 0
        low[~bare], high[~bare] = FAR, -FAR
        boxes, owners = self.measure_boxes()[solid], model.geom_bodyid[solid]
        np.minimum.at(low, owners, boxes[:, 0])
        np.maximum.at(high, owners, boxes[:, 1])
        return np.stack((low, high), axis=1)

    def read_quaternions(self, index: Array) -> Array:
        """The orientations of shapes, the real part first."""
        turn = import_module("mujoco").mju_mat2Quat
        found = np.empty((len(index), 4))
        for place, matrix in enumerate(self.data.geom_xmat[index]):
            turn(found[place], matrix)
        return found

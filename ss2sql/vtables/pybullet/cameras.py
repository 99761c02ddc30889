"""The cameras of a scene, and what they see."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from ss2sql.vtables.body_columns import VECTOR
from ss2sql.vtables.contract import Column, Gone, Table, Where

WIDTH, HEIGHT = 160, 120  # pixels of the pictures that show which bodies are visible
NEAR, FAR = 0.05, 1000.0  # metres


class Cameras(Table):
    """One row for each view of a scene; a client by itself has none."""

    name, key = "cameras", "name"
    text = "the views of a scene; a client that belongs to none has no cameras"
    columns = (
        Column("name", str, filter="="),
        Column("eye", VECTOR, "m", "where it is"),
        Column("target", VECTOR, "m", "the point that it looks at"),
        Column("up", VECTOR, text="the direction that is up in its pictures"),
        Column("angle", float, "deg", "how much it sees, from bottom to top"),
        Column("sees", list, text="the ids of the bodies in its picture"),
    )
    groups: ClassVar[Mapping[str, str]] = {"read_view": "eye target up angle", "read_sensed": "sees"}

    def keys(self, where: Where) -> list[str]:
        return [name for name in self._get_views() if where.allows("name", name)]

    def read_view(self, key: str) -> tuple[Any, ...]:
        view = self._get_view(key)
        return view.eye, view.target, view.up, view.angle

    def read_sensed(self, key: str) -> list[int]:
        calls, view = self.world.calls, self._get_view(key)
        looking = calls.computeViewMatrix(view.eye, view.target, view.up)
        seeing = calls.computeProjectionMatrixFOV(view.angle, WIDTH / HEIGHT, NEAR, FAR)
        renderer = calls.ER_TINY_RENDERER
        *_, seen = calls.getCameraImage(WIDTH, HEIGHT, looking, seeing, renderer=renderer)
        return [int(body) for body in np.unique(np.asarray(seen)) if body >= 0]  # tuples where PyBullet lacks NumPy

    def _get_views(self) -> dict[str, Any]:
        return getattr(self.world.scene, "views", {})

    def _get_view(self, key: str) -> Any:
        if key not in self._get_views():
            raise Gone
        return self._get_views()[key]

"""Simulations to ask questions of, and their pictures, all without a window; they need the extra `sim`.

`chaos` is a box of particles that fly, collide and explode, `hall` a factory floor with a robot; `render` makes a
picture of either. In order: chaos_scene, mujoco_chaos, ode_chaos, hall_scene, rendering.
"""

from __future__ import annotations

from ss2sql.errors import SessionError, suggest_names
from ss2sql.scenes.chaos_scene import chaos
from ss2sql.scenes.hall_scene import hall
from ss2sql.scenes.rendering import render
from ss2sql.vtables.pybullet.scene import Scene, Sensor, View

__all__ = ["Scene", "Sensor", "View", "chaos", "hall", "render"]


class UnknownSceneError(SessionError, AttributeError):
    """An unknown scene: an error like any other here, and for `hasattr` a missing attribute."""


def __getattr__(name: str) -> object:
    if name.startswith("__"):
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")  # Python itself asks for such names
    raise UnknownSceneError("S002", f"there is no scene '{name}'", hints=suggest_names(name, ("chaos", "hall")))

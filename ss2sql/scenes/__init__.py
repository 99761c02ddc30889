"""Simulations to ask questions of, and their pictures, all without a window; they need the extra `sim`.

`chaos` is a box of particles that fly, collide and explode, `hall` a factory floor with a robot; `render` makes a
picture of either. In order: chaos_scene, mujoco_chaos, ode_chaos, hall_scene, rendering. Each is imported at its first
use.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ss2sql.scenes.chaos_scene import chaos
    from ss2sql.scenes.hall_scene import hall
    from ss2sql.scenes.rendering import render
    from ss2sql.vtables.pybullet.scene import Scene, Sensor, View

__all__ = ["Scene", "Sensor", "View", "chaos", "hall", "render"]

_PLACES = {
    **dict.fromkeys(("Scene", "Sensor", "View"), "ss2sql.vtables.pybullet.scene"),
    "chaos": "ss2sql.scenes.chaos_scene",
    "hall": "ss2sql.scenes.hall_scene",
    "render": "ss2sql.scenes.rendering",
}

if not TYPE_CHECKING:

    def __getattr__(name):
        if name not in _PLACES:
            raise AttributeError(f"module 'ss2sql.scenes' has no attribute '{name}'")
        return getattr(import_module(_PLACES[name]), name)

    def __dir__():
        return __all__

"""Simulations to ask questions of, and their pictures, all without a window; they need the extra `sim`.

`chaos` is a box of particles that fly, collide and explode, `hall` a factory floor with a robot; `render` makes a
picture of either. In order: chaos_scene, mujoco_chaos, ode_chaos, hall_scene, rendering.
"""

from __future__ import annotations

from ss2sql.scenes.chaos_scene import chaos
from ss2sql.scenes.hall_scene import hall
from ss2sql.scenes.rendering import render
from ss2sql.vtables.pybullet.scene import Scene, Sensor, View

__all__ = ["Scene", "Sensor", "View", "chaos", "hall", "render"]

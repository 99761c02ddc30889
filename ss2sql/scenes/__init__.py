"""Simulations to query, and their pictures, without a window; they need the extra `sim`.

`chaos` is a box of particles that fly, collide and explode, `hall` a factory floor with a robot; `render` makes a
picture of either. In the order of a picture's creation: scenes/particles.py and scenes/drawn.py (chaos),
scenes/layout.py and scenes/factory.py (hall), scenes/camera.py, scenes/strokes.py, scenes/picture.py (pictures). Scenes
are built from the solids in `vtables/pybullet/`.
"""

from __future__ import annotations

from ss2sql.errors import SessionError, did_you_mean
from ss2sql.scenes.factory import hall
from ss2sql.scenes.particles import chaos
from ss2sql.scenes.picture import render
from ss2sql.vtables.pybullet.scene import Scene, Sensor, View

__all__ = ["Scene", "Sensor", "View", "chaos", "hall", "render"]


class UnknownSceneError(SessionError, AttributeError):
    """An unknown scene: an error like any other here, and for `hasattr` a missing attribute."""


def __getattr__(name: str) -> object:
    if name.startswith("__"):
        raise AttributeError(f"module '{__name__}' has no attribute '{name}'")  # Python itself asks for such names
    raise UnknownSceneError("S002", f"there is no scene '{name}'", hints=did_you_mean(name, ("chaos", "hall")))

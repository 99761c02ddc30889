"""Cameras: pictures of a simulation, and conversion between points in space and pixels."""

from __future__ import annotations

from functools import cached_property
from math import asin, degrees, dist
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ss2sql.fast_dataclasses import dataclass
from ss2sql.vtables.pybullet.pybullet_loader import import_pybullet
from ss2sql.vtables.pybullet.scene import View
from ss2sql.vtables.pybullet.solids import Vector

Floats = NDArray[np.float32]
LIGHT: Vector = (0.35, -0.5, 1.1)  # the direction from which it comes
TAPS = (-1.2, 0.0, 1.2)  # pixels of the light's picture around a point, for soft edges of shadows
SLACK = 0.08  # metres of tolerance for the depth of a surface in the light's picture


@dataclass(frozen=True, slots=True)
class Shot:
    """A camera's picture, per pixel: the colour from 0 to 1, the depth from 0 to 1, and the body, or -1."""

    colours: Floats
    depth: Floats
    bodies: NDArray[np.int64]


@dataclass(frozen=True)
class Camera:
    """A camera with a picture of `width` x `height` pixels that sees everything between `near` and `far`."""

    view: View
    width: int
    height: int
    near: float
    far: float

    @cached_property
    def _matrices(self) -> tuple[list[float], list[float]]:
        view, bullet = self.view, import_pybullet()
        return (
            list(bullet.computeViewMatrix(view.eye, view.target, view.up)),
            list(bullet.computeProjectionMatrixFOV(view.angle, self.width / self.height, self.near, self.far)),
        )

    @cached_property
    def _matrix(self) -> NDArray[np.float64]:
        looking, seeing = (np.reshape(matrix, (4, 4)).T for matrix in self._matrices)  # Bullet writes columns
        return np.asarray(seeing @ looking, np.float64)

    def take_picture(self, client: Any) -> Shot:
        looking, seeing = self._matrices
        _, _, colours, depth, bodies = client.getCameraImage(
            self.width, self.height, looking, seeing,
            shadow=0, lightDirection=LIGHT, lightColor=(1, 1, 1), lightDistance=1,
            lightAmbientCoeff=0.65, lightDiffuseCoeff=0.42, lightSpecularCoeff=0.05,
            renderer=import_pybullet().ER_TINY_RENDERER,
        )  # fmt: skip
        shape = (self.height, self.width)  # a build without NumPy gives flat tuples
        return Shot(
            np.reshape(colours, (*shape, 4))[..., :3].astype(np.float32) / np.float32(255),
            np.asarray(np.reshape(depth, shape), np.float32),
            np.asarray(np.reshape(bodies, shape), np.int64),
        )

    def project_points(self, points: NDArray[Any]) -> tuple[Floats, Floats, Floats]:
        """Column and row of points (n x 3) in the picture, and their distance, which is negative behind the camera."""
        matrix = self._matrix.astype(points.dtype)
        x, y, distance = (points @ matrix[row, :3] + matrix[row, 3] for row in (0, 1, 3))
        away = np.maximum(distance, self.near)
        return (x / away + 1) / 2 * self.width, (1 - y / away) / 2 * self.height, distance

    def convert_depths(self, depth: Floats) -> Floats:
        """Metres along the line of sight, from the depths of a shot."""
        return self.near * self.far / (self.far - depth * (self.far - self.near))

    def locate_pixels(self, depth: Floats) -> Floats:
        """The points in space of all pixels, from their depths."""
        back = np.linalg.inv(self._matrix).astype(np.float32)
        x = (np.arange(self.width, dtype=np.float32) + 0.5) / self.width * 2 - 1
        y = 1 - (np.arange(self.height, dtype=np.float32) + 0.5) / self.height * 2
        z = depth * 2 - 1
        found = [back[k, 0] * x[None, :] + back[k, 1] * y[:, None] + back[k, 2] * z + back[k, 3] for k in range(4)]
        return np.stack([part / found[3] for part in found[:3]], axis=-1)


def make_sun_camera(low: Vector, high: Vector, pixels: int) -> Camera:
    """The camera at the light's position, far away, so that the rays are almost parallel."""
    middle = tuple((a + b) / 2 for a, b in zip(low, high, strict=True))
    around = dist(low, high) / 2
    away = 8 * around
    scale = away / dist((0, 0, 0), LIGHT)
    eye = (middle[0] + LIGHT[0] * scale, middle[1] + LIGHT[1] * scale, middle[2] + LIGHT[2] * scale)
    view = View(eye, (middle[0], middle[1], middle[2]), 2 * degrees(asin(around / away)), (0.0, 1.0, 0.0))
    return Camera(view, pixels, pixels, away - around, away + around)


def compute_light(shot: Shot, seen: Camera, light: Shot, source: Camera) -> Floats:
    """The light of each pixel: 1, or 0 in the shadow, with soft edges."""
    height, width = shot.depth.shape
    column, row, distance = source.project_points(seen.locate_pixels(shot.depth).reshape(-1, 3))
    surface = source.convert_depths(light.depth)
    total = np.zeros(column.shape, np.float32)
    for across in TAPS:
        x = np.clip((column + across).astype(np.int32), 0, source.width - 1)
        for up in TAPS:
            y = np.clip((row + up).astype(np.int32), 0, source.height - 1)
            total += surface[y, x] > distance - SLACK
    return (total / np.float32(len(TAPS) ** 2)).reshape(height, width)

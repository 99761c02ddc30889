"""The particles of the scene `chaos` for simulators other than PyBullet: drawn from a seed, before anything moves.

They are drawn as PyBullet's chaos draws them, but where there is room for one is found by spheres around the particles
and not by PyBullet, so the same seed gives other particles there.
"""

from __future__ import annotations

from collections.abc import Iterator
from colorsys import hsv_to_rgb
from dataclasses import dataclass
from importlib import import_module
from math import cos, dist, pi, sin, sqrt
from random import Random
from typing import Any

from ss2sql.errors import SessionError
from ss2sql.scenes.particles import ACCELERATION, HALF, KINDS, SPEED
from ss2sql.scenes.solids import Box, Capsule, Colour, Cylinder, Solid, Sphere, Vector, reach


@dataclass(frozen=True, slots=True)
class Particle:
    """A particle at its birth. `turned`: roll, pitch and yaw in radians."""

    name: str
    solid: Solid
    position: Vector
    turned: Vector
    velocity: Vector
    spin: Vector
    mass: float
    colour: Colour


class Draws:
    """All that is left to chance, from one seed."""

    def __init__(self, seed: int) -> None:
        self.random = Random(seed)
        self._counts: dict[str, int] = {}

    def particles(self, count: int) -> Iterator[Particle]:
        """Particles that do not touch each other, at most so many: where there is no more room there are fewer."""
        if count < 0:
            raise SessionError("S002", f"a scene cannot have {count} bodies", hints=("give a number from 0 on",))
        taken: list[tuple[Vector, float]] = []
        for _ in range(count):
            particle = self.particle(taken)
            if particle is not None:
                taken.append((particle.position, reach(particle.solid)))
                yield particle

    def particle(self, taken: list[tuple[Vector, float]]) -> Particle | None:
        """One particle outside of spheres that are taken, if there is room."""
        solid, kind = self._solid()
        around = reach(solid)
        for _ in range(100):
            position = self.point(HALF - around)
            if all(dist(position, other) > around + radius for other, radius in taken):
                break
        else:
            return None
        mass = self.random.uniform(1.0, 100.0)
        colour = hsv_to_rgb(self.random.random(), self.random.uniform(0.55, 0.95), self.random.uniform(0.7, 1.0))
        turned, velocity, spin = self.point(pi), self.within(SPEED), self.within(2.0)
        return Particle(self.name(kind), solid, position, turned, velocity, spin, mass, colour)

    def name(self, kind: str) -> str:
        """`box_1`, `box_2` and so on."""
        self._counts[kind] = self._counts.get(kind, 0) + 1
        return f"{kind}_{self._counts[kind]}"

    def force(self, mass: float) -> Vector:
        """What pushes a particle for a while."""
        return self.within(mass * ACCELERATION)

    def _solid(self) -> tuple[Solid, str]:
        kind = self.random.choice(KINDS)
        a, b, c = (self.random.uniform(0.1, 0.5) for _ in range(3))
        match kind:
            case "sphere":
                return Sphere(a), kind
            case "box":
                return Box(2 * a, 2 * b, 2 * c), kind
            case "capsule":
                return Capsule(a / 1.5, 2 * b), kind
            case _:
                return Cylinder(a, 2 * b), kind

    def point(self, half: float) -> Vector:
        """A point in the cube with this half edge."""
        x, y, z = (self.random.uniform(-half, half) for _ in range(3))
        return x, y, z

    def direction(self) -> Vector:
        """A vector of the length 1."""
        z, angle = self.random.uniform(-1.0, 1.0), self.random.uniform(0.0, 2 * pi)
        across = sqrt(1 - z * z)
        return across * cos(angle), across * sin(angle), z

    def within(self, length: float) -> Vector:
        """A vector of random direction and of a random length up to this one."""
        (x, y, z), size = self.direction(), self.random.uniform(0.0, length)
        return x * size, y * size, z * size


def quaternion(turned: Vector) -> tuple[float, float, float, float]:
    """The quaternion (x, y, z, w) of roll, pitch and yaw."""
    (sx, sy, sz), (cx, cy, cz) = ([function(angle / 2) for angle in turned] for function in (sin, cos))
    return (
        sx * cy * cz - cx * sy * sz,
        cx * sy * cz + sx * cy * sz,
        cx * cy * sz - sx * sy * cz,
        cx * cy * cz + sx * sy * sz,
    )


def simulator(name: str, install: str) -> Any:
    """The module of a simulator, or the error that says how to install it."""
    try:
        return import_module(name)
    except ImportError as reason:
        message = f"this scene needs the package {name}, which is not installed"
        raise SessionError("S003", message, hints=(install,)) from reason

"""The particles of the scene `chaos`, drawn from a seed.

PyBullet itself finds room for its particles, other simulators use bounding spheres, so their particles differ.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from colorsys import hsv_to_rgb
from importlib import import_module
from math import cos, dist, pi, sin, sqrt
from random import Random
from typing import Any

from ss2sql.errors import SessionError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.vtables.pybullet.solids import Box, Capsule, Colour, Cylinder, Solid, Sphere, Vector, measure_reach

HALF = 5.0  # half the edge of the box, whose middle is the origin
SPEED = 3.0  # of particles at their birth, at most, in m/s
ACCELERATION = 4.0  # that forces give, at most
KINDS = ("sphere", "box", "capsule", "cylinder")


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


class ParticleSource:
    """The random choices. `name` gives the next name of a kind: `box_1`, `box_2` and so on."""

    def __init__(self, random: Random, name: Callable[[str], str] | None = None) -> None:
        self.random = random
        self.name = self._make_name if name is None else name
        self._counts: dict[str, int] = {}

    def draw_particles(self, count: int) -> Iterator[Particle]:
        """Particles that do not touch each other, at most so many, fewer where there is no more room."""
        check_count(count)
        taken: list[tuple[Vector, float]] = []
        for _ in range(count):
            particle = self.draw_particle(is_outside(taken))
            if particle is not None:
                taken.append((particle.position, measure_reach(particle.solid)))
                yield particle

    def draw_particle(self, is_free: Callable[[Vector, float], bool]) -> Particle | None:
        """One particle at a random free place, if one is found; `is_free` tests spheres."""
        solid, kind = self._draw_solid()
        around = measure_reach(solid)
        for _ in range(100):
            position = self.draw_point(HALF - around)
            if is_free(position, around):
                break
        else:
            return None
        mass = self.random.uniform(1.0, 100.0)
        colour = hsv_to_rgb(self.random.random(), self.random.uniform(0.55, 0.95), self.random.uniform(0.7, 1.0))
        turned, velocity, spin = self.draw_point(pi), self.draw_vector(SPEED), self.draw_vector(2.0)
        return Particle(self.name(kind), solid, position, turned, velocity, spin, mass, colour)

    def _make_name(self, kind: str) -> str:
        self._counts[kind] = self._counts.get(kind, 0) + 1
        return f"{kind}_{self._counts[kind]}"

    def draw_force(self, mass: float) -> Vector:
        """A random force on a particle."""
        return self.draw_vector(mass * ACCELERATION)

    def _draw_solid(self) -> tuple[Solid, str]:
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

    def draw_point(self, half: float) -> Vector:
        """A point in the cube with this half edge."""
        x, y, z = (self.random.uniform(-half, half) for _ in range(3))
        return x, y, z

    def draw_direction(self) -> Vector:
        """A vector of the length 1."""
        z, angle = self.random.uniform(-1.0, 1.0), self.random.uniform(0.0, 2 * pi)
        across = sqrt(1 - z * z)
        return across * cos(angle), across * sin(angle), z

    def draw_vector(self, length: float) -> Vector:
        """A vector of random direction and of a random length up to this one."""
        (x, y, z), size = self.draw_direction(), self.random.uniform(0.0, length)
        return x * size, y * size, z * size


def check_count(bodies: int) -> None:
    """Refuses invalid numbers of bodies."""
    if bodies < 0:
        raise SessionError("S002", f"a scene cannot have {bodies} bodies", hints=("give a number from 0 on",))


def is_outside(taken: list[tuple[Vector, float]]) -> Callable[[Vector, float], bool]:
    """Whether a sphere touches none of these spheres."""
    return lambda place, radius: all(dist(place, other) > radius + its for other, its in taken)


def make_quaternion(turned: Vector) -> tuple[float, float, float, float]:
    """The quaternion (x, y, z, w) of roll, pitch and yaw."""
    (sx, sy, sz), (cx, cy, cz) = ([function(angle / 2) for angle in turned] for function in (sin, cos))
    return (
        sx * cy * cz - cx * sy * sz,
        cx * sy * cz + sx * cy * sz,
        cx * cy * sz - sx * sy * cz,
        cx * cy * cz + sx * sy * sz,
    )


def import_sim(name: str, install: str) -> Any:
    """The module of a simulator. Raises the error with the install command."""
    try:
        return import_module(name)
    except ImportError as reason:
        message = f"this scene needs the package {name}, which is not installed"
        raise SessionError("S003", message, hints=(install,)) from reason

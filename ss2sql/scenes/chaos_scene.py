"""The scene `chaos`: a closed box full of particles that fly, collide, explode and are born.

PyBullet itself finds room for its particles, other simulators use bounding spheres, so their particles differ.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from colorsys import hsv_to_rgb
from math import cos, dist, pi, sin, sqrt
from random import Random
from typing import Any, ClassVar

from ss2sql.errors import SessionError
from ss2sql.fast_dataclasses import dataclass
from ss2sql.vtables.pybullet.client import import_pybullet
from ss2sql.vtables.pybullet.scene import (
    Box,
    Capsule,
    Colour,
    Cylinder,
    Plane,
    Scene,
    Solid,
    Sphere,
    Vector,
    View,
    measure_reach,
)

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
        check_particle_count(count)
        taken: list[tuple[Vector, float]] = []
        for _ in range(count):
            particle = self.draw_particle(is_particle_outside(taken))
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
        return self.draw_vector(mass * ACCELERATION)

    def draw_splinters(
        self, position: Vector, velocity: Vector, mass: float, spread: float
    ) -> Iterator[tuple[Particle, int]]:
        """The white splinters of a particle, with its mass and its movement, and for how many steps each lives."""
        count, still = self.random.randint(6, 10), (0.0, 0.0, 0.0)
        for _ in range(count):
            away = self.draw_direction()
            x, y, z = (max(0.1 - HALF, min(HALF - 0.1, p + spread * a)) for p, a in zip(position, away, strict=True))
            speed = self.random.uniform(1.5, 3.5)
            vx, vy, vz = (v + speed * a for v, a in zip(velocity, away, strict=True))
            splinter = Particle(
                self.name("particle"), SPLINTER, (x, y, z), still, (vx, vy, vz), still, mass / count, WHITE
            )
            yield splinter, self.random.randint(*SPLINTER_STEPS)

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


def check_particle_count(bodies: int) -> None:
    if bodies < 0:
        raise SessionError("S002", f"a scene cannot have {bodies} bodies", hints=("give a number from 0 on",))


def is_particle_outside(taken: list[tuple[Vector, float]]) -> Callable[[Vector, float], bool]:
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


INSIDE = HALF - 0.02  # where the middle of every particle stays
BOUNCE = 0.3
PUSH_EVERY = 120  # steps; then every force has a new direction and strength
BIRTH_EVERY = 90
LOOK_EVERY = 4  # steps between checks of contacts
HARD = 300.0  # a contact of this force, in N, can make a particle explode
EXPLODES = 0.03  # the probability that it does
FULL = 4  # no births beyond this multiple of the bodies at the beginning
SPLINTER = Sphere(0.07)
SPLINTER_STEPS = (2 * 240, 10 * 240)  # the lifetime of a splinter, at least and at most
WHITE = (1.0, 1.0, 1.0)
WALLS: dict[str, Vector] = {
    "wall_left": (1, 0, 0), "wall_right": (-1, 0, 0), "wall_front": (0, 1, 0), "wall_back": (0, -1, 0),
    "wall_floor": (0, 0, 1), "wall_ceiling": (0, 0, -1),
}  # fmt: skip


class Chaos(Scene):
    """A closed box of 10 x 10 x 10 m without gravity. Collisions can make a particle explode into white splinters."""

    bounds = ((-HALF, -HALF, -HALF), (HALF, HALF, HALF))
    views: ClassVar[dict[str, View]] = {
        "corner": View((11.0, -22.0, 10.5), (0.0, 0.0, -0.7), 33.0),
        "front": View((0.0, -24.0, 0.0), (0.0, 0.0, 0.0), 33.0),
        "top": View((0.0, 0.0, 24.0), (0.0, 0.0, 0.0), 33.0, (0.0, 1.0, 0.0)),
    }

    def __init__(self, seed: int, bodies: int, client: Any = None) -> None:
        super().__init__(seed, client)
        self.full = FULL * bodies
        self.draws = ParticleSource(self.random, self.next_name)
        self.ends: dict[int, int] = {}  # the step in which a splinter vanishes
        corners = [(x, y, z) for x in (-HALF, HALF) for y in (-HALF, HALF) for z in (-HALF, HALF)]
        self.outlines = [(a, b) for a in corners for b in corners if a < b and dist(a, b) == 2 * HALF]
        self.client.setPhysicsEngineParameter(erp=0.8, contactERP=0.8)  # separates overlapping bodies at once
        for name, (x, y, z) in WALLS.items():
            colour = (0.84, 0.86, 0.9) if name == "wall_floor" else (1.0, 1.0, 1.0)
            wall = self.add(name, Plane((x, y, z), 2 * HALF), (-HALF * x, -HALF * y, -HALF * z), colour)
            self._make_bouncy(wall)
        for _ in range(bodies):
            self.add_particle()

    def before_step(self) -> None:
        if self.steps % PUSH_EVERY == 0 and self.steps:
            for body in self.forces:
                self.forces[body] = self.draws.draw_force(self.client.getDynamicsInfo(body, -1)[0])
        if self.steps % BIRTH_EVERY == 0 and self.steps and len(self.names) < self.full:
            self.add_particle()
        if self.steps % LOOK_EVERY == 0:
            self._explode_collided()
            self._remove_expired()

    def after_step(self) -> None:
        where, push = self.client.getBasePositionAndOrientation, self.client.applyExternalForce
        in_world = import_pybullet().WORLD_FRAME
        for body, force in self.forces.items():
            position, _ = where(body)
            if max(map(abs, position)) > INSIDE:
                position = self._reflect_at_wall(body)
            push(body, -1, force, position, in_world)
        for body in self.ends:
            if max(map(abs, where(body)[0])) > INSIDE:
                self._reflect_at_wall(body)

    def _reflect_at_wall(self, body: int) -> Vector:
        """Reflects a body at the wall where its middle is about to leave the box."""
        position, turned = self.client.getBasePositionAndOrientation(body)
        velocity, spin = self.client.getBaseVelocity(body)
        x, y, z = (max(-INSIDE, min(INSIDE, p)) for p in position)
        back = [-BOUNCE * v if p * v > 0 and abs(p) > INSIDE else v for p, v in zip(position, velocity, strict=True)]
        self.client.resetBasePositionAndOrientation(body, (x, y, z), turned)
        self.client.resetBaseVelocity(body, back, spin)
        return x, y, z

    def add_particle(self) -> int | None:
        """A new particle at a random place where there is room, if one is found."""
        particle = self.draws.draw_particle(self.is_free)
        if particle is None:
            return None
        body = self._add_particle(particle)
        self.forces[body] = self.draws.draw_force(particle.mass)
        return body

    def _add_particle(self, particle: Particle) -> int:
        body = self.add(
            particle.name, particle.solid, particle.position, particle.colour, particle.mass, particle.turned
        )
        self._make_bouncy(body)
        self.client.resetBaseVelocity(body, particle.velocity, particle.spin)
        return body

    def explode_body(self, body: int) -> None:
        """Replaces a particle by white splinters with its mass and its movement."""
        position, _ = self.client.getBasePositionAndOrientation(body)
        velocity, _ = self.client.getBaseVelocity(body)
        mass = self.client.getDynamicsInfo(body, -1)[0]
        low, high = self.client.getAABB(body)
        spread = min(b - a for a, b in zip(low, high, strict=True)) / 3
        self.remove(body)
        for splinter, steps in self.draws.draw_splinters(position, velocity, mass, spread):
            self.ends[self._add_particle(splinter)] = self.steps + steps

    def _explode_collided(self) -> None:
        hard: set[int] = set()
        for contact in self.client.getContactPoints():
            one, other, strength = contact[1], contact[2], contact[9]
            if strength > HARD and one in self.forces and other in self.forces:
                hard |= {one, other}
        for body in sorted(hard):
            if self.random.random() < EXPLODES:
                self.explode_body(body)

    def _remove_expired(self) -> None:
        for body in [body for body, end in self.ends.items() if end <= self.steps]:
            del self.ends[body]
            self.remove(body)

    def _make_bouncy(self, body: int) -> None:
        # Bullet multiplies the values of the two bodies, and has damping by default.
        self.client.changeDynamics(body, -1, restitution=sqrt(BOUNCE), linearDamping=0.0, angularDamping=0.02)


def chaos(seed: int = 18, bodies: int = 150, client: Any = None) -> Chaos:
    """A closed box of particles without gravity, centred at the origin, with `bodies` of them at the beginning.

    It builds in a simulation of its own, or in `client`, which it empties.
    """
    check_particle_count(bodies)
    return Chaos(seed, bodies, client)

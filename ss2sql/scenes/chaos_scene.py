"""The scene `chaos`: a closed box full of particles that fly, collide, explode and are born."""

from __future__ import annotations

from math import dist, sqrt
from typing import Any, ClassVar

from ss2sql.scenes.random_particles import HALF, ParticleSource, check_count
from ss2sql.vtables.pybullet.pybullet_loader import import_pybullet
from ss2sql.vtables.pybullet.scene import Scene, View
from ss2sql.vtables.pybullet.solids import Plane, Sphere, Vector

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
        for name, normal in WALLS.items():
            colour = (0.84, 0.86, 0.9) if name == "wall_floor" else (1.0, 1.0, 1.0)
            wall = self.add(name, Plane(normal, 2 * HALF), _scale_vector(normal, -HALF), colour)
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
        body = self.add(
            particle.name, particle.solid, particle.position, particle.colour, particle.mass, particle.turned
        )
        self._make_bouncy(body)
        self.client.resetBaseVelocity(body, particle.velocity, particle.spin)
        self.forces[body] = self.draws.draw_force(particle.mass)
        return body

    def explode_body(self, body: int) -> None:
        """Replaces a particle by white splinters with its mass and its movement."""
        position, _ = self.client.getBasePositionAndOrientation(body)
        velocity, _ = self.client.getBaseVelocity(body)
        mass = self.client.getDynamicsInfo(body, -1)[0]
        low, high = self.client.getAABB(body)
        spread = min(b - a for a, b in zip(low, high, strict=True)) / 3
        self.remove(body)
        count = self.random.randint(6, 10)
        for _ in range(count):
            away = self.draws.draw_direction()
            place = tuple(max(0.1 - HALF, min(HALF - 0.1, p + spread * a)) for p, a in zip(position, away, strict=True))
            splinter = self.add(self.next_name("particle"), SPLINTER, place, WHITE, mass / count)
            self._make_bouncy(splinter)
            speed = self.random.uniform(1.5, 3.5)
            self.client.resetBaseVelocity(splinter, [v + speed * a for v, a in zip(velocity, away, strict=True)])
            self.ends[splinter] = self.steps + self.random.randint(*SPLINTER_STEPS)

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


def _scale_vector(vector: Vector, factor: float) -> Vector:
    return vector[0] * factor, vector[1] * factor, vector[2] * factor


def chaos(seed: int = 18, bodies: int = 150, client: Any = None) -> Chaos:
    """A closed box of particles without gravity, centred at the origin, with `bodies` of them at the beginning.

    It builds in a simulation of its own, or in `client`, which it empties.
    """
    check_count(bodies)
    return Chaos(seed, bodies, client)

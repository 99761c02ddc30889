"""The scene `chaos` in ODE, the simulator for which the paper shows it. It needs Debian's python3-pyode."""

from __future__ import annotations

from math import dist
from random import Random
from typing import Any

from ss2sql.errors import require_package
from ss2sql.scenes.chaos_scene import (  # fmt: skip
    BIRTH_EVERY,
    BOUNCE,
    EXPLODES,
    FULL,
    HALF,
    PUSH_EVERY,
    WALLS,
    Particle,
    ParticleSource,
    is_particle_outside,
    make_quaternion,
)
from ss2sql.vtables.ode import OdeWorld
from ss2sql.vtables.pybullet.scene import TIME_STEP, Box, Capsule, Cylinder, Solid, Sphere, Vector

HARD = 5.0  # m/s, the speed of a contact at which a particle can explode


class OdeChaos:
    """A closed box of 10 x 10 x 10 m without gravity. Collisions can make a particle explode into white splinters.

    - `world`, `space`: the `ode.World` and the `ode.HashSpace`; geoms have the attributes `name` and `colour`
    - `particles`: all geoms that are no walls, in the order of their births
    - `births`, `deaths`: how many particles were added and removed
    """

    def __init__(self, seed: int, bodies: int) -> None:
        self.ode = require_package("ode", "ode", "this scene")
        self.seed = seed
        self.steps = self.births = self.deaths = 0
        self.world, self.space = self.ode.World(), self.ode.HashSpace()
        self.walls = [self.ode.GeomPlane(self.space, normal, -HALF) for normal in WALLS.values()]
        for wall, name in zip(self.walls, WALLS, strict=True):
            wall.name = name
        self.particles: list[Any] = []
        self._forces: dict[Any, Vector] = {}
        self._ends: dict[Any, int] = {}
        self._hit: list[Any] = []
        self._joints = self.ode.JointGroup()
        self._draws = ParticleSource(Random(seed))
        for particle in self._draws.draw_particles(bodies):
            self._forces[self._add_geom(particle)] = self._draws.draw_force(particle.mass)
        self._full = FULL * bodies

    @property
    def time(self) -> float:
        return self.steps * TIME_STEP

    def step(self, n: int = 1) -> None:
        """Lets `n` steps of the simulation pass, each of a 240th of a second."""
        for _ in range(n):
            if self.steps and self.steps % PUSH_EVERY == 0:
                for geom in self._forces:
                    self._forces[geom] = self._draws.draw_force(geom.getBody().getMass().mass)
            if self.steps and self.steps % BIRTH_EVERY == 0 and len(self.particles) < self._full:
                self._add_particle()
            for geom, force in self._forces.items():
                geom.getBody().addForce(force)
            self.space.collide(None, self._collide_pair)
            self.world.step(TIME_STEP)  # quickStep uses random numbers of its own
            self._joints.empty()
            self.steps += 1
            self._explode_some()
            for geom in [geom for geom, end in self._ends.items() if end <= self.steps]:
                self.remove_geom(geom)

    def _collide_pair(self, _: object, one: Any, other: Any) -> None:
        for contact in self.ode.collide(one, other):
            contact.setBounce(BOUNCE)
            contact.setBounceVel(0.05)
            contact.setMu(0.5)
            joint = self.ode.ContactJoint(self.world, self._joints, contact)
            joint.attach(one.getBody(), other.getBody())
            place, normal, _, _, _ = contact.getContactGeomParams()
            if one in self._forces and other in self._forces and self._measure_speed(one, other, place, normal) > HARD:
                self._hit += [one, other]

    @staticmethod
    def _measure_speed(one: Any, other: Any, place: Vector, normal: Vector) -> float:
        """The speed at which two geoms approach at a point."""
        first, second = one.getBody().getPointVel(place), other.getBody().getPointVel(place)
        return float(sum((b - a) * n for a, b, n in zip(first, second, normal, strict=True)))

    def _explode_some(self) -> None:
        hit, self._hit = dict.fromkeys(self._hit), []
        for geom in self.particles[:]:
            if geom in hit and self._draws.random.random() < EXPLODES:
                self.explode_geom(geom)

    def explode_geom(self, geom: Any) -> None:
        """Replaces a particle by white splinters with its mass and its movement."""
        body = geom.getBody()
        position, velocity, mass = body.getPosition(), body.getLinearVel(), body.getMass().mass
        self.remove_geom(geom)
        for splinter, steps in self._draws.draw_splinters(position, velocity, mass, 0.1):
            self._ends[self._add_geom(splinter)] = self.steps + steps

    def _add_particle(self) -> None:
        taken = [(geom.getPosition(), _measure_particle_reach(geom)) for geom in self.particles]
        particle = self._draws.draw_particle(is_particle_outside(taken))
        if particle is not None:
            self._forces[self._add_geom(particle)] = self._draws.draw_force(particle.mass)

    def remove_geom(self, geom: Any) -> None:
        self.space.remove(geom)
        self.particles.remove(geom)
        self._forces.pop(geom, None)
        self._ends.pop(geom, None)
        geom.setBody(None)
        self.deaths += 1

    def __del__(self) -> None:
        # If world and bodies become garbage together, pyode may destroy the world first and crash on the bodies.
        for geom in getattr(self, "particles", ()):
            geom.setBody(None)

    def _add_geom(self, particle: Particle) -> Any:
        body, mass = self.ode.Body(self.world), self.ode.Mass()
        geom = self._make_geom(particle.solid, mass)
        mass.adjust(particle.mass)
        body.setMass(mass)
        geom.setBody(body)
        x, y, z, w = make_quaternion(particle.turned)
        body.setPosition(particle.position)
        body.setQuaternion((w, x, y, z))
        body.setLinearVel(particle.velocity)
        body.setAngularVel(particle.spin)
        geom.name, geom.colour = particle.name, particle.colour
        self.particles.append(geom)
        self.births += 1
        return geom

    def _make_geom(self, solid: Solid, mass: Any) -> Any:
        """A geom, and how its mass is spread."""
        ode, upright = self.ode, 3
        match solid:
            case Sphere(radius):
                mass.setSphere(1.0, radius)
                return ode.GeomSphere(self.space, radius)
            case Box(x, y, z):
                mass.setBox(1.0, x, y, z)
                return ode.GeomBox(self.space, (x, y, z))
            case Capsule(radius, length):
                mass.setCappedCylinder(1.0, upright, radius, length)
                return ode.GeomCapsule(self.space, radius, length)
            case Cylinder(radius, length):
                mass.setCylinder(1.0, upright, radius, length)
                return ode.GeomCylinder(self.space, radius, length)
        raise ValueError(f"{solid} is no particle")

    def __world__(self) -> OdeWorld:
        return OdeWorld(self.space, clock=lambda: self.time)

    def __repr__(self) -> str:
        return f"<chaos in ODE of seed {self.seed}: {len(self.particles)} particles, {self.time:.2f} s>"


def _measure_particle_reach(geom: Any) -> float:
    """The radius of a sphere around a geom."""
    low_x, high_x, low_y, high_y, low_z, high_z = geom.getAABB()
    return dist((low_x, low_y, low_z), (high_x, high_y, high_z)) / 2


def chaos(seed: int = 18, bodies: int = 150) -> OdeChaos:
    """A closed box of particles without gravity, centred at the origin, with `bodies` of them at the beginning."""
    return OdeChaos(seed, bodies)

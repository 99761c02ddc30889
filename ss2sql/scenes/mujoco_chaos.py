"""The scene `chaos` in MuJoCo: the same box of particles, written as a model in MuJoCo's own language, MJCF.

MuJoCo's models cannot grow while they run, so there are no births and explosions.
"""

from __future__ import annotations

from collections.abc import Iterable
from random import Random
from xml.sax.saxutils import quoteattr

from ss2sql.errors import require_package
from ss2sql.scenes.chaos_scene import HALF, PUSH_EVERY, WALLS, Particle, ParticleSource, make_quaternion
from ss2sql.vtables.mujoco import MuJoCoWorld
from ss2sql.vtables.pybullet.scene import TIME_STEP, Box, Capsule, Cylinder, Solid, Sphere, Vector

# A contact is a spring with a damper, which gives back the part exp(-pi z / sqrt(1 - z²)) of the speed: 0.3 here.
_BOUNCE = "0.02 0.358"


class MuJoCoChaos:
    """A closed box of 10 x 10 x 10 m without gravity.

    - `model`, `data`: the `mujoco.MjModel` and `mujoco.MjData`
    - `mjcf`: the text that the model was made of
    - `names`: the name of every body, by its id
    - `forces`: the force that acts on a body, by its id
    """

    def __init__(self, seed: int, bodies: int) -> None:
        self.mujoco = require_package("mujoco", "mujoco", "this scene")
        self.seed = seed
        self.steps = 0
        self._draws = ParticleSource(Random(seed))
        particles = list(self._draws.draw_particles(bodies))
        self.mjcf = write_mjcf(particles)
        self.model = self.mujoco.MjModel.from_xml_string(self.mjcf)
        self.data = self.mujoco.MjData(self.model)
        self.names = {number: self.model.body(number).name for number in range(self.model.nbody)}
        self.forces: dict[int, Vector] = {}
        for particle in particles:
            joint = self.data.joint(particle.name)
            joint.qvel[:3] = particle.velocity
            joint.qvel[3:] = particle.spin
            self.forces[int(self.model.body(particle.name).id)] = self._draws.draw_force(particle.mass)
        self.mujoco.mj_forward(self.model, self.data)

    @property
    def time(self) -> float:
        return float(self.data.time)

    def step(self, n: int = 1) -> None:
        """Lets `n` steps of the simulation pass, each of a 240th of a second."""
        for _ in range(n):
            if self.steps % PUSH_EVERY == 0 and self.steps:
                for body in self.forces:
                    self.forces[body] = self._draws.draw_force(float(self.model.body_mass[body]))
            for body, force in self.forces.items():
                self.data.xfrc_applied[body, :3] = force
            self.mujoco.mj_step(self.model, self.data)
            self.steps += 1
        # Updates what depends on positions and velocities; later steps stay the same.
        self.mujoco.mj_kinematics(self.model, self.data)
        self.mujoco.mj_comPos(self.model, self.data)
        self.mujoco.mj_comVel(self.model, self.data)

    def __world__(self) -> MuJoCoWorld:
        return MuJoCoWorld(self.model, self.data)

    def __repr__(self) -> str:
        return f"<chaos in MuJoCo of seed {self.seed}: {self.model.nbody} bodies, {self.time:.2f} s>"


def write_mjcf(particles: Iterable[Particle]) -> str:
    lines = [
        '<mujoco model="chaos">',
        f'  <option gravity="0 0 0" timestep="{TIME_STEP!r}"/>',
        f'  <default><geom solref="{_BOUNCE}" friction="0.5 0.005 0.0001"/></default>',
        "  <worldbody>",
    ]
    for name, normal in WALLS.items():
        place = (-HALF * part for part in normal)
        plane = f'<geom type="plane" size="{HALF} {HALF} 0.1" zaxis="{_format_mjcf(normal)}"/>'
        lines.append(f'    <body name="{name}" pos="{_format_mjcf(place)}">{plane}</body>')
    lines += [f"    {_write_particle_mjcf(particle)}" for particle in particles]
    return "\n".join([*lines, "  </worldbody>", "</mujoco>", ""])


def _write_particle_mjcf(particle: Particle) -> str:
    kind, size = _write_shape_mjcf(particle.solid)
    x, y, z, w = make_quaternion(particle.turned)
    name = quoteattr(particle.name)
    colour = _format_mjcf((*particle.colour, 1.0))
    return (
        f'<body name={name} pos="{_format_mjcf(particle.position)}" quat="{_format_mjcf((w, x, y, z))}">'
        f"<freejoint name={name}/>"
        f'<geom type="{kind}" size="{_format_mjcf(size)}" mass="{particle.mass!r}" rgba="{colour}"/></body>'
    )


def _write_shape_mjcf(solid: Solid) -> tuple[str, tuple[float, ...]]:
    """The type of a shape, and its size for MuJoCo: half edges, half lengths."""
    match solid:
        case Sphere(radius):
            return "sphere", (radius,)
        case Box(x, y, z):
            return "box", (x / 2, y / 2, z / 2)
        case Capsule(radius, length):
            return "capsule", (radius, length / 2)
        case Cylinder(radius, length):
            return "cylinder", (radius, length / 2)
    raise ValueError(f"{solid} is no particle")


def _format_mjcf(numbers: Iterable[float]) -> str:
    return " ".join(repr(float(number)) for number in numbers)


def chaos(seed: int = 18, bodies: int = 150) -> MuJoCoChaos:
    """A closed box of particles without gravity, centred at the origin, with `bodies` of them."""
    return MuJoCoChaos(seed, bodies)

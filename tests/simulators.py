"""Every simulator that is shipped: random scenes, one small room, and what a plain loop over its interface finds."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from importlib.machinery import EXTENSION_SUFFIXES
from importlib.util import module_from_spec, spec_from_file_location
from math import dist, sqrt
from pathlib import Path
from random import Random
from typing import Any

import fake_openravepy as fake
import numpy as np
import pytest

import ss2sql

DEBIAN = Path("/usr/lib/python3/dist-packages")
ODE_MISSING = "ODE is not installed for this Python: apt-get install python3-pyode"
# What tables with parameters are called with by `check_world`.
ARGUMENTS = {
    "closest": [(None, None, 1.0), (2, None, 3.0)], "near": [([0, 0, 0], 4.0), ([0, 0], 3.0)],
    "overlaps": [([[-3, -3, -3], [2, 2, 2]],)], "contacts": [(), (2,)],
    "rays": [([0.0, 0.0, 9.0], [0.0, 0.0, -9.0]), ([[3.0, 0.0, 1.0]], [[-3.0, 0.0, 1.0]])],
}  # fmt: skip
REACH = 1.25  # half the edge of a box of conditions


@dataclass
class Plain:
    """A body as a loop over the interface of its simulator finds it."""

    id: int
    name: str
    type: str
    pos: tuple[float, ...]
    mass: float
    rise: float = 0.0  # its speed upwards
    free: bool | None = None  # whether it can move, where the simulator says so


@dataclass
class Stage:
    """A world as its simulator has it, what a loop finds in it, what changes it, and what lets one body die."""

    source: Any
    look: Callable[[], list[Plain]]
    change: Callable[[Random], object] = lambda dice: None
    kill: Callable[[str], object] | None = None


# The small room of each simulator: name, radius of a ball or edge of a cube, mass, place. Nothing touches.
ROOM = (("ball", 0.5, 60.0, (0.0, 0.0, 1.0)), ("crate", 1.0, 10.0, (2.0, 0.0, 1.0)),
        ("pearl", 0.1, 51.0, (-1.0, 0.0, 1.0)))  # fmt: skip

# --- the same queries for all --------------------------------------------------------------------------

SCRIPTS = {
    "heavy": "SELECT mass, pos FROM space WHERE isSphere(this) AND mass(this) > 50;",
    "heaviest": """
        spheres = SELECT obj FROM space WHERE isSphere(this) AS list;
        maxMass = IF([] == spheres; None; max(SELECT mass FROM spheres AS list));
        SELECT name FROM space WHERE isSphere(this) AND mass == maxMass AS list;""",
    "all": "SELECT id, name, type, x, posY(this), z, mass FROM space AS rows;",
    "moving": "SELECT name FROM space WHERE hasBody(this) AS list;",
    "rising": "SELECT linearVelocity(this, 2) FROM space AS list;",
    "pairs": "SELECT a.id, b.id FROM a = space, b = space WHERE a.id < b.id AND distance(a.this, b.this) <= 3 AS rows;",
    "neighbours": "SELECT a.id, b.id FROM a = space, b = space.near(a.this, 3) WHERE a.id < b.id AS rows;",
    "near": "SELECT id FROM space.near(middle, 2.0) AS list;",
    "corner": "SELECT id FROM space WHERE x >= low[0] AND x <= high[0] AND y >= low[1] AND y <= high[1] AS list;",
    "one": "SELECT name FROM space WHERE id == one AS list;",
}


def agree(ss: ss2sql.Session, bodies: list[Plain], engine: Any) -> None:
    """The session's `space` gives what loops over the bodies give: no row twice, none lost, the same order."""
    spheres = [body for body in bodies if body.type == "sphere"]
    most = max((body.mass for body in spheres), default=None)
    pairs = [(a.id, b.id) for a in bodies for b in bodies if a.id < b.id and dist(a.pos, b.pos) <= 3]
    middle = bodies[-1]
    low, high = ([part + reach for part in middle.pos] for reach in (-REACH, REACH))
    for name, value in {"one": middle.id, "middle": list(middle.pos), "low": low, "high": high}.items():
        ss.set(name, value)
    wanted: dict[str, Any] = {
        "heavy": [{"mass": body.mass, "pos": list(body.pos)} for body in spheres if body.mass > 50],
        "heaviest": [body.name for body in spheres if body.mass == most],
        "all": [(body.id, body.name, body.type, *body.pos, body.mass) for body in bodies],
        "moving": [body.name for body in bodies if body.free],
        "rising": pytest.approx([body.rise for body in bodies], rel=1e-12, abs=1e-12), "pairs": pairs,
        "neighbours": pairs, "near": [body.id for body in bodies if dist(body.pos, middle.pos) <= 2],
        "corner": [body.id for body in bodies if all(low[k] <= body.pos[k] <= high[k] for k in (0, 1))],
        "one": [middle.name],
    }  # fmt: skip
    if bodies[0].free is None:
        del wanted["moving"]
    for name, value in wanted.items():
        assert ss.run(SCRIPTS[name], engine=engine).value == value, (name, engine)


class PyBullet:
    """Chaos, in which bodies are born and explode."""

    def __init__(self, request: pytest.FixtureRequest) -> None:
        pytest.importorskip("pybullet")
        self.client = request.getfixturevalue("client")

    def look(self, names: Any) -> list[Plain]:
        from bullet_rooms import kind_of, live, mass_of

        def plain(body: int) -> Plain:
            place, speed = self.client.getBasePositionAndOrientation(body)[0], self.client.getBaseVelocity(body)[0]
            name = names.get(body, f"body_{body}")
            mass = mass_of(self.client, body)
            return Plain(body, name, kind_of(self.client, body), place, mass, speed[2], mass > 0)

        return [plain(body) for body in live(self.client)]

    def scene(self, seed: int, count: int) -> Stage:
        from ss2sql.scenes import chaos

        scene = chaos(seed, count, self.client)

        def change(dice: Random) -> None:
            scene.step(dice.randint(1, 40))
            scene.explode_body(dice.choice(list(scene.forces)))
            scene.add_particle()
            scene.step(dice.randint(0, 3))

        return Stage(scene, lambda: self.look(scene.names), change)

    def room(self) -> Stage:
        from bullet_rooms import ball, box

        from ss2sql.vtables.pybullet import PyBulletWorld

        names = {}
        for name, size, mass, place in ROOM:
            cube = name == "crate"
            names[box(self.client, [size] * 3, place, mass) if cube else ball(self.client, size, place, mass)] = name
        bodies = {name: body for body, name in names.items()}
        world = PyBulletWorld(self.client, names=names)
        return Stage(world, lambda: self.look(names), kill=lambda name: self.client.removeBody(bodies[name]))


class Things(PyBullet):
    """Bodies of several shapes, with links, and such as can only be seen."""

    def scene(self, seed: int, count: int) -> Stage:
        from bullet_rooms import furnish, stir

        self.client.resetSimulation()
        furnish(self.client, Random(seed), count)
        return Stage(self.client, lambda: self.look({}), lambda dice: stir(self.client, dice))


class MuJoCo:
    """Nobody is born here, and nobody dies."""

    def __init__(self, _: Any = None) -> None:
        self.mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed: pip install mujoco")

    def look(self, model: Any, data: Any) -> list[Plain]:
        """The bodies by MuJoCo's own interface by name, one after the other."""
        shapes = ("sphere", "box", "plane", "capsule", "cylinder", "ellipsoid")
        names = {getattr(self.mujoco.mjtGeom, f"mjGEOM_{name.upper()}"): name for name in shapes}
        found = []
        for number in range(model.nbody):
            body, place = model.body(number), tuple(data.body(number).xpos.tolist())
            kinds = [names[self.mujoco.mjtGeom(int(geom))] for geom in model.geom_type[model.geom_bodyid == number]]
            kind = "ghost" if not kinds else kinds[0] if len(kinds) == 1 else "compound"
            moves, mass = bool(model.body_dofnum[number]), float(body.mass[0])
            found.append(Plain(number, body.name, kind, place, mass, self.velocity(model, data, number)[5], moves))
        return found

    def velocity(self, model: Any, data: Any, body: int) -> list[float]:
        """The spin of a body, and its velocity."""
        known = np.zeros(6)
        self.mujoco.mj_objectVelocity(model, data, self.mujoco.mjtObj.mjOBJ_XBODY, body, known, 0)
        return known.tolist()

    def scene(self, seed: int, count: int) -> Stage:
        from ss2sql.scenes.mujoco_chaos import chaos

        scene = chaos(seed, count)
        return Stage(scene, lambda: self.look(scene.model, scene.data), lambda dice: scene.step(dice.randint(1, 40)))

    def room(self) -> Stage:
        bodies = ""
        for name, size, mass, (x, y, z) in ROOM:
            geom = f'type="box" size="{size / 2} {size / 2} {size / 2}"' if name == "crate" else f'size="{size}"'
            bodies += f'<body name="{name}" pos="{x} {y} {z}"><freejoint/><geom {geom} mass="{mass}"/></body>'
        model, data = self.made(bodies)
        return Stage(data, lambda: self.look(model, data), lambda dice: self.mujoco.mj_step(model, data))

    def made(self, bodies: str, more: str = "") -> tuple[Any, Any]:
        """A model of bodies, and its data."""
        model = self.mujoco.MjModel.from_xml_string(f"<mujoco>{more}<worldbody>{bodies}</worldbody></mujoco>")
        data = self.mujoco.MjData(model)
        self.mujoco.mj_forward(model, data)
        return model, data


# --- ODE -----------------------------------------------------------------------------------------------

_worlds: list[Any] = []  # kept to the end: pyode crashes where a failed test leaves world and bodies to the collector


def ode_module() -> Any:
    """ODE's module: Debian's python3-pyode puts it where only Debian's own Python looks. Skips where there is none.

    Nothing else from there may be imported: its packages belong to another Python.
    """
    for file in (DEBIAN / f"ode{suffix}" for suffix in EXTENSION_SUFFIXES):
        if "ode" not in sys.modules and file.exists():
            spec: Any = spec_from_file_location("ode", file)
            module = module_from_spec(spec)
            spec.loader.exec_module(module)
            sys.modules["ode"] = module
    found = pytest.importorskip("ode", reason=ODE_MISSING)
    if not hasattr(found, "GeomSphere"):  # another package of this name, which integrates equations
        pytest.skip(ODE_MISSING)
    return found


class Ode:
    """Geoms of a space."""

    KINDS = ("sphere", "box", "capsule", "cylinder", "plane")

    def __init__(self, _: Any = None) -> None:
        self.ode = ode_module()

    def look(self, geoms: Any, numbers: dict[Any, int]) -> list[Plain]:
        """Geoms in the order of their births: each keeps its number, and the next goes to the next that is born."""
        kinds = {f"Geom{kind.title()}": kind for kind in self.KINDS}
        found = []
        for geom in geoms:
            number, body = numbers.setdefault(geom, len(numbers) + 1), geom.getBody()
            normal, offset = geom.getParams() if body is None else ((0, 0, 0), 0)
            place = tuple(part * offset for part in normal) if body is None else geom.getPosition()
            mass, rise = (0.0, 0.0) if body is None else (body.getMass().mass, body.getLinearVel()[2])
            found.append(Plain(number, geom.name, kinds[type(geom).__name__], place, mass, rise, mass > 0))
        return found

    def scene(self, seed: int, count: int) -> Stage:
        from ss2sql.scenes.ode_chaos import chaos

        scene = chaos(seed, count)
        numbers: dict[Any, int] = {}

        def change(dice: Random) -> None:
            scene.step(dice.randint(1, 40))
            if len(scene.particles) > 2 * count:
                scene.remove_geom(dice.choice(scene.particles))
            else:
                scene.explode_geom(dice.choice(scene.particles))

        return Stage(scene, lambda: self.look([*scene.walls, *scene.particles], numbers), change)

    def kept(self) -> Any:
        """A world, to which bodies may be added."""
        _worlds.append(self.ode.World())
        return _worlds[-1]

    def add(self, world: Any, geom: Any, mass: float, position: tuple[float, ...], name: str | None) -> Any:
        """A geom as a body."""
        body, weight = self.ode.Body(world), self.ode.Mass()
        weight.setSphere(1.0, 1.0)
        weight.adjust(mass)
        body.setMass(weight)
        body.setPosition(position)
        geom.setBody(body)
        if name:
            geom.name = name
        return geom

    def room(self) -> Stage:
        world, space = self.kept(), self.ode.HashSpace()
        geoms = {}
        for name, size, mass, place in ROOM:
            geom = self.ode.GeomBox(space, (size,) * 3) if name == "crate" else self.ode.GeomSphere(space, size)
            geoms[name] = self.add(world, geom, mass, place, name)
        numbers: dict[Any, int] = {}
        return Stage(space, lambda: self.look(geoms.values(), numbers), kill=lambda name: space.remove(geoms[name]))


# --- OpenRAVE ------------------------------------------------------------------------------------------


def solid(name: str, size: Any, mass: float, position: Any) -> fake.KinBody:
    """A ball of a radius, or a crate of half edges."""
    if isinstance(size, float):
        geometry = fake.Geometry(fake.GeometryType.Sphere, size)
    else:
        geometry = fake.Geometry(fake.GeometryType.Box, *size)
    body = fake.KinBody(name, [fake.Link("solid", mass, geometry)])
    body.SetTransform([1, 0, 0, 0, *position])
    return body


class OpenRave:
    """A stand-in for the documented interface of OpenRAVE."""

    def __init__(self, request: pytest.FixtureRequest) -> None:
        request.getfixturevalue("monkeypatch").setitem(sys.modules, "openravepy", fake)

    @staticmethod
    def load(environment: fake.Environment) -> None:
        """A ball, a crate, and a robot of two links."""
        environment.Add(solid("ball", 0.5, 60, (0, 0, 1)))
        environment.Add(solid("crate", (0.5, 0.5, 0.5), 10, (2, 0, 1)))
        wheel = fake.Link("wheel", 1, fake.Geometry(fake.GeometryType.Sphere, 0.1), (0.5, 0, -0.3))
        base = fake.Link("base", 20, fake.Geometry(fake.GeometryType.Box, 0.5, 0.3, 0.2))
        axle = fake.Joint("axle", fake.JointType.Revolute, [0.25])
        joints = [axle, fake.Joint("ball", fake.JointType.Spherical, [0, 0, 0])]
        robot = fake.KinBody("YouBot", [base, wheel], joints, robot=True)
        robot.SetTransform([sqrt(0.5), 0, 0, sqrt(0.5), -3, 0, 1])
        base.velocity = np.arange(1.0, 7.0)
        environment.Add(robot)

    def look(self, environment: fake.Environment) -> list[Plain]:
        found = []
        for body in sorted(environment.GetBodies(), key=lambda body: body.GetEnvironmentId()):
            (link,) = body.GetLinks()
            (geometry,) = link.GetGeometries()
            place = tuple(body.GetTransform()[:3, 3].tolist())
            kind = geometry.GetType().name.lower()
            found.append(Plain(body.GetEnvironmentId(), body.GetName(), kind, place, link.GetMass()))
        return found

    def scene(self, seed: int, count: int) -> Stage:
        random, environment = Random(seed), fake.Environment()
        for number in range(max(count, 3)):
            place = [random.uniform(-4, 4) for _ in range(3)]
            sizes, mass = [random.uniform(0.1, 0.5) for _ in range(3)], random.uniform(1, 100)
            environment.Add(solid(f"body_{number}", random.choice([sizes[0], sizes]), mass, place))

        def change(dice: Random) -> None:
            environment.Remove(dice.choice(environment.bodies))
            environment.Add(solid("new", 0.3, 77, [dice.uniform(-4, 4) for _ in range(3)]))
            dice.choice(environment.bodies).SetTransform([1, 0, 0, 0, *(dice.uniform(-4, 4) for _ in range(3))])

        return Stage(environment, lambda: self.look(environment), change)

    def room(self) -> Stage:
        environment = fake.Environment()
        for name, size, mass, place in ROOM:
            environment.Add(solid(name, [size / 2] * 3 if name == "crate" else size, mass, place))
        bodies = {body.name: body for body in environment.bodies}
        return Stage(environment, lambda: self.look(environment), kill=lambda name: environment.Remove(bodies[name]))


SIMULATORS = {found.__name__: found for found in (PyBullet, Things, MuJoCo, Ode, OpenRave)}


def answer(ss: ss2sql.Session, script: str, engine: Any = "auto") -> Any:
    """What a script gives; rows as lists."""
    value = ss.run(script, engine=engine).value
    return [list(row) if isinstance(row, tuple) else row for row in value] if isinstance(value, list) else value

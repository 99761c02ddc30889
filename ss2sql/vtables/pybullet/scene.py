"""Scenes: a simulation without a window, the names of its bodies, and its clock."""

from __future__ import annotations

from collections.abc import Callable
from random import Random
from types import TracebackType
from typing import Any, ClassVar, Self

from ss2sql.errors import SessionError, suggest_names
from ss2sql.fast_dataclasses import dataclass
from ss2sql.vtables.pybullet.client import import_pybullet, start_simulation
from ss2sql.vtables.pybullet.solids import Colour, Plane, Solid, Vector, make_collision_shape, make_visual_shape

TIME_STEP = 1 / 240  # seconds, Bullet's own


@dataclass(frozen=True, slots=True)
class View:
    """The viewpoint of pictures: the eye, the point that it looks at, and its angle in degrees."""

    eye: Vector
    target: Vector
    angle: float = 40.0
    up: Vector = (0.0, 0.0, 1.0)


@dataclass(frozen=True, slots=True)
class Sensor:
    """What a sensor sees: everything within `range` metres and half of `angle` degrees around `direction`."""

    position: Vector
    direction: Vector
    range: float
    angle: float


class Scene:
    """A simulation that is built by code: the same seed always gives the same bodies and the same movements.

    - `client`: the `BulletClient`, for all functions of PyBullet
    - `names`: the name of every body, by its id, in the order in which they were born
    - `time`: seconds of simulation
    - `births`, `deaths`: how many bodies were added and removed; Bullet gives the ids of removed bodies to later ones
    - `forces`: the force that acts on a body, where there is one
    - `sensors`: what the bodies that are sensors see
    - `places`: points that have a name
    - `outlines`: lines that pictures show, although no body is there
    - `bounds`: two opposite corners of the scene
    - `views`: where pictures can be taken from; the first is the usual one
    - `listeners`: functions that are called after every step; sessions look after their triggers so
    """

    views: ClassVar[dict[str, View]]
    bounds: ClassVar[tuple[Vector, Vector]]

    def __init__(self, seed: int, client: Any = None) -> None:
        self.client = start_simulation() if client is None else client
        self.client.resetSimulation()
        self.client.setTimeStep(TIME_STEP)
        self.client.setPhysicsEngineParameter(deterministicOverlappingPairs=1)
        self.seed = seed
        self.random = Random(seed)
        self.names: dict[int, str] = {}
        self.births = self.deaths = self.steps = 0
        self.forces: dict[int, Vector] = {}
        self.sensors: dict[int, Sensor] = {}
        self.listeners: list[Callable[[], object]] = []
        self.places: dict[str, tuple[float, float]] = {}
        self.outlines: list[tuple[Vector, ...]] = []
        self._shapes: dict[Solid | tuple[Solid, Colour], int] = {}
        self._numbers: dict[str, int] = {}
        self._planes: set[int] = set()

    @property
    def time(self) -> float:
        return self.steps * TIME_STEP

    def step(self, n: int = 1) -> None:
        """Lets `n` steps of the simulation pass, each of a 240th of a second."""
        self._check_open()
        for _ in range(n):
            self.before_step()
            self.client.stepSimulation()
            self.steps += 1
            self.after_step()
            for listener in list(self.listeners):
                listener()

    def before_step(self) -> None:
        """Changes of the scene before a step, such as births."""

    def after_step(self) -> None:
        """Changes of the scene after a step."""

    def body(self, name: str) -> int:
        """The id of the body with this name."""
        for body, known in self.names.items():
            if known == name:
                return body
        raise SessionError("S002", f"no body is called '{name}'", hints=suggest_names(name, self.names.values()))

    def next_name(self, kind: str) -> str:
        """`box_1`, `box_2` and so on."""
        self._numbers[kind] = self._numbers.get(kind, 0) + 1
        return f"{kind}_{self._numbers[kind]}"

    def add(
        self, name: str, solid: Solid, position: Vector, colour: Colour, mass: float = 0.0,
        turned: Vector = (0.0, 0.0, 0.0), touchable: bool = True,
    ) -> int:  # fmt: skip
        """Adds a body; without mass nothing moves it. `turned`: roll, pitch and yaw in radians."""
        body = self.client.createMultiBody(
            baseMass=mass,
            baseCollisionShapeIndex=self._make_collision_shape(solid) if touchable else -1,
            baseVisualShapeIndex=self._make_visual_shape(solid, colour),
            basePosition=position,
            baseOrientation=import_pybullet().getQuaternionFromEuler(turned),
        )
        if isinstance(solid, Plane):
            self._planes.add(body)
        return self.adopt(body, name)

    def _make_collision_shape(self, solid: Solid) -> int:
        # Bullet keeps shapes until the simulation ends: equal ones are made once.
        if solid not in self._shapes:
            self._shapes[solid] = make_collision_shape(self.client, solid)
        return self._shapes[solid]

    def _make_visual_shape(self, solid: Solid, colour: Colour) -> int:
        if (solid, colour) not in self._shapes:
            self._shapes[solid, colour] = make_visual_shape(self.client, solid, colour)
        return self._shapes[solid, colour]

    def adopt(self, body: int, name: str) -> int:
        """Gives a name to a body that PyBullet has just made."""
        self.names[body] = name
        self.births += 1
        return body

    def remove(self, body: int) -> None:
        self.client.removeBody(body)
        del self.names[body]
        self.forces.pop(body, None)
        self.sensors.pop(body, None)
        self.deaths += 1

    def is_free(self, position: Vector, radius: float) -> bool:
        """Whether the cube around a sphere is free of bodies, except endless planes."""
        low = [x - radius for x in position]
        high = [x + radius for x in position]
        found = self.client.getOverlappingObjects(low, high) or ()
        return all(body in self._planes for body, _ in found)

    def _check_open(self) -> None:
        if not self.client.isConnected():
            raise SessionError("S001", "the scene is closed", hints=("build it anew",))

    def close(self) -> None:
        """Ends the simulation. Closing twice does no harm."""
        if self.client.isConnected():
            self.client.disconnect()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def __repr__(self) -> str:
        return f"<{type(self).__name__.lower()} of seed {self.seed}: {len(self.names)} bodies, {self.time:.2f} s>"

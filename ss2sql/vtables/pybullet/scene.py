"""Scenes: a simulation without a window, the names of its bodies, its clock, and solids as Bullet's shapes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import dist, hypot, pi
from random import Random
from types import TracebackType
from typing import Any, ClassVar, Self, TypeAlias

import numpy as np

from ss2sql.errors import SessionError, suggest_names
from ss2sql.fast_dataclasses import dataclass
from ss2sql.vtables.body_functions import compute_solid_volume
from ss2sql.vtables.pybullet.client import Point, import_pybullet, invert_rotation, rotate_point, start_bullet

Vector = tuple[float, float, float]
Colour = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Sphere:
    radius: float


@dataclass(frozen=True, slots=True)
class Box:
    """A box of these edge lengths."""

    x: float
    y: float
    z: float


@dataclass(frozen=True, slots=True)
class Cylinder:
    radius: float
    length: float


@dataclass(frozen=True, slots=True)
class Capsule:
    """A cylinder with half a sphere at both ends; `length` is that of the cylinder."""

    radius: float
    length: float


@dataclass(frozen=True, slots=True)
class Plane:
    """The half space under an endless plane; pictures show a square of it, only from its front."""

    normal: Vector
    side: float


Solid = Sphere | Box | Cylinder | Capsule | Plane


def measure_reach(solid: Solid) -> float:
    match solid:
        case Sphere(radius):
            return radius
        case Box(x, y, z):
            return hypot(x, y, z) / 2
        case Cylinder(radius, length):
            return hypot(radius, length / 2)
        case Capsule(radius, length):
            return radius + length / 2
        case Plane():
            return float("inf")


def measure_half_edges(solid: Solid) -> Vector:
    """Half the edges of the box around a solid along its own axes."""
    match solid:
        case Box(x, y, z):
            return x / 2, y / 2, z / 2
        case Cylinder(radius, length):
            return radius, radius, length / 2
        case Capsule(radius, length):
            return radius, radius, radius + length / 2
        case _:
            reach = measure_reach(solid)
            return reach, reach, reach


def describe_shape(solid: Solid) -> dict[str, Any]:
    """The arguments of PyBullet's `createCollisionShape`."""
    bullet = import_pybullet()
    match solid:
        case Sphere(radius):
            return {"shapeType": bullet.GEOM_SPHERE, "radius": radius}
        case Box(x, y, z):
            return {"shapeType": bullet.GEOM_BOX, "halfExtents": [x / 2, y / 2, z / 2]}
        case Cylinder(radius, length):
            return {"shapeType": bullet.GEOM_CYLINDER, "radius": radius, "height": length}
        case Capsule(radius, length):
            return {"shapeType": bullet.GEOM_CAPSULE, "radius": radius, "height": length}
        case Plane(normal):
            return {"shapeType": bullet.GEOM_PLANE, "planeNormal": list(normal)}


def make_visual_shape(client: Any, solid: Solid, colour: Colour) -> int:
    """The visual shape of a solid: a mesh, since Bullet's own round shapes have a dozen corners."""
    bullet, rgba = import_pybullet(), (*colour, 1.0)
    if isinstance(solid, Box):
        half = (solid.x / 2, solid.y / 2, solid.z / 2)
        return int(client.createVisualShape(bullet.GEOM_BOX, halfExtents=half, rgbaColor=rgba))
    vertices, normals, indices = (
        _make_bullet_square(solid) if isinstance(solid, Plane) else _revolve_bullet_outline(_make_bullet_outline(solid))
    )
    return int(
        client.createVisualShape(
            bullet.GEOM_MESH, vertices=vertices, normals=normals, indices=indices, rgbaColor=rgba,
            specularColor=(0.2, 0.2, 0.2),
        )
    )  # fmt: skip


Mesh = tuple[list[list[float]], list[list[float]], list[int]]
Outline = list[tuple[float, float, float, float]]


def _make_bullet_outline(solid: Sphere | Cylinder | Capsule) -> Outline:
    """Half the cross section of a round solid from top to bottom: radius and height, then the normal."""
    match solid:
        case Cylinder(radius, length):
            top, bottom = length / 2, -length / 2
            return [
                (0.0, top, 0.0, 1.0), (radius, top, 0.0, 1.0), (radius, top, 1.0, 0.0),
                (radius, bottom, 1.0, 0.0), (radius, bottom, 0.0, -1.0), (0.0, bottom, 0.0, -1.0),
            ]  # fmt: skip
        case Sphere(radius):
            return _make_bullet_arc(radius, 0.0, np.linspace(0, pi, 13 if radius > 0.1 else 9))
        case Capsule(radius, length):
            upper = _make_bullet_arc(radius, length / 2, np.linspace(0, pi / 2, 7))
            return upper + _make_bullet_arc(radius, -length / 2, np.linspace(pi / 2, pi, 7))


def _make_bullet_arc(radius: float, height: float, angles: Iterable[float]) -> Outline:
    normals = [(float(np.sin(angle)), float(np.cos(angle))) for angle in angles]
    return [(radius * x, height + radius * z, x, z) for x, z in normals]


def _revolve_bullet_outline(outline: Outline) -> Mesh:
    """The solid of revolution of an outline around the z axis."""
    slices = 2 * len(outline) if len(outline) > 6 else 24
    angles = np.linspace(0, 2 * pi, slices + 1)
    radius, height, normal_radius, normal_height = np.array(outline).T[:, :, None]
    across, up = np.cos(angles), np.sin(angles)
    level = np.ones_like(angles)
    vertices = np.stack((radius * across, radius * up, height * level), axis=-1).reshape(-1, 3)
    normals = np.stack((normal_radius * across, normal_radius * up, normal_height * level), axis=-1).reshape(-1, 3)
    corner = (np.arange(len(outline) - 1)[:, None] * (slices + 1) + np.arange(slices)).ravel()
    below = corner + slices + 1
    indices = np.stack((corner, below, corner + 1, corner + 1, below, below + 1), axis=-1).ravel()
    return vertices.tolist(), normals.tolist(), indices.tolist()


def _make_bullet_square(plane: Plane) -> Mesh:
    normal = np.array(plane.normal)
    first = np.roll(normal, 1)  # at right angles to it: the planes of scenes follow the axes
    second = np.cross(normal, first)
    half = plane.side / 2
    corners = [half * (a * first + b * second) for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1))]
    return [corner.tolist() for corner in corners], [normal.tolist()] * 4, [0, 1, 2, 0, 2, 3]


# --- the shapes that PyBullet tells of
KINDS = {2: "sphere", 3: "box", 4: "cylinder", 5: "mesh", 6: "plane", 7: "capsule", 9: "terrain"}  # PyBullet's GEOM_...


def make_solid(kind: int, size: Sequence[float]) -> Solid | None:
    """The solid with PyBullet's measures; None for meshes and other shapes."""
    a, b, c = size
    match KINDS.get(kind):
        case "sphere":
            return Sphere(a)
        case "box":
            return Box(a, b, c)
        case "capsule":
            return Capsule(b, a)
        case "cylinder":
            return Cylinder(b, a)
        case "plane":
            return Plane((a, b, c), SIDE)
        case _:
            return None


def get_volume(shape: Any) -> float | None:
    kind, (a, b, c) = KINDS.get(shape[2]), shape[3]
    sizes = {"sphere": (a,), "box": (a, b, c), "cylinder": (b, a), "capsule": (b, a)}
    return compute_solid_volume(kind, *sizes.get(kind or "", ()))


SIDE = 10.0  # metres: the edge of the squares that represent endless planes in pictures
UNNAMED = (b"", b"unknown_file")  # the files of meshes that were built from points
Part: TypeAlias = dict[str, Any]  # the keywords of a shape for PyBullet


def read_corners(calls: Any, body: int, link: int, number: int, data: Any) -> tuple[Point, ...]:
    """The corners of a mesh that was built from points, as seen from the mesh; none for other shapes.

    PyBullet gives them as seen from the centre of mass of the link.
    """
    if KINDS.get(data[2]) != "mesh" or data[4] not in UNNAMED:
        return ()
    _, corners = calls.getMeshData(body, link, collisionShapeIndex=number)
    (px, py, pz), back = data[5], invert_rotation(data[6])
    return tuple(rotate_point(back, (x - px, y - py, z - pz)) for x, y, z in corners)


def read_bullet_shape(kind: int, size: Sequence[float], file: bytes, corners: Sequence[Any]) -> Part | None:
    """A shape from PyBullet's data; None where these are incomplete."""
    solid = make_solid(kind, size)
    if solid is not None:
        return describe_shape(solid)
    if KINDS.get(kind) != "mesh":
        return None
    if file not in UNNAMED:
        return {"shapeType": kind, "fileName": file.decode(), "meshScale": list(size)}
    return {"shapeType": kind, "vertices": corners} if corners else None


TIME_STEP = 1 / 240  # seconds, Bullet's own


@dataclass(frozen=True, slots=True)
class View:
    """The viewpoint of pictures: the eye, the point that it looks at, and its angle in degrees."""

    eye: Vector
    target: Vector
    angle: float = 40.0
    up: Vector = (0.0, 0.0, 1.0)


def make_corner_view(low: Vector, high: Vector) -> View:
    """A view of a box from above one of its corners."""
    x, y, z = ((a + b) / 2 for a, b in zip(low, high, strict=True))
    away = 1.5 * max(1.0, dist(low, high))
    return View((x + 0.4 * away, y - 0.75 * away, z + 0.55 * away), (x, y, z))


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
    - `joint_ends`: lower and upper end, greatest force and velocity of the joints of copies, which PyBullet forgets
    - `places`: points that have a name
    - `outlines`: lines that pictures show, although no body is there
    - `bounds`: two opposite corners of the scene
    - `views`: where pictures can be taken from; the first is the usual one
    - `listeners`: functions that are called after every step; sessions look after their triggers so
    """

    views: ClassVar[dict[str, View]]
    bounds: ClassVar[tuple[Vector, Vector]]

    def __init__(self, seed: int, client: Any = None) -> None:
        self.client = start_bullet() if client is None else client
        self.client.resetSimulation()
        self.client.setTimeStep(TIME_STEP)
        self.client.setPhysicsEngineParameter(deterministicOverlappingPairs=1)
        self.seed = seed
        self.random = Random(seed)
        self.names: dict[int, str] = {}
        self.births = self.deaths = self.steps = 0
        self.forces: dict[int, Vector] = {}
        self.sensors: dict[int, Sensor] = {}
        self.joint_ends: dict[int, dict[int, tuple[float, ...]]] = {}
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
        # Bullet keeps shapes until the simulation ends: equal ones are made once.
        if touchable and solid not in self._shapes:
            self._shapes[solid] = self.client.createCollisionShape(**describe_shape(solid))
        if (solid, colour) not in self._shapes:
            self._shapes[solid, colour] = make_visual_shape(self.client, solid, colour)
        body = self.client.createMultiBody(
            baseMass=mass,
            baseCollisionShapeIndex=self._shapes[solid] if touchable else -1,
            baseVisualShapeIndex=self._shapes[solid, colour],
            basePosition=position,
            baseOrientation=import_pybullet().getQuaternionFromEuler(turned),
        )
        if isinstance(solid, Plane):
            self._planes.add(body)
        return self.adopt(body, name)

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
        self.joint_ends.pop(body, None)
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

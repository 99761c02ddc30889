"""`AS environment`: a new simulation with only the selected bodies.

Each body is made anew from PyBullet's data: shapes, colours, masses, friction, joints, pose and velocity. Damping and
motors, which PyBullet does not expose, have Bullet's defaults in the copy. The boxes around links that were loaded from
files are up to 3 mm larger in the original, their shapes are not: only loading gives links such a margin.
"""

from __future__ import annotations

from collections import Counter
from typing import Any, NoReturn

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.area_arguments import refuse_argument
from ss2sql.language.cancellation import Check
from ss2sql.language.rows import Table
from ss2sql.vtables.pybullet.bodies import (
    FIXED,
    UNNAMED,
    Part,
    has_untold_shape,
    make_solid,
    read_bullet_shape,
    read_corners,
)
from ss2sql.vtables.pybullet.client import (
    UPRIGHT,
    Pose,
    compose_pose_turns,
    convert_pose_to_local,
    convert_pose_to_world,
    invert_rotation,
    rotate_point,
)
from ss2sql.vtables.pybullet.occupancy_grid import find_selected_world, list_selected_bodies, measure_bounds
from ss2sql.vtables.pybullet.scene import Scene, Sphere, make_corner_view, make_visual_shape

MOST_PARTS = 16  # of one shape: PyBullet leaves out those beyond


def copy_collision_shapes(client: Any, parts: list[tuple[Part, Pose]]) -> list[int]:
    """Collision shapes in a simulation, as few as PyBullet allows for the parts."""
    plain = [part for part in parts if "vertices" not in part[0]]
    some = [plain[first : first + MOST_PARTS] for first in range(0, len(plain), MOST_PARTS)]
    some += [[part] for part in parts if "vertices" in part[0]]
    return [_create_shape(client, group, "Collision") for group in some]


def copy_visual_shape(client: Any, parts: list[tuple[Part, Pose]]) -> int:
    """A visual shape, -1 without parts; PyBullet shows the first MOST_PARTS parts."""
    parts = [({_VISUAL.get(name, name): value for name, value in part.items()}, pose) for part, pose in parts]
    return _create_shape(client, parts, "Visual")


def _create_shape(client: Any, parts: list[tuple[Part, Pose]], kind: str) -> int:
    """A shape of parts, each at its pose."""
    if not parts:
        return -1
    create, word = f"create{kind}Shape", kind.lower()
    places = [pose[0] for _, pose in parts]
    turns = [pose[1] for _, pose in parts]
    if len(parts) == 1:
        placed = {f"{word}FramePosition": places[0], f"{word}FrameOrientation": turns[0]}
        return int(getattr(client, create)(**parts[0][0], **placed))
    # PyBullet reads every list for each shape, whether its kind needs the entry or not.
    lists: dict[str, list[Any]] = {
        plural: [part.get(name, part.get(_VISUAL.get(name, name), default)) for part, _ in parts]
        for name, plural, default in _LISTS
    }
    lists |= {f"{word}FramePositions": places, f"{word}FrameOrientations": turns}
    return int(getattr(client, f"{create}Array")(**lists))


_VISUAL = {"height": "length"}  # words of createCollisionShape that createVisualShape has others for
_LISTS: tuple[tuple[str, str, Any], ...] = (
    ("shapeType", "shapeTypes", None),
    ("radius", "radii", 1.0),
    ("halfExtents", "halfExtents", [1.0, 1.0, 1.0]),
    ("height", "lengths", 1.0),
    ("fileName", "fileNames", ""),
    ("meshScale", "meshScales", [1.0, 1.0, 1.0]),
    ("planeNormal", "planeNormals", [0.0, 0.0, 1.0]),
)


NOWHERE: Pose = ((0.0, 0.0, 0.0), UPRIGHT)
MARK = 0.05  # metres: the radius of balls for bodies without collision shapes


class Environment(Scene):
    """A copy of some bodies of a simulation, in a simulation of its own, which takes 29 MB.

    It is a scene: it has the names of its bodies, and the original scene's data of them and of itself. Bodies have new
    ids. Steps continue from the time of the original. `close` ends it.
    """

    def __init__(self, world: Any, bodies: list[int], check: Check | None = None) -> None:
        scene = world.scene
        super().__init__(getattr(scene, "seed", 0))
        self.ids: dict[int, int] = {}  # of the copies, by those of the originals
        _copy_bullet_settings(world.calls, self.client)
        self.bounds = measure_bounds(world)  # type: ignore[misc]
        self.views = {"corner": make_corner_view(*self.bounds)}  # type: ignore[misc]
        for name in ("views", "places", "outlines", "steps"):
            if hasattr(scene, name):
                setattr(self, name, getattr(scene, name))
        try:
            for body in bodies:
                if check is not None:
                    check()
                copy = self.ids[body] = self.adopt(_BodyCopy(world, body, self.client).make_body(), world.name_of(body))
                if body in world.sensors:
                    self.sensors[copy] = world.sensors[body]
                if scene is not None and body in scene.forces:
                    self.forces[copy] = scene.forces[body]
        except BaseException:
            self.close()
            raise

    def after_step(self) -> None:
        for body, force in self.forces.items():
            place, _ = self.client.getBasePositionAndOrientation(body)
            self.client.applyExternalForce(body, -1, force, place, self.client.WORLD_FRAME)


def make_environment(world: Any, table: Table) -> Environment:
    world = find_selected_world(world, table)
    return Environment(world, list_selected_bodies(world, "environment", table), table.check)


def _copy_bullet_settings(calls: Any, client: Any) -> None:
    parameters = calls.getPhysicsEngineParameters()
    client.setGravity(*(parameters[f"gravityAcceleration{axis}"] for axis in "XYZ"))
    client.setTimeStep(parameters["fixedTimeStep"])


@dataclass(frozen=True, slots=True)
class Link:
    """A link for PyBullet: collision and visual shapes, its pose within its parent, its centre of mass seen from it."""

    mass: float
    shapes: tuple[int, int]
    pose: Pose
    local: Pose
    parent: int
    joint: int
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)


class _BodyCopy:
    """The copy of one body in another simulation.

    The poses of links are those of the original's files; `local` are the centres of mass in them. Bullet gives
    collision shapes relative to the centre of mass, and visual shapes relative to the link.
    """

    def __init__(self, world: Any, body: int, client: Any) -> None:
        self.world, self.body, self.client, self.calls = world, body, client, world.calls
        self.links = range(-1, self.calls.getNumJoints(body))
        self.matter = {link: self.calls.getDynamicsInfo(body, link) for link in self.links}
        self.local: dict[int, Pose] = {link: (info[3], info[4]) for link, info in self.matter.items()}
        self.seen = self.calls.getVisualShapeData(body)
        self.more: list[Link] = []

    def make_body(self) -> int:
        """Makes the body; gives its new id."""
        if not self.world.shapes.read_shapes(self.body) and has_untold_shape(self.world, self.body):
            self._refuse_body()
        try:
            base, *links = [self._copy_link(link) for link in self.links]
        except self.calls.error:
            self._refuse_body()  # PyBullet cannot make all shapes again that it has made from a file
        links += self.more
        pose = convert_pose_to_world(
            self.calls.getBasePositionAndOrientation(self.body), convert_pose_to_local(base.local, NOWHERE)
        )
        made: int = self.client.createMultiBody(
            baseMass=base.mass,
            baseCollisionShapeIndex=base.shapes[0],
            baseVisualShapeIndex=base.shapes[1],
            basePosition=pose[0],
            baseOrientation=pose[1],
            baseInertialFramePosition=base.local[0],
            baseInertialFrameOrientation=base.local[1],
            linkMasses=[link.mass for link in links],
            linkCollisionShapeIndices=[link.shapes[0] for link in links],
            linkVisualShapeIndices=[link.shapes[1] for link in links],
            linkPositions=[link.pose[0] for link in links],
            linkOrientations=[link.pose[1] for link in links],
            linkInertialFramePositions=[link.local[0] for link in links],
            linkInertialFrameOrientations=[link.local[1] for link in links],
            linkParentIndices=[link.parent + 1 for link in links],
            linkJointTypes=[link.joint for link in links],
            linkJointAxis=[link.axis for link in links],
        )
        if made < 0:
            self._refuse_body()
        self._copy_pose(made)
        self._copy_colors(made)
        return made

    def _copy_link(self, link: int) -> Link:
        """A link of the copy. Parts beyond PyBullet's limit for a shape go into links without mass."""
        shape, *more = self._copy_collision_shapes(link) or [-1]
        for other in more:
            self.more.append(Link(0.0, (other, -1), NOWHERE, self.local[link], link, FIXED))
        shapes = (shape, self._copy_visual_shape(link))
        mass, local = self.matter[link][0], self.local[link]
        if link < 0:
            return Link(mass, shapes, NOWHERE, local, -1, FIXED)
        # PyBullet gives joints between centres of mass: the place seen from the parent's, the axis and the parent's
        # orientation seen from the link's.
        info = self.calls.getJointInfo(self.body, link)
        place, parent = info[14], info[16]
        turn = invert_rotation(compose_pose_turns(local[1], info[15]))
        axis = rotate_point(local[1], info[13])
        pose = convert_pose_to_world(self.local[parent], (place, turn))
        return Link(mass, shapes, pose, local, parent, info[2], axis)

    def _copy_pose(self, made: int) -> None:
        pose = self.calls.getBasePositionAndOrientation(self.body)
        self.client.resetBasePositionAndOrientation(made, *pose)
        self.client.resetBaseVelocity(made, *self.calls.getBaseVelocity(self.body))
        for link in self.links:
            mass, friction, inertia, _, _, bounce, rolling, spinning, *_ = self.matter[link]
            self.client.changeDynamics(
                made, link, lateralFriction=friction, restitution=bounce, rollingFriction=rolling,
                spinningFriction=spinning, **({"localInertiaDiagonal": inertia} if mass else {}),
            )  # fmt: skip
        margin = self.matter[-1][11]
        if self.client.getDynamicsInfo(made, -1)[11] != margin:  # as after loading files; rays would miss one set to 0
            self.client.changeDynamics(made, -1, collisionMargin=margin)  # of a link it would set that of the base
        for joint in self.links[1:]:
            place, speed, *_ = self.calls.getJointState(self.body, joint)
            low, high = self.calls.getJointInfo(self.body, joint)[8:10]
            self.client.resetJointState(made, joint, place, speed)
            if low < high:
                self.client.changeDynamics(made, joint, jointLowerLimit=low, jointUpperLimit=high)

    def _copy_collision_shapes(self, link: int) -> list[int]:
        parts = [
            (self._copy_solid(link, number, data), convert_pose_to_world(self.local[link], (data[5], data[6])))
            for of, number, data in self.world.shapes.read_shapes(self.body)
            if of == link
        ]
        return copy_collision_shapes(self.client, parts)

    def _copy_solid(self, link: int, number: int, data: Any) -> Part:
        if data[5] is None:
            self._refuse_body()  # its place is unknown
        corners = read_corners(self.calls, self.body, link, number, data)
        return read_bullet_shape(data[2], data[3], data[4], corners) or self._refuse_body()

    def _refuse_body(self) -> NoReturn:
        name = self.world.name_of(self.body)
        refuse_argument("environment", f"cannot copy the shape of '{name}'", "leave it out with WHERE")

    def _copy_visual_shape(self, link: int) -> int:
        """The visual shape of a link of the copy; -1 for none.

        Meshes that were built from points cannot be read. In scenes they look like the collision shape, which replaces
        them, or a small ball where there is none.
        """
        seen = [shape for shape in self.seen if shape[1] == link]
        if any(shape[2] == self.calls.GEOM_MESH and shape[4] in UNNAMED for shape in seen):
            touched = [data for of, _, data in self.world.shapes.read_shapes(self.body) if of == link]
            solid = make_solid(touched[0][2], touched[0][3]) if len(touched) == 1 else None
            return make_visual_shape(self.client, solid or Sphere(MARK), seen[0][7][:3])
        parts = [(read_bullet_shape(shape[2], shape[3], shape[4], ()), (shape[5], shape[6])) for shape in seen]
        return copy_visual_shape(self.client, [(part, pose) for part, pose in parts if part is not None])

    def _copy_colors(self, made: int) -> None:
        counts: Counter[int] = Counter()
        for shape in self.seen:
            self.client.changeVisualShape(made, shape[1], shapeIndex=counts[shape[1]], rgbaColor=shape[7])
            counts[shape[1]] += 1

"""Representations of selected bodies: what they occupy, what sensors see, and a new simulation with only these bodies.

`AS occupancygrid(z, cell, area)`: a cell is occupied where a body reaches into its square at the height z, beyond
touching its edge, so a wall that is thinner than the cells stays closed for path planning. The shape itself is tested,
not its bounding box: Bullet tests whether a thin plate of the size of the cell meets the body. Plates of 2 x 2, 4 x 4
... cells come first: where they meet nothing, their cells are free.

`AS sensorgrid(z, cell, area)`: a sensor sees a cell if the middle of the cell, at the height z, is within its range and
its angle, and if nothing stands between the two: no body of the world, selected or not, except the sensor's own. A
middle on a surface, such as the floor, is seen.

`AS environment`: each body is made anew from PyBullet's data: shapes, colours, masses, friction, joints, pose and
velocity. Damping and motors, which PyBullet does not expose, have Bullet's defaults in the copy. The boxes around links
that were loaded from files are up to 3 mm larger in the original, their shapes are not: only loading gives links such a
margin.
"""

from __future__ import annotations

from collections import Counter
from math import ceil, dist
from typing import Any, NoReturn

import numpy as np

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.area_grid import Grid
from ss2sql.language.cancellation import ITEMS_PER_CHECK, Check
from ss2sql.language.rows import Table, check_area_cells, check_number, check_numbers, refuse_argument
from ss2sql.language.values import format_value
from ss2sql.vtables.contract import Element
from ss2sql.vtables.pybullet.bullet_tables import FIXED, has_untold_shape, measure_box
from ss2sql.vtables.pybullet.client import (
    UPRIGHT,
    Box,
    Pose,
    compose_pose_turns,
    convert_pose_to_local,
    convert_pose_to_world,
    invert_rotation,
    rotate_point,
    unite_boxes,
)
from ss2sql.vtables.pybullet.collision import ShapeCache, are_in_cone, find_first_hits
from ss2sql.vtables.pybullet.scene import (
    UNNAMED,
    Part,
    Scene,
    Sphere,
    make_corner_view,
    make_solid,
    make_visual_shape,
    read_bullet_shape,
    read_corners,
)

FAR = 1000.0  # metres: bodies with larger boxes, such as endless planes, do not extend an area
WIDE = 100.0  # metres: bodies with larger boxes, such as that of plane.urdf, leave a view to the others


def find_selected_bodies(world: Any, form: str, table: Table) -> tuple[Any, list[int]]:
    """The world that the selected bodies belong to, `world` where there are none, and their ids, each once, in order.

    They are the elements in the columns of SELECT; where there are none, those of the source that the columns read.
    """
    selected = [value for row in table.rows for value in row if isinstance(value, Element)]
    selected = selected or [value for row in table.hidden for value in row if isinstance(value, Element)]
    if table.rows and not selected:
        hints = (
            "select them: SELECT obj FROM the world",
            "of several sources name one: SELECT b.this FROM a = ..., b = ...",
        )
        refuse_argument(form, "finds no bodies in these rows", *hints)
    world = selected[0].world if selected else world
    for element in selected:
        if element.world.source is not world.source:
            refuse_argument(
                form, f"cannot mix worlds: {element!r} belongs to another one", "ask for the bodies of one world"
            )
    world.check()
    return world, list(dict.fromkeys(world.find_body(element.key) for element in selected))


def resolve_area(world: Any, form: str, cell: Any, area: Any) -> tuple[list[float], float, int, int]:
    """The lower corner of a grid, the edge of its cells, its columns and its rows.

    Without an area it is that of the scene, else the box around all bodies of the world. It may extend one cell more.
    """
    edge = check_number(form, "the edge of a cell", cell, above=0)
    if area is None:
        low, high = (list(corner[:2]) for corner in measure_bounds(world))
    else:
        if not isinstance(area, list) or len(area) != 2:
            refuse_argument(form, f"needs an area [[x, y], [x, y]], not {format_value(area)}")
        low, high = (check_numbers(form, "an area [[x, y], [x, y]]", corner, 2) for corner in area)
        if low[0] >= high[0] or low[1] >= high[1]:
            refuse_argument(form, f"needs the lower corner of the area first, unlike {format_value(area)}")
    columns, rows = ((high[axis] - low[axis]) / edge for axis in (0, 1))
    half = min(2.0, 1000 * edge)
    example = f"AS {form}(0.3, {edge:g}, [[-{half:g}, -{half:g}], [{half:g}, {half:g}]])"
    check_area_cells(form, columns, rows, f"or name the area, where 0.3 is the height: {example}")
    return low, edge, ceil(columns - 1e-9), ceil(rows - 1e-9)


def measure_bounds(world: Any, widest: float = FAR) -> Box:
    """The lowest and the highest corner of a scene; for other clients those of all bodies up to a size, or of all."""
    known: Box | None = getattr(world.scene, "bounds", None)
    if known is not None:
        return known
    boxes = [measure_box(world, body) for body in world.list_ids()]
    boxes = [box for box in boxes if dist(*box) < widest] or [box for box in boxes if dist(*box) < FAR]
    return unite_boxes(boxes) if boxes else ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))


GAP = 1e-3  # parts of a cell by which plates are smaller than cells, so that touching a cell is not occupying it
THIN = 1e-3  # the thickness of plates, in parts of their edge
PLATES_PER_CHECK = 64  # plates tested between two checks of whether the run has to end; each takes 3 to 100 us

Ranges = tuple[range, range]  # of columns and of rows


def make_occupancy_grid(world: Any, table: Table, z: Any, cell: Any, area: Any) -> Grid:
    world, bodies = find_selected_bodies(world, "occupancygrid", table)
    height = check_number("occupancygrid", "the height z", z)
    origin, edge, columns, rows = resolve_area(world, "occupancygrid", cell, area)
    grid = Grid(np.zeros((rows, columns), dtype=bool), origin, edge)
    for body in bodies:
        low, high = measure_box(world, body)
        if low[2] - edge <= height <= high[2] + edge:
            ranges = _find_covered_cells((low, high), origin, edge, columns, rows)
            _mark_occupied_cells(world, grid, body, height, ranges, table.check)
    return grid


def _mark_occupied_cells(
    world: Any, grid: Grid, body: int, height: float, ranges: Ranges, check: Check | None
) -> None:  # fmt: skip
    """Marks the cells that a body occupies, from the largest plate, over the cells in these ranges, to single cells.

    Where a plate meets nothing its cells are free: an endless floor below the plates takes a few of them.
    """
    covered, across = ranges
    cells, (x, y), edge = np.asarray(grid), grid.origin, grid.cell
    level = max(len(covered), len(across)).bit_length()
    plates = _make_grid_plates(world, edge, level + 1)
    closest = world.calls.getClosestPoints
    waiting = [(level, covered.start, across.start)]
    tested = 0
    while waiting:
        level, column, row = waiting.pop()
        if column not in covered or row not in across or (level == 0 and cells[row, column]):
            continue
        tested += 1
        if check is not None and tested % PLATES_PER_CHECK == 0:
            check()
        size = 2**level
        middle = (x + (column + size / 2) * edge, y + (row + size / 2) * edge, height)
        plate = plates[level]
        if not closest(bodyA=-1, bodyB=body, distance=0.0, collisionShapeA=plate, collisionShapePositionA=middle):
            continue
        if level == 0:
            cells[row, column] = True
            continue
        half = size // 2
        waiting += [(level - 1, column + a, row + b) for a in (0, half) for b in (0, half)]


def _make_grid_plates(world: Any, edge: float, count: int) -> list[int]:
    """The shapes of plates of 1, 2, 4 ... cells along their edges, made once for each size."""
    stock: ShapeCache = world.__dict__.setdefault("plates", ShapeCache(world.calls))
    stock.clear_after_reset()
    sizes = [((side - GAP) * edge, (side - GAP) * edge, THIN * side * edge) for side in (2**n for n in range(count))]
    return [stock.get_shape(-1, -1, 0, (-1, -1, world.calls.GEOM_BOX, size, b"")) for size in sizes]


def _find_covered_cells(box: Box, origin: list[float], edge: float, columns: int, rows: int) -> Ranges:
    """The columns and rows that the box around a body covers."""
    (x1, y1, _), (x2, y2, _) = box
    ranges = []
    for low, high, start, count in ((x1, x2, origin[0], columns), (y1, y2, origin[1], rows)):
        first, last = (low - start) / edge - GAP, (high - start) / edge + GAP
        ranges.append(range(int(max(0.0, min(first, count))), int(max(0.0, min(last + 1, count)))))
    covered, across = ranges
    return covered, across


# --- `AS sensorgrid(z, cell, area)`, also `sensormap`: how many of the selected sensors see each cell
NEAR = 1e-4  # metres before the end of a ray where a hit counts as the surface that was aimed at


def make_sensor_grid(world: Any, table: Table, z: Any, cell: Any, area: Any) -> Grid:
    world, bodies = find_selected_bodies(world, "sensorgrid", table)
    for body in bodies:
        if body not in world.sensors:
            refuse_argument(
                "sensorgrid", f"was given '{world.name_of(body)}', which is no sensor", "add WHERE isSensor(this)"
            )
    height = check_number("sensorgrid", "the height z", z)
    origin, edge, columns, rows = resolve_area(world, "sensorgrid", cell, area)
    grid = Grid(np.zeros((rows, columns), dtype=np.int64), origin, edge)
    xs, ys = grid.centres()
    seen = np.asarray(grid).reshape(-1)
    for first in range(0, len(seen), ITEMS_PER_CHECK):
        places = np.arange(first, min(first + ITEMS_PER_CHECK, len(seen)))
        points = np.stack([xs[places % columns], ys[places // columns], np.full(len(places), height)], axis=1)
        for body in bodies:
            if table.check is not None:
                table.check()
            sensor = world.sensors[body]
            selected = np.flatnonzero(are_in_cone(sensor, points))
            hits, fractions = find_first_hits(world, body, sensor.position, points[selected])
            lengths = np.linalg.norm(points[selected] - np.asarray(sensor.position, dtype=float), axis=1)
            seen[first + selected[(hits < 0) | ((1 - fractions) * lengths <= NEAR)]] += 1
    return grid


# --- `AS environment`: a new simulation with only the selected bodies
MOST_PARTS = 16  # of one shape: PyBullet leaves out those beyond


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
        parameters = world.calls.getPhysicsEngineParameters()
        self.client.setGravity(*(parameters[f"gravityAcceleration{axis}"] for axis in "XYZ"))
        self.client.setTimeStep(parameters["fixedTimeStep"])
        self.bounds = measure_bounds(world)  # type: ignore[misc]
        self.views = {"corner": make_corner_view(*measure_bounds(world, WIDE))}  # type: ignore[misc]
        for name in ("views", "places", "outlines", "steps"):
            if hasattr(scene, name):
                setattr(self, name, getattr(scene, name))
        try:
            for body in bodies:
                if check is not None:
                    check()
                copy = self.ids[body] = self.adopt(_BodyCopy(world, body, self.client).make_body(), world.name_of(body))
                joints = range(world.calls.getNumJoints(body))
                self.joint_ends[copy] = {joint: world.read_joint_ends(body, joint) for joint in joints}
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
    world, bodies = find_selected_bodies(world, "environment", table)
    return Environment(world, bodies, table.check)


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
            low, high, *_ = self.world.read_joint_ends(self.body, joint)
            self.client.resetJointState(made, joint, place, speed)
            if low < high:
                self.client.changeDynamics(made, joint, jointLowerLimit=low, jointUpperLimit=high)

    def _copy_collision_shapes(self, link: int) -> list[int]:
        parts = [
            (self._copy_solid(link, number, data), convert_pose_to_world(self.local[link], (data[5], data[6])))
            for of, number, data in self.world.shapes.read_shapes(self.body)
            if of == link
        ]
        plain = [part for part in parts if "vertices" not in part[0]]
        groups = [plain[first : first + MOST_PARTS] for first in range(0, len(plain), MOST_PARTS)]
        groups += [[part] for part in parts if "vertices" in part[0]]
        return [_create_shape(self.client, group, "Collision") for group in groups]

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
        named = [({_VISUAL.get(n, n): v for n, v in part.items()}, pose) for part, pose in parts if part is not None]
        return _create_shape(self.client, named, "Visual")  # PyBullet shows the first MOST_PARTS

    def _copy_colors(self, made: int) -> None:
        counts: Counter[int] = Counter()
        for shape in self.seen:
            self.client.changeVisualShape(made, shape[1], shapeIndex=counts[shape[1]], rgbaColor=shape[7])
            counts[shape[1]] += 1

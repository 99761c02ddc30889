"""What worlds of bodies share: columns, functions, and tables with parameters.

Simulators provide different columns. A name that two of them have means the same in both, so a query runs over either.

Simulators that hold arrays compute the same columns from whole arrays.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from math import atan2, copysign, dist, hypot, isnan, pi, sqrt
from typing import Any, ClassVar

import numpy as np

from ss2sql.errors import ExecutionError, suggest_names
from ss2sql.language.cancellation import iterate_checked
from ss2sql.language.conversion import format_value
from ss2sql.vtables.contract import Column, Element, Gone, Table, TableFunction, Where, World, function
from ss2sql.vtables.schema import get_schema, get_world_tables, world_error

VECTOR = (float, float, float)
FAR = 1e30  # where the boxes of endless bodies end
RANGE = "< <= > >="

PLACES = {"this": "x y z", "pos": "x y z"}  # for Table.places

# The columns of groups that one call of a simulator gives, in the order of the functions below.
POSITION = "x y z posX posY posZ pos"
ROTATION = "qx qy qz qw quat"
VELOCITY = "vx vy vz velocity linearVelocity"
SPIN = "wx wy wz angularVelocity"
SHAPES = ("sphere", "box", "capsule", "cylinder", "plane", "mesh")
SHAPE = " ".join(["type", *(f"is{shape.title()}" for shape in SHAPES)])
AXES = ("x", "y", "z")

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]  # x, y, z, w

_COLUMNS = (
    Column("id", int, "", "the number of the body", "="),
    Column("name", str, "", "its name", "="),
    Column("obj", Element, "", "the body itself, what `this` is"),
    Column("type", str, "", f"{' '.join(SHAPES)} terrain, MuJoCo's ellipsoid and sdf, compound, or ghost: no shape"),
    *(Column(axis, float, "m", "the position", RANGE) for axis in AXES),
    *(Column(f"pos{axis.upper()}", float, "m", axis) for axis in AXES),
    Column("pos", VECTOR, "m", "the position, [x, y, z]"),
    *(Column(f"q{axis}", float, "", "the orientation as a quaternion") for axis in AXES),
    Column("qw", float, "", "the orientation as a quaternion, the real part"),
    Column("quat", (float, float, float, float), "", "the orientation as a quaternion, [qx, qy, qz, qw]"),
    Column("rot", VECTOR, "rad", "the orientation as roll, pitch and yaw"),
    Column("pose", (*VECTOR, *VECTOR, float), "m", "pos and quat in one list of seven"),
    *(Column(f"v{axis}", float, "m/s", "the velocity") for axis in AXES),
    *(Column(name, VECTOR, "m/s", "the velocity, [vx, vy, vz]") for name in ("velocity", "linearVelocity")),
    *(Column(f"w{axis}", float, "rad/s", "the angular velocity") for axis in AXES),
    Column("angularVelocity", VECTOR, "rad/s", "the angular velocity, [wx, wy, wz]"),
    Column("force", VECTOR, "N", "the force that is applied from outside"),
    Column("torque", VECTOR, "Nm", "the torque that is applied from outside"),
    Column("mass", float, "kg", "the mass"),
    Column("volume", float | None, "m3", "the volume of its shapes; None where it has no end or is not known"),
    Column("aabb", (VECTOR, VECTOR), "m", "the box around it along the axes: two opposite corners"),
    *(Column(f"is{shape.title()}", bool, "", f"whether its shape is a {shape}") for shape in SHAPES),
    Column("isRobot", bool, "", "whether it is a robot, or a part of one"),
    Column("isSensor", bool, "", "whether a sensor is mounted on it"),
    Column("isEnabled", bool, "", "whether anything can collide with it, as far as the simulator tells"),
    Column("hasBody", bool, "", "whether it has mass and can move: walls and the like stand still"),
)


def make_body_columns(without: str = "", unknown: str = "") -> tuple[Column, ...]:
    """The columns of bodies except `without`; those in `unknown` may be None."""
    left_out, optional = without.split(), unknown.split()
    return tuple(
        replace(column, type=_make_body_column_optional(column.type)) if column.name in optional else column
        for column in _COLUMNS
        if column.name not in left_out
    )


def _make_body_column_optional(declared: Any) -> Any:
    return tuple(map(_make_body_column_optional, declared)) if isinstance(declared, tuple) else declared | None


def list_body_shape_columns(shape: Any) -> tuple[Any, ...]:
    return shape, *(shape == known for known in SHAPES)


def compute_euler_angles(x: float, y: float, z: float, w: float) -> Vector:
    """Roll, pitch and yaw of a quaternion. Where the pitch is a right angle the roll is 0."""
    sine = 2 * (w * y - z * x)
    if abs(sine) > 1 - 1e-12:
        return 0.0, copysign(pi / 2, sine), -copysign(2.0, sine) * atan2(x, w)
    roll = atan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    yaw = atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    return roll, atan2(sine, sqrt((1 - sine) * (1 + sine))), yaw


def compute_solid_volume(kind: str | None, *size: float) -> float | None:
    """The volume of a sphere (radius), a box (its edges), a cylinder or capsule (radius, length without the ends)."""
    match kind, size:
        case "sphere", (radius,):
            return 4 / 3 * pi * radius**3
        case "box", (x, y, z):
            return x * y * z
        case "cylinder", (radius, length):
            return pi * (radius * radius * length)
        case "capsule", (radius, length):
            return pi * (radius * radius * length) + 4 / 3 * pi * radius**3
    return None


def clip_body_corner(values: Iterable[float]) -> Vector:
    """A corner of a box, with infinite coordinates replaced by FAR."""
    x, y, z = (max(-FAR, min(FAR, float(value))) for value in values)
    return x, y, z


def make_gone_error(what: str, key: Any) -> Gone:
    return Gone(f"no {what} has the id {key!r}")


# --- tables of things with a pose and a velocity: the columns that follow from these, one thing at a time
class Posed(Table, ABC):
    """A derived class declares `groups = {**PLACED, ...}` with the groups that it adds."""

    PLACED: ClassVar[dict[str, str]] = {
        "read_shape": SHAPE, "compute_angles": "rot", "read_pose": "pose",
        "read_position": "pos(x=posX y=posY z=posZ)", "read_turn": "quat(qx qy qz qw)",
        "read_velocity": "velocity=linearVelocity(vx vy vz)", "read_spin": "angularVelocity(wx wy wz)",
    }  # fmt: skip

    @abstractmethod
    def read_kind(self, key: Any) -> str:
        """Its shape."""

    @abstractmethod
    def read_position(self, key: Any) -> Vector:
        """Where it is."""

    @abstractmethod
    def read_turn(self, key: Any) -> Quaternion:
        """How it is turned: x, y, z, w."""

    @abstractmethod
    def read_velocity(self, key: Any) -> Vector:
        """How fast it moves."""

    @abstractmethod
    def read_spin(self, key: Any) -> Vector:
        """How fast it turns."""

    def read_shape(self, key: Any) -> tuple[Any, ...]:
        return list_body_shape_columns(self.read_kind(key))

    def compute_angles(self, key: Any) -> Vector:
        return compute_euler_angles(*self.read_turn(key))

    def read_pose(self, key: Any) -> tuple[float, ...]:
        return (*self.read_position(key), *self.read_turn(key))


Box = tuple[Sequence[float], Sequence[float]]
PAIR = (
    Column("a", Element, "", "the one body"),
    Column("b", Element, "", "the other body"),
    Column("idA", int, "", "the id of a"),
    Column("idB", int, "", "the id of b"),
)
SLACK = 1e-9  # relative: distances from different formulas differ by less


def make_parameter_error(name: str, wanted: str, value: Any) -> ExecutionError:
    return ExecutionError("X007", f"'{name}' needs {wanted}, not {format_value(value)}")


def read_body_numbers(value: Any, *lengths: int) -> tuple[float, ...] | None:
    """The numbers of a list that has one of these lengths; None for anything else."""
    if not isinstance(value, (list, tuple)) or len(value) not in lengths:
        return None
    if any(isinstance(part, bool) or not isinstance(part, (int, float)) for part in value):
        return None
    return tuple(map(float, value))


def find_named_body(wanted: str, names: Mapping[int, str]) -> int:
    """The id of the one body with a name; `names` are those of all bodies."""
    found = [body for body, name in names.items() if name == wanted]
    if len(found) == 1:
        return found[0]
    if found:
        raise world_error(
            f"{len(found)} bodies are called '{wanted}'", f"give the id of one: {found[0]}, {found[1]} ..."
        )
    known = [name for name in names.values() if name]
    some = f"some names are {', '.join(known[:3])}; SELECT name FROM the world shows all"
    raise world_error(f"no body is called '{wanted}'", *(suggest_names(wanted, known) or [some] * bool(known)))


def read_element_column(element: Element, name: str) -> Any:
    """A column of an element of another world, or of a part of a body."""
    if name not in get_schema(element.table).kinds:
        raise ExecutionError("X007", f"{element.table.name} have no column '{name}'", hints=("give a body",))
    return getattr(element, name)


class BodyWorld(World):
    """A world whose principal table has columns of bodies, keyed by `id`."""

    # --- what an adapter gives -------------------------------------------------------------------------

    @abstractmethod
    def read_positions(self) -> tuple[list[int], Any]:
        """The ids of all bodies in their order, and an array of their positions."""

    @abstractmethod
    def measure_gap(self, one: int, other: int) -> float:
        """The shortest distance between the surfaces of two bodies; 0 or less where they touch.

        Infinite where it is undefined.
        """

    def do_touch(self, one: int, other: int, margin: float = 0.0) -> bool:
        """Whether two bodies come nearer than a margin."""
        return self.measure_gap(one, other) <= margin

    def list_ids(self) -> Sequence[int]:
        """The ids of all bodies in their order."""
        return self.read_positions()[0]

    def has_body(self, body: int) -> bool:
        return body in self.list_ids()

    def name_of(self, body: int) -> str:
        return str(self.read_column(body, "name"))

    def list_parts(self, body: int) -> Sequence[int]:
        """The bodies that a body consists of, where it is more than its own row."""
        return (body,)

    @abstractmethod
    def is_touching(self, body: int, margin: float = 0.0) -> bool:
        """Whether a body comes nearer to any other than a margin."""

    @abstractmethod
    def would_touch(self, body: int, position: Vector, turn: Quaternion, margin: float = 0.0) -> bool:
        """Whether a body, put to a pose, would come nearer to any other than a margin; it does not move."""

    @abstractmethod
    def put_body(self, body: int, position: Vector, turn: Quaternion) -> None:
        """Moves a body to a pose."""

    # --- what functions are made of --------------------------------------------------------------------

    @property
    def bodies(self) -> Table:
        table = get_world_tables(self)[0]
        assert isinstance(table, Table)
        return table

    def read_column(self, body: int, name: str) -> Any:
        """A column of a body, read now."""
        return get_schema(self.bodies).read_value(body, name)

    def read_pose(self, body: int) -> tuple[Sequence[float], Sequence[float]]:
        return self.read_column(body, "pos"), self.read_column(body, "quat")

    def read_box(self, body: int) -> Box:
        """The box around a body, read once in a query."""
        known = self.memory.setdefault("boxes", {})
        if body not in known:
            low, high = self.measure_box(body)
            if any(map(isnan, (*low, *high))):
                self.read_column(body, "aabb")  # raises the error that says of which body
            known[body] = low, high
        return known[body]  # type: ignore[no-any-return]

    def measure_box(self, body: int) -> Box:
        low, high = self.read_column(body, "aabb")
        return low, high

    def iterate_pairs(self, a: Any, b: Any) -> Iterable[tuple[int, int]]:
        """The pairs of bodies a and b, where None stands for all; without both each pair once."""
        first, second = (self.list_ids() if body is None else [self.find_body(body)] for body in (a, b))
        both = a is None and b is None
        pairs = ((x, y) for x in first for y in second if x < y or (x != y and not both))
        return iterate_checked(pairs)

    def list_positions(self) -> tuple[list[int], Any]:
        """The same as `read_positions`, read once in a query."""
        known = self.memory
        if "positions" not in known:
            known["positions"] = self.read_positions()
        return known["positions"]  # type: ignore[no-any-return]

    def filter_bodies(self, where: Where) -> Sequence[int]:
        """The bodies that may meet conditions on id, name, x, y and z.

        Those without a position may, too: reading it tells why.
        """
        wanted, name = where.equal("id"), where.equal("name")
        if wanted is not None:
            found: Sequence[int] = [int(wanted)] if wanted % 1 == 0 and self.has_body(int(wanted)) else []
        elif where.keys().isdisjoint(AXES):
            found = self.list_ids()
        else:
            ids, points = self.list_positions()
            inside = np.ones(len(ids), bool)
            for number, axis in enumerate(AXES):
                if axis in where:
                    inside &= ~((points[:, number] < where.low(axis)) | (points[:, number] > where.high(axis)))
            found = [ids[place] for place in np.flatnonzero(inside)]
        return found if name is None else [body for body in found if self.name_of(body) == name]

    def find_body(self, wanted: Any) -> int:
        """The id of a body, given by its element or that of a part of it, by its id or its name."""
        if isinstance(wanted, Element) and wanted.world.source is self.source:
            return int(read_element_column(wanted, "body"))
        if isinstance(wanted, int) and not isinstance(wanted, bool):
            return wanted
        if not isinstance(wanted, str):
            raise make_parameter_error("body", "an element of this world, the id of a body, or its name", wanted)
        return find_named_body(wanted, {body: self.name_of(body) for body in self.list_ids()})

    def find_point(self, value: Any) -> Sequence[float]:
        """A point, given by coordinates or by a body. Raises the error of the column `pos` where the body has none."""
        found = self.read_point(value)
        if isnan(sum(found)):
            self.read_column(self.find_body(value), "pos")
        return found

    def read_point(self, value: Any) -> Sequence[float]:
        if isinstance(value, Element):  # of another world, or a part of a body
            return tuple(read_element_column(value, "pos"))
        if not isinstance(value, (list, tuple)):
            return tuple(self.read_column(self.find_body(value), "pos"))
        found = read_body_numbers(value, 2, 3)
        if found is None:
            raise ExecutionError("X007", f"a point has two or three numbers, unlike {format_value(value)}")
        return found

    def find_box(self, name: str, value: Any) -> Box:
        """A box, given by two opposite corners, or by a body with a box around it."""
        if isinstance(value, Element):
            low, high = read_element_column(value, "aabb")
            return low, high
        if not isinstance(value, (list, tuple)):
            return self.read_box(self.find_body(value))
        corners = [read_body_numbers(part, 3) for part in value]
        if len(corners) != 2 or corners[0] is None or corners[1] is None:
            raise make_parameter_error(name, "a box [[x, y, z], [x, y, z]]", value)
        pairs = list(zip(corners[0], corners[1], strict=True))
        return [min(pair) for pair in pairs], [max(pair) for pair in pairs]

    def find_pose(self, name: str, body: int, value: Any) -> tuple[Vector, Quaternion]:
        """A pose; missing parts are taken from the body's present pose."""
        numbers = read_body_numbers(value, 2, 3, 7)
        if numbers is None:
            raise make_parameter_error(name, "a place [x, y], [x, y, z] or [x, y, z, qx, qy, qz, qw]", value)
        point, turn = self.read_pose(body) if len(numbers) < 7 else (numbers, numbers[3:])
        size = hypot(*turn)
        if size < 1e-6:
            raise make_parameter_error(name, "a turn whose four numbers are not all 0", value)
        z = numbers[2] if len(numbers) > 2 else point[2]
        qx, qy, qz, qw = (part / size for part in turn)
        return (numbers[0], numbers[1], z), (qx, qy, qz, qw)

    # --- functions of scripts --------------------------------------------------------------------------

    @function
    def position(self, body: Any) -> list[float]:
        """Where it is on the floor plan, [x, y] in m. `pos` has all three numbers."""
        return list(self.find_point(body)[:2])

    @function("stable", indexed=True)
    def linearVelocity(self, body: Any, axis: Any = None) -> Any:  # noqa: N802 - the paper's word
        """How fast it moves, in m/s: [x, y, z], or the part along the axis 0, 1 or 2."""
        velocity = self.read_column(self.find_body(body), "velocity")
        if axis is None:
            return list(velocity)
        if axis not in (0, 1, 2) or isinstance(axis, bool):
            raise make_parameter_error("linearVelocity", "an axis 0, 1 or 2", axis)
        return velocity[int(axis)]

    @function
    def distance(self, one: Any, other: Any) -> float:
        """From position to position, in m; each may be a point. [x, y] counts on the floor plan.

        Between surfaces the table `closest` measures.
        """
        a, b = self.find_point(one), self.find_point(other)
        size = min(len(a), len(b))
        return dist(a[:size], b[:size])

    @function
    def above(self, one: Any, other: Any) -> bool:
        """Whether the middle of its box is higher than the other's box, and the boxes meet as seen from above.

        The boxes are those around bodies or parts of them, the column `aabb`, or a box [[x, y, z], [x, y, z]].
        That of an endless plane along two axes, such as a floor, ends at its front.
        """
        (low, high), (least, most) = self.find_box("above", one), self.find_box("above", other)
        return (low[2] + high[2]) / 2 > most[2] and all(low[k] <= most[k] and least[k] <= high[k] for k in (0, 1))

    @function
    def below(self, one: Any, other: Any) -> bool:
        """Whether the middle of its box is lower than the other's box, and the boxes meet as seen from above."""
        (low, high), (least, most) = self.find_box("below", one), self.find_box("below", other)
        return (low[2] + high[2]) / 2 < least[2] and all(low[k] <= most[k] and least[k] <= high[k] for k in (0, 1))

    @function
    def within(self, one: Any, other: Any) -> bool:
        """Whether its box lies within the other's box, or within a box [[x, y, z], [x, y, z]]."""
        (low, high), (least, most) = self.find_box("within", one), self.find_box("within", other)
        return all(least[k] <= low[k] and high[k] <= most[k] for k in range(3))

    @function
    def collision(self, one: Any, other: Any = None, margin: Any = 0.0) -> bool:
        """Whether a body would collide at a pose in m, [x, y], [x, y, z] or seven numbers; nothing moves.

        A body in place of the pose: whether these two collide now. Nothing at all: whether it collides with any, now.
        Bodies collide where they come nearer than `margin`, in m: 0 counts what just touches, -0.001 lets it touch.
        """
        near = _check_margin("collision", margin)
        body = self.find_body(one)
        if other is None:
            return self.is_touching(body, near)
        if isinstance(other, list):
            return self.would_touch(body, *self.find_pose("collision", body, other), near)
        return self.do_touch(body, self.find_body(other), near)

    @function("volatile")
    def checkCollision(self, body: Any, margin: Any = 0.0) -> bool:  # noqa: N802
        """Whether a body collides with any other where it is now, after all `move`s; `margin` as in `collision`."""
        return self.is_touching(self.find_body(body), _check_margin("checkCollision", margin))

    @function("volatile")
    def move(self, body: Any, to: Any) -> Any:
        """Puts a body at a place and gives the place back: [x, y] in m, [x, y, z], or seven numbers of a pose.

        It keeps its height, and how it is turned, where the place does not say.
        """
        moved = self.find_body(body)
        self.put_body(moved, *self.find_pose("move", moved, to))
        return to


def _check_margin(name: str, value: Any) -> float:
    found = read_body_numbers([value], 1)
    if found is None:
        raise make_parameter_error(name, "a margin in metres", value)
    return found[0]


def refuse_margin(margin: float, simulator: str) -> None:
    """Raises ExecutionError X007 for a margin where the simulator can only tell whether bodies touch."""
    if margin:
        raise ExecutionError("X007", f"{simulator} tests no margins", hints=("FROM space.closest(a, b, distance)",))


class RequestedPairs:
    """The requested pairs of bodies: all, those of body a, or those between a and b."""

    def __init__(self, world: BodyWorld, a: Any, b: Any) -> None:
        self.a, self.b = (None if body is None else world.list_parts(world.find_body(body)) for body in (a, b))

    def order_pair(self, one: int, other: int) -> tuple[int, int] | None:
        """Two bodies as a and b; None if they are not requested."""
        for a, b in ((one, other), (other, one)):
            if (self.a is None or a in self.a) and (self.b is None or b in self.b):
                return a, b
        return None


class Closest(TableFunction):
    name = "closest"
    text = "how far a and b are apart, if they are within a distance; None stands for all bodies"
    columns = (*PAIR, Column("distance", float, "m", "between the surfaces; 0 or less where they touch"))
    world: BodyWorld

    def rows(self, a: Any, b: Any, distance: float) -> Iterator[tuple[Any, ...]]:
        world = self.world
        for one, other in world.iterate_pairs(a, b):
            gap = world.measure_gap(one, other)
            if gap <= distance:
                yield world.bodies.element(one), world.bodies.element(other), one, other, gap


class Near(TableFunction):
    name, table = "near", "bodies"
    text = "the bodies whose position is at most radius metres away from a point or from that of a body"
    world: BodyWorld

    def rows(self, point: Any, radius: float) -> Iterator[int]:
        if read_body_numbers([radius], 1) is None:
            raise make_parameter_error("near", "a radius in metres", radius)
        wanted = self.world.find_point(point)
        ids, points = self.world.list_positions()
        size = len(wanted)
        far = np.linalg.norm(points[:, :size] - np.asarray(wanted), axis=1) > radius + SLACK * (1 + abs(radius))
        for place in np.flatnonzero(~far).tolist():
            away = dist(points[place, :size].tolist(), wanted)
            if isnan(away):
                self.world.read_column(ids[place], "pos")  # raises the error that says of which body
            if away <= radius:
                yield ids[place]


class Overlaps(TableFunction):
    name, table = "overlaps", "bodies"
    text = "the bodies whose aabb has a point in common with a box [[x, y, z], [x, y, z]] or with the aabb of a body"
    world: BodyWorld

    def rows(self, box: Any) -> Iterator[int]:
        low, high = self.world.find_box("overlaps", box)
        for body in self.world.list_ids():
            least, most = self.world.read_box(body)
            if all(a <= d and c <= b for a, b, c, d in zip(low, high, least, most, strict=True)):
                yield body

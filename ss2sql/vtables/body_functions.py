"""The functions and tables with parameters that worlds of bodies share, computed from columns of bodies."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterable, Iterator, Sequence
from math import dist, hypot
from typing import Any

import numpy as np

from ss2sql.errors import ExecutionError, suggest_names
from ss2sql.language.value_messages import format_value
from ss2sql.vtables.body_columns import Quaternion, Vector
from ss2sql.vtables.contract import Column, Element, Table, TableFunction, Where, World, function
from ss2sql.vtables.schema import get_schema, get_world_tables

Box = tuple[Sequence[float], Sequence[float]]
PAIR = (
    Column("a", object, "", "the one body"),
    Column("b", object, "", "the other body"),
    Column("idA", int, "", "the id of a"),
    Column("idB", int, "", "the id of b"),
)
AXES = ("x", "y", "z")
SLACK = 1e-9  # relative: distances from different formulas differ by less


def make_parameter_error(name: str, wanted: str, value: Any) -> ExecutionError:
    """The error for an argument."""
    return ExecutionError("X007", f"'{name}' needs {wanted}, not {format_value(value)}")


def read_numbers(value: Any, *lengths: int) -> tuple[float, ...] | None:
    """The numbers of a list that has one of these lengths; None for anything else."""
    if not isinstance(value, (list, tuple)) or len(value) not in lengths:
        return None
    if any(isinstance(part, bool) or not isinstance(part, (int, float)) for part in value):
        return None
    return tuple(map(float, value))


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

    def do_touch(self, one: int, other: int) -> bool:
        """Whether two bodies touch."""
        return self.measure_gap(one, other) <= 0.0

    @abstractmethod
    def is_touching(self, body: int) -> bool:
        """Whether a body touches any other."""

    @abstractmethod
    def would_touch(self, body: int, position: Vector, turn: Quaternion) -> bool:
        """Whether a body would touch any other at a pose; it does not move."""

    @abstractmethod
    def put_body(self, body: int, position: Vector, turn: Quaternion) -> None:
        """Moves a body to a pose."""

    # --- what functions are made of --------------------------------------------------------------------

    @property
    def bodies(self) -> Table:
        """The principal table."""
        table = get_world_tables(self)[0]
        assert isinstance(table, Table)
        return table

    def read_column(self, body: int, name: str) -> Any:
        """A column of a body, read now."""
        return get_schema(self.bodies).read_value(body, name)

    def read_pose(self, body: int) -> tuple[Sequence[float], Sequence[float]]:
        """Where a body is, and how it is turned."""
        return self.read_column(body, "pos"), self.read_column(body, "quat")

    def filter_by_position(self, where: Where) -> list[int]:
        """The bodies that meet conditions on x, y and z. Positions are read once in a query."""
        known = self.memory
        if "positions" not in known:
            known["positions"] = self.read_positions()
        ids, points = known["positions"]
        inside = np.ones(len(ids), bool)
        for number, axis in enumerate(AXES):
            if axis in where:
                inside &= (points[:, number] >= where.low(axis)) & (points[:, number] <= where.high(axis))
        return [ids[place] for place in np.flatnonzero(inside)]

    def find_body(self, wanted: Any) -> int:
        """The id of a body, given by its element, its id or its name."""
        if isinstance(wanted, int) and not isinstance(wanted, bool):
            return wanted
        if not isinstance(wanted, str):
            raise make_parameter_error("body", "an element of this world, the id of a body, or its name", wanted)
        keys: list[Any] = list(self.bodies.keys(Where()))
        names = {self.read_column(key, "name"): key for key in keys}
        if wanted not in names:
            raise ExecutionError("X007", f"no body is called '{wanted}'", hints=suggest_names(wanted, names))
        return int(names[wanted])

    def find_point(self, value: Any) -> Sequence[float]:
        """A point, given by coordinates or by a body."""
        if isinstance(value, Element):  # of another world
            return tuple(value.pos)
        if not isinstance(value, (list, tuple)):
            return tuple(self.read_column(self.find_body(value), "pos"))
        found = read_numbers(value, 2, 3)
        if found is None:
            raise ExecutionError("X007", f"a point has two or three numbers, unlike {format_value(value)}")
        return found

    def find_box(self, name: str, value: Any) -> Box:
        """A box, given by two opposite corners, or by a body with a box around it."""
        if isinstance(value, Element):
            low, high = value.aabb
            return low, high
        if not isinstance(value, (list, tuple)):
            low, high = self.read_column(self.find_body(value), "aabb")
            return low, high
        corners = [read_numbers(part, 3) for part in value]
        if len(corners) != 2 or corners[0] is None or corners[1] is None:
            raise make_parameter_error(name, "a box [[x, y, z], [x, y, z]]", value)
        pairs = list(zip(corners[0], corners[1], strict=True))
        return [min(pair) for pair in pairs], [max(pair) for pair in pairs]

    def find_pose(self, name: str, body: int, value: Any) -> tuple[Vector, Quaternion]:
        """A pose; missing parts are taken from the body's present pose."""
        numbers = read_numbers(value, 2, 3, 7)
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

        The boxes are those around the bodies, the column `aabb`; the other may be a box [[x, y, z], [x, y, z]].
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
    def collision(self, one: Any, other: Any = None) -> bool:
        """Whether a body would touch another one at a pose [x, y], [x, y, z] or seven numbers; nothing moves.

        A body in place of the pose: whether these two touch now. Nothing at all: whether it touches any, now.
        """
        body = self.find_body(one)
        if other is None:
            return self.is_touching(body)
        if isinstance(other, (list, tuple)):
            return self.would_touch(body, *self.find_pose("collision", body, other))
        return self.do_touch(body, self.find_body(other))

    @function("volatile")
    def checkCollision(self, body: Any) -> bool:  # noqa: N802
        """Whether a body touches any other where it is now, after all `move`s."""
        return self.is_touching(self.find_body(body))

    @function("volatile")
    def move(self, body: Any, to: Any) -> Any:
        """Puts a body at a place and gives the place back: [x, y] in m, [x, y, z], or seven numbers of a pose.

        It keeps its height, and how it is turned, where the place does not say.
        """
        moved = self.find_body(body)
        self.put_body(moved, *self.find_pose("move", moved, to))
        return to


class RequestedPairs:
    """The requested pairs of bodies: all, those of body a, or those between a and b."""

    def __init__(self, world: BodyWorld, a: Any, b: Any) -> None:
        self.a, self.b = (None if body is None else world.find_body(body) for body in (a, b))

    def order_pair(self, one: int, other: int) -> tuple[int, int] | None:
        """Two bodies as a and b; None if they are not requested."""
        for a, b in ((one, other), (other, one)):
            if self.a in (None, a) and self.b in (None, b):
                return a, b
        return None


class Closest(TableFunction):
    """How far bodies are apart."""

    name = "closest"
    text = "how far a and b are apart, if they are within a distance; None stands for all bodies"
    columns = (*PAIR, Column("distance", float, "m", "between the surfaces; 0 or less where they touch"))
    world: BodyWorld

    def rows(self, a: Any, b: Any, distance: float) -> Iterator[tuple[Any, ...]]:
        world = self.world
        ids = world.read_positions()[0] if a is None or b is None else []
        first, second = (ids if body is None else [world.find_body(body)] for body in (a, b))
        both = a is None and b is None
        for one in first:
            for other in second:
                if one < other or (one != other and not both):
                    gap = world.measure_gap(one, other)
                    if gap <= distance:
                        yield world.bodies.element(one), world.bodies.element(other), one, other, gap


class Near(TableFunction):
    """Bodies near a point."""

    name, table = "near", "bodies"
    text = "the bodies whose position is at most radius metres away from a point or from that of a body"
    world: BodyWorld

    def rows(self, point: Any, radius: float) -> Iterable[int]:
        wanted = self.world.find_point(point)
        ids, points = self.world.read_positions()
        size = len(wanted)
        roughly = np.linalg.norm(points[:, :size] - np.asarray(wanted), axis=1) <= radius + SLACK * (1 + abs(radius))
        found = np.flatnonzero(roughly).tolist()
        return [ids[place] for place in found if dist(points[place, :size].tolist(), wanted) <= radius]


class Overlaps(TableFunction):
    """Bodies in a box."""

    name, table = "overlaps", "bodies"
    text = "the bodies whose aabb has a point in common with a box [[x, y, z], [x, y, z]] or with the aabb of a body"
    world: BodyWorld

    def rows(self, box: Any) -> Iterator[int]:
        low, high = self.world.find_box("overlaps", box)
        for body in self.world.read_positions()[0]:
            least, most = self.world.read_column(body, "aabb")
            if all(least[k] <= high[k] and low[k] <= most[k] for k in range(3)):
                yield body

"""Tables with parameters: what touches, what is near, what a ray hits."""

from __future__ import annotations

from collections.abc import Iterator
from math import dist
from typing import Any

from ss2sql.language.cancellation import iterate_checked
from ss2sql.vtables.body_functions import PAIR, VECTOR, make_parameter_error, read_body_numbers
from ss2sql.vtables.contract import Column, TableFunction

MOST_RAYS = 16_383  # in one call; from one more on PyBullet loses some

_PAIR = (
    *PAIR,
    Column("linkA", int, text="the number of the link of a, -1 for the base"),
    Column("linkB", int, text="the number of the link of b"),
    Column("pointA", VECTOR, "m", "the point on a"),
    Column("pointB", VECTOR, "m", "the point on b"),
    Column("normal", VECTOR, text="the direction from b to a"),
    Column("distance", float, "m", "between the surfaces; below 0 where they reach into each other"),
)


class BulletContacts(TableFunction):
    name = "contacts"
    text = "where bodies touched in the last step: all, those of body a, or those between a and b"
    columns = (*_PAIR, Column("normalForce", float, "N", "how strongly they press"))

    def rows(self, a: Any = None, b: Any = None) -> Iterator[tuple[Any, ...]]:
        world = self.world
        chosen = {name: world.find_body(body) for name, body in (("bodyA", a), ("bodyB", b)) if body is not None}
        for point in world.calls.getContactPoints(**chosen) or ():
            yield (*_make_contact_row(world, point), point[9])


class BulletClosest(TableFunction):
    name = "closest"
    text = "where links of a and b are nearest to each other, if they are within a distance; None stands for all bodies"
    columns = _PAIR

    def rows(self, a: Any, b: Any, distance: float) -> Iterator[tuple[Any, ...]]:
        world = self.world
        if read_body_numbers([distance], 1) is None:
            raise make_parameter_error("closest", "a distance in metres", distance)
        for one, other in world.iterate_pairs(a, b):
            for point in world.calls.getClosestPoints(one, other, distance) or ():
                yield _make_contact_row(world, point)


def _make_contact_row(world: Any, point: Any) -> tuple[Any, ...]:
    _, a, b, link_a, link_b, point_a, point_b, normal, distance, *_ = point
    return world.get_element(a), world.get_element(b), a, b, link_a, link_b, point_a, point_b, normal, distance


class Rays(TableFunction):
    name = "rays"
    text = "what rays hit first, between points or lists of points; a ray that hits nothing has no row"
    columns = (
        Column("ray", int, text="the number of the ray, from 0"),
        Column("body", object, text="what it hits"),
        Column("id", int, text="the id of the body"),
        Column("link", int, text="the number of the link, -1 for the base"),
        Column("pos", VECTOR, "m", "where it hits"),
        Column("normal", VECTOR, text="the direction in which the surface looks there"),
        Column("distance", float, "m", "from its start; rays from inside of a shape do not see this shape"),
    )

    def rows(self, start: Any, end: Any) -> Iterator[tuple[Any, ...]]:
        world = self.world
        starts, ends = _read_ray_points(world, start), _read_ray_points(world, end)
        if len(starts) != len(ends):
            if 1 not in (len(starts), len(ends)):
                raise make_parameter_error("rays", "as many starts as ends", f"{len(starts)} and {len(ends)}")
            starts, ends = starts * max(1, len(ends)), ends * max(1, len(starts))
        for first in range(0, len(starts), MOST_RAYS):
            part = slice(first, first + MOST_RAYS)
            for number, hit in enumerate(world.calls.rayTestBatch(starts[part], ends[part]), first):
                body, link, _, pos, normal = hit[:5]
                if body >= 0:
                    yield number, world.get_element(body), body, link, pos, normal, dist(starts[number], pos)


def _read_ray_points(world: Any, value: Any) -> list[tuple[float, ...]]:
    if isinstance(value, list) and (not value or isinstance(value[0], list)):
        return [_read_ray_point(point) for point in iterate_checked(value)]
    return [_read_ray_point(value if isinstance(value, list) else world.find_point(value))]


def _read_ray_point(value: Any) -> tuple[float, ...]:
    point = read_body_numbers(value, 3)
    if point is None:
        raise make_parameter_error("rays", "points [x, y, z]", value)
    return point

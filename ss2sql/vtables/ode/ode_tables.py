"""The tables of ODE."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from ss2sql.vtables.body_columns import PLACES, VECTOR, Quaternion, Vector, clip_to_finite, make_body_columns
from ss2sql.vtables.body_functions import PAIR, RequestedPairs
from ss2sql.vtables.contract import Column, TableFunction, Where
from ss2sql.vtables.ode.ode_shapes import position_of, shape_of, turn_of, volume_of
from ss2sql.vtables.pose_columns import Posed

if TYPE_CHECKING:
    from ss2sql.vtables.ode import OdeWorld

STILL = (0.0, 0.0, 0.0)


class Bodies(Posed):
    name, key = "bodies", "id"
    text = "the geoms of the space, with what their bodies add"
    columns = make_body_columns(without="isRobot isSensor")
    places = PLACES
    groups: ClassVar[Mapping[str, str]] = {
        **Posed.PLACED, "called": "name", "itself": "obj", "pushed": "force", "turned": "torque", "weight": "mass",
        "size": "volume", "box": "aabb", "touchable": "isEnabled", "movable": "hasBody",
    }  # fmt: skip
    world: OdeWorld

    def keys(self, where: Where) -> Iterable[int]:
        number, name = where.equal("id"), where.equal("name")
        if number is not None:
            return [int(number)] if self.world.holds(number) else []
        found = sorted(self.world.found()) if where.keys().isdisjoint("xyz") else self.world.filter_by_position(where)
        return found if name is None else [key for key in found if self.called(key) == name]

    def geom(self, key: Any) -> Any:
        return self.world.geom(key)

    def called(self, key: int) -> str:
        """The attribute `name` of the geom, or of its body; else its shape and number."""
        geom = self.geom(key)
        body = geom.getBody()
        given = getattr(geom, "name", None) or (None if body is None else getattr(body, "name", None))
        return str(given) if given else f"{shape_of(geom)}_{key}"

    def itself(self, key: int) -> Any:
        self.geom(key)  # raises Gone
        return self.element(key)

    def kind_of(self, key: Any) -> str:
        return shape_of(self.geom(key))

    def position_of(self, key: Any) -> Vector:
        return position_of(self.geom(key))

    def turn_of(self, key: Any) -> Quaternion:
        return turn_of(self.geom(key))

    def velocity_of(self, key: Any) -> Vector:
        return self._of_body(key, "getLinearVel")

    def spin_of(self, key: Any) -> Vector:
        return self._of_body(key, "getAngularVel")

    def pushed(self, key: int) -> Vector:
        return self._of_body(key, "getForce")

    def turned(self, key: int) -> Vector:
        return self._of_body(key, "getTorque")

    def _of_body(self, key: int, method: str) -> Vector:
        body = self.geom(key).getBody()
        return STILL if body is None else getattr(body, method)()

    def weight(self, key: int) -> float:
        body = self.geom(key).getBody()
        return 0.0 if body is None else float(body.getMass().mass)

    def size(self, key: int) -> float | None:
        return volume_of(self.geom(key))

    def box(self, key: int) -> tuple[Vector, Vector]:
        low_x, high_x, low_y, high_y, low_z, high_z = self.geom(key).getAABB()
        return clip_to_finite((low_x, low_y, low_z)), clip_to_finite((high_x, high_y, high_z))

    def touchable(self, key: int) -> bool:
        return bool(self.geom(key).isEnabled())

    def movable(self, key: int) -> bool:
        return self.geom(key).getBody() is not None


class Contacts(TableFunction):
    name = "contacts"
    text = "where bodies touch, as ode.collide finds it: all, those of body a, or those between a and b"
    columns = (
        *PAIR,
        Column("pos", VECTOR, "m", "where they touch"),
        Column("normal", VECTOR, "", "the direction from b to a"),
        Column("distance", float, "m", "between the surfaces: 0, or less where they reach into each other"),
    )
    world: OdeWorld

    def rows(self, a: Any = None, b: Any = None) -> Iterator[tuple[Any, ...]]:
        world = self.world
        requested, element = RequestedPairs(world, a, b), world.bodies.element
        for one, other in world.near():
            pair = requested.in_order(one, other)
            if pair is not None:
                for contact in world.touches(*pair):
                    place, normal, depth, _, _ = contact.getContactGeomParams()
                    yield (*map(element, pair), *pair, place, normal, -depth)

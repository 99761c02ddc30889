"""The tables of ODE."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from ss2sql.vtables.body_columns import PLACES, VECTOR, Quaternion, Vector, clip_to_finite, make_body_columns
from ss2sql.vtables.body_functions import PAIR, RequestedPairs
from ss2sql.vtables.contract import Column, TableFunction, Where
from ss2sql.vtables.ode.ode_shapes import compute_volume, name_shape, read_position, read_turn
from ss2sql.vtables.pose_columns import Posed

if TYPE_CHECKING:
    from ss2sql.vtables.ode import OdeWorld

STILL = (0.0, 0.0, 0.0)


class OdeBodies(Posed):
    name, key = "bodies", "id"
    text = "the geoms of the space, with what their bodies add"
    columns = make_body_columns(without="isRobot isSensor")
    places = PLACES
    groups: ClassVar[Mapping[str, str]] = {
        **Posed.PLACED, "read_name": "name", "read_element": "obj", "read_force": "force", "read_torque": "torque",
        "read_mass": "mass", "read_volume": "volume", "read_box": "aabb", "is_touchable": "isEnabled",
        "is_movable": "hasBody",
    }  # fmt: skip
    world: OdeWorld

    def keys(self, where: Where) -> Iterable[int]:
        number, name = where.equal("id"), where.equal("name")
        if number is not None:
            return [int(number)] if self.world.has_geom(number) else []
        found = (
            sorted(self.world.find_geoms()) if where.keys().isdisjoint("xyz") else self.world.filter_by_position(where)
        )
        return found if name is None else [key for key in found if self.read_name(key) == name]

    def get_geom(self, key: Any) -> Any:
        return self.world.get_geom(key)

    def read_name(self, key: int) -> str:
        """The attribute `name` of the geom, or of its body; else its shape and number."""
        geom = self.get_geom(key)
        body = geom.getBody()
        name = getattr(geom, "name", None) or (None if body is None else getattr(body, "name", None))
        return str(name) if name else f"{name_shape(geom)}_{key}"

    def read_element(self, key: int) -> Any:
        self.get_geom(key)  # raises Gone
        return self.element(key)

    def read_kind(self, key: Any) -> str:
        return name_shape(self.get_geom(key))

    def read_position(self, key: Any) -> Vector:
        return read_position(self.get_geom(key))

    def read_turn(self, key: Any) -> Quaternion:
        return read_turn(self.get_geom(key))

    def read_velocity(self, key: Any) -> Vector:
        return self._read_from_body(key, "getLinearVel")

    def read_spin(self, key: Any) -> Vector:
        return self._read_from_body(key, "getAngularVel")

    def read_force(self, key: int) -> Vector:
        return self._read_from_body(key, "getForce")

    def read_torque(self, key: int) -> Vector:
        return self._read_from_body(key, "getTorque")

    def _read_from_body(self, key: int, method: str) -> Vector:
        body = self.get_geom(key).getBody()
        return STILL if body is None else getattr(body, method)()

    def read_mass(self, key: int) -> float:
        body = self.get_geom(key).getBody()
        return 0.0 if body is None else float(body.getMass().mass)

    def read_volume(self, key: int) -> float | None:
        return compute_volume(self.get_geom(key))

    def read_box(self, key: int) -> tuple[Vector, Vector]:
        low_x, high_x, low_y, high_y, low_z, high_z = self.get_geom(key).getAABB()
        return clip_to_finite((low_x, low_y, low_z)), clip_to_finite((high_x, high_y, high_z))

    def is_touchable(self, key: int) -> bool:
        return bool(self.get_geom(key).isEnabled())

    def is_movable(self, key: int) -> bool:
        return self.get_geom(key).getBody() is not None


class OdeContacts(TableFunction):
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
        for one, other in world.list_near_pairs():
            pair = requested.order_pair(one, other)
            if pair is not None:
                for contact in world.list_contacts(*pair):
                    place, normal, depth, _, _ = contact.getContactGeomParams()
                    yield (*map(element, pair), *pair, place, normal, -depth)

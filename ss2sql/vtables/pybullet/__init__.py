"""PyBullet as a world: `ss.attach("space", client)`.

client calls the simulator, and has poses. Its tables are in bullet_tables. Functions: collision.
Representations: environment. scene is what simulations with names are made of.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from ss2sql.language.area_grid import Grid
from ss2sql.language.rows import Table, request_hidden_columns
from ss2sql.vtables.body_functions import Near, Overlaps
from ss2sql.vtables.contract import Element, Gone
from ss2sql.vtables.pybullet.bullet_tables import (
    BulletBodies,
    BulletClosest,
    BulletContacts,
    BulletJoints,
    BulletLinks,
    BulletShapes,
    Cameras,
    Rays,
)
from ss2sql.vtables.pybullet.client import BodyNotes, Calls, NumberedClient, get_client_number
from ss2sql.vtables.pybullet.collision import BulletFunctions, CollisionShapes
from ss2sql.vtables.pybullet.environment import (
    Environment,
    make_environment,
    make_occupancy_grid,
    make_sensor_grid,
)
from ss2sql.vtables.reading import digest_world
from ss2sql.vtables.schema import get_world_tables, world_error

__all__ = ["PyBulletWorld"]


class PyBulletWorld(BulletFunctions):
    """A PyBullet simulation. Lengths are in metres, masses in kilograms, angles in radians.

    Args:
        source: a `BulletClient`, a scene of `ss2sql.scenes`, or the number that `pybullet.connect` gave.
        names: names of bodies by their ids; others have the names that their files give them. A name ends with its
            body.
        sensors: what the bodies that are sensors see, by their ids: objects with `position`, `direction`, `range` and
            `angle`, as `ss2sql.scenes.Sensor`. They end with their bodies, too.

    Raises ExecutionError X011 where `names` or `sensors` mention a body that does not exist.

    A scene has names, sensors, forces, cameras and a clock.
    """

    tables = (
        BulletBodies, BulletLinks, BulletJoints, BulletShapes, BulletContacts, BulletClosest, Near, Overlaps,
        Rays, Cameras,
    )  # fmt: skip
    representations: ClassVar[Mapping[str, str]] = {
        "occupancygrid": "occupancygrid", "sensorgrid": "sensorgrid", "sensormap": "sensorgrid",
        "environment": "environment",
    }  # fmt: skip

    def __init__(
        self, source: Any, names: Mapping[int, str] | None = None, sensors: Mapping[int, Any] | None = None
    ) -> None:
        self.scene = source if hasattr(source, "client") else None
        client = NumberedClient(source) if isinstance(source, int) else getattr(source, "client", source)
        super().__init__(source if isinstance(source, int) else client)
        self.client = client
        self.calls = Calls(client)
        self.shapes = CollisionShapes(self)
        self._number = get_client_number(client)
        self._info = self.calls.get_numbered_call("getBodyInfo")
        self.names: Mapping[int, str] = self._note_bodies("names", names)
        self.sensors: Mapping[int, Any] = self._note_bodies("sensors", sensors)
        self._ids: dict[str, int] = {}  # by name, from the last search

    def _note_bodies(self, name: str, given: Mapping[int, Any] | None) -> Mapping[int, Any]:
        """What is given for bodies, or else what the scene says of them."""
        if given is None:
            return getattr(self.scene, name, {})
        for body in given:
            if not self.has_body(body):
                raise world_error(f"there is no body {body!r} for {name}=", f"give {name}= once its bodies are made")
        return BodyNotes(self.calls, given)

    def read_joint_ends(self, body: int, joint: int) -> tuple[float, ...]:
        """Lower and upper end, greatest force and velocity of a joint, which PyBullet does not tell of copies."""
        known = getattr(self.scene, "joint_ends", {}).get(body, {})
        return known.get(joint) or self.calls.getJointInfo(body, joint)[8:12]  # type: ignore[no-any-return]

    @property
    def time(self) -> float | None:
        """The clock of a scene; PyBullet itself has no readable one."""
        return None if self.scene is None else self.scene.time

    def check(self) -> None:
        """Raises where the client is disconnected, even if another one has its number now."""
        if get_client_number(self.client) != self._number or not self.calls.isConnected():
            raise world_error("the PyBullet client is disconnected", "connect anew, and attach the new client")

    def fingerprint(self) -> str:
        """A hash of all tables without the cameras' pictures, which follow from the rest and take longest."""
        words = ("position", "direction", "range", "angle")
        seen = [(body, *(getattr(one, word) for word in words)) for body, one in sorted(self.sensors.items())]
        return f"{digest_world(self, without=('cameras.sees',))} {seen}"

    def has_body(self, body: int) -> bool:
        try:
            self._info(body, self.calls.number)
        except (self.calls.error, OverflowError, TypeError):
            return False
        return True

    def check_body(self, body: int) -> None:
        """Raises Gone for a missing body, for which many of PyBullet's functions answer as if it were empty."""
        if not self.has_body(body):
            self.check()
            raise Gone("it was removed")

    def name_of(self, body: int) -> str:
        """The name that it was given, that of its file, or `body_7`."""
        name = self.names.get(body)
        if name is not None:
            return name
        return self.calls.getBodyInfo(body)[1].decode(errors="replace") or f"body_{body}"

    def find_body(self, wanted: Any) -> int:
        """The id of a body, given by its element, its id, its name, or one of its links."""
        if isinstance(wanted, tuple):  # the key of a link
            return self.find_body(wanted[0])
        if type(wanted) is int and not self.has_body(wanted):
            raise world_error(f"there is no body {wanted}", "ask for the bodies anew: SELECT id, name FROM the world")
        if not isinstance(wanted, str):
            return super().find_body(wanted)
        known = self._ids.get(wanted)  # cached: a search takes a microsecond for each body
        if known is None or not self.has_body(known) or self.name_of(known) != wanted:
            known = self._ids[wanted] = super().find_body(wanted)
        return known

    def get_element(self, body: int) -> Element | None:
        """A body as scripts see it; None for PyBullet's -1."""
        principal: Any = get_world_tables(self)[0]
        return principal.element(body) if body >= 0 else None

    # --- representations of selected bodies; those of another simulation are read there ------------------

    @request_hidden_columns("elements")
    def occupancygrid(self, table: Table, z: Any, cell: Any, area: Any = None) -> Grid:
        """Where the selected bodies stand at the height `z`: a grid of bools, with cells of this edge.

        `area` is [[x, y], [x, y]]; without it the grid covers the scene. Lengths are in metres.
        """
        return make_occupancy_grid(self, table, z, cell, area)

    @request_hidden_columns("elements")
    def sensorgrid(self, table: Table, z: Any, cell: Any, area: Any = None) -> Grid:
        """How many of the selected sensors see each cell at the height `z`; with the arguments of occupancygrid."""
        return make_sensor_grid(self, table, z, cell, area)

    @request_hidden_columns("elements")
    def environment(self, table: Table) -> Environment:
        """A new simulation with only the selected bodies, a scene that can be attached in its turn."""
        return make_environment(self, table)

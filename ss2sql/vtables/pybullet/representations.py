"""The representations of a simulation: `AS occupancygrid`, `AS sensorgrid` and `AS environment`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from ss2sql.language.area_grid import Grid
from ss2sql.language.rows import Table, request_hidden_columns
from ss2sql.vtables.pybullet.occupancy_grid import find_selected_world, list_selected_bodies

if TYPE_CHECKING:
    from ss2sql.vtables.pybullet.environment import Environment


class Representations:
    """The representations of selected bodies; bodies of another simulation are read there."""

    representations: ClassVar[Mapping[str, str]] = {
        "occupancygrid": "occupancygrid", "sensorgrid": "sensorgrid", "sensormap": "sensorgrid",
        "environment": "environment",
    }  # fmt: skip

    @request_hidden_columns("elements")
    def occupancygrid(self, table: Table, z: Any, cell: Any, area: Any = None) -> Grid:
        """Where the selected bodies stand at the height `z`: a grid of bools, with cells of this edge.

        `area` is [[x, y], [x, y]]; without it the grid covers the scene. Lengths are in metres.
        """
        from ss2sql.vtables.pybullet.occupancy_grid import make_occupancy_grid

        return make_occupancy_grid(find_selected_world(self, table), table, z, cell, area)

    @request_hidden_columns("elements")
    def sensorgrid(self, table: Table, z: Any, cell: Any, area: Any = None) -> Grid:
        """How many of the selected sensors see each cell at the height `z`; with the arguments of occupancygrid."""
        from ss2sql.vtables.pybullet.occupancy_grid import make_sensor_grid

        return make_sensor_grid(find_selected_world(self, table), table, z, cell, area)

    @request_hidden_columns("elements")
    def environment(self, table: Table) -> Environment:
        """A new simulation with only the selected bodies, a scene that can be attached in its turn."""
        from ss2sql.vtables.pybullet.environment import Environment

        world = find_selected_world(self, table)
        return Environment(world, list_selected_bodies(world, "environment", table))

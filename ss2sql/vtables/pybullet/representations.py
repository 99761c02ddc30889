"""The representations of a simulation: `AS occupancygrid`, `AS sensorgrid` and `AS environment`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, ClassVar

from ss2sql.runtime.representations.base import Table, asks
from ss2sql.runtime.representations.grid import Grid
from ss2sql.vtables.pybullet.selected import bodies_in, world_of

if TYPE_CHECKING:
    from ss2sql.vtables.pybullet.environment import Environment


class Representations:
    """The representations of selected bodies; bodies of another simulation are read there."""

    representations: ClassVar[Mapping[str, str]] = {
        "occupancygrid": "occupancygrid", "sensorgrid": "sensorgrid", "sensormap": "sensorgrid",
        "environment": "environment",
    }  # fmt: skip

    @asks("elements")
    def occupancygrid(self, table: Table, z: Any, cell: Any, area: Any = None) -> Grid:
        """Where the selected bodies stand at the height `z`: a grid of bools, with cells of this edge.

        `area` is [[x, y], [x, y]]; without it the grid covers the scene. Lengths are in metres.
        """
        from ss2sql.vtables.pybullet.occupancy import occupancy

        return occupancy(world_of(self, table), table, z, cell, area)

    @asks("elements")
    def sensorgrid(self, table: Table, z: Any, cell: Any, area: Any = None) -> Grid:
        """How many of the selected sensors see each cell at the height `z`; with the arguments of occupancygrid."""
        from ss2sql.vtables.pybullet.coverage import coverage

        return coverage(world_of(self, table), table, z, cell, area)

    @asks("elements")
    def environment(self, table: Table) -> Environment:
        """A new simulation with only the selected bodies, a scene that can be attached in its turn."""
        from ss2sql.vtables.pybullet.environment import Environment

        world = world_of(self, table)
        return Environment(world, bodies_in(world, "environment", table))

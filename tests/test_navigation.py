"""Planning in the hall: paths that hold in the simulator, and the shortest way.

The floor is asked for collisions by PyBullet's own functions: the robot is put there, and every body is asked how near
it is.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from math import dist
from typing import Any

import pytest
from cases.functions import vector_add

import ss2sql

pytest.importorskip("pybullet")

from example_pages import EXAMPLES, play

from ss2sql.vtables.pybullet import PyBulletWorld

Spot = tuple[float, float]
DIRECTIONS: list[Spot] = [(0, 1), (0, -1), (1, -1), (-1, -1), (1, 0), (-1, 0), (-1, 1), (1, 1)]
START, TARGET = (4.0, 3.0), (10.0, 9.0)

MOVING = (EXAMPLES / "navigation" / "1_paths.ss").read_text("utf-8")  # the listing of the paper
BEST = (EXAMPLES / "navigation" / "2_best.ss").read_text("utf-8")


class Floor:
    """The hall, a world over it, and what the simulator itself says of places."""

    def __init__(self) -> None:
        self.hall = ss2sql.scenes.hall(seed=0)
        self.space = PyBulletWorld(self.hall)
        self.start = self.where()
        self._known: dict[Spot, bool] = {}

    def where(self) -> Any:
        return self.hall.client.getBasePositionAndOrientation(self.hall.robot)

    def home(self) -> None:
        self.hall.client.resetBasePositionAndOrientation(self.hall.robot, *self.start)

    def session(self) -> ss2sql.Session:
        """A session over the hall, with the robot at its start."""
        self.home()
        ss = ss2sql.connect()
        ss.attach("space", self.space)
        ss.function("add", vector_add)
        ss.function("playSound", lambda file: None, volatility="volatile")
        return ss

    def collides(self, spot: Spot) -> bool:
        """Whether the robot collides there, by PyBullet's own functions."""
        if spot not in self._known:
            client, robot = self.hall.client, self.hall.robot
            (_, _, z), turned = self.start
            client.resetBasePositionAndOrientation(robot, (*spot, z), turned)
            bodies = [client.getBodyUniqueId(place) for place in range(client.getNumBodies())]
            self._known[spot] = any(client.getClosestPoints(robot, body, 0.0) for body in bodies if body != robot)
            self.home()
        return self._known[spot]

    def check(self, paths: list[Any]) -> None:
        """1,000 different paths from start to target, shortest first, none with a collision."""
        assert len(paths) == len({tuple(map(tuple, path)) for path in paths}) == 1000
        assert [len(path) for path in paths] == sorted(len(path) for path in paths)
        for path in paths:
            spots = [(x, y) for x, y in path]
            assert spots[-1] == TARGET
            assert all((b[0] - a[0], b[1] - a[1]) in DIRECTIONS for a, b in pairwise([START, *spots]))
            assert not any(map(self.collides, spots))


@pytest.fixture(scope="module")
def floor() -> Iterator[Floor]:
    found = Floor()
    yield found
    found.hall.close()


@pytest.fixture(scope="module")
def paths(floor: Floor) -> list[Any]:
    """What the listing of the paper finds: a thousand paths, shortest first, none with a collision."""
    with floor.session() as ss:
        result = ss.run(MOVING)
    assert result.status == "maximum"
    floor.check(result.value)
    return result.value


def test_the_example_tells_what_it_asked_and_shows_a_picture(floor: Floor, paths: list[Any]) -> None:
    example = play("navigation")
    assert example.value("1_paths") == paths
    assert f"{example.result('1_paths').stats.calls['checkCollision']} calls of checkCollision" in example.text
    assert example.picture("navigation.png").read_bytes().startswith(b"\x89PNG")


def test_the_best_path_costs_what_networkx_says(floor: Floor, engine: Any) -> None:
    networkx = pytest.importorskip("networkx")
    spots = [(float(x), float(y)) for x in range(1, 16) for y in range(1, 12)]
    free = [spot for spot in spots if not floor.collides(spot)]
    ways = [(one, (one[0] + x, one[1] + y)) for one in free for x, y in DIRECTIONS]
    grid = networkx.Graph()
    grid.add_weighted_edges_from((one, other, dist(one, other)) for one, other in ways if other in free)
    for target in [TARGET, *(spot for spot in free[::9] if networkx.has_path(grid, START, spot) and spot != START)]:
        with floor.session() as ss:
            script = BEST.replace("[10.0, 9.0]", str(list(target)))
            result = ss.run(script, engine=engine)
        ((*path,),) = result.value
        assert (tuple(path[-1]), result.engine) == (target, engine)
        assert not any(floor.collides((x, y)) for x, y in path)
        cost = sum(dist(a, b) for a, b in pairwise([list(START), *path]))
        assert cost == pytest.approx(networkx.shortest_path_length(grid, START, target, weight="weight"), rel=1e-12)

"""Planning in the hall: paths that hold in the simulator, no question asked twice, and the shortest way.

The floor is asked for collisions by PyBullet's own functions: the robot is put there, and every body is asked how near
it is.
"""

from __future__ import annotations

from collections import Counter, deque
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


def replaced(script: str, *changes: tuple[str, str]) -> str:
    for old, new in changes:
        assert old in script
        script = script.replace(old, new)
    return script


# The same, with a test that moves nothing in the place of those that do.
PURE = replaced(
    MOVING,
    ("move(robot, this + cur_pos)", "this + cur_pos"),
    ("move(robot, cur_pos + this)", "cur_pos + this"),
    ("move(robot, this+cur_pos)", "this + cur_pos"),
    ("IF(checkCollision(robot);", "IF(collision(robot, this + cur_pos);"),
)


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

    def steps(self) -> Iterator[tuple[Spot, int, Spot, bool]]:
        """All (place, level, direction) that the search of the paper has to look at, and whether it asks there.

        Each place is gone on from once, from the level where it was reached first. A direction that leads back to a
        place that was reached before is known by its row, and not looked at. The start has been left, and not reached:
        it may come again.
        """
        reached: set[Spot] = set()
        waiting = deque([(START, 1)])
        while waiting:
            here, level = waiting.popleft()
            for x, y in DIRECTIONS:
                spot = here[0] + x, here[1] + y
                if spot in reached:
                    continue
                free = spot != TARGET and dist(spot, TARGET) <= 0.5 * (20 - level)
                yield here, level, (x, y), free
                if spot == TARGET:
                    reached.add(spot)
                elif free and not self.collides(spot):
                    reached.add(spot)
                    waiting.append((spot, level + 1))


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
    asked = [(x + dx, y + dy) for (x, y), _, (dx, dy), free in floor.steps() if free]
    assert example.result("1_paths").stats.calls["checkCollision"] == len(asked)
    assert f"the bell rang {sum(map(floor.collides, asked))} times" in example.text
    assert f"{len(asked)} calls of checkCollision" in example.text
    assert example.picture("navigation.png").read_bytes().startswith(b"\x89PNG")


def test_a_test_that_moves_nothing_asks_once_for_each_pose(floor: Floor, paths: list[Any]) -> None:
    asked: Counter[Spot] = Counter()
    with floor.session() as ss:

        @ss.function(volatility="stable")
        def collision(robot: str, spot: list[float]) -> bool:
            asked[spot[0], spot[1]] += 1
            return floor.space.collision(robot, spot)

        result = ss.run(PURE)
    assert floor.where() == floor.start
    assert result.value == paths
    assert set(asked.values()) == {1}
    assert set(asked) == {(x + dx, y + dy) for (x, y), _, (dx, dy), free in floor.steps() if free}
    assert asked.total() == result.stats.calls["collision"]


def test_the_best_path_costs_what_networkx_says(floor: Floor, engine: Any) -> None:
    networkx = pytest.importorskip("networkx")
    spots = [(float(x), float(y)) for x in range(1, 16) for y in range(1, 12)]
    free = [spot for spot in spots if not floor.collides(spot)]
    ways = [(one, (one[0] + x, one[1] + y)) for one in free for x, y in DIRECTIONS]
    grid = networkx.Graph()
    grid.add_weighted_edges_from((one, other, dist(one, other)) for one, other in ways if other in free)
    for target in [TARGET, *(spot for spot in free[::9] if networkx.has_path(grid, START, spot) and spot != START)]:
        with floor.session() as ss:
            script = replaced(BEST, ("[10.0, 9.0]", str(list(target))))
            result = ss.run(script, engine=engine)
        ((*path,),) = result.value
        assert (tuple(path[-1]), result.engine) == (target, engine)
        assert not any(floor.collides((x, y)) for x, y in path)
        cost = sum(dist(a, b) for a, b in pairwise([list(START), *path]))
        assert cost == pytest.approx(networkx.shortest_path_length(grid, START, target, weight="weight"), rel=1e-12)

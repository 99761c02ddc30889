"""The robot's ways through the hall: what remains of their search when the collision tests of PyBullet are taken away.

All tests are made before. What is measured asks a dictionary for them, and Python by hand does not even do that: its
graph of free places is ready-made too, so it only enumerates paths.
"""

from __future__ import annotations

from functools import lru_cache
from itertools import islice
from typing import Any

from problems.base import Problem, Script, Target, Work
from problems.memorize import STEPS, by_length, within

Place = tuple[float, float]
START, TARGET = (4.0, 3.0), (10.0, 9.0)
BOUND = 20


@lru_cache
def collisions() -> dict[Place, bool]:
    """Whether the robot collides, for all places that a search of so many steps asks about."""
    from ss2sql.scenes import hall
    from ss2sql.vtables.pybullet import PyBulletWorld

    space = PyBulletWorld(hall(seed=0))
    known: dict[Place, bool] = {}
    level = {START}
    for _ in range(BOUND):
        around = {after for place in level for after in reached(place)} - known.keys() - {TARGET}
        known.update((place, space.collision("YouBot", list(place))) for place in sorted(around))
        level = {place for place in around if not known[place]}
    return known


def reached(place: Place) -> list[Place]:
    return [(place[0] + x, place[1] + y) for x, y in STEPS]


def plus(place: list[float], step: list[float]) -> list[float]:
    return [place[0] + step[0], place[1] + step[1]]


def script(paths: int) -> Script:
    known = collisions()

    def collides(place: list[float]) -> bool:
        return known[place[0], place[1]]

    return Script(
        f"""SELECT plus(place, this) FROM steps WHERE target == plus(place, this)
            START WITH place = start
            CONNECT BY MEMORIZE {BOUND} MAXIMUM {paths} place = plus(place, this)
            STOP WITH  target == plus(place, this) OR collides(plus(place, this))
            AS list;""",
        (plus, (collides, "immutable")),
        {"steps": STEPS, "start": list(START), "target": list(TARGET)},
        shaped=False,
    )


def by_hand(paths: int) -> Work:
    known = collisions()
    graph: dict[Place, list[tuple[Place, Place, bool]]] = {}
    for place in (START, *(place for place, hit in known.items() if not hit)):
        ways = [after for after in reached(place) if after == TARGET or known.get(after) is False]
        graph[place] = [(after, after, after == TARGET) for after in ways]

    def nexts(place: Place) -> list[Any]:
        return graph.get(place, [])

    return Work(lambda: list(islice(within(nexts, START, BOUND), paths)))


PROBLEMS = (
    Problem(
        "worlds-navigation",
        f"paths through the hall within {BOUND} steps, all collision tests known, beside walks over the graph",
        "paths",
        (1_000,),
        20,
        script,
        {"python": by_hand},
        "the number of paths of each length",
        answer=by_length,
        targets=(Target(1.5, contender="native"),),
    ),
)

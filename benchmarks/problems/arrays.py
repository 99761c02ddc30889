"""A function that takes arrays, over the rows of a table: all of them, and those of one robot, which an index finds."""

from __future__ import annotations

import random
from collections.abc import Iterator
from math import hypot
from pathlib import Path
from typing import Any

from problems.base import Problem, Script, Work
from problems.tables import opened, table_file

OBSTACLES = [(random.Random(number).uniform(0, 10), random.Random(-number).uniform(0, 10)) for number in range(1, 31)]
ROBOTS = 100
LEAST = 1.0


def file_of(size: int) -> Path:
    chance = random.Random(size)

    def rows() -> Iterator[tuple[Any, ...]]:
        for number in range(size):
            yield number, chance.randrange(ROBOTS), chance.uniform(0, 10), chance.uniform(0, 10), f"place {number}"

    statements = (
        "CREATE TABLE places (id INTEGER PRIMARY KEY, robot INTEGER, x REAL, y REAL, remark TEXT)",
        "CREATE INDEX of_robot ON places (robot)",
    )
    return table_file(f"places_{size}", statements, "INSERT INTO places VALUES (?, ?, ?, ?, ?)", rows)


def clearance(x: Any, y: Any) -> Any:
    """The distance of each place to the nearest obstacle."""
    import numpy

    return numpy.min([numpy.hypot(x - left, y - up) for left, up in OBSTACLES], axis=0)


def in_a_loop(rows: list[tuple[int, float, float]]) -> list[tuple[int, float]]:
    found = []
    for number, x, y in rows:
        nearest = min([hypot(x - left, y - up) for left, up in OBSTACLES])
        if nearest > LEAST:
            found.append((number, nearest))
    return found


def in_numpy(rows: list[tuple[int, float, float]]) -> list[tuple[int, float]]:
    import numpy

    numbers, xs, ys = map(numpy.array, zip(*rows, strict=True))
    nearest = clearance(xs, ys)
    kept = nearest > LEAST
    return list(zip(numbers[kept].tolist(), nearest[kept].tolist(), strict=True))


def problem(name: str, about: str, condition: str, where: str) -> Problem:
    text = f"SELECT id, clearance(x, y) FROM places WHERE {condition}clearance(x, y) > {LEAST} AS rows;"

    def by_hand(work: Any) -> Any:
        def prepare(size: int) -> Work:
            connection = opened(file_of(size))
            return Work(lambda: work(connection.execute(f"SELECT id, x, y FROM places{where}").fetchall()))

        return prepare

    return Problem(
        f"arrays-{name}",
        f"a function that takes arrays: the distance to the nearest of 30 obstacles, {about}",
        "places",
        (100_000,),
        1_000,
        lambda size: Script(text, array_functions=(clearance,), file=file_of(size)),
        {"python": by_hand(in_a_loop), "numpy": by_hand(in_numpy)},
        "the rows in order, numbers to 6 decimals",
        lambda rows: [(number, round(nearest, 6)) for number, nearest in rows],
        full=(1_000_000,),
    )


PROBLEMS = (
    problem("all", "of all places", "", ""),
    problem("some", "of those of one robot", "robot == 7 AND ", " WHERE robot = 7 ORDER BY id"),
)

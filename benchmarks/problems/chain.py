"""A chain: one path whose only goal is at its end. The cost of a step must not grow with the length of its path."""

from __future__ import annotations

from functools import partial

from problems.base import Problem

LENGTHS = (10_000, 20_000)
OPTIONS = ("", "BREADTH FIRST", "UNIQUE")


def walk(length: int) -> list[int]:
    """The chain by hand: a path that grows, and a set of what was met."""
    path: list[int] = []
    met: set[int] = set()
    number = 1
    while True:
        if number in met:
            return []
        met.add(number)
        path.append(number)
        if number == length:
            return [len(path)]
        number += 1


PROBLEMS = tuple(
    Problem(
        f"chain of {length:,}, {option or 'no option'}",
        f"""SELECT n FROM [0] WHERE n == {length}
            START WITH n = 1 CONNECT BY {option} n = n + 1 STOP WITH n == {length};""",
        partial(walk, length),
    )
    for option in OPTIONS
    for length in LENGTHS
)

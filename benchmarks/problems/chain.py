"""A chain: one path whose only goal is at its end. The cost of a step must not grow with the length of its path."""

from __future__ import annotations

from collections.abc import Callable

from problems.base import Problem, Script, Work, bounds, lengths

OPTIONS = {"chain": "", "chain-breadth": "BREADTH FIRST", "chain-unique": "UNIQUE"}


def script(option: str) -> Callable[[int], Script]:
    return lambda length: Script(
        f"""SELECT n FROM [0] WHERE n == {length}
            START WITH n = 1 CONNECT BY {option} n = n + 1 STOP WITH n == {length} AS list;"""
    )


def by_hand(length: int) -> Work:
    """A path that grows, and a set of what was met."""

    def run() -> list[list[int]]:
        path: list[int] = []
        met: set[int] = set()
        number = 1
        while number not in met:
            met.add(number)
            path.append(number)
            if number == length:
                return [path]
            number += 1
        return []

    return Work(run)


PROBLEMS = tuple(
    Problem(
        name,
        f"one path without branches, {option or 'no option'}",
        "steps",
        (10_000, 20_000),
        50,
        script(option),
        {"python": by_hand},
        "the length of the path",
        lengths,
        full=(100_000,),
        targets=bounds(4.5, 4.0, since=20_000),
    )
    for name, option in OPTIONS.items()
)

"""Towers of Hanoi: every path of at most seven moves with three disks, and UNIQUE with eight disks."""

from __future__ import annotations

from collections import deque
from typing import Any

from problems.base import Problem

MOVES = [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]]


def move(step: list[int], towers: list[list[int]]) -> list[list[int]]:
    """The towers after a move, or [] where it is not allowed; changes its argument."""
    if not towers or not towers[step[0]]:
        pass
    elif not towers[step[1]] or towers[step[1]][-1] > towers[step[0]][-1]:
        towers[step[1]].append(towers[step[0]].pop())
        return towers
    return []


def moved(step: list[int], towers: list[list[int]]) -> list[list[int]]:
    return move(step, [tower[:] for tower in towers])


def every_path(disks: int, most: int) -> list[int]:
    """The lengths of all paths to the goal, depth first."""
    goal = [[], [], list(range(disks, 0, -1))]
    found: list[int] = []

    def go(towers: list[list[int]], level: int) -> None:
        for step in MOVES:
            after = moved(step, towers)
            if after == goal:
                found.append(level)
            if after and level < most:
                go(after, level + 1)

    go(goal[::-1], 1)
    return found


def unique(disks: int) -> list[int]:
    """The lengths of the paths to the goal, each row (a move, the towers before it) taken once, breadth first."""
    goal = [[], [], list(range(disks, 0, -1))]
    seen: set[Any] = set()
    queue = deque([(goal[::-1], 1)])
    found: list[int] = []
    while queue:
        towers, level = queue.popleft()
        before = tuple(map(tuple, towers))
        for number, step in enumerate(MOVES):
            if (number, before) in seen:
                continue
            seen.add((number, before))
            after = moved(step, towers)
            if after == goal:
                found.append(level)
            elif after:
                queue.append((after, level + 1))
    return found


PROBLEMS = (
    Problem(
        "hanoi, 3 disks, every path",
        """SELECT this FROM moves WHERE [[],[],[3,2,1]] == move(this, tower)
           START WITH tower = [[3,2,1],[],[]], level = 1
           CONNECT BY tower = move(this, tower), level = level + 1
           STOP WITH level == 7 OR [] == move(this, tower);""",
        lambda: every_path(3, 7),
        (move,),
        {"moves": MOVES},
    ),
    Problem(
        "hanoi, 8 disks, UNIQUE",
        """SELECT this, tower FROM moves WHERE goal == move(this, tower)
           START WITH tower = start
           CONNECT BY UNIQUE tower = move(this, tower)
           STOP WITH [] == move(this, tower) OR goal == move(this, tower);""",
        lambda: unique(8),
        (move,),
        {"moves": MOVES, "start": [[8, 7, 6, 5, 4, 3, 2, 1], [], []], "goal": [[], [], [8, 7, 6, 5, 4, 3, 2, 1]]},
    ),
)

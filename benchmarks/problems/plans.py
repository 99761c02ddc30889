"""Towers of Hanoi with three disks: every plan of at most so many moves, as the paper's listings ask for them."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import apsw

from problems.base import Prepare, Problem, Script, Work, bounds, same
from problems.hanoi import AFTER, ALLOWED, MOVES, NUMBERED, goal_of, move, start_of
from problems.levels import duck


def every_script(level: int) -> Script:
    return Script(
        f"""SELECT this FROM moves WHERE [[],[],[3,2,1]] == move(this, tower)
            START WITH tower = [[3,2,1],[],[]], level=1
            CONNECT BY tower = move(this, tower), level=level+1
            STOP WITH  level=={level} or []==move(this, tower);""",
        (move,),
        {"moves": MOVES},
    )


def every_by_hand(most: int) -> Work:
    goal = goal_of(3)

    def run() -> list[list[dict[str, Any]]]:
        found: list[list[dict[str, Any]]] = []
        path: list[dict[str, Any]] = []

        def go(towers: list[list[int]], level: int) -> None:
            for step in MOVES:
                after = move(step, [tower[:] for tower in towers])
                if after == goal:
                    found.append([*path, {"this": step}])
                if after and level < most:
                    path.append({"this": step})
                    go(after, level + 1)
                    path.pop()

        go(start_of(3), 1)
        return found

    return Work(run)


def no_cycle_script(level: int) -> Script:
    return Script(
        f"""SELECT this, tower FROM moves WHERE [[],[],[3,2,1]] == move(this, tower)
            START WITH tower = [[3,2,1],[],[]], level = 1
            CONNECT BY NO CYCLE
                       tower = move(this, tower), level = level+1
            STOP WITH  level == {level} or [] == move(this, tower);""",
        (move,),
        {"moves": MOVES},
    )


def no_cycle_by_hand(most: int) -> Work:
    goal = goal_of(3)

    def run() -> list[list[dict[str, Any]]]:
        found: list[list[dict[str, Any]]] = []
        path: list[dict[str, Any]] = []
        met: set[tuple[int, Any]] = set()

        def go(towers: list[list[int]], level: int) -> None:
            state = tuple(map(tuple, towers))
            for number, step in enumerate(MOVES):
                row = (number, state)
                if row in met:
                    continue
                after = move(step, [tower[:] for tower in towers])
                if after == goal:
                    found.append([*path, {"this": step, "tower": towers}])
                if after and level < most:
                    path.append({"this": step, "tower": towers})
                    met.add(row)
                    go(after, level + 1)
                    met.discard(row)
                    path.pop()

        go(start_of(3), 1)
        return found

    return Work(run)


# --- in SQL -----------------------------------------------------------------------------------------------------


def recursion(most: int, fresh: str, goal: str) -> str:
    """Every plan as a text: the digit of each move and the towers before it, so that texts sort depth first."""
    return f"""WITH RECURSIVE moves(n, a, b) AS (VALUES {NUMBERED}),
        search(s, path, depth) AS (
            SELECT 'aaa', '', 0
            UNION ALL
            SELECT {AFTER}, path || n || s, depth + 1
            FROM search CROSS JOIN moves
            WHERE depth < {most} AND {ALLOWED} AND {fresh}
        )
        SELECT path FROM search WHERE s = 'ccc' AND {goal} ORDER BY path"""


def steps_of(path: str) -> list[list[int]]:
    return [MOVES[int(path[place])] for place in range(0, len(path), 4)]


def towers_of(text: str) -> list[list[int]]:
    return [[disk for disk in (3, 2, 1) if text[disk - 1] == letter] for letter in "abc"]


def every_answer(rows: list[tuple[str]]) -> list[list[dict[str, Any]]]:
    return [[{"this": step} for step in steps_of(path)] for (path,) in rows]


def no_cycle_answer(rows: list[tuple[str]]) -> list[list[dict[str, Any]]]:
    return [
        [
            {"this": MOVES[int(path[place])], "tower": towers_of(path[place + 1 : place + 4])}
            for place in range(0, len(path), 4)
        ]
        for (path,) in rows
    ]


def sql_and_duckdb(
    answer: Callable[[Any], Any], fresh: str = "1 = 1", goal: Callable[[int], str] = lambda most: "1 = 1"
) -> dict[str, Prepare]:
    """Both contenders with the same text. Dead ends are cut where a move is not allowed, as by hand."""

    def in_sql(most: int) -> Work:
        connection, text = apsw.Connection(":memory:"), recursion(most, fresh, goal(most))
        return Work(lambda: connection.execute(text).fetchall(), answer)

    def in_duckdb(most: int) -> Work:
        connection, text = duck(), recursion(most, fresh, goal(most))
        return Work(lambda: connection.execute(text).fetchall(), answer)

    return {"sql": in_sql, "duckdb": in_duckdb}


PROBLEMS = (
    Problem(
        "hanoi-default",
        "3 disks, every plan of at most so many moves: the paper's listing, its `move` in Python",
        "moves",
        (7, 8, 9),
        7,
        every_script,
        {"python": every_by_hand, **sql_and_duckdb(every_answer)},
        "the plans, row by row, in order",
        same,
        full=(10, 11),
        targets=bounds(1.0, 0.4, since=9),
    ),
    Problem(
        "hanoi-nocycle",
        "3 disks, NO CYCLE: the paper's listing, its `move` in Python",
        "moves",
        (7, 8, 9),
        7,
        no_cycle_script,
        {
            "python": no_cycle_by_hand,
            **sql_and_duckdb(no_cycle_answer, "instr(path, n || s) = 0"),
        },
        "the plans, row by row, in order",
        same,
        full=(10, 11),
        targets=bounds(1.0, 0.65, since=9),
    ),
)

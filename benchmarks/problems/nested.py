"""The paper's first listing: every sequence of seven moves, nested calls of `move` in WHERE."""

from __future__ import annotations

from typing import Any

from problems.base import Problem, Script, Target, Work, same
from problems.hanoi import MOVES, goal_of, move, start_of
from problems.plans import sql_and_duckdb, steps_of


def script(moves: int) -> Script:
    numbers = range(1, moves + 1)
    call = "[[3,2,1],[],[]]"
    for number in numbers:
        call = f"move(m{number}.this, {call})"
    columns = ", ".join(f"m{number}.this" for number in numbers)
    sources = ", ".join(f"m{number}=moves" for number in numbers)
    text = f"SELECT {columns} FROM {sources} WHERE [[],[],[3,2,1]] == {call} AS list;"
    return Script(text, (move,), {"moves": MOVES})


def by_hand(moves: int) -> Work:
    """Loops one inside the other; each keeps the towers behind its own move."""
    goal = goal_of(3)

    def run() -> list[Any]:
        found: list[Any] = []
        chosen: list[Any] = []

        def loop(depth: int, towers: list[list[int]]) -> None:
            for step in MOVES:
                after = move(step, [tower[:] for tower in towers])
                if depth == moves:
                    if after == goal:
                        found.extend([*chosen, step])
                else:
                    chosen.append(step)
                    loop(depth + 1, after)
                    chosen.pop()

        loop(1, start_of(3))
        return found

    return Work(run)


def flat(rows: list[tuple[str]]) -> list[Any]:
    return [step for (path,) in rows for step in steps_of(path)]


PROBLEMS = (
    Problem(
        "nested-moves",
        "seven nested calls of `move` over seven sources: the paper's first listing",
        "moves",
        (5, 7),
        3,
        script,
        {"python": by_hand, **sql_and_duckdb(flat, goal=lambda moves: f"depth = {moves}")},
        "the rows, in order",
        same,
        targets=(Target(1.5),),
    ),
)

"""Towers of Hanoi: the shortest plan, as a search of 3^n states."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from itertools import product
from typing import Any

from problems.base import Problem, Script, Work, bounds, lengths
from problems.graphs import Graph, libraries
from problems.levels import duck, sql_levels

MOVES = [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]]


def move(step: list[int], towers: list[list[int]]) -> list[list[int]]:
    """The paper's: the towers after a move, or [] where it is not allowed; changes its argument."""
    if not towers or not towers[step[0]]:
        pass
    elif not towers[step[1]] or towers[step[1]][-1] > towers[step[0]][-1]:
        towers[step[1]].append(towers[step[0]].pop())
        return towers
    return []


def start_of(disks: int) -> list[list[int]]:
    return [list(range(disks, 0, -1)), [], []]


def goal_of(disks: int) -> list[list[int]]:
    return [[], [], list(range(disks, 0, -1))]


def unique_script(disks: int) -> Script:
    return Script(
        """SELECT move(this, tower) FROM moves WHERE goal == move(this, tower)
           START WITH tower = start
           CONNECT BY UNIQUE MAXIMUM 1 tower = move(this, tower)
           STOP WITH  [] == move(this, tower);""",
        (move,),
        {"moves": MOVES, "start": start_of(disks), "goal": goal_of(disks)},
    )


def unique_by_hand(disks: int) -> Work:
    goal = goal_of(disks)

    def run() -> list[list[dict[str, Any]]]:
        parents: dict[Any, tuple[Any, list[list[int]]]] = {}
        queue: deque[tuple[Any, list[list[int]]]] = deque([(None, start_of(disks))])
        while queue:
            key, towers = queue.popleft()
            for step in MOVES:
                after = move(step, [tower[:] for tower in towers])
                if not after:
                    continue
                state = tuple(map(tuple, after))
                if state in parents:
                    continue
                parents[state] = (key, after)
                if after == goal:
                    path = []
                    while state is not None:
                        state, towers = parents[state]
                        path.append({"move": towers})
                    return [path[::-1]]
                queue.append((state, after))
        return []

    return Work(run)


# In SQL the towers are a text: one letter per disk, the smallest first, that names its tower.
ALLOWED = "instr(s, a) > 0 AND (instr(s, b) = 0 OR instr(s, b) > instr(s, a))"
AFTER = "substr(s, 1, instr(s, a) - 1) || b || substr(s, instr(s, a) + 1)"
NUMBERED = "(0, 'a', 'b'), (1, 'a', 'c'), (2, 'b', 'a'), (3, 'b', 'c'), (4, 'c', 'a'), (5, 'c', 'b')"
LETTERS = "('a', 'b'), ('a', 'c'), ('b', 'a'), ('b', 'c'), ('c', 'a'), ('c', 'b')"


def unique_in_sql(disks: int) -> Work:
    return sql_levels(
        f"CREATE TABLE moves (a TEXT, b TEXT); INSERT INTO moves VALUES {LETTERS}",
        "s",
        ("a" * disks,),
        f"SELECT {AFTER} FROM seen CROSS JOIN moves WHERE seen.rowid > :last AND {ALLOWED}",
        f"s = '{'c' * disks}'",
    )


def unique_in_duckdb(disks: int) -> Work:
    connection, goal = duck(), "c" * disks
    text = f"""WITH RECURSIVE moves(a, b) AS (VALUES {LETTERS}),
        seen(s, depth) USING KEY (s) AS (
            SELECT ?::TEXT, 0
            UNION
            SELECT next.s, next.depth
            FROM (SELECT DISTINCT {AFTER} AS s, depth + 1 AS depth FROM seen, moves WHERE {ALLOWED}) AS next
            LEFT JOIN recurring.seen AS old ON old.s = next.s
            WHERE old.s IS NULL
        )
        SELECT depth FROM seen WHERE s = ?"""
    return Work(lambda: connection.execute(text, ("a" * disks, goal)).fetchone(), list)


def graph_of(disks: int) -> Callable[[], Graph]:
    """Towers as numbers in base 3, the place of the largest disk first."""

    def make() -> Graph:
        edges = []
        weights = [3**disk for disk in range(disks)]
        for number, pegs in enumerate(product(range(3), repeat=disks)):
            free = {0, 1, 2}  # towers on which no smaller disk lies
            for peg, weight in zip(reversed(pegs), weights, strict=True):
                if peg in free:
                    free.discard(peg)
                    edges += [(number, number + (other - peg) * weight) for other in free]
                if not free:
                    break
        return Graph(3**disks, edges, 0, 3**disks - 1)

    return make


def moves_of(path: Sequence[int], size: int) -> list[int]:
    return [len(path) - 1]


PROBLEMS = (
    Problem(
        "hanoi-unique",
        "the shortest plan, UNIQUE over the next towers, `move` in Python",
        "disks",
        (4, 6, 8),
        3,
        unique_script,
        {
            "python": unique_by_hand,
            "sql": unique_in_sql,
            "duckdb-key": unique_in_duckdb,
            **libraries(graph_of, moves_of),
        },
        "the number of moves",
        lengths,
        full=(9, 10),
        targets=bounds(2.2, 1.2, since=8),
    ),
)

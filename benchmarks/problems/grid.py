"""The cheapest path over a grid with obstacles, eight directions, a quarter of the cells blocked.

The same search in the ways that a user may write it: by what a step looks up (an index into a list of lists, a list of
free cells, a table of cells, a Python function) and by how the list of moves is written (dicts or lists).
"""

from __future__ import annotations

import random
from collections.abc import Callable, Iterable, Sequence
from functools import lru_cache
from heapq import heappop, heappush
from itertools import pairwise
from math import sqrt
from pathlib import Path
from typing import Any

import apsw

from problems.base import Prepare, Problem, Script, Work, bounds
from problems.graphs import Graph, libraries
from problems.levels import duck
from problems.tables import opened, table_file

STEPS = [(1, 0), (-1, 0), (0, 1), (0, -1), (1, 1), (1, -1), (-1, 1), (-1, -1)]
MOVES = [{"dx": dx, "dy": dy, "cost": 1.0 if 0 in (dx, dy) else sqrt(2)} for dx, dy in STEPS]
MOVE_LISTS = [list(move.values()) for move in MOVES]


@lru_cache
def grid_of(size: int) -> list[list[int]]:
    """Rows of 0, free, and 1, blocked, in a frame of blocked cells; two opposite corners are free and connected."""
    for seed in range(100):
        chance = random.Random(seed)
        inner = [[1, *(int(chance.random() < 0.25) for _ in range(size)), 1] for _ in range(size)]
        frame = [1] * (size + 2)
        grid = [frame, *inner, frame[:]]
        grid[1][1] = grid[size][size] = 0
        if cheapest(grid, size, False) is not None:
            return grid
    raise AssertionError("no grid has a way")


def free_cells(size: int) -> list[list[int]]:
    return [[x, y] for y, row in enumerate(grid_of(size)) for x, cell in enumerate(row) if not cell]


def is_free_in(grid: list[list[int]]) -> Callable[[int, int], bool]:
    def is_free(x: int, y: int) -> bool:
        return grid[y][x] == 0

    return is_free


def file_of(size: int) -> Path:
    create = ("CREATE TABLE cells (px INTEGER, py INTEGER, PRIMARY KEY (px, py)) WITHOUT ROWID",)
    return table_file(f"cells_{size}", create, "INSERT INTO cells VALUES (?, ?)", lambda: map(tuple, free_cells(size)))


# --- by hand ----------------------------------------------------------------------------------------------------


def cheapest(
    grid: list[list[int]], size: int, astar: bool, is_free: Callable[[int, int], bool] | None = None
) -> tuple[float, list[tuple[int, int]]] | None:
    """The way with the least cost by Dijkstra's algorithm, or A* with the distance as the crow flies."""
    moves = [(dx, dy, cost) for dx, dy, cost in MOVE_LISTS]
    best = {(1, 1): 0.0}
    parents: dict[tuple[int, int], tuple[int, int]] = {}
    queue: list[tuple[float, int, float, tuple[int, int]]] = [(0.0, 0, 0.0, (1, 1))]
    goal = (size, size)
    number = 0
    while queue:
        _, _, spent, place = heappop(queue)
        if spent > best[place]:
            continue
        if place == goal:
            path = [place]
            while path[-1] in parents:
                path.append(parents[path[-1]])
            return spent, path[-2::-1]
        x, y = place
        for dx, dy, cost in moves:
            px, py = x + dx, y + dy
            if grid[py][px] if is_free is None else not is_free(px, py):
                continue
            total = spent + cost
            after = (px, py)
            known = best.get(after)
            if known is None or total < known:
                best[after] = total
                parents[after] = place
                number += 1
                ahead = sqrt((size - px) ** 2 + (size - py) ** 2) if astar else 0.0
                heappush(queue, (total + ahead, number, total, after))
    return None


def grid_from(cells: Iterable[Sequence[int]], size: int) -> list[list[int]]:
    """Looking a cell up is cheapest in lists of lists."""
    grid = [[1] * (size + 2) for _ in range(size + 2)]
    for x, y in cells:
        grid[y][x] = 0
    return grid


def by_hand(astar: bool, form: str) -> Prepare:
    """Over what the script of this form gets: the grid, a list or a table of free cells, or the function."""

    def prepare(size: int) -> Work:
        grid = grid_of(size)
        if form == "-function":
            is_free = is_free_in(grid)
            return Work(lambda: cheapest(grid, size, astar, is_free), found_cost)
        if form == "-in":
            free = free_cells(size)
            return Work(lambda: cheapest(grid_from(free, size), size, astar), found_cost)
        if form == "-table":
            connection = opened(file_of(size))
            cells = "SELECT px, py FROM cells"
            return Work(lambda: cheapest(grid_from(connection.execute(cells), size), size, astar), found_cost)
        return Work(lambda: cheapest(grid, size, astar), found_cost)

    return prepare


def found_cost(found: tuple[float, Any]) -> list[float]:
    return [round(found[0], 6)]


# --- by graph libraries and in SQL ------------------------------------------------------------------------------


def graph_of(size: int) -> Callable[[], Graph]:
    grid, width = grid_of(size), size + 2

    def make() -> Graph:
        edges = [
            (y * width + x, (y + dy) * width + x + dx, cost)
            for y, row in enumerate(grid)
            for x, blocked in enumerate(row)
            if not blocked
            for dx, dy, cost in MOVE_LISTS
            if not grid[y + dy][x + dx]
        ]
        return Graph(width * width, edges, width + 1, size * width + size, weighted=True)

    return make


def crow_flies(size: int) -> Callable[[int, int], float]:
    width = size + 2

    def bound(node: int, goal: int) -> float:
        return sqrt((goal % width - node % width) ** 2 + (goal // width - node // width) ** 2)

    return bound


def nodes_cost(path: Sequence[int], size: int) -> list[float]:
    return cost_of([[part for node in path[1:] for part in (node % (size + 2), node // (size + 2))]])


MOVE_ROWS = ", ".join(str(tuple(move)) for move in MOVE_LISTS)


def in_sql(size: int) -> Work:
    """One INSERT per round: every cell that became cheaper in the last one offers its cost to its neighbours.

    A queue in order of cost is what WITH RECURSIVE has, but without a function it cannot drop a cell that was reached
    at less cost before.
    """
    connection = apsw.Connection(":memory:")
    connection.execute(
        "CREATE TABLE cells (x INTEGER, y INTEGER, PRIMARY KEY (x, y)) WITHOUT ROWID;"
        f"CREATE TABLE moves (dx, dy, cost); INSERT INTO moves VALUES {MOVE_ROWS}"
    )
    connection.executemany("INSERT INTO cells VALUES (?, ?)", free_cells(size))
    offer = f"""INSERT INTO best
        SELECT cells.x, cells.y, min(best.cost + moves.cost) AS offered, :round + 1
        FROM best CROSS JOIN moves
        CROSS JOIN cells ON cells.x = best.x + moves.dx AND cells.y = best.y + moves.dy
        WHERE best.round = :round AND best.cost < (SELECT cost FROM best WHERE x = {size} AND y = {size})
        GROUP BY cells.x, cells.y
        ON CONFLICT (x, y) DO UPDATE SET cost = excluded.cost, round = excluded.round WHERE excluded.cost < best.cost"""

    def run() -> list[float]:
        connection.execute(
            "DROP TABLE IF EXISTS best;"
            "CREATE TABLE best (x INTEGER, y INTEGER, cost REAL, round INTEGER, PRIMARY KEY (x, y)) WITHOUT ROWID;"
            "CREATE INDEX best_round ON best (round);"
            f"INSERT INTO best VALUES (1, 1, 0.0, 0), ({size}, {size}, 9e9, -1)"
        )
        number = 0
        while connection.execute("SELECT 1 FROM best WHERE round = ? LIMIT 1", (number,)).fetchall():
            connection.execute(offer, {"round": number})
            number += 1
        return [row[0] for row in connection.execute("SELECT cost FROM best WHERE x = ? AND y = ?", (size, size))]

    return Work(run, lambda costs: [round(cost, 6) for cost in costs])


def in_duckdb(size: int) -> Work:
    connection = duck()
    connection.execute(f"CREATE TABLE moves AS SELECT * FROM (VALUES {MOVE_ROWS}) AS m(dx, dy, cost)")
    columns = [list(column) for column in zip(*free_cells(size), strict=True)]
    connection.execute("CREATE TABLE cells AS SELECT unnest(?) AS x, unnest(?) AS y", columns)
    text = f"""WITH RECURSIVE best(x, y, cost) USING KEY (x, y) AS (
            SELECT 1, 1, 0.0::DOUBLE
            UNION
            SELECT next.x, next.y, next.cost
            FROM (SELECT cells.x, cells.y, min(best.cost + moves.cost) AS cost
                  FROM best CROSS JOIN moves JOIN cells ON cells.x = best.x + moves.dx AND cells.y = best.y + moves.dy
                  GROUP BY cells.x, cells.y) AS next
            LEFT JOIN recurring.best AS old ON old.x = next.x AND old.y = next.y
            WHERE old.x IS NULL OR next.cost < old.cost
        )
        SELECT cost FROM best WHERE x = {size} AND y = {size}"""
    return Work(lambda: connection.execute(text).fetchall(), lambda rows: [round(row[0], 6) for row in rows])


# --- the scripts ------------------------------------------------------------------------------------------------

HEURISTIC = "HEURISTIC sqrt((goal - ({x})) ^ 2 + (goal - ({y})) ^ 2)"


def search(moves: str, x: str, y: str, cost: str, astar: bool, condition: str) -> str:
    heuristic = HEURISTIC.format(x=x, y=y) if astar else ""
    return f"""SELECT to({x}, px), to({y}, py) FROM {moves}
        WHERE  {x} == goal AND {y} == goal
        START WITH x = 1, y = 1
        CONNECT BY COST {cost} {heuristic} UNIQUE MAXIMUM 1 x = {x}, y = {y}
        {condition}
        AS list;"""


def with_index(astar: bool) -> Callable[[int], Script]:
    """`grid[y + dy][x + dx]`, moves as dicts."""
    text = search("moves", "x + dx", "y + dy", "cost", astar, "STOP WITH grid[y + dy][x + dx] == 1")
    return lambda size: Script(text, (), {"moves": MOVES, "grid": grid_of(size), "goal": size})


def with_lists(astar: bool) -> Callable[[int], Script]:
    """`grid[y + this[1], x + this[0]]`, moves as lists."""
    text = search("moves", "x + this[0]", "y + this[1]", "this[2]", astar, "STOP WITH grid[y + this[1], x + this[0]]")
    return lambda size: Script(text, (), {"moves": MOVE_LISTS, "grid": grid_of(size), "goal": size})


def with_in(astar: bool) -> Callable[[int], Script]:
    """`[x + dx, y + dy] IN free`."""
    text = search("moves", "x + dx", "y + dy", "cost", astar, "STOP WITH [x + dx, y + dy] NOT IN free")

    return lambda size: Script(text, (), {"moves": MOVES, "free": free_cells(size), "goal": size})


def with_table(astar: bool) -> Callable[[int], Script]:
    """A table of the free cells, joined by the place behind a step."""
    source = "moves, (SELECT * FROM cells WHERE px == x + dx AND py == y + dy)"
    text = search(source, "px", "py", "cost", astar, "").replace("to(px, px), to(py, py)", "px, py")

    return lambda size: Script(text, (), {"moves": MOVES, "goal": size}, file_of(size))


def with_function(astar: bool) -> Callable[[int], Script]:
    """A Python function tells whether a cell is free."""
    text = search("moves", "x + dx", "y + dy", "cost", astar, "STOP WITH NOT is_free(x + dx, y + dy)")
    return lambda size: Script(text, ((is_free_in(grid_of(size)), "immutable"),), {"moves": MOVES, "goal": size})


def cost_of(paths: list[list[int]]) -> list[float]:
    """The cost of every path: cells as a flat list, from the corner (1, 1)."""
    costs = []
    for path in paths:
        cells = [(1, 1), *zip(path[::2], path[1::2], strict=True)]
        costs.append(sum(sqrt(abs(b[0] - a[0]) + abs(b[1] - a[1])) for a, b in pairwise(cells)))
    return [round(cost, 6) for cost in costs]


FORMS = {
    "": (with_index, "`grid[y + dy][x + dx]`"),
    "-lists": (with_lists, "`grid[y + this[1], x + this[0]]`, moves as lists"),
    "-in": (with_in, "`[x + dx, y + dy] IN free`"),
    "-table": (with_table, "a table of cells, joined"),
    "-function": (with_function, "`is_free(x + dx, y + dy)`, a Python function"),
}


def others(astar: bool, form: str) -> dict[str, Prepare]:
    """The other means stand beside the first form only: they know no forms."""
    found = {"python": by_hand(astar, form)}
    if form == "":
        found |= libraries(graph_of, nodes_cost, crow_flies if astar else None)
        if not astar:
            found |= {"sql": in_sql, "duckdb-key": in_duckdb}
    return found


PROBLEMS = tuple(
    Problem(
        f"grid-{'astar' if astar else 'cost'}{form}",
        f"the cheapest path over a grid, {'COST HEURISTIC UNIQUE' if astar else 'COST UNIQUE'}; {about}",
        "cells a side",
        (30, 100, 300) if form == "" else (30, 300),
        8,
        script(astar),
        others(astar, form),
        "the cost of the path, to 6 decimals",
        cost_of,
        full=(600,),
        targets=bounds(2.2, 1.6, 300) if form == "-function" else bounds(1.3, 1.25, 300),
    )
    for astar in (False, True)
    for form, (script, about) in FORMS.items()
)

"""The 8-puzzle: from a board that is so many slides away to the ordered one."""

from __future__ import annotations

from collections import deque
from functools import lru_cache

from problems.base import Problem, Script, Work, bounds, lengths
from problems.levels import duck, sql_levels

GOAL = [1, 2, 3, 4, 5, 6, 7, 8, 0]
Key = tuple[int, ...]
SLIDES = [-3, 3, -1, 1]  # where the tile comes from, seen from the empty place


def slide(step: int, board: list[int]) -> list[int]:
    """The board after a slide, or [] where there is no such tile; changes its argument."""
    empty = board.index(0)
    tile = empty + step
    if tile < 0 or tile > 8 or (step in (-1, 1) and tile // 3 != empty // 3):
        return []
    board[empty] = board[tile]
    board[tile] = 0
    return board


@lru_cache
def start_of(distance: int) -> list[int]:
    """The first board that a search from the ordered one finds at this distance."""
    seen = {tuple(GOAL)}
    level = [GOAL]
    for _ in range(distance):
        following = []
        for board in level:
            for step in SLIDES:
                after = slide(step, board[:])
                if after and tuple(after) not in seen:
                    seen.add(tuple(after))
                    following.append(after)
        level = following
    return level[0]


def script(distance: int) -> Script:
    return Script(
        """SELECT slide(this, board) FROM slides WHERE goal == slide(this, board)
           START WITH board = start
           CONNECT BY UNIQUE MAXIMUM 1 board = slide(this, board)
           STOP WITH  [] == slide(this, board)
           AS list;""",
        (slide,),
        {"slides": SLIDES, "start": start_of(distance), "goal": GOAL},
    )


def path_to(board: list[int], before: Key | None, parents: dict[Key, Key | None]) -> list[list[int]]:
    """The boards up to this one."""
    path = [board]
    while before is not None:
        path.append(list(before))
        before = parents[before]
    return path[::-1]


def by_hand(distance: int) -> Work:
    start = start_of(distance)

    def run() -> list[list[list[int]]]:
        parents: dict[Key, Key | None] = {}
        queue: deque[tuple[Key | None, list[int]]] = deque([(None, start)])
        while queue:
            key, board = queue.popleft()
            for step in SLIDES:
                after = slide(step, board[:])
                if not after:
                    continue
                state = tuple(after)
                if state in parents:
                    continue
                parents[state] = key
                if after == GOAL:
                    return [path_to(after, key, parents)]
                queue.append((state, after))
        return []

    return Work(run)


def after(board: list[int]) -> list[list[int]]:
    """The boards after one slide."""
    return [made for step in SLIDES if (made := slide(step, board[:]))]


def successors_script(distance: int) -> Script:
    return Script(
        """SELECT this FROM after(board) WHERE this == goal
           START WITH board = start CONNECT BY UNIQUE MAXIMUM 1 board = this
           AS list;""",
        ((after, "immutable"),),
        {"start": start_of(distance), "goal": GOAL},
    )


def successors_by_hand(distance: int) -> Work:
    start = start_of(distance)

    def run() -> list[list[list[int]]]:
        parents: dict[Key, Key | None] = {}
        queue: deque[tuple[Key | None, list[int]]] = deque([(None, start)])
        while queue:
            key, board = queue.popleft()
            for following in after(board):
                state = tuple(following)
                if state in parents:
                    continue
                parents[state] = key
                if following == GOAL:
                    return [path_to(following, key, parents)]
                queue.append((state, following))
        return []

    return Work(run)


# In SQL a board is a text of nine digits; `slides` holds the places, from 1, between which a tile can slide.
PLACES = ", ".join(
    f"({empty + 1}, {empty + step + 1})"
    for empty in range(9)
    for step in SLIDES
    if slide(step, [1] * empty + [0] + [1] * (8 - empty))
)
TILE = "substr(s, tile, 1)"
AFTER = f"replace(replace(replace(s, '0', 'x'), {TILE}, '0'), 'x', {TILE})"
TEXT = "".join(map(str, GOAL))


def in_sql(distance: int) -> Work:
    return sql_levels(
        f"CREATE TABLE slides (empty INTEGER, tile INTEGER); INSERT INTO slides VALUES {PLACES};"
        "CREATE INDEX slides_empty ON slides (empty, tile)",
        "s",
        ("".join(map(str, start_of(distance))),),
        f"""SELECT {AFTER} FROM seen CROSS JOIN slides WHERE seen.rowid > :last AND slides.empty = instr(s, '0')""",
        f"s = '{TEXT}'",
    )


def in_duckdb(distance: int) -> Work:
    connection, start = duck(), "".join(map(str, start_of(distance)))
    text = f"""WITH RECURSIVE slides(empty, tile) AS (VALUES {PLACES}),
        seen(s, depth) USING KEY (s) AS (
            SELECT ?::TEXT, 0
            UNION
            SELECT next.s, next.depth
            FROM (SELECT DISTINCT {AFTER} AS s, depth + 1 AS depth
                  FROM seen JOIN slides ON empty = instr(s, '0')) AS next
            LEFT JOIN recurring.seen AS old ON old.s = next.s
            WHERE old.s IS NULL AND next.depth <= ?
        )
        SELECT depth FROM seen WHERE s = ?"""
    return Work(lambda: connection.execute(text, (start, distance, TEXT)).fetchone(), list)


PROBLEMS = (
    Problem(
        "puzzle-successors",
        "the 8-puzzle, UNIQUE over the boards that a function of the board lists",
        "slides",
        (20,),
        4,
        successors_script,
        {"python": successors_by_hand, "sql": in_sql, "duckdb-key": in_duckdb},
        "the number of slides",
        lengths,
        full=(24, 31),
    ),
    Problem(
        "puzzle",
        "the 8-puzzle, UNIQUE over the next board, `slide` in Python",
        "slides",
        (8, 14, 20),
        4,
        script,
        {"python": by_hand, "sql": in_sql, "duckdb-key": in_duckdb},
        "the number of slides",
        lengths,
        full=(24, 31),
        targets=bounds(4.5, 1.25, since=20),
    ),
)

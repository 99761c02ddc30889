"""Two water jugs that hold n - 1 and n: fill, empty and pour until one holds half of n. Everything is in the script."""

from __future__ import annotations

from collections import deque

from problems.base import Problem, Script, Work, bounds, lengths
from problems.levels import duck, sql_levels


def script(size: int) -> Script:
    return Script(
        """SELECT this
           FROM  [[A, b], [a, B], [0, b], [a, 0],
                  [max([0, a + b - B]), min([B, a + b])], [min([A, a + b]), max([0, a + b - A])]]
           WHERE this[0] == want OR this[1] == want
           START WITH a = 0, b = 0
           CONNECT BY UNIQUE MAXIMUM 1 a = this[0], b = this[1]
           AS list;""",
        (),
        {"A": size - 1, "B": size, "want": size // 2},
    )


def by_hand(size: int) -> Work:
    left, right, want = size - 1, size, size // 2

    def run() -> list[list[list[int]]]:
        parents: dict[tuple[int, int], tuple[int, int] | None] = {}
        queue: deque[tuple[int, int] | None] = deque([None])
        while queue:
            before = queue.popleft()
            a, b = before or (0, 0)
            for after in (
                (left, b),
                (a, right),
                (0, b),
                (a, 0),
                (max(0, a + b - right), min(right, a + b)),
                (min(left, a + b), max(0, a + b - left)),
            ):
                if after in parents:
                    continue
                parents[after] = before
                if want in after:
                    path = []
                    place: tuple[int, int] | None = after
                    while place is not None:
                        path.append(list(place))
                        place = parents[place]
                    return [path[::-1]]
                queue.append(after)
        return []

    return Work(run)


def following(size: int, table: str, condition: str, greatest: str, least: str) -> str:
    """The six ways on from a pair, as SELECTs."""
    left, right = size - 1, size
    ways = (
        f"{left}, b",
        f"a, {right}",
        "0, b",
        "a, 0",
        f"{greatest}(0, a + b - {right}), {least}({right}, a + b)",
        f"{least}({left}, a + b), {greatest}(0, a + b - {left})",
    )
    return " UNION ALL ".join(f"SELECT {way} FROM {table} WHERE {condition}" for way in ways)


def in_sql(size: int) -> Work:
    ways = following(size, "seen", "rowid > :last", "max", "min")
    want = size // 2
    return sql_levels("", "a, b", (0, 0), ways, f"({want} IN (a, b))")


def in_duckdb(size: int) -> Work:
    connection, want = duck(), size // 2
    ways = following(size, "seen", "true", "greatest", "least").replace(" FROM seen", ", depth + 1 FROM seen")
    text = f"""WITH RECURSIVE seen(a, b, depth) USING KEY (a, b) AS (
            SELECT 0, 0, 0
            UNION
            SELECT DISTINCT next.a, next.b, next.depth
            FROM ({ways}) AS next(a, b, depth)
            LEFT JOIN recurring.seen AS old ON old.a = next.a AND old.b = next.b
            WHERE old.a IS NULL
        )
        SELECT min(depth) FROM seen WHERE {want} IN (a, b)"""
    return Work(lambda: connection.execute(text).fetchone(), list)


PROBLEMS = (
    Problem(
        "jugs",
        "two water jugs, the next states as a list that mentions the state, nothing in Python",
        "litres",
        (5, 101, 1001),
        5,
        script,
        {"python": by_hand, "sql": in_sql, "duckdb-key": in_duckdb},
        "the number of steps",
        lengths,
        full=(10_001,),
        targets=bounds(1.6, 1.25, since=1001),
    ),
)

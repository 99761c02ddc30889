"""The 8-puzzle in DuckDB: a script beside the query that one would write by hand, seconds of the processor.

    python benchmarks/by_hand.py [--times 8] [--threads 1]

Both visit all 181,440 boards that can be reached. The query by hand, with `USING KEY`, keeps neither parents nor goals;
the script could give a path. They take turns; of each the least counts. The script is compiled once, as a program
would do that asks again.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import duckdb

import ss2sql

BOARDS = 181_440
START = "123456780"
MOVED = "board[0:s.lo] + board[s.hi:s.hi + 1] + board[s.lo + 1:s.hi] + board[s.lo:s.lo + 1] + board[s.hi + 1:9]"
SCRIPT = f"""
    SELECT {MOVED} FROM s = swaps WHERE board == "none of them" START WITH board = "{START}"
    CONNECT BY UNIQUE board = {MOVED} STOP WITH board[s.z:s.z + 1] != "0" AS list
"""
BY_HAND = f"""
    WITH RECURSIVE reached(board) USING KEY (board) AS (
      SELECT '{START}'
      UNION
      SELECT moved.board
      FROM (
        SELECT
          substring(board, 1, lo) || substring(board, hi + 1, 1) || substring(board, lo + 2, hi - lo - 1)
            || substring(board, lo + 1, 1) || substring(board, hi + 2) AS board
        FROM reached
        JOIN swaps ON substring(board, z + 1, 1) = '0'
      ) AS moved
      LEFT JOIN recurring.reached AS known ON known.board = moved.board
      WHERE known.board IS NULL
    )
    SELECT count(*) FROM reached
"""


def swaps() -> list[dict[str, int]]:
    """Where the gap can go from each place: `z` is its place, `lo` and `hi` the two that change."""
    near = (
        (z, z + d)
        for z in range(9)
        for d in (-1, 1, -3, 3)
        if 0 <= z + d < 9 and (abs(d) == 3 or z // 3 == (z + d) // 3)
    )
    return [{"z": z, "lo": min(z, t), "hi": max(z, t)} for z, t in near]


def by_hand(threads: int) -> Callable[[], int]:
    """What runs the query, and gives the number of boards."""
    connection = duckdb.connect(config={"threads": threads})
    connection.execute("CREATE TABLE swaps(z BIGINT, lo BIGINT, hi BIGINT)")
    connection.executemany("INSERT INTO swaps VALUES (?, ?, ?)", [list(swap.values()) for swap in swaps()])
    return lambda: int(connection.execute(BY_HAND).fetchall()[0][0])


def by_script(threads: int) -> Callable[[], int]:
    """What runs the script, and gives the number of boards."""
    ss = ss2sql.connect(engine="duckdb", session=duckdb.connect(config={"threads": threads}))
    ss.set("swaps", swaps())
    script = ss.compile(SCRIPT)

    def run() -> int:
        found = script.run()
        assert found.value == []
        return sum(level.rows for level in found.stats.levels)

    return run


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=8)
    parser.add_argument("--threads", type=int, default=1)
    given = parser.parse_args()
    runners = {"by hand": by_hand(given.threads), "script": by_script(given.threads)}
    least = dict.fromkeys(runners, float("inf"))
    for _ in range(given.times):
        for name, run in runners.items():
            before = time.process_time()
            boards = run()
            least[name] = min(least[name], time.process_time() - before)
            assert boards == BOARDS, f"{name}: {boards:,} boards"
    for name, seconds in least.items():
        print(f"{name}: {seconds:.3f} s")
    print(f"script / by hand: {least['script'] / least['by hand']:.2f}")


if __name__ == "__main__":
    main()

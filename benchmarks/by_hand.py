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
from boards import BOARDS, SLIDES, START, script

import ss2sql

BY_HAND = f"""
    WITH RECURSIVE reached(board) USING KEY (board) AS (
      SELECT '{START}'
      UNION
      SELECT moved.board
      FROM (
        SELECT
          substring(board, 1, low) || substring(board, high + 1, 1) || substring(board, low + 2, high - low - 1)
            || substring(board, low + 1, 1) || substring(board, high + 2) AS board
        FROM reached
        JOIN slides ON substring(board, "at" + 1, 1) = '0'
      ) AS moved
      LEFT JOIN recurring.reached AS known ON known.board = moved.board
      WHERE known.board IS NULL
    )
    SELECT count(*) FROM reached
"""


def by_hand(threads: int) -> Callable[[], int]:
    """What runs the query, and gives the number of boards."""
    connection = duckdb.connect(config={"threads": threads})
    connection.execute('CREATE TABLE slides("at" BIGINT, low BIGINT, high BIGINT)')
    connection.executemany("INSERT INTO slides VALUES (?, ?, ?)", [list(slide.values()) for slide in SLIDES])
    return lambda: int(connection.execute(BY_HAND).fetchall()[0][0])


def by_script(threads: int) -> Callable[[], int]:
    """What runs the script, and gives the number of boards."""
    ss = ss2sql.connect(engine="duckdb", session=duckdb.connect(config={"threads": threads}))
    ss.set("slides", SLIDES)
    search = ss.compile(script())

    def run() -> int:
        found = search.run()
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

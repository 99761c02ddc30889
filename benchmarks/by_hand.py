"""Searches in DuckDB: a script beside the query that one would write by hand, seconds of the processor.

    python benchmarks/by_hand.py [--times 8] [--threads 1] [--edges 1000000]

Both visit all 181,440 boards of the 8-puzzle, or all nodes that the edges of a table lead to. The query by hand, with
`USING KEY`, keeps neither parents nor goals; the script could give a path. They take turns; of each the least counts.
The script is compiled once, as a program would do that asks again.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import duckdb
import pyarrow as pa
from boards import BOARDS, SLIDES, START, script
from problems.reach import edges_of

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
REACH_BY_HAND = """
    WITH RECURSIVE reached(node) USING KEY (node) AS (
      SELECT 0
      UNION
      SELECT edges.dst
      FROM reached
      JOIN edges ON edges.src = reached.node
      LEFT JOIN recurring.reached AS known ON known.node = edges.dst
      WHERE known.node IS NULL
    )
    SELECT count(*) FROM reached
"""
REACH = """
    SELECT dst FROM (SELECT * FROM edges WHERE src == node) WHERE dst == -1
    START WITH node = 0
    CONNECT BY UNIQUE node = dst
    AS list;
"""


Run = Callable[[], int]


def boards_by_hand(connection: duckdb.DuckDBPyConnection) -> Run:
    """What runs the query, and gives the number of boards."""
    connection.execute('CREATE TABLE slides("at" BIGINT, low BIGINT, high BIGINT)')
    connection.executemany("INSERT INTO slides VALUES (?, ?, ?)", [list(slide.values()) for slide in SLIDES])
    return lambda: int(connection.execute(BY_HAND).fetchall()[0][0])


def boards_by_script(ss: ss2sql.Session) -> Run:
    """What runs the script, and gives the number of boards."""
    ss.set("slides", SLIDES)
    return count_rows(ss.compile(script()))


def count_rows(search: ss2sql.Query) -> Run:
    """What runs a search that has no result, and gives the number of rows that it has kept."""

    def run() -> int:
        found = search.run()
        assert found.value == []
        return sum(level.rows for level in found.stats.levels)

    return run


def load_edges(connection: duckdb.DuckDBPyConnection, edges: int) -> None:
    columns = [pa.array(column, pa.int32()) for column in zip(*edges_of(edges), strict=True)]
    connection.register("made", pa.table(columns, names=["src", "dst"]))
    connection.execute("CREATE TABLE edges AS SELECT * FROM made")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--times", type=int, default=8)
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--edges", type=int, default=1_000_000)
    given = parser.parse_args()
    own = duckdb.connect(config={"threads": given.threads})
    load_edges(own, given.edges)
    ss = ss2sql.connect(engine="duckdb", session=own)
    boards = boards_by_hand(own), boards_by_script(ss)
    measure_pair("8-puzzle", *boards, given.times, lambda *counts: counts == (BOARDS, BOARDS))
    reach = (lambda: int(own.execute(REACH_BY_HAND).fetchall()[0][0])), count_rows(ss.compile(REACH))
    # By hand the start is a node that was reached; in the script it is one where an edge leads to it.
    measure_pair(f"{given.edges:,} edges", *reach, given.times, lambda one, other: one - other in (0, 1))


def measure_pair(name: str, by_hand: Run, script: Run, times: int, agree: Callable[[int, int], bool]) -> None:
    """Prints the least of the seconds that each takes, and their ratio."""
    least, counts = [float("inf")] * 2, [0, 0]
    for _ in range(times):
        for n, run in enumerate((by_hand, script)):
            before = time.process_time()
            counts[n] = run()
            least[n] = min(least[n], time.process_time() - before)
        assert agree(*counts), f"{name}: {counts[0]:,} by hand, {counts[1]:,} in the script"
    print(f"{name}: by hand {least[0]:.3f} s, script {least[1]:.3f} s, ratio {least[1] / least[0]:.2f}")


if __name__ == "__main__":
    main()

"""One level of a search as statements over whole tables, written once and printed for each dialect.

The tables: `frontier` has the states that are expanded, in the order of their steps. `tries` has all steps from them
that leave a trace, numbered in the order in which a search that takes one after the other would try them. `steps` has
those that were kept, which is where the paths are found; `kept` are those of this level. A step has the same number
everywhere; the start is 0. `row_key` is the same for equal rows.

A try that `failed` has raised an error. That counts only where the search would have come to it: not if its row is left
out anyway, and not behind the first step to the same row.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, partial

import sqlglot

from ss2sql import plan
from ss2sql.lowering.dialects import Dialect

TABLES = {
    "frontier": "step BIGINT, state BLOB",
    "tries": (
        "step BIGINT, parent BIGINT, row_key BLOB, row BLOB, last BLOB, goal BOOLEAN, goes_on BOOLEAN, state BLOB,"
        " failed BOOLEAN"
    ),
    "steps": "step BIGINT, parent BIGINT, depth BIGINT, row_key BLOB, row BLOB, last BLOB, goal BOOLEAN",
}


@dataclass(frozen=True, slots=True)
class Guard:
    """What makes `kept` of `tries`, in words and in SQL, and what finds the first try that failed and counts."""

    words: str
    kept: str
    failed: str
    before: str | None = None
    after: str | None = None


EVERY = Guard(
    "keeps all of them",
    "CREATE TABLE kept AS SELECT * FROM tries WHERE NOT failed",
    "SELECT MIN(step) FROM tries WHERE failed",
)
# The first step to a row, if none of a level before has led there.
FIRST = Guard(
    "keeps the first step to each row that no level before has reached",
    """
    CREATE TABLE kept AS
    SELECT * FROM tries WHERE step IN (
      SELECT MIN(step)
      FROM tries
      WHERE NOT failed AND NOT EXISTS (SELECT 1 FROM steps WHERE steps.row_key = tries.row_key)
      GROUP BY row_key
    )
    """,
    """
    SELECT MIN(tries.step)
    FROM tries
    LEFT JOIN kept ON kept.row_key = tries.row_key
    WHERE tries.failed
      AND (kept.step IS NULL OR tries.step < kept.step)
      AND NOT EXISTS (SELECT 1 FROM steps WHERE steps.row_key = tries.row_key)
    """,
)
# Every step whose row is not met on the way back to the start. From level to level all ways have the same length.
FREE = Guard(
    "keeps those whose row is not met on the way back to the start",
    "CREATE TABLE kept AS SELECT * FROM tries WHERE NOT failed AND step IN (SELECT step FROM free)",
    "SELECT MIN(step) FROM tries WHERE failed AND step IN (SELECT step FROM free)",
    before="""
    CREATE TABLE free AS
    WITH RECURSIVE back(step, at, row_key) AS (
      SELECT step, parent, row_key FROM tries
      UNION ALL
      SELECT back.step, steps.parent, back.row_key
      FROM back
      JOIN steps ON steps.step = back.at AND steps.row_key <> back.row_key
    )
    SELECT step FROM back WHERE at = 0
    """,
    after="DROP TABLE free",
)
GUARDS: dict[plan.Repeats, Guard] = {"allowed": EVERY, "unique": FIRST, "no cycle": FREE}

# In pages, so that nothing large waits while the steps from some states are tried.
EXPANDED = "SELECT step, state FROM frontier WHERE step > :after ORDER BY step LIMIT 5000"
KEEP = "INSERT INTO steps SELECT step, parent, :depth, row_key, row, last, goal FROM kept"
COUNTS = """
SELECT COUNT(*), COUNT(CASE WHEN goal THEN 1 END), COUNT(CASE WHEN goes_on THEN 1 END) FROM kept
"""
# The ways to the goals of a level, from the last step of each backwards, by numbers alone: rows may be large.
WAYS = """
CREATE TABLE ways AS
WITH RECURSIVE back(goal, step, at, distance) AS (
  SELECT step, step, parent, 0 FROM kept WHERE goal
  UNION ALL
  SELECT back.goal, steps.step, steps.parent, back.distance + 1
  FROM back
  JOIN steps ON steps.step = back.at
)
SELECT goal, step, distance FROM back
"""
PATHS = """
SELECT ways.goal, steps.row, CASE WHEN ways.distance = 0 THEN steps.last END
FROM ways
JOIN steps ON steps.step = ways.step
ORDER BY ways.goal, ways.distance DESC
"""
GO_ON = (
    "DROP TABLE frontier",
    "CREATE TABLE frontier AS SELECT step, state FROM kept WHERE goes_on",
    "DROP TABLE kept",
    "DELETE FROM tries",
)


DROP_WAYS = "DROP TABLE ways"


@cache
def printed(dialect: Dialect, text: str) -> str:
    """A statement in a dialect; to read and to write one takes a millisecond."""
    return dialect.print(sqlglot.parse_one(text, read="duckdb"))


class Statements:
    """The statements of a search in one dialect; `repeats` says what happens to rows that were met before."""

    def __init__(self, dialect: Dialect, repeats: plan.Repeats) -> None:
        guard, say = GUARDS[repeats], partial(printed, dialect)
        self.made = [say(f"CREATE TABLE {name}({columns})") for name, columns in TABLES.items()]
        self.expanded = say(EXPANDED)
        self.kept = [say(text) for text in (guard.before, guard.kept) if text is not None]  # what makes `kept`
        self.failed = say(guard.failed)
        self.keep = say(KEEP)
        self.counts = say(COUNTS)
        self.ways = say(WAYS)
        self.paths = say(PATHS)
        self.no_ways = say(DROP_WAYS)
        self.go_on = [say(text) for text in (*GO_ON, guard.after) if text is not None]  # what leads to the next level

    def level(self) -> Iterator[str]:
        """All of one level, in order; between the first and the others the steps are tried, outside."""
        yield self.expanded
        yield from self.kept
        yield self.failed
        yield self.keep
        yield self.counts
        yield self.ways
        yield self.paths
        yield self.no_ways
        yield from self.go_on

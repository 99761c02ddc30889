"""One level of a search as statements.

The tables: `frontier` has the states that are expanded, in the order of their steps. `tries` has all steps from them
that leave a trace; `place` orders them as a search would try them that takes one step after the other: by the step
before, then by their elements. `steps` has those that were kept, which is where the paths are found; `kept` are those
of this level. Steps are numbered in their order from 1; the start is 0. `row_key` is the same for equal rows.

A try that `failed` has raised an error. That counts only where the search would have come to it: not if its row is left
out anyway, and not behind the first step to the same row.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ss2sql import plan
from ss2sql.records import dataclass
from ss2sql.runtime.levels.statements import Add, Ask, Create, Drop, Make, Number, Statement, Walk

TABLES = {
    "frontier": "step BIGINT, state BLOB",
    "tries": (
        "place BIGINT, parent BIGINT, row_key BLOB, row BLOB, last BLOB, goal BOOLEAN, goes_on BOOLEAN, state BLOB,"
        " failed BOOLEAN"
    ),
    "steps": "step BIGINT, parent BIGINT, depth BIGINT, row_key BLOB, row BLOB, last BLOB, goal BOOLEAN",
}


@dataclass(frozen=True, slots=True)
class Guard:
    """Which tries are kept, in words and in SQL, and what finds the first one that failed and counts."""

    words: str
    chosen: str  # the places of those that are kept; alone, because what is numbered should be small
    failed: str
    before: Walk | None = None


def back_to_start(
    tries: str = "tries", parent: str = "parent", row: Sequence[str] = ("row_key",), more: str = ""
) -> Walk:
    """The way back of each of the `tries` as long as it does not meet its row; free is what ends at step 0.

    `parent` says from which step a try comes, `row` are the columns that tell rows apart, `more` is asked of steps.
    """
    different = " OR ".join(f"steps.{name} <> walk.{name}" for name in row)
    other = f"({different})" if len(row) > 1 else different
    return Walk(
        "back",
        ", ".join(("place", "previous", *row)),
        f"SELECT place, {parent}, {', '.join(row)} FROM {tries}",
        f"""
        SELECT walk.place, steps.parent, {", ".join(f"walk.{name}" for name in row)}
        FROM walk
        JOIN steps ON steps.step = walk.previous {more} AND {other}
        """,
    )


def ways_back(goals: str, more: str = "") -> Walk:
    """The ways to some goals, from the last step of each backwards, by numbers alone: rows may be large.

    `goals` are steps, what stands behind FROM; `more` is asked of those before.
    """
    return Walk(
        "ways",
        "goal, step, previous, distance",
        f"SELECT step, step, parent, 0 FROM {goals}",
        f"""
        SELECT walk.goal, steps.step, steps.parent, walk.distance + 1
        FROM walk
        JOIN steps ON steps.step = walk.previous {more}
        """,
    )


EVERY = Guard(
    "keeps all of them",
    "SELECT place FROM tries WHERE NOT failed",
    "SELECT MIN(place) FROM tries WHERE failed",
)
# The first step to a row, if none of a level before has led there.
FIRST = Guard(
    "keeps the first step to each row that no level before has reached",
    """
    SELECT MIN(place) AS place
    FROM tries
    WHERE NOT failed AND NOT EXISTS (SELECT 1 FROM steps WHERE steps.row_key = tries.row_key)
    GROUP BY row_key
    """,
    """
    SELECT MIN(tries.place)
    FROM tries
    LEFT JOIN kept ON kept.row_key = tries.row_key
    WHERE tries.failed
      AND (kept.place IS NULL OR tries.place < kept.place)
      AND NOT EXISTS (SELECT 1 FROM steps WHERE steps.row_key = tries.row_key)
    """,
)
FREE = Guard(
    "keeps those whose row is not met on the way back to the start",
    "SELECT place FROM tries WHERE NOT failed AND place IN (SELECT place FROM back WHERE previous = 0)",
    "SELECT MIN(place) FROM tries WHERE failed AND place IN (SELECT place FROM back WHERE previous = 0)",
    back_to_start(),
)
GUARDS: dict[plan.Repeats, Guard] = {"allowed": EVERY, "unique": FIRST, "no cycle": FREE}

KEPT = Make("kept", "SELECT chosen.step, tries.* FROM chosen JOIN tries ON tries.place = chosen.place")
KEEP = Add("steps", "SELECT step, parent, :depth, row_key, row, last, goal FROM kept")
GOALS_AND_GOING = "COUNT(CASE WHEN goal THEN 1 END), COUNT(CASE WHEN goes_on THEN 1 END)"
COUNTS = Ask(f"SELECT COUNT(*), {GOALS_AND_GOING}, MAX(step) FROM kept", simple=True)
WAYS = ways_back("kept WHERE goal")
PATHS = Ask("""
SELECT ways.goal, steps.row, CASE WHEN ways.distance = 0 THEN steps.last END
FROM ways
JOIN steps ON steps.step = ways.step
ORDER BY ways.goal, ways.distance DESC
""")
LAST_BEFORE = Ask("SELECT MAX(step) FROM kept WHERE place <= :place")  # a step that failed
STATE_OF = Ask("SELECT state FROM frontier WHERE step = :step")


class LevelStatements:
    """The statements of a search."""

    def __init__(self, search: plan.Search) -> None:
        self.search = search
        guard = GUARDS[search.repeats]
        self.made = [Create(table, columns) for table, columns in TABLES.items()]
        before = [] if guard.before is None else [guard.before]
        self.kept: list[Statement] = [*before, Number("chosen", guard.chosen), KEPT]  # what makes `kept`
        self.failed = Ask(guard.failed)
        self.go_on: list[Statement] = [  # what leads to the next level
            Drop("frontier"),
            Make("frontier", "SELECT step, state FROM kept WHERE goes_on"),
            Drop("kept"),
            Drop("chosen"),
            Drop("tries"),
            Create("tries", TABLES["tries"]),
            *(Drop(walk.table) for walk in before),
        ]

    def level(self) -> Iterator[Statement]:
        """All of one level, in order, once its steps are tried."""
        yield from self.kept
        yield self.failed
        yield KEEP
        yield COUNTS
        yield WAYS
        yield PATHS
        yield Drop(WAYS.table)
        yield from self.go_on

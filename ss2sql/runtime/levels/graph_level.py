"""One level of the graph of MEMORIZE as statements, and what of the graph lies on ways to goals.

The first step to a row makes it a node, see `steps`, which are the nodes here, numbered in the order of their making.
Every step to a row that is known by then is an edge. So `tries` has two answers for each step: whether it `makes` a
node where its row is new and has `failed` there; and whether it `leads` to its row where that is known, for which only
its weight is asked, and whether that has failed.

`reaches` are the nodes from which goals can be reached, with the number of steps to the nearest one.
"""

from __future__ import annotations

from collections.abc import Iterator

from ss2sql import plan
from ss2sql.runtime.levels.level import KEEP, KEPT, TABLES
from ss2sql.runtime.levels.statements import Add, Ask, Create, Drop, Make, Number, Statement

TRIES = f"{TABLES['tries']}, makes BOOLEAN, leads BOOLEAN, weight BLOB, weight_failed BOOLEAN"
EDGES = "place BIGINT, parent BIGINT, target BIGINT, depth BIGINT, weight BLOB, last BLOB"

# The first step that would make a node of a row that no level before has reached.
CHOSEN = Number(
    "chosen",
    """
    SELECT MIN(place) AS place
    FROM tries
    WHERE makes AND NOT EXISTS (SELECT 1 FROM steps WHERE steps.row_key = tries.row_key)
    GROUP BY row_key
    """,
)
ADD_EDGES = Add(
    "edges",
    """
    SELECT tries.place, tries.parent, steps.step, :depth, tries.weight, tries.last
    FROM tries
    JOIN steps ON steps.row_key = tries.row_key
    LEFT JOIN kept ON kept.step = steps.step
    WHERE tries.leads AND (kept.place IS NULL OR tries.place >= kept.place)
    """,
)
COUNTS = Ask("""
SELECT COUNT(*), COUNT(CASE WHEN goes_on THEN 1 END), MAX(step), (SELECT COUNT(*) FROM edges) FROM kept
""")
# The first step that failed and counts, and whether its row was known.
FAILED = Ask("""
SELECT failing.place, failing.known
FROM (
  SELECT tries.*, CASE WHEN steps.step IS NULL OR tries.place < kept.place THEN FALSE ELSE TRUE END AS known
  FROM tries
  LEFT JOIN steps ON steps.row_key = tries.row_key
  LEFT JOIN kept ON kept.step = steps.step
  WHERE tries.failed OR tries.weight_failed
) AS failing
WHERE CASE WHEN failing.known THEN failing.weight_failed ELSE failing.failed END
ORDER BY failing.place
LIMIT 1
""")
NODES_FROM = Ask("SELECT COUNT(*) FROM steps WHERE parent < :parent")

GOALS = Make("reaches", "SELECT step, CAST(0 AS BIGINT) AS distance FROM steps WHERE goal")
REACHING = Add(
    "reaches",
    """
    SELECT DISTINCT edges.parent, CAST(:distance AS BIGINT)
    FROM edges
    JOIN reaches ON reaches.step = edges.target
    WHERE reaches.distance = :distance - 1
      AND NOT EXISTS (SELECT 1 FROM reaches AS nearer WHERE nearer.step = edges.parent)
    """,
)
REACHED = Ask("SELECT COUNT(*) FROM reaches")
# A node is reached by `depth` steps at least, so what is further from a goal than is left of the bound leads nowhere.
NODES = Ask("""
SELECT steps.step, steps.row, steps.goal
FROM steps
JOIN reaches ON reaches.step = steps.step
WHERE steps.depth + reaches.distance <= :bound
ORDER BY steps.step
""")
WAYS_ON = Ask("""
SELECT edges.parent, edges.target, edges.weight, edges.last
FROM edges
JOIN reaches ON reaches.step = edges.target
WHERE edges.depth + reaches.distance <= :bound
ORDER BY edges.place
""")


class GraphStatements:
    """The statements of a search."""

    def __init__(self, search: plan.Search) -> None:
        self.search = search
        self.made: list[Statement] = [
            Create("frontier", TABLES["frontier"]),
            Create("tries", TRIES),
            Create("steps", TABLES["steps"]),
            Create("edges", EDGES),
        ]
        self.keep: list[Statement] = [CHOSEN, KEPT, KEEP, ADD_EDGES]
        self.go_on: list[Statement] = [
            Drop("frontier"),
            Make("frontier", "SELECT step, state FROM kept WHERE goes_on"),
            *(Drop(table) for table in ("kept", "chosen", "tries")),
            Create("tries", TRIES),
        ]

    def level(self) -> Iterator[Statement]:
        """All of one level, in order, once its steps are tried; then what is done with the graph."""
        yield from self.keep
        yield COUNTS
        yield FAILED
        yield from self.go_on
        yield GOALS
        yield REACHING
        yield NODES
        yield WAYS_ON

"""One level of a search by COST or PROBABILITY as statements.

Such a search takes the waiting step with the least total, among equals the one that was tried first. So do levels: they
take the first of the steps that wait, as many as come before every new step. Nobody knows how many these are before
the steps from them are tried. `chosen` are those that may be; what is tried from them says which of them are `kept`:
all whose totals are not greater than that of the least new step. The others wait on.

The tables: `waiting` has all steps that have ever waited, as `tries` had them, in the order of `total` and `place`.
All up to some total have been taken, but for those which the last level has added. `steps` are those that were taken,
numbered in that order. `fresh` are tries whose row nobody has taken before the step that they start from. `known` has
the tries from steps that were chosen too early, by the place of these, so that they are not made again, where that
takes longer than to keep them; and for each of these steps a row with an `nth` of -1, because some have no tries.
"""

from __future__ import annotations

from collections.abc import Iterator

from ss2sql import plan
from ss2sql.lowering.portable.steps import ELEMENTS
from ss2sql.records import dataclass
from ss2sql.runtime.levels.level import KEEP, PATHS, TABLES, WAYS, back_to_start
from ss2sql.runtime.levels.statements import Add, Ask, Create, Drop, Make, Number, Statement, Walk, columns_of, listed

TRIES = f"{TABLES['tries']}, total DOUBLE"
WAITING = TRIES.replace(" failed BOOLEAN,", "")
CHOSEN = "step BIGINT, place BIGINT, row_key BLOB, total DOUBLE"
COLUMNS = ", ".join(name for name, _ in columns_of(WAITING))
REST = [column for column in columns_of(TRIES) if column[0] not in ("place", "parent")]
KNOWN = ", ".join(("waiting BIGINT", "nth BIGINT", *(f"{name} {kind}" for name, kind in REST)))
# The steps that wait: those with greater totals than the last one taken, or tried from the last ones taken.
WAIT = "(total > :total OR (total = :total AND parent > :earlier))"


@dataclass(frozen=True, slots=True)
class Queue:
    """What becomes of rows that were met before, in words and in SQL.

    `waits` are the steps that wait, which become `alive`, and `first` those of the `near` ones that can be taken.
    `least` has the tries that may enter, and `enters` those that do, once it is known up to which step they count;
    `failed` finds the first that failed.
    """

    words: str
    waits: str
    first: str
    before: tuple[Statement, ...]
    least: str
    after: tuple[Statement, ...]
    enters: str
    failed: str


EVERY = Queue(
    "keeps all of them",
    f"SELECT place, row_key, total FROM waiting WHERE {WAIT}",
    "{near}",
    (),
    "SELECT MIN(total) FROM tries",
    (),
    f"SELECT {COLUMNS} FROM tries WHERE NOT failed AND parent <= :last",
    "SELECT MIN(place) FROM tries WHERE failed AND parent <= :last",
)
# Each row once, by the first step to it that is taken. The others are left out where that is known already.
FIRST = Queue(
    "keeps those to rows that were not taken before",
    f"""
    SELECT place, row_key, total
    FROM waiting
    WHERE {WAIT} AND NOT EXISTS (SELECT 1 FROM steps WHERE steps.row_key = waiting.row_key)
    """,
    """
    SELECT place, row_key, total
    FROM (
      SELECT *, ROW_NUMBER() OVER (PARTITION BY row_key ORDER BY total, place) AS nth
      FROM ({near}) AS near
    ) AS ranked
    WHERE nth = 1
    """,
    (
        Make(
            "fresh",
            """
            SELECT place, parent, row_key, failed, total
            FROM tries
            WHERE NOT EXISTS (SELECT 1 FROM steps WHERE steps.row_key = tries.row_key)
              AND NOT EXISTS (SELECT 1 FROM chosen WHERE chosen.row_key = tries.row_key AND chosen.step <= tries.parent)
            """,
        ),
    ),
    "SELECT MIN(total) FROM fresh",
    (
        Make(
            "first_tries",
            """
            SELECT place
            FROM (
              SELECT place, ROW_NUMBER() OVER (PARTITION BY row_key ORDER BY total, place) AS nth
              FROM fresh
              WHERE NOT failed AND parent <= :last
            ) AS ranked
            WHERE nth = 1
            """,
        ),
    ),
    f"SELECT {COLUMNS} FROM tries WHERE place IN (SELECT place FROM first_tries)",
    "SELECT MIN(place) FROM fresh WHERE failed AND parent <= :last",
)
FREE = Queue(
    "keeps those whose row is not met on the way back to the start",
    EVERY.waits,
    EVERY.first,
    (),
    EVERY.least,
    (back_to_start("tries WHERE parent <= :last"),),
    f"SELECT {COLUMNS} FROM tries WHERE NOT failed AND place IN (SELECT place FROM back WHERE previous = 0)",
    "SELECT MIN(place) FROM tries WHERE failed AND place IN (SELECT place FROM back WHERE previous = 0)",
)
QUEUES: dict[plan.Repeats, Queue] = {"allowed": EVERY, "unique": FIRST, "no cycle": FREE}

STATE_OF = Ask("SELECT waiting.state FROM chosen JOIN waiting ON waiting.place = chosen.place WHERE step = :step")
TAKEN = "FROM chosen JOIN waiting ON waiting.place = chosen.place"

# What is known of tries, and noting those from steps that were chosen too early.
UNKNOWN = " AND NOT EXISTS (SELECT 1 FROM known WHERE known.waiting = chosen.place)"
REMEMBER = Add(
    "tries",
    f"""
    SELECT chosen.step * {ELEMENTS} + known.nth, chosen.step, {listed(*(f"known.{name}" for name, _ in REST))}
    FROM known
    JOIN chosen ON chosen.place = known.waiting
    WHERE known.nth >= 0
    """,
)
NOTE: tuple[Statement, ...] = (
    Make(
        "early",
        f"""
        SELECT known.*
        FROM known
        WHERE NOT EXISTS (SELECT 1 FROM chosen WHERE chosen.place = known.waiting)
        UNION ALL
        SELECT chosen.place, tries.place % {ELEMENTS}, {listed(*(f"tries.{name}" for name, _ in REST))}
        FROM tries
        JOIN chosen ON chosen.step = tries.parent
        WHERE tries.parent > :last
        UNION ALL
        SELECT place, -1, {listed(*(f"CAST(NULL AS {kind})" for _, kind in REST))}
        FROM chosen
        WHERE step > :last
        """,
    ),
    Drop("known"),
    Make("known", "SELECT * FROM early"),
    Drop("early"),
)


class CostStatements:
    """The statements of a search; `keeps`: the tries of steps that were chosen too early."""

    def __init__(self, search: plan.Search, keeps: bool = False) -> None:
        self.search, self.keeps = search, keeps
        queue = QUEUES[search.repeats]
        reach = "*" if search.order == "probability" else "+"
        self.made: list[Statement] = [
            Create("frontier", TABLES["frontier"]),
            Create("tries", TRIES),
            Create("waiting", WAITING),
            Create("steps", TABLES["steps"]),
            Create("chosen", CHOSEN),
            *([Create("known", KNOWN)] if keeps else ()),
        ]
        near = f"SELECT * FROM alive WHERE total <= (SELECT MIN(total) FROM alive) {reach} :reach"
        self.choose: list[Statement] = [
            Make("alive", queue.waits),
            Number("chosen", queue.first.format(near=near), "total, place"),
            Drop("alive"),
            Make(
                "frontier",
                f"SELECT chosen.step, waiting.state {TAKEN} WHERE waiting.goes_on{UNKNOWN if keeps else ''}",
            ),
        ]
        self.keep: list[Statement] = [
            *queue.before,
            Make(
                "kept",
                f"SELECT chosen.step, waiting.* {TAKEN} WHERE chosen.total <= COALESCE(({queue.least}), chosen.total)",
            ),
            KEEP,
        ]
        self.counts = Ask(
            "SELECT COUNT(*), COUNT(CASE WHEN goal THEN 1 END), MAX(step), MIN(total), MAX(total),"
            f" ({queue.least}), (SELECT COUNT(*) FROM chosen) FROM kept"
        )
        self.enter: list[Statement] = [*queue.after, Add("waiting", queue.enters)]
        self.entered = Ask(f"SELECT COUNT(*), ({queue.failed}) FROM waiting")
        made = [statement.table for statement in (*queue.before, *queue.after) if isinstance(statement, Make | Walk)]
        self.go_on: list[Statement] = [
            *(Drop(table) for table in ("frontier", "kept", "chosen", "tries", *made)),
            Create("tries", TRIES),
        ]

    def level(self) -> Iterator[Statement]:
        """All of one level, in order, with its steps tried after `frontier` is made."""
        yield from self.choose
        if self.keeps:
            yield REMEMBER
        yield from self.keep
        yield self.counts
        yield from self.enter
        yield self.entered
        if self.keeps:
            yield from NOTE
        yield WAYS
        yield PATHS
        yield Drop(WAYS.table)
        yield from self.go_on

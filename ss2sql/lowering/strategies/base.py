"""What a strategy consists of."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Order:
    """Which step is taken next from the queue of a recursive query.

    `queue` are the columns of the recursive table that sort the queue, with True for descending; the tie
    order is part of it. None: SQLite's queue does not run this order yet, it runs natively. `promise` says
    what a user can rely on.
    """

    name: str
    keyword: str
    queue: tuple[tuple[str, bool], ...] | None
    promise: str


@dataclass(frozen=True, slots=True)
class Guard:
    """What happens to a step whose row was met before.

    `met` is the SQL function that tells whether the row was met (None: nobody asks), `meet` the one that
    notes it once the step has turned out to count. `lowered` is False for what only runs natively.
    """

    name: str
    keyword: str
    met: str | None
    meet: str | None
    lowered: bool
    promise: str

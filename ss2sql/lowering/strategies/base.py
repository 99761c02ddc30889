"""What a strategy consists of."""

from __future__ import annotations

from ss2sql.records import dataclass


@dataclass(frozen=True, slots=True)
class Order:
    """Which step is taken next from the queue of a recursive query.

    `queue` are the columns of the recursive table that sort the queue, with True for descending; the tie
    order is part of it, `step` being the number under which a step was generated. `total` names the column
    that holds what the path comes to, where steps have weights. `promise` says what a user can rely on.
    """

    name: str
    keyword: str
    queue: tuple[tuple[str, bool], ...]
    promise: str
    total: str | None = None


@dataclass(frozen=True, slots=True)
class Guard:
    """What happens to a step whose row was met before; the names are SQL functions of runtime/search_functions.py.

    `entering` tells whether a row was met (None: nobody asks), and `number` gives the step its number, and notes
    the row. `lowered` is False for what only runs natively.
    """

    name: str
    keyword: str
    entering: str | None
    number: str
    lowered: bool
    promise: str

"""What runs the statements of a search: the tables of one run, in some database."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any, Protocol

from ss2sql.records import dataclass
from ss2sql.runtime.levels.level import PATHS, WAYS
from ss2sql.runtime.levels.statements import AddNumbered, Ask, Drop, Statement, Value, Walk
from ss2sql.runtime.levels.trial import FAILED, Trial
from ss2sql.runtime.levels.watch import Opened

Row = tuple[Any, ...]


@dataclass(frozen=True, slots=True)
class Tally:
    """How many steps of a level were tried, and how many of them failed."""

    tried: int
    failed: int


class Tables(Opened, Protocol):
    """The tables of one run. `:name` in a statement stands for a value."""

    def run(self, statement: Statement, **values: Value) -> None:
        """Runs a statement."""

    def rows(self, question: Ask, **values: Value) -> Iterator[Row]:
        """The rows of a query, read in blocks; another statement may run meanwhile."""

    def load(self, table: str, columns: Sequence[Sequence[Any]]) -> None:
        """Adds rows, given by columns, to a table that `Create` has made."""

    def try_all(self, trial: Trial, pause: Callable[[], None]) -> Tally:
        """Adds the steps from all states of `frontier` to `tries`, and counts them.

        `pause` is called every few thousand steps; it ends the run where that has to end.
        """

    def ways(self) -> Iterator[Row]:
        """The ways to the goals in `kept`, as `level.PATHS` gives them."""


class NumberingTables(Tables, Protocol):
    """Tables of which one has all steps, numbered."""

    def add(self, statement: AddNumbered, **values: Value) -> int:
        """Adds rows, and counts them."""


def walked_ways(tables: Tables, walk: Walk = WAYS, paths: Ask = PATHS, **values: Value) -> Iterator[Row]:
    """`ways` by statements over all of them: a `walk`, and what asks for the rows of its paths."""
    tables.run(walk, **values)
    yield from tables.rows(paths)
    tables.run(Drop(walk.table))


# In pages, so that nothing large waits while the steps from some states are tried.
EXPANDED = Ask("SELECT step, state FROM frontier WHERE step > :after ORDER BY step LIMIT 5000")
BLOCK = 5_000  # tries that are added to their table at once


def try_in_blocks(tables: Tables, trial: Trial, pause: Callable[[], None]) -> Tally:
    """`try_all` in this process, for databases that hand over states and take steps."""
    tried, failed, after = 0, 0, -1
    block: list[Row] = []
    while page := list(tables.rows(EXPANDED, after=after)):
        for after, state in page:
            for made in trial.steps(after, state):
                tried += 1
                if made is not None:
                    block.append(made)
                    failed += made[FAILED]
            if len(block) >= BLOCK:
                pause()
                tables.load("tries", list(zip(*block, strict=True)))
                block.clear()
    pause()
    if block:
        tables.load("tries", list(zip(*block, strict=True)))
    return Tally(tried, failed)

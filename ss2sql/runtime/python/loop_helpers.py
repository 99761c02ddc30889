"""What the loops of generated code call: what they walk, and how often they look at the clock.

Iterations of a loop may take a tenth of a microsecond or, with a slow function, seconds. So the turns between two
looks are counted, and their number follows the time that they took.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from itertools import chain
from operator import length_hint
from typing import TYPE_CHECKING, Any

from ss2sql.language import plan
from ss2sql.language.conversion import read_column
from ss2sql.runtime.run.call_memo import make_call_key
from ss2sql.runtime.run.elements import list_source_elements
from ss2sql.runtime.run.run_state import Run
from ss2sql.vtables.frames import Frame

if TYPE_CHECKING:
    from ss2sql.lowering.flat import TableFilter

QUICK, SLOW = 0.002, 0.01  # seconds between two looks: below the one there may be more turns, above the other fewer
MAX_TURNS = 128
TURNS_PER_CHECK = 64  # so many turns are quick enough not to look at the clock between them


class ClockChecks:
    """Ends the run where it has to end, and says at which turn to look again."""

    def __init__(self, run: Run) -> None:
        self._check = run.check
        self._turns = 1
        self._last = time.perf_counter()

    def check_clock(self, turn: int) -> int:
        self._check()
        now = time.perf_counter()
        if now - self._last < QUICK:
            self._turns = min(2 * self._turns, MAX_TURNS)
        elif now - self._last > SLOW:
            self._turns = max(self._turns // 4, 1)
        self._last = now
        return turn + self._turns


def make_turn_check(run: Run) -> Callable[[int], int]:
    return ClockChecks(run).check_clock


def make_step_meter(run: Run) -> Callable[[int, int, int], int]:
    """Adds what searches have counted since the last look, and ends the run where it has to end.

    Gives the number of steps until the next look.
    """
    count, check_turn = make_count_report(run), ClockChecks(run).check_clock

    def count_steps(generated: int, expanded: int, pruned: int) -> int:
        count(generated, expanded, pruned)
        return check_turn(0)

    return count_steps


def make_count_report(run: Run) -> Callable[[int, int, int], None]:
    """Hands on to the run what a search has counted."""
    stats = run.stats

    def add_counts(generated: int, expanded: int, pruned: int) -> None:
        stats.generated += generated
        stats.expanded += expanded
        stats.pruned += pruned

    return add_counts


def make_known_steps_check(run: Run) -> Callable[[int], None]:
    """Counts the steps of a state that were known, and looks at the clock now and then."""
    stats, check_turn = run.stats, ClockChecks(run).check_clock
    steps, due = 0, 1

    def check_steps(elements: int) -> None:
        nonlocal steps, due
        stats.generated += elements
        stats.expanded += 1
        steps += elements
        if steps >= due:
            due = check_turn(steps)

    return check_steps


class Parts:
    """The items of a long list, which looks at the clock between parts of it; it knows how many are left."""

    def __init__(self, items: Sequence[Any], run: Run) -> None:
        self._items = items
        self._run = run
        self._begun = 0
        self._part: Iterator[Any] = iter(())

    def __iter__(self) -> Iterator[Any]:
        return chain.from_iterable(self._iterate_parts())

    def _iterate_parts(self) -> Iterator[Iterator[Any]]:
        for start in range(0, len(self._items), TURNS_PER_CHECK):
            self._run.check()
            self._run.check_steps(start)
            part = self._items[start : start + TURNS_PER_CHECK]
            self._begun, self._part = start + len(part), iter(part)
            yield self._part

    def __length_hint__(self) -> int:
        return len(self._items) - self._begun + length_hint(self._part)


# --- what the loops of generated code walk: helpers that it calls
def list_elements_with_keys(items: list[Any]) -> list[tuple[Any, bytes]]:
    """The items, each with its exact key as an argument of a call."""
    return [(item, make_call_key(item)) for item in items]


def loop_over_dict_columns(value: Any, *names: str) -> list[tuple[Any, ...]]:
    """Columns of the dicts that are the elements of a value."""
    return [tuple([element.get(name) for name in names]) for element in list_source_elements(value)]


def loop_over_frame_rows(source: Any, *names: str) -> list[tuple[Any, ...]]:
    """The rows of a data frame, or of what a function of the user has put in its place."""
    if isinstance(source, Frame):
        return source.list_rows(names)
    return [tuple(read_column(element, name, None) for name in names) for element in list_source_elements(source)]


def loop_over_table_rows(
    run: Run, table: plan.TableSource, wanted: TableFilter | None = None, give: Callable[[], Sequence[Any]] = tuple
) -> list[tuple[Any, ...]]:
    """The rows of a table, without what a filter leaves out for the values that a function gives."""
    try:
        wanted = None if wanted is None else wanted.bind_values(give())
    except NameError:  # a variable has no value, which only a row may miss
        wanted = None
    return run.host.read_table_rows(table, run, wanted)


def iterate_with_checks(run: Run, items: list[Any]) -> Iterator[Any]:
    """The items of a loop that ends when the run has to end; to count them takes 0.02 us more for each."""
    return chain.from_iterable(_loop_over_parts(ClockChecks(run).check_clock, items))


def _loop_over_parts(check_turn: Callable[[int], int], items: list[Any]) -> Iterator[list[Any]]:
    start = 0
    while start < len(items):
        end = check_turn(start)
        yield items[start:end]
        start = end

"""What a search in SQL has no words for: numbers for its steps, the path to a step, and the rows that were met.

One `SearchState` serves one execution of one statement. Its methods are the SQL functions that the lowering of
searches writes down. Ranks are totals for which less is better.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Hashable, Mapping
from functools import partial
from math import inf
from typing import Any

from ss2sql.language.values import is_overestimate
from ss2sql.lowering.sql_query import Bookkeeping
from ss2sql.runtime.run.run_state import Stats
from ss2sql.runtime.run.search_paths import KeptSteps

# The SQL functions with the number of their arguments, -1 for any.
FUNCTIONS = {
    **dict.fromkeys(("arrive", "give", "enter_first"), 1),
    **dict.fromkeys(("give_once", "enter_best"), 2),
    "still_best": -1,
    **dict.fromkeys(("enter", "on_path", "reached", "closed", "improves", "visit"), -1),
}


class StepPathKeys:
    """The keys of the rows on the path to one step, for NO CYCLE.

    The set follows the search from step to step: it gives up what lies only on the old path and takes what
    lies only on the new one. Depth first that is a row or two for each move. Numbers grow along a path, so
    the greater of two ends is never on the path to the other.
    """

    def __init__(self, parents: list[int], compared: list[Any], make_key: Callable[[Any], Hashable]) -> None:
        self.parents = parents
        self.compared = compared
        self.make_key = make_key
        self.end = 0
        self.keys: set[Any] = set()

    def follow_to(self, step: int) -> None:
        parents, compared, old, new = self.parents, self.compared, self.end, step
        gained: list[Hashable] = []
        while old != new:
            if old > new:
                self.keys.discard(self.make_key(compared[old]))
                old = parents[old]
            else:
                gained.append(self.make_key(compared[new]))
                new = parents[new]
        self.end = step
        self.keys.update(gained)


class StepNumbers:
    """Numbers from 1 for what nobody has to keep: `next` is a C function, 0.04 us a call.

    They go on from run to run of a connection; `count` has those of one run, which `restart_count` begins.
    """

    def __init__(self) -> None:
        self._count = itertools.count(1)
        self._before = 0
        self.next = self._count.__next__
        self.next_for_row = partial(next, self._count)  # the same, called with a column of the row that is counted

    def restart_count(self, count: int = 0) -> None:
        """Begins to count, where so many were given already."""
        self._before += self.count - count

    @property
    def count(self) -> int:
        """How many were given in this run."""
        return int(self._count.__reduce__()[1][0]) - 1 - self._before


class SearchState:
    """Steps are numbered from 1; 0 is the parent of the first ones.

    One object serves a connection: what SQLite calls are its methods themselves, for a function around them would
    cost as much as they do. `begin_search` makes it ready for one execution; `save_state` and `restore_state` serve one
    inside of another.
    """

    # What stands in a slot is found faster than in a dict: a search over edges runs a quarter fewer instructions.
    __slots__ = (
        *("compared", "current_path", "expanded", "expansions", "generated", "highest", "keyed", "keys"),
        *("last_dropped", "late_pruned", "met", "numbers", "overestimated", "parents", "pruned", "returned"),
        *("rows", "steps_per_state", "taken", "tested_key", "tested_row", "trials"),
    )

    def __init__(self) -> None:
        self.numbers = StepNumbers()  # of steps that are not kept
        self.expansions = StepNumbers()  # of steps that went on, the start among them
        self.trials = StepNumbers()  # of steps that are counted one by one
        self.begin_search({})

    def save_state(self) -> tuple[Any, ...]:
        """What `restore_state` gives back to an execution that another one has interrupted."""
        counts = [numbers.count for numbers in (self.numbers, self.expansions, self.trials)]
        return counts, [getattr(self, name) for name in self.__slots__]

    def restore_state(self, saved: tuple[Any, ...]) -> None:
        counts, values = saved
        for numbers, count in zip((self.numbers, self.expansions, self.trials), counts, strict=True):
            numbers.restart_count(count)
        for name, value in zip(self.__slots__, values, strict=True):
            setattr(self, name, value)

    def begin_search(self, keys: Mapping[Any, Any], keyed: bool = False) -> None:
        """Starts afresh.

        `keys` has those SQL values that equal another one, with the one that stands for both. `keyed`: something else
        than rows is compared, and kept beside them in `compared`.
        """
        for numbers in (self.numbers, self.expansions, self.trials):
            numbers.restart_count()
        self.keys = keys
        self.tested_row: Any = ()  # the row that a repeat test let pass, or its only value
        self.tested_key: Any = ()
        self.generated = 0
        self.expanded = 0
        self.pruned = 0
        self.late_pruned = 0  # of these, the steps that had entered
        self.highest = float("-inf")  # the greatest total that A* expected of a path through a step that was taken
        self.overestimated = False  # whether a path was found that costs less
        self.parents = [0]  # of the steps that entered, by number
        self.rows: list[tuple[Any, ...]] = [()]
        self.met: dict[Any, Any] = {}  # row -> the step that reached it, or its best rank
        self.taken: dict[Any, Any] = {}  # row -> the rank at which it was taken
        self.returned: set[Any] = set()
        self.keyed = keyed
        self.compared: list[Any] = [()] if keyed else self.rows
        self.current_path = StepPathKeys(self.parents, self.compared, self._make_key)
        self.last_dropped = 0
        self.steps_per_state = 1  # where all states have as many

    def add_counts(self, stats: Stats, book: Bookkeeping, results: int) -> None:
        """Adds what the search has done; `results` is the number of paths."""
        stats.generated += self.count_generated(book, results)
        stats.expanded += self._count_continued(book, results)
        stats.pruned += self.pruned

    def count_generated(self, book: Bookkeeping, results: int) -> int:
        """The number of steps that have been generated until now."""
        generated = self.generated + self.trials.count
        if not generated and book.counts == "product":
            return self.steps_per_state * self._count_continued(book, results)
        if not generated and book.counts == "entered":
            return self._count_entered(book, results) + self.pruned - self.late_pruned
        return generated

    def _count_continued(self, book: Bookkeeping, results: int) -> int:
        entered = self._count_entered(book, results) if book.all_go_on else self.expanded
        return entered + self.expansions.count + book.uncounted_starts

    def _count_entered(self, book: Bookkeeping, results: int) -> int:
        if book.steps_unkept:
            return self.numbers.count
        return results if book.all_results else len(self.rows) - 1

    @property
    def entered(self) -> int:
        """The number of steps that have entered until now."""
        return len(self.rows) - 1

    def _make_key(self, row: Any) -> Hashable:
        """The key of a row, or of what is its key already; that of a single value is the value itself."""
        if type(row) is tuple:
            if len(row) > 1:
                return tuple(map(self.keys.get, row, row)) if self.keys else row
            (row,) = row
        return self.keys.get(row, row) if self.keys else row  # type: ignore[no-any-return]

    def get_kept_steps(self) -> KeptSteps:
        return KeptSteps(self.parents, self.rows)

    # --- steps that are evaluated on entering ----------------------------------------------------------

    def expand(self, guess: Any) -> int:
        """Counts what goes on, the start included; always true. `guess` is the total that A* expects.

        Without one `expand` is a C function, which SQLite picks by the number of arguments.
        """
        if guess > self.highest:
            self.highest = guess
        return self.expansions.next()

    def enter(self, parent: int, *row: Any) -> int:
        """Notes a step that enters the queue and gives its number."""
        number = len(self.parents)
        self.parents.append(parent)
        self.rows.append(row)
        if self.keyed:
            self.compared.append(self.tested_key)
        return number

    def enter_first(self, parent: int) -> int:
        """The same for the first step to the row that `reached` was called with last."""
        number, row = len(self.parents), self.tested_row
        self.met[self.tested_key] = number
        self.parents.append(parent)
        self.rows.append(row if type(row) is tuple else (row,))
        if self.keyed:
            self.compared.append(self.tested_key)
        return number

    def enter_first_row(self, parent: int, *row: Any) -> int:
        """The same where that was the key of another row; SQLite picks by the number of arguments."""
        number = self.enter_first(parent)
        self.rows[number] = row
        return number

    def enter_best(self, parent: int, rank: Any) -> int:
        """The same for the best step so far to the row that `improves` was called with last."""
        # Written out: with a call of `enter_first` a search over a grid takes a tenth longer.
        self.met[self.tested_key] = rank
        number, row = len(self.parents), self.tested_row
        self.parents.append(parent)
        self.rows.append(row if type(row) is tuple else (row,))
        if self.keyed:
            self.compared.append(self.tested_key)
        return number

    def enter_best_row(self, parent: int, rank: Any, *row: Any) -> int:
        """The same where that was the key of another row."""
        number = self.enter_best(parent, rank)
        self.rows[number] = row
        return number

    def visit(self, *key: Any) -> int:
        """Lets the state of a start count as visited; false if another start has it."""
        found = self._make_key(key)
        if found in self.met:
            return 0
        self.met[found] = self.taken[found] = float("-inf")
        self.current_path.keys.add(found)
        return 1

    def reached(self, *row: Any) -> int:
        """Whether a step has reached the row."""
        key = self._make_key(row) if self.keys else row
        if key in self.met:
            self.pruned += 1
            return 1
        self.tested_row, self.tested_key = row, key
        return 0

    def reached_value(self, value: Any) -> int:
        """The same of a row with one value, which is its own key: without tuples it takes 0.6 of the time.

        SQLite picks it, and the like of other tests, by the number of arguments.
        """
        key = self.keys.get(value, value) if self.keys else value
        if key in self.met:
            self.pruned += 1
            return 1
        self.tested_row, self.tested_key = value, key
        return 0

    def arrive(self, step: int) -> int:
        """Whether a step that is taken is the first to reach its row; it then is the one that has."""
        if not step or self.met.setdefault(self._make_key(self.compared[step]), step) == step:
            return 1
        if step != self.last_dropped:  # it is called for the result and for the children
            self.last_dropped = step
            self.late_pruned += 1
            self.pruned += 1
        return 0

    def closed(self, rank: Any, *row: Any) -> int:
        """Whether the row was taken at a rank so good that no path through a step of this rank can be better."""
        taken = self.taken.get(self._make_key(row))
        if taken is None or taken > rank:
            return 0
        self.pruned += 1
        return 1

    def improves(self, rank: Any, *row: Any) -> int:
        """Whether the step is better than the best to the row so far."""
        key = self._make_key(row) if self.keys else row
        if rank < self.met.get(key, inf):
            self.tested_row, self.tested_key = row, key
            return 1
        self.pruned += 1
        return 0

    def improves_value(self, rank: Any, value: Any) -> int:
        """The same of a row with one value."""
        key = self.keys.get(value, value) if self.keys else value
        if rank < self.met.get(key, inf):
            self.tested_row, self.tested_key = value, key
            return 1
        self.pruned += 1
        return 0

    def still_best(self, step: int, rank: Any, guess: Any = None) -> int:
        """Whether a step that is taken is still the best to its row; the start is. `guess` is that of `expand`."""
        if step:
            key = self._make_key(self.compared[step])
            if self.met[key] < rank:
                return 0
            self.taken[key] = rank
        self.expanded += 1
        if guess is not None and guess > self.highest:
            self.highest = guess
        return 1

    def give(self, total: Any) -> int:
        """Looks at the total of a result of A*; always true."""
        if is_overestimate(self.highest, total):
            self.overestimated = True
        return 1

    def give_once(self, step: int, rank: Any) -> int:
        """Whether a step is still the best to its row, which was not given out before."""
        key = self._make_key(self.compared[step])
        if self.met[key] < rank:
            return 0
        self.taken[key] = rank
        self.give(rank)  # of a row that was given out, too: this path to it is cheaper
        if key in self.returned:
            return 0
        self.returned.add(key)
        return 1

    def on_path(self, parent: int, *row: Any) -> int:
        """Whether the row occurs on the path to the parent."""
        current_path = self.current_path
        if parent != current_path.end:
            current_path.follow_to(parent)
        key = self._make_key(row) if self.keys else row
        if key in current_path.keys:
            self.pruned += 1
            return 1
        self.tested_key = key
        return 0

    def is_value_on_path(self, parent: int, value: Any) -> int:
        """The same of a row with one value."""
        current_path = self.current_path
        if parent != current_path.end:
            current_path.follow_to(parent)
        key = self.keys.get(value, value) if self.keys else value
        if key in current_path.keys:
            self.pruned += 1
            return 1
        self.tested_key = key
        return 0

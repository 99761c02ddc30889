"""What a search loop and the step function of a query owe each other, and steps that are evaluated once for each state.

The generator of step functions (runtime/python/step_function.py) writes one Python function for each query:

    expand(state, closed)               -> steps    every search but the next two
    expand(state, closed, best, total)  -> steps    COST or PROBABILITY with UNIQUE
    expand(state, closed, choose)       -> steps    MEMORIZE; `choose(elements, state)` leaves elements out, or is None
    expand(state, closed, drop)         -> steps    NO CYCLE, remembered steps; `drop(key)` hears of steps without a
    trace

A step is `row, key, goal, goes_on, after, weight, estimate, last`:

    row       the frozen row, see values.py
    key       what is compared: the value of a row of one column, else the row, or what BY names
    goal      whether a path may end here; goes_on: whether it goes on from the state `after`
    weight    COST or PROBABILITY; with `best` the new total; estimate: HEURISTIC, None where the step stops
    last      the elements and the state before, as values, where GROUP BY or ORDER BY ask for the last step

What a search does not have is None. So of `SELECT n + this FROM [1, 2] WHERE n + this == 3 START WITH n = 0 CONNECT BY
UNIQUE n = n + this` the steps from the start are

    (1,), 1, False, True, (1,), None, None, None
    (2,), 2, False, True, (2,), None, None, None

**The caller guarantees**
- `state` is a start or an `after` of this function: a tuple of the frozen values of the START WITH variables in their
  order, then whether it is a start where START WITH has a condition. Nobody changes it.
- It draws the steps of a state in order, and the next one only when it has done with the one before: what it adds to
  `closed` or `best` meanwhile is seen by the steps that follow, siblings included. It may leave the iterator for other
  states and come back (depth first), or drop it (MAXIMUM).
- `closed` answers `key in closed`: `()` where rows may repeat, the rows reached so far with UNIQUE and MEMORIZE, those
  on the path to `state` with NO CYCLE (while its steps are drawn). Where there is `best`, it maps rows to the best
  totals so far, and the caller enters a step that it is given at once. With a heuristic `closed` maps rows to the
  totals at which they were taken; else it is `best`, where a row that was taken has TAKEN.
- With UNIQUE and MEMORIZE it expands a key once. A start has no row, so its state may come once more; where BY names
  the state its key counts as one that is reached.

**It must return** for each element of the state that meets the condition of CONNECT BY, in source order or that of
ORDER SIBLINGS BY, one step or none:
- none, and one more is `pruned`, if the key is closed (with a heuristic: taken at no more than `total`). Where rows are
  compared STOP WITH and WHERE are not evaluated then, and MEMORIZE is given the step all the same, for it is an edge,
  with `goal` None and its weight. Where BY names a key it is known last, and MEMORIZE is given all steps.
- none if it stops without being a goal, or if its probability is 0; pruned, if its total is not below `best[key]`.

**Order and laziness.** When a step is drawn its clauses are evaluated in the order of language.md, 7, guards included,
each call once, and nothing of the elements after it; what mentions only the state when it is first needed, once for
the state. Where all clauses are steady the order may differ where no guard forbids it: `best` is looked up before STOP
WITH where COST cannot fail, and before HEURISTIC and CONNECT BY.

**Errors** pass through as they are; `finally` has put the counters right. Places are those of the script's positions in
the code. A function's result is made a value before any clause sees it, or refused by the function's name.

**Counting.** It counts `generated` (elements drawn), `pruned`, `expanded` (calls) and the calls of
functions. It looks at the clock and at `max_steps` every so many elements, and before each call of the user's where
there is a deadline. It returns the number of elements (`StopIteration.value`). Who draws none for long calls `check`.

**The text of a loop** is put around the code of the function where that pays (runtime/python/step_inlining.py). So it
has one `for` over `expand(...)`, takes a step apart in its head, does not `continue` there, names what it wants of
`problem` at its beginning, and calls the state `state`, which may stand for several variables in a tuple.

The step function with notes (runtime/python/search_compiler.py) takes from a note what is there, and puts there what it
evaluates. So a file is told of each step, calls are made by other processes beforehand, and a step that failed can be
taken again. That is for searches in which nobody can notice when a clause is evaluated: all functions of the user
are immutable or stable, nothing is assigned.

The 9 moves of Hanoi with its states in any order take 0.4 of the time of a loop by hand; with a memory of calls 0.7.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Sequence
from collections.abc import Set as AbstractSet
from itertools import islice
from marshal import dumps
from typing import Any, NamedTuple, TypeAlias

from ss2sql.errors import Stopped
from ss2sql.fast_dataclasses import dataclass
from ss2sql.language import plan
from ss2sql.language.values import UNSET, FrozenRow, State

# --- what a search loop and the step function of a query owe each other, and notes of what clauses came to
Step: TypeAlias = tuple[FrozenRow, Any, bool | None, bool, Any, Any, Any, Any]
Expand: TypeAlias = Callable[..., Iterator[Step]]
Found: TypeAlias = tuple[Sequence[FrozenRow], Any]  # the rows of a path, and the `last` of its last step


def _ignore_step_estimate(total: Any, guess: Any) -> None:
    """Nobody asks for results that are cheaper than was expected."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One run of a search: what a loop gets."""

    starts: Sequence[State]
    expand: Expand
    repeats: plan.Repeats
    likeliest: bool = False  # the weights are probabilities
    weighed: bool = False  # steps have a weight
    keyed: bool = False  # steps have a last part
    alone: bool = False  # the key is the only value of its row
    apart: bool = False  # the key is no row
    visits: bool = False  # the starts count as visited, by `key_of(start)`
    last: bool = False  # only the last row of a path is wanted
    key_of: Callable[[State], Any] = id
    found: Callable[[Any, Any], None] = (
        _ignore_step_estimate  # (total, guess): A* has found a result below its estimate
    )
    outdated: Callable[[State, Any], None] | None = None  # a step has waited in vain


# --- notes of steps: what the clauses of a step came to, kept beside the search so that nothing is evaluated twice
Note: TypeAlias = list[Any]  # the values of clauses, UNSET where they are not known; the last says whether it was made
Pair: TypeAlias = tuple[Note, Any]  # of a note and an element, a tuple where there are several sources
Last: TypeAlias = tuple[Any, ...]  # the elements of a step and the state before it


class Places(NamedTuple):
    """Where in a note everything is, and the number of its values.

    `rows` are the columns of the row, `states` the variables after the step, None for those that stay.
    """

    rows: tuple[int, ...]
    states: tuple[int | None, ...]
    size: int


class NotedSearch:
    """A search whose steps are noted.

    `expand(state, closed, notes)` is the step function, see above; it calls `notes.get_known_pairs()` for the pairs of
    the state, and where there are none `notes.begin_state(elements)`. `goal(start)` and `before(last)` go backwards,
    where that is possible: the state at the goal, the state before a step.
    """

    def __init__(
        self,
        expand: Callable[[State, Container[Any], Any], Iterator[Step]],
        goal: Callable[[State], State] | None,
        before: Callable[[Last], State | None] | None,
        places: Places,
        sources: int,
    ) -> None:
        self.expand, self.goal, self.before = expand, goal, before
        self.places, self.sources = places, sources

    def row(self, note: Note) -> tuple[Any, ...]:
        """The row of a step that was evaluated."""
        return tuple([note[at] for at in self.places.rows])

    def after(self, note: Note, before: State) -> State | None:
        """The state after a step, None where CONNECT BY was not evaluated."""
        found = tuple([old if at is None else note[at] for at, old in zip(self.places.states, before, strict=True)])
        return None if any(value is UNSET for value in found) else found

    def make_blank_note(self) -> Note:
        """A note of which nothing is known."""
        return [*[UNSET] * self.places.size, False]

    def read_elements(self, item: Any) -> tuple[Any, ...]:
        """The elements of all sources."""
        return item if self.sources > 1 else (item,)


class Notes:
    """The notes of some states, in the order in which they are expanded. `counted` is how often their steps count."""

    counted = 1

    def __init__(self, noted: NotedSearch) -> None:
        self.noted = noted
        self.pairs: list[list[Pair] | None] = []
        self.at = -1

    def begin_level(self, states: Sequence[State], chosen: Sequence[list[Any]] | None = None) -> None:
        """Other states, frozen; `chosen` are the elements that are tried, where that is known."""
        self.at = -1
        self.pairs = [None for _ in states] if chosen is None else list(map(self.pair_elements, chosen))

    def get_known_pairs(self) -> list[Pair] | None:
        """The pairs of the next state, as far as there are."""
        self.at += 1
        return self.pairs[self.at]

    def begin_state(self, items: list[Any]) -> list[Pair]:
        """The pairs of this state, whose elements are these."""
        found = self.pairs[self.at] = self.pair_elements(items)
        return found

    def pair_elements(self, items: list[Any]) -> list[Pair]:
        """The elements of a state with blank notes."""
        return [(self.noted.make_blank_note(), item) for item in items]


def list_step_elements(noted: NotedSearch, start: State) -> list[Any]:
    """The elements of a frozen state, each as it stands in a pair; nothing else is evaluated."""
    notes = Elements(noted)
    for _ in noted.expand(start, (), notes):
        raise AssertionError("there is no step without elements")
    return notes.items


class Elements(Notes):
    """Takes the elements and gives none."""

    counted = 0
    items: list[Any]

    def get_known_pairs(self) -> None:
        return None

    def begin_state(self, items: list[Any]) -> list[Pair]:
        self.items = items
        return []


# --- steps that are evaluated once for each state, where a search may come to a state again and calls are expensive
class KnownSteps(NamedTuple):
    """All steps of a state: those that leave a trace, the keys of the others, the keys of all, and the number of its
    elements.
    """

    steps: list[Step]
    dropped: list[Any]
    keys: frozenset[Any]
    elements: int


class MemoizedSteps:
    """`expand` of a search whose clauses are all steady, for whoever expands a state again and again.

    `look(elements)` counts a state that was known, and looks at the clock; `prune(steps)` counts pruned steps. At most
    so many states are kept as `most`. `compares`: with NO CYCLE steps to rows on the path are left out, which are the
    same rows whenever a step of a state is drawn.
    """

    def __init__(
        self, expand: Expand, most: int, look: Callable[[int], None], prune: Callable[[int], None], compares: bool
    ) -> None:
        self._expand, self._most, self._look, self._prune = expand, most, look, prune
        self._compares = compares
        self._known: dict[bytes, KnownSteps] = {}

    def expand(self, state: State, closed: AbstractSet[Any]) -> Any:
        """The steps; they are known to the next who asks when all of them were drawn."""
        try:
            key = dumps(state, 2)
        except ValueError:  # there are objects inside
            return self._expand(state, closed, ignore_step_key) if self._compares else self._expand(state, closed)
        known = self._known.get(key)
        if known is None:
            return self._draw_open(key, state, closed) if self._compares else self._draw_steps(key, state, None)
        self._look(known.elements)
        return self._choose_open(known, closed) if self._compares else known.steps

    def _choose_open(self, known: KnownSteps, closed: AbstractSet[Any]) -> list[Step]:
        met = known.keys & closed
        if not met:
            return known.steps
        steps = [step for step in known.steps if step[1] not in met]
        self._prune(len(known.steps) - len(steps) + sum(map(known.dropped.count, met)))
        return steps

    def _draw_steps(self, key: bytes, state: State, dropped: list[Any] | None) -> Iterator[Step]:
        steps: list[Step] = []
        drawn = self._expand(state, ()) if dropped is None else self._expand(state, (), dropped.append)
        while True:
            try:
                step = next(drawn)
            except StopIteration as end:
                elements = end.value
                break
            steps.append(step)
            yield step
        if len(self._known) >= self._most:
            self._known.clear()
        keys = frozenset(() if dropped is None else [*dropped, *(step[1] for step in steps)])
        self._known[key] = KnownSteps(steps, dropped or [], keys, elements)

    def _draw_open(self, key: bytes, state: State, closed: AbstractSet[Any]) -> Iterator[Step]:
        """The same without steps to rows on the path; one may fail, which the written order does not evaluate."""
        generated = pruned = 0
        dropped: list[Any] = []
        try:
            for step in self._draw_steps(key, state, dropped):
                if step[1] in closed:
                    pruned += 1
                else:
                    generated += 1
                    yield step
            pruned += sum(one in closed for one in dropped)
        except Stopped:
            raise
        except Exception:  # nothing of the state is remembered
            pruned = 0
            yield from islice(self._expand(state, closed, ignore_step_key), generated, None)
        finally:
            self._prune(pruned)


def ignore_step_key(key: object) -> None:
    """Nobody wants to hear it."""

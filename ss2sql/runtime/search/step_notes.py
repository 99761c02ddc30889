"""Notes of steps: what the clauses of a step came to, kept beside the search so that nothing is evaluated twice.

The step function with notes (runtime/python/noted_steps.py) takes from a note what is there, and puts there what it
evaluates. So a graph in a file is read first, calls are made by other processes beforehand, and a step that failed can
be taken again. That is for searches in which nobody can notice when a clause is evaluated: all functions of the user
are immutable or stable, nothing is assigned.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Sequence
from operator import itemgetter
from typing import Any, NamedTuple, TypeAlias

from ss2sql.fast_dataclasses import dataclass
from ss2sql.language.frozen_values import UNSET, Shape, State
from ss2sql.language.rows import Row
from ss2sql.runtime.search.step_contract import Step

Note: TypeAlias = list[Any]  # the values of clauses, UNSET where they are not known; the last says whether it was made
Pair: TypeAlias = tuple[Note, Any]  # of a note and an element, a tuple where there are several sources
Last: TypeAlias = tuple[Any, ...]  # the elements of a step and the state before it


class Places(NamedTuple):
    """Where in a note everything is, and the number of its values.

    `rows` are the columns of the row, `frozen` the same as they are frozen in `shapes`, None where they are not noted;
    `states` the variables after the step, None for those that stay; `clauses` are `stop`, `goal` and `weight`.
    """

    rows: tuple[int, ...]
    frozen: tuple[int | None, ...]
    shapes: tuple[Shape, ...]
    states: tuple[int | None, ...]
    clauses: dict[str, int]
    size: int


@dataclass(frozen=True, slots=True)
class NotedSearch:
    """A search whose steps are noted.

    `expand(state, closed, notes)` is the step function, see runtime/search/step_contract.py; it calls
    `notes.get_known_pairs()` for the pairs of the state, and where there are none `notes.begin_state(elements)`.
    `goals(start)` and `before(last)` go backwards, where that is possible: the states at the goal, the state before a
    step. `probable`: the weight is a probability. `plain`: all elements are values. `row(note)` is the row of a step
    that was evaluated, `after(note, before)` the state after it, None where CONNECT BY was not evaluated.
    """

    expand: Callable[[State, Container[Any], Any], Iterator[Step]]
    goals: Callable[[State], list[State]] | None
    before: Callable[[Last], State | None] | None
    places: Places
    probable: bool
    sources: int
    plain: bool

    row: Callable[[Note], Row]
    after: Callable[[Note, State], State | None]
    nothing: Note

    def make_blank_note(self) -> Note:
        """A note of which nothing is known."""
        return self.nothing.copy()

    def read_elements(self, item: Any) -> tuple[Any, ...]:
        """The elements of all sources."""
        return item if self.sources > 1 else (item,)


def make_noted_search(
    expand: Callable[..., Iterator[Step]],
    goals: Any,
    before: Any,
    places: Places,
    probable: bool,
    sources: int,
    plain: bool,
) -> NotedSearch:
    """A search whose steps are noted, from what is generated."""
    states = places.states
    take, whole = _make_getter(places.rows), None if None in states else _make_getter(states)

    def read_next_state(note: Note, before: State) -> State | None:
        if whole is not None:
            found = whole(note)
        else:
            found = tuple([old if at is None else note[at] for at, old in zip(states, before, strict=True)])
        for value in found:
            if value is UNSET:
                return None
        return found

    nothing = [*[UNSET] * places.size, False]
    return NotedSearch(expand, goals, before, places, probable, sources, plain, take, read_next_state, nothing)


def _make_getter(places: Sequence[Any]) -> Callable[[Note], tuple[Any, ...]]:
    """What takes the values at some places of a note."""
    if len(places) == 1:
        return lambda note: (note[places[0]],)
    return itemgetter(*places) if places else lambda note: ()


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
        self.pairs = [None for _ in states] if chosen is None else [self.pair_elements(*o) for o in enumerate(chosen)]

    def get_known_pairs(self) -> list[Pair] | None:
        """The pairs of the next state, as far as there are."""
        self.at += 1
        return self.pairs[self.at]

    def begin_state(self, items: list[Any]) -> list[Pair]:
        """The pairs of this state, whose elements are these."""
        found = self.pairs[self.at] = self.pair_elements(self.at, items)
        return found

    def pair_elements(self, at: int, items: list[Any]) -> list[Pair]:
        """The same for the elements of one of the states."""
        return [(self.noted.make_blank_note(), item) for item in items]


def list_elements(noted: NotedSearch, start: State) -> list[Any]:
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

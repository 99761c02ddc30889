"""The steps of a block of states, tried before they are taken: which calls will they ask for?

Each clause of a step is tried by itself, so a call that is not known yet costs that clause and what depends on it. What
the search will not ask is not asked here: rows that are known, the next state of a step that stops. Two steps of the
block may lead to the same row; the first one of them that leaves a trace is asked, as it will be by the search. So
behind a step whose row is not known yet nothing is asked but rows.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Hashable, Iterable, Iterator
from contextlib import contextmanager
from typing import Any, TypeAlias

from ss2sql.errors import Stopped
from ss2sql.runtime.frozen import State
from ss2sql.runtime.memorize.hunt import Hunt
from ss2sql.runtime.memorize.pieces import Last, Pieces

Elements: TypeAlias = Callable[[State], Iterable[Last]]


class PendingError(BaseException):
    """A result is not known yet. Nothing but the trial of a clause may take notice."""


class Ahead:
    """The steps from some states. `size` is the number of these."""

    def __init__(self, hunt: Hunt, seen: Container[Hashable], elements: Elements | None) -> None:
        assert hunt.pieces is not None
        self.hunt = hunt
        self.pieces: Pieces = hunt.pieces
        self.elements: Elements = elements or hunt.pieces.elements
        self.seen = seen
        self.size = 0
        self._states: list[tuple[State, list[Last], list[bool]]] = []
        self._claimed: dict[Hashable, bool] = {}  # rows that steps of the block lead to; True: that is certain
        self._settled: dict[tuple[int, int], Hashable | None] = {}  # the claims of steps that nothing is missing of
        self._failed = self._unknown = False

    def add(self, state: State) -> None:
        """Tries the steps from one more state, unless they are remembered."""
        self.size += 1
        if self.hunt.run.knows is None or not self.hunt.run.knows(state):
            self._states.append((state, [], [False]))
            self._try(len(self._states) - 1)

    def again(self) -> None:
        """Tries once more whatever depended on calls that were not known."""
        self._claimed.clear()
        self._failed = self._unknown = False
        for place in range(len(self._states)):
            self._try(place)

    def _try(self, place: int) -> None:
        """Tries the steps from a state. Where one fails, the search ends, so nothing behind it is of interest."""
        if self._failed:
            return
        try:
            for number, last in enumerate(self._elements(place)):
                if (place, number) in self._settled:
                    claim = self._settled[place, number]
                    if claim is not None:
                        self._claimed[claim] = True
                else:
                    self._step(place, number, last)
        except PendingError:
            self._unknown = True
        except Stopped:
            raise
        except Exception:
            self._failed = True

    def _elements(self, place: int) -> Iterator[Last]:
        """The elements of a state, kept as soon as all are there."""
        state, known, complete = self._states[place]
        if self.hunt.run.knows is not None and self.hunt.run.knows(state):
            return
        if complete[0]:
            yield from known
            return
        for number, last in enumerate(self.elements(state)):
            if number == len(known):
                known.append(last)
            yield last
        complete[0] = True

    def _step(self, place: int, number: int, last: Last) -> None:
        """Tries the clauses of a step, in the order of the search."""
        pieces, missing = self.pieces, False
        try:
            row, key = pieces.row(last)
        except PendingError:
            self._unknown = True
            return
        if self._unknown:
            return
        if key in self.seen or key in self._claimed:
            if pieces.weigh is not None and self._claimed.get(key, True):
                try:
                    pieces.weigh(last, row)
                except PendingError:
                    return
            if key in self.seen:
                self._settled[place, number] = None
            return
        ends: Any = False
        goal: Any = None
        try:
            ends = pieces.ends is not None and pieces.ends(last, row, None)
        except PendingError:
            ends, missing = None, True
        try:
            goal = (None if ends is None else not ends) if pieces.is_goal is None else pieces.is_goal(last, row, None)
        except PendingError:
            missing = True
        if ends and goal is False:
            self._settled[place, number] = None
            return
        possible = True
        if pieces.weigh is not None and (ends is False or not missing):
            try:
                if not pieces.weigh(last, row) and pieces.probable:
                    self._settled[place, number] = None
                    return
            except PendingError:
                missing, possible = True, not pieces.probable
        if ends is False and possible:
            try:
                pieces.follow(last, row)
            except PendingError:
                missing = True
        self._claimed[key] = not missing
        if not missing:
            self._settled[place, number] = key

    @contextmanager
    def uncounted(self) -> Iterator[None]:
        """For the time of trying, steps do not count."""
        stats, flush = self.hunt.stats, self.hunt.flush
        flush()
        before = stats.generated, stats.expanded, stats.pruned
        try:
            yield
        finally:
            flush()
            stats.generated, stats.expanded, stats.pruned = before

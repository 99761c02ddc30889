"""Growing the graph of MEMORIZE from both ends, where the goal is known and steps can be undone (regression.py).

From the goal backwards only states are found: which elements lead from them towards the goal, and how many steps they
take to it at least. Nothing is decided there. The graph itself grows forwards as ever; but as soon as the two depths
together are the bound, a state is only expanded by those of its elements that still lead to the goal in time. What the
graph then lacks lies on no path from the start to the goal, so its paths, and their order, are the same.

The side with fewer states in its last level goes on. Of the two halves each reaches about the square root of the
states that the whole would: bidirectional search as Pohl described it in 1971.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Any

from ss2sql.errors import Stopped
from ss2sql.language.frozen_values import State
from ss2sql.runtime.run.run_state import GraphLevel
from ss2sql.runtime.search.search_run import SearchRun
from ss2sql.runtime.search.step_notes import NotedSearch, list_elements

MAX_ELEMENTS = 100_000  # of a state; they are kept as a list
CHECK_EVERY = 255


class BackwardSearch:
    """The states from which the goal is reached, level by level.

    `depth` is the number of levels, `last` the states of the last one. `edges` gives for the frozen state before a step
    the position of its element and the number of steps to the goal, this one included.
    """

    def __init__(self, search_run: SearchRun, noted: NotedSearch, items: list[Any]) -> None:
        assert noted.goals is not None
        assert noted.before is not None
        self.search_run, self.items, self.before = search_run, items, noted.before
        self.elements = list(map(noted.read_elements, items))
        self.key = search_run.shapes.freeze_state
        self.depth = 0
        self.edges: dict[Hashable, list[tuple[int, int]]] = {}
        self.seen: set[Hashable] = set()
        self.met: set[Hashable] = set()  # on the way from the start
        self.last: list[State] = []
        for goal in noted.goals(search_run.start):
            key = self.key(goal)
            if key not in self.seen:
                self.seen.add(key)
                self.last.append(goal)

    def add_level(self) -> None:
        self.depth += 1
        depth, before, key_of, edges, seen = self.depth, self.before, self.key, self.edges, self.seen
        level: list[State] = []
        steps = 0
        for number, state in enumerate(self.last):
            if not number & CHECK_EVERY:
                self.search_run.check()
            for position, elements in enumerate(self.elements):
                earlier = before(elements + state)
                if earlier is None:
                    continue
                steps += 1
                key = key_of(earlier)
                known = edges.get(key)
                if known is None:
                    edges[key] = [(position, depth)]
                    if key not in seen:
                        seen.add(key)
                        level.append(earlier)
                else:
                    known.append((position, depth))
        self.last = level
        self.search_run.stats.backward.append(GraphLevel(len(level), steps))

    def has_all_states(self, depth: int) -> bool:
        """Whether the backward search has reached all states that so many steps from the start can have."""
        bound = self.search_run.bound
        return not self.last or (bound is not None and depth + self.depth >= bound)

    def choose_elements(self, depth: int, elements: list[Any], state: State) -> list[Any]:
        """The elements of a frozen state of that level from which the goal can be reached in time."""
        bound = self.search_run.bound
        assert bound is not None
        known = self.edges.get(state, ())
        return [elements[position] for position in sorted(place for place, left in known if depth + left <= bound)]


def start_backward_search(search_run: SearchRun) -> BackwardSearch | None:
    """The search from the goal; None if there is none or, with a note, if it cannot start.

    It evaluates the goal before the first step, so an error here need not be one of the forward search.
    """
    noted = search_run.noted
    if noted is None or noted.goals is None:
        return None
    try:
        items = list_elements(noted, search_run.problem.starts[0])
        if len(items) <= MAX_ELEMENTS:
            return BackwardSearch(search_run, noted, items)
        _note_failure(search_run, f"a state has more than {MAX_ELEMENTS:,} elements")
    except Stopped:
        raise
    except Exception as error:
        _note_failure(search_run, f"what is known of the goal failed: {type(error).__name__}: {error}")
    return None


def balance_backward_search(backward: BackwardSearch, depth: int, level: Sequence[State]) -> BackwardSearch | None:
    """Grows the backward search while its last level is no larger than `level` of the forward search.

    Gives None, with a note, after an error or beyond `max_rows`. The script need not reach the states that only the
    backward search meets, so its errors are not those of the script: the forward search goes on alone.
    """
    most = backward.search_run.run.max_rows
    new = set(level) - backward.met  # more than one row may lead to a state
    backward.met |= new
    try:
        while not backward.has_all_states(depth) and len(backward.last) <= len(new):
            backward.add_level()
            if most is not None and len(backward.seen) > most:
                _note_failure(backward.search_run, f"more than max_rows={most} states lead to the goal")
                return None
    except Stopped:
        raise
    except Exception as error:
        _note_failure(backward.search_run, f"going back from the goal failed: {type(error).__name__}: {error}")
        return None
    return backward


def _note_failure(search_run: SearchRun, reason: str) -> None:
    search_run.stats.notes.append(f"searched from the start only: {reason}")
    search_run.stats.backward.clear()

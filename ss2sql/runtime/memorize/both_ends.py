"""Growing the graph of MEMORIZE from both ends, where the goal is known and steps can be undone (reverse.py).

From the goal backwards only states are found: which elements lead from them towards the goal, and how many steps they
take to it at least. Nothing is decided there. The graph itself grows forwards as ever; but as soon as the two depths
together are the bound, a state is only asked for those of its elements that still lead to the goal in time. What the
graph then lacks lies on no path from the start to the goal, so its paths, and their order, are the same.

The side with fewer states in its last level goes on. Of the two halves each reaches about the square root of the
states that the whole would: bidirectional search as Pohl described it in 1971.
"""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Any

from ss2sql.errors import Stopped
from ss2sql.runtime.frozen import State
from ss2sql.runtime.memorize.hunt import Hunt
from ss2sql.runtime.memorize.notes import Noted, elements_of
from ss2sql.runtime.run import Level

MOST_ELEMENTS = 100_000  # of a state; they are kept as a list
CHECK_EVERY = 255


class WayBack:
    """The states from which the goal is reached, level by level.

    `depth` is the number of levels, `last` the states of the last one. `edges` gives for the frozen state before a step
    the position of its element and the number of steps to the goal, this one included.
    """

    def __init__(self, hunt: Hunt, noted: Noted, items: list[Any]) -> None:
        assert noted.goals is not None
        assert noted.before is not None
        self.hunt, self.items, self.before = hunt, items, noted.before
        self.elements = list(map(noted.elements, items))
        self.key = hunt.shapes.freeze
        self.depth = 0
        self.edges: dict[Hashable, list[tuple[int, int]]] = {}
        self.seen: set[Hashable] = set()
        self.met: set[Hashable] = set()  # on the way from the start
        self.last: list[State] = []
        for goal in noted.goals(hunt.start):
            key = self.key(goal)
            if key not in self.seen:
                self.seen.add(key)
                self.last.append(goal)

    def grow(self) -> None:
        """One level more."""
        self.depth += 1
        depth, before, key_of, edges, seen = self.depth, self.before, self.key, self.edges, self.seen
        level: list[State] = []
        steps = 0
        for number, state in enumerate(self.last):
            if not number & CHECK_EVERY:
                self.hunt.check()
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
        self.hunt.stats.backward.append(Level(len(level), steps))

    def leads(self, depth: int) -> bool:
        """Whether all is known of the way on from states that so many steps have reached."""
        bound = self.hunt.bound
        return not self.last or (bound is not None and depth + self.depth >= bound)

    def chosen(self, depth: int, elements: list[Any], state: State) -> list[Any]:
        """Those elements of a frozen state of that level which still lead to the goal in time."""
        bound = self.hunt.bound
        assert bound is not None
        known = self.edges.get(state, ())
        return [elements[position] for position in sorted(place for place, left in known if depth + left <= bound)]


def way_back(hunt: Hunt) -> WayBack | None:
    """The way back from the goal; None where there is none, or, with a note, where it cannot be begun.

    It asks for the goal before the first step. What fails then may never be asked by the search itself.
    """
    noted = hunt.noted
    if noted is None or noted.goals is None:
        return None
    try:
        items = elements_of(noted, hunt.problem.starts[0])
        if len(items) <= MOST_ELEMENTS:
            return WayBack(hunt, noted, items)
        _give_up(hunt, f"a state has more than {MOST_ELEMENTS:,} elements")
    except Stopped:
        raise
    except Exception as error:
        _give_up(hunt, f"what is known of the goal failed: {type(error).__name__}: {error}")
    return None


def balanced(way: WayBack, depth: int, level: Sequence[State]) -> WayBack | None:
    """Lets the way back grow as long as its last level is no larger than that of the other side: `level`, frozen.

    Gives None, with a note, where that fails or takes more memory than `max_rows` allows. States that only the way back
    meets need not be states at all for the functions that see them, so what fails there says nothing about the search:
    it goes on from the start alone, and fails where the script says so.
    """
    most = way.hunt.run.max_rows
    new = set(level) - way.met  # more than one row may lead to a state
    way.met |= new
    try:
        while not way.leads(depth) and len(way.last) <= len(new):
            way.grow()
            if most is not None and len(way.seen) > most:
                _give_up(way.hunt, f"more than max_rows={most} states lead to the goal")
                return None
    except Stopped:
        raise
    except Exception as error:
        _give_up(way.hunt, f"going back from the goal failed: {type(error).__name__}: {error}")
        return None
    return way


def _give_up(hunt: Hunt, reason: str) -> None:
    hunt.stats.notes.append(f"searched from the start only: {reason}")
    hunt.stats.backward.clear()

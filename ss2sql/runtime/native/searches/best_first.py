"""Best-first search: the cheapest, respectively the likeliest, path is extended first.

Totals are made so that less is better: costs are added up from 0, probabilities multiplied from -1. A step
has two entries in the queue, its result at its total and its expansion at its total plus the estimate of
what remains. Among equals the step that was generated first comes first, its result before its expansion.
"""

from __future__ import annotations

from collections.abc import Container, Hashable, Iterator
from heapq import heappop, heappush
from itertools import count
from operator import add, mul
from typing import Any, TypeAlias

from ss2sql.runtime.native.searches.step import Found, Hunt, Place, State, Trail, path_to

# Rank, number of the step, whether it is the expansion; then total and place, and the state after the step of
# an expansion, or what GROUP BY and ORDER BY see of a result.
Entry: TypeAlias = tuple[Any, int, bool, Any, Place, Any]


def best_first(hunt: Hunt) -> Iterator[Found]:
    """Every path."""
    return _best_first(hunt, None)


def best_first_no_cycle(hunt: Hunt) -> Iterator[Found]:
    """Every path on which no row occurs twice."""
    return _best_first(hunt, Trail())


def _best_first(hunt: Hunt, trail: Trail | None) -> Iterator[Found]:
    total, combine = (-1, mul) if hunt.order == "probability" else (0, add)
    numbers = count()
    queue: list[Entry] = []
    seen: Container[Hashable] = () if trail is None else trail.keys
    state: State = hunt.start
    place: Place | None = None
    while True:
        if trail is not None:
            trail.move_to(place)
        depth = 1 if place is None else place[3] + 1
        for row, goal, following, key, weight, estimate, last in hunt.steps(state, seen):
            number, rank, new = next(numbers), combine(total, weight), (place, row, key, depth)
            if goal:
                heappush(queue, (rank, number, False, rank, new, last))
            if following is not None:
                heappush(queue, (rank + estimate, number, True, rank, new, following))
        while queue and not queue[0][2]:
            _, _, _, _, place, last = heappop(queue)
            yield path_to(place), last
        if not queue:
            return
        _, _, _, total, place, state = heappop(queue)


class Taken(dict[Hashable, Any]):
    """The totals at which rows were taken, and that of the present place.

    A row that was taken at a total so good need not be looked at again. Without a heuristic no total is less than one
    before it, so every row in here is such a row; with one, generated code compares.
    """

    present: Any = None


def best_first_unique(hunt: Hunt) -> Iterator[Found]:
    """Each row once, by its best path.

    A row enters the queue only if it is better than the best path to it so far; what is then no longer the
    best is neither given out nor expanded. With an inconsistent heuristic a row may be taken again.
    """
    likeliest, steps, stats = hunt.order == "probability", hunt.steps, hunt.stats
    total: Any = -1 if likeliest else 0
    number = 0
    queue: list[Entry] = []
    best: dict[Hashable, Any] = {}
    taken = Taken()
    given: set[Hashable] = set()
    state: State = hunt.start
    place: Place | None = None
    while True:
        taken.present = total
        for row, goal, following, key, weight, estimate, last in steps(state, taken):
            rank = total * weight if likeliest else total + weight
            known = best.get(key)
            if known is not None and known <= rank:
                stats.pruned += 1
                continue
            best[key] = rank
            number += 1
            new = (place, row, key, 0)
            if goal:
                heappush(queue, (rank, number, False, rank, new, last))
            if following is not None:
                heappush(queue, (rank + estimate, number, True, rank, new, following))
        while queue:
            _, _, expansion, total, place, rest = heappop(queue)
            key = place[2]
            if best[key] < total:
                continue
            taken[key] = total
            if expansion:
                state = rest
                break
            if key not in given:
                given.add(key)
                yield path_to(place), rest
        else:
            return

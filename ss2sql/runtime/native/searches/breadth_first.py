"""Breadth-first search: the oldest path is extended first, so shorter paths come before longer ones."""

from __future__ import annotations

from collections import deque
from collections.abc import Hashable, Iterator

from ss2sql.runtime.native.searches.step import Found, Hunt, Place, State, Trail, Way, path_to


def breadth_first(hunt: Hunt) -> Iterator[Found]:
    """Every path; ties in source order."""
    queue: deque[tuple[State, Way | None]] = deque([(hunt.start, None)])
    while queue:
        state, parent = queue.popleft()
        for row, goal, following, _, _, _, last in hunt.steps(state, ()):
            way = (parent, row)
            if goal:
                yield path_to(way), last
            if following is not None:
                queue.append((following, way))


def breadth_first_no_cycle(hunt: Hunt) -> Iterator[Found]:
    """Every path on which no row occurs twice."""
    trail = Trail()
    queue: deque[tuple[State, Place | None, int]] = deque([(hunt.start, None, 1)])
    while queue:
        state, parent, depth = queue.popleft()
        trail.move_to(parent)
        for row, goal, following, key, _, _, last in hunt.steps(state, trail.keys):
            place = (parent, row, key, depth)
            if goal:
                yield path_to(place), last
            if following is not None:
                queue.append((following, place, depth + 1))


def breadth_first_unique(hunt: Hunt) -> Iterator[Found]:
    """Each row once, by the first of its shortest paths."""
    reached: set[Hashable] = set()
    queue: deque[tuple[State, Way | None]] = deque([(hunt.start, None)])
    while queue:
        state, parent = queue.popleft()
        for row, goal, following, key, _, _, last in hunt.steps(state, reached):
            reached.add(key)
            way = (parent, row)
            if goal:
                yield path_to(way), last
            if following is not None:
                queue.append((following, way))

"""Breadth-first search: the oldest path is extended first, so shorter paths come before longer ones.

Ties are in source order.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from typing import Any

from ss2sql.runtime.run.search_paths import (
    START,
    PathKeys,
    collect_path_by_parents,
    follow_backpointers,
    make_start_backpointer,
)
from ss2sql.runtime.search.step_contract import Found, Problem


def breadth_first(problem: Problem) -> Iterator[Found]:
    """Every path, with NO CYCLE those without a repeated key."""
    expand = problem.expand
    trail = PathKeys() if problem.repeats == "no cycle" else None
    closed: Any = trail.keys if trail else ()
    queue: deque[Any] = deque()
    for state in problem.starts:
        queue.append((make_start_backpointer(problem.key_of(state)) if problem.visits else None, state))
    while queue:
        path, state = queue.popleft()
        if trail:
            trail.move_to(path)
        for row, key, goal, goes_on, after, _, _, last in expand(state, closed):
            new = (path, row, key, path[3] + 1 if path else 1) if trail else (path, row)
            if goal:
                yield (row,) if problem.last else follow_backpointers(new), last
            if goes_on:
                queue.append((new, after))


def breadth_first_unique(problem: Problem) -> Iterator[Found]:
    """Each key once, by the first of its shortest paths. `parents` maps each reached key to the key before it.

    A dict is twice as fast as a chain of tuples in an 8-puzzle, because the garbage collector has less to do.
    """
    expand = problem.expand
    parents: dict[Any, Any] = {}
    rows: Any = {} if problem.alone or problem.apart else None
    queue: deque[Any] = deque()
    for state in problem.starts:
        queue.append((START, state))
        if problem.visits:
            parents[problem.key_of(state)] = START
    while queue:
        before, state = queue.popleft()
        for row, key, goal, goes_on, after, _, _, last in expand(state, parents):
            parents[key] = before
            if problem.apart:
                rows[key] = row
            if goal:
                yield collect_path_by_parents(parents, key, rows, problem.last), last
            if goes_on:
                queue.append((key, after))

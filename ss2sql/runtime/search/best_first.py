"""Best-first search: the cheapest, respectively the likeliest, path is extended first.

Totals are made so that less is better: costs are added up from 0, probabilities multiplied from -1. Among equals the
smaller estimate comes first, then the step that was generated first, its result before its expansion.
"""

from __future__ import annotations

from collections.abc import Iterator
from heapq import heappop, heappush
from typing import Any

from ss2sql.runtime.run.search_paths import (
    START,
    PathKeys,
    collect_path_by_parents,
    follow_backpointers,
    make_start_backpointer,
)
from ss2sql.runtime.search.step_contract import Found, Problem

TAKEN = -2  # less than every total


def a_star(problem: Problem) -> Iterator[Found]:
    """A* over all paths: a result waits at its total, its expansion at total plus estimate.

    Without an estimate it is uniform cost. With NO CYCLE no key occurs twice on a path.
    """
    expand, found, likeliest = problem.expand, problem.found, problem.likeliest
    trail = PathKeys() if problem.repeats == "no cycle" else None
    closed: Any = trail.keys if trail else ()
    queue: list[Any] = []
    number, start = 0, -1 if likeliest else 0
    highest: Any = start
    for state in problem.starts:
        number += 1
        path = make_start_backpointer(problem.key_of(state)) if problem.visits else None
        queue.append((start, 0, number, True, start, state, path, None))
    while queue:
        guess, _, _, goes_on, total, state, path, last = heappop(queue)
        if not goes_on:
            if guess < highest:
                found(guess, highest)
            yield (path[1],) if problem.last else follow_backpointers(path), last
            continue
        if guess > highest:
            highest = guess
        if trail:
            trail.move_to(path)
        for row, key, goal, goes_on, after, weight, estimate, last in expand(state, closed):
            rank = total * weight if likeliest else total + weight
            number += 1
            new = (path, row, key, path[3] + 1 if path else 1) if trail else (path, row)
            if goal:
                heappush(queue, (rank, 0, number, False, rank, state, new, last))
            if goes_on:
                ahead = estimate if estimate is not None else 0
                heappush(queue, (rank + ahead, ahead, number, True, rank, after, new, None))


def uniform_cost_unique(problem: Problem) -> Iterator[Found]:
    """Dijkstra: each key once, by its best path. `best` has its total, or TAKEN once it has come out of the queue."""
    expand = problem.expand
    best: dict[Any, Any] = {}
    parents: dict[Any, Any] = {}  # of the keys that have come out
    rows: Any = {} if problem.alone or problem.apart else None
    queue: list[Any] = []
    number = 0
    for state in problem.starts:
        number += 1
        queue.append((-1 if problem.likeliest else 0, number, START, False, True, state, START, None))
        if problem.visits:
            best[problem.key_of(state)] = TAKEN
    while queue:
        total, _, key, goal, goes_on, state, before, last = heappop(queue)
        if key is not START:
            if best[key] is TAKEN:
                if problem.outdated:
                    problem.outdated(state, last)
                continue
            best[key] = TAKEN
            parents[key] = before
            if goal:
                yield collect_path_by_parents(parents, key, rows, problem.last), last
            if not goes_on:
                continue
        before = key
        for row, key, goal, goes_on, after, rank, _, last in expand(state, best, best, total):
            best[key] = rank
            if problem.apart:
                rows[key] = row
            number += 1
            heappush(queue, (rank, number, key, goal, goes_on, after, before, last))


def a_star_unique(problem: Problem) -> Iterator[Found]:
    """A*. The heuristic may be inconsistent: a key is taken again when a cheaper path to it appears."""
    expand, found = problem.expand, problem.found
    best: dict[Any, Any] = {START: 0}  # the least total of a path to each key so far
    taken: dict[Any, Any] = {}  # those at which keys came out of the queue
    closed: set[Any] = set()
    queue: list[Any] = []
    number = highest = 0
    for state in problem.starts:
        number += 1
        queue.append((0, 0, number, True, START, 0, None, None, state))
        if problem.visits:
            best[problem.key_of(state)] = taken[problem.key_of(state)] = 0
    while queue:
        guess, _, _, goes_on, key, total, path, last, state = heappop(queue)
        if best[key] < total:
            if problem.outdated:
                problem.outdated(state, last)
            continue
        taken[key] = total
        if guess > highest:
            highest = guess
        if not goes_on:
            if guess < highest:
                found(guess, highest)
            if key not in closed:
                closed.add(key)
                yield (path[1],) if problem.last else follow_backpointers(path), last
            continue
        for row, key, goal, goes_on, after, rank, estimate, last in expand(state, taken, best, total):
            best[key] = rank
            number += 1
            if goal:
                heappush(queue, (rank, 0, number, False, key, rank, (path, row), last, state))
            if goes_on:
                heappush(queue, (rank + estimate, estimate, number, True, key, rank, (path, row), None, after))


def greedy_best_first(problem: Problem) -> Iterator[Found]:
    """The step with the smallest estimate is extended first. A result is given out when it is generated."""
    expand, unique = problem.expand, problem.repeats == "unique"
    trail = PathKeys() if problem.repeats == "no cycle" else None
    closed: Any = trail.keys if trail else set()
    queue: list[Any] = []
    number = 0
    for state in problem.starts:
        number += 1
        if unique and problem.visits:
            closed.add(problem.key_of(state))
        queue.append((0, number, make_start_backpointer(problem.key_of(state)) if problem.visits else None, state))
    while queue:
        _, _, path, state = heappop(queue)
        if trail:
            trail.move_to(path)
        for row, key, goal, goes_on, after, _, estimate, last in expand(state, closed):
            if unique:
                closed.add(key)
            new = (path, row, key, path[3] + 1 if path else 1)
            if goal:
                yield (row,) if problem.last else follow_backpointers(new), last
            if goes_on:
                number += 1
                heappush(queue, (estimate, number, new, after))

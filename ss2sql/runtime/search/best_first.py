"""Best-first search: the cheapest, respectively the likeliest, path is extended first.

Totals are made so that less is better: costs are added up from 0, probabilities multiplied from -1. Among equals the
smaller estimate comes first, then the step that was generated first, its result before its expansion.
"""

from __future__ import annotations

from collections.abc import Iterator
from heapq import heappop, heappush
from typing import Any

from ss2sql.runtime.search.contract import Found, Problem
from ss2sql.runtime.ways import START, Parents, Trail, path_by_parents, path_to

TAKEN = -2  # less than every total


def best_first(problem: Problem) -> Iterator[Found]:
    """Uniform cost: every path, or with NO CYCLE every path on which no row occurs twice."""
    expand, watch, likeliest = problem.expand, problem.watch, problem.likeliest
    trail = Trail() if problem.repeats == "no cycle" else None
    closed: Any = trail.keys if trail else ()
    queue: list[Any] = [(-1 if likeliest else 0, 0, False, True, problem.start, None, None)]
    number = 0
    while queue:
        total, _, goal, goes_on, state, path, last = heappop(queue)
        if goal:
            yield (path[1],) if problem.last else path_to(path), last
        if not goes_on:
            continue
        if trail:
            trail.move_to(path)
        if watch:
            watch(path)
        for row, key, goal, goes_on, after, weight, _, last in expand(state, closed):
            number += 1
            new = (path, row, key, path[3] + 1 if path else 1) if trail else (path, row)
            rank = total * weight if likeliest else total + weight
            heappush(queue, (rank, number, goal, goes_on, after, new, last))


def guided(problem: Problem) -> Iterator[Found]:
    """A* over all paths: a result waits at its total, its expansion at total plus estimate."""
    expand, watch, found = problem.expand, problem.watch, problem.found
    trail = Trail() if problem.repeats == "no cycle" else None
    closed: Any = trail.keys if trail else ()
    queue: list[Any] = [(0, 0, 0, True, 0, problem.start, None, None)]
    number = highest = 0
    while queue:
        guess, _, _, goes_on, total, state, path, last = heappop(queue)
        if not goes_on:
            if guess < highest:
                found(guess, highest)
            yield (path[1],) if problem.last else path_to(path), last
            continue
        if guess > highest:
            highest = guess
        if trail:
            trail.move_to(path)
        if watch:
            watch(path)
        for row, key, goal, goes_on, after, weight, estimate, last in expand(state, closed):
            rank = total + weight
            number += 1
            new = (path, row, key, path[3] + 1 if path else 1) if trail else (path, row)
            if goal:
                heappush(queue, (rank, 0, number, False, rank, problem.start, new, last))
            if goes_on:
                heappush(queue, (rank + estimate, estimate, number, True, rank, after, new, None))


def best_first_unique(problem: Problem) -> Iterator[Found]:
    """Dijkstra: each row once, by its best path. `best` has its total, or TAKEN once it has come out of the queue."""
    expand, watch = problem.expand, problem.watch
    best: dict[Any, Any] = {}
    parents: dict[Any, Any] = {}  # of the rows that have come out
    rows: dict[Any, Any] | None = {} if problem.alone else None
    queue: list[Any] = []
    number, total, state, key = 0, -1 if problem.likeliest else 0, problem.start, START
    while True:
        if watch:
            watch(Parents(parents, key))
        before = key
        for _, key, goal, goes_on, after, rank, _, last in expand(state, best, best, total):
            best[key] = rank
            number += 1
            heappush(queue, (rank, number, key, goal, goes_on, after, before, last))
        while queue:
            total, _, key, goal, goes_on, state, before, last = heappop(queue)
            if best[key] is TAKEN:
                continue
            best[key] = TAKEN
            parents[key] = before
            if goal:
                yield ((key,) if problem.alone else key,) if problem.last else path_by_parents(parents, key, rows), last
            if goes_on:
                break
        else:
            return


def guided_unique(problem: Problem) -> Iterator[Found]:
    """A*. The heuristic may be inconsistent: a row is taken again when a cheaper path to it appears."""
    expand, watch, found = problem.expand, problem.watch, problem.found
    best: dict[Any, Any] = {}  # the least total of a path to each row so far
    taken: dict[Any, Any] = {}  # those at which rows came out of the queue
    given: set[Any] = set()
    queue: list[Any] = []
    number, total, state, path, highest = 0, 0, problem.start, None, 0
    while True:
        if watch:
            watch(path)
        for row, key, goal, goes_on, after, rank, estimate, last in expand(state, taken, best, total):
            best[key] = rank
            number += 1
            if goal:
                heappush(queue, (rank, 0, number, False, key, rank, (path, row), last, problem.start))
            if goes_on:
                heappush(queue, (rank + estimate, estimate, number, True, key, rank, (path, row), None, after))
        while queue:
            guess, _, _, goes_on, key, total, path, last, state = heappop(queue)
            if best[key] < total:
                continue
            taken[key] = total
            if guess > highest:
                highest = guess
            if goes_on:
                break
            if key not in given:
                given.add(key)
                if guess < highest:
                    found(guess, highest)
                yield (path[1],) if problem.last else path_to(path), last
        else:
            return

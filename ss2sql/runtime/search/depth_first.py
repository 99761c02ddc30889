"""Depth-first search: a step is evaluated when it is reached, and followed before its next sibling."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ss2sql.runtime.search.step_contract import Found, Problem


def depth_first(problem: Problem) -> Iterator[Found]:
    """The results of a depth-first search, in its order.

    `closed` has the keys on the path with NO CYCLE, all keys so far with UNIQUE.
    """
    expand, repeats = problem.expand, problem.repeats
    unique, no_cycle = repeats == "unique", repeats == "no cycle"
    closed: Any = () if repeats == "allowed" else set()
    path: list[Any] = []
    stack: list[Any] = []
    for state in problem.starts:
        if problem.visits:
            if no_cycle:
                closed.clear()
            elif problem.key_of(state) in closed:
                continue
            closed.add(problem.key_of(state))
        steps = iter(expand(state, closed))
        while True:
            for row, key, goal, goes_on, after, _, _, last in steps:
                if unique:
                    closed.add(key)
                if goal:
                    yield (row,) if problem.last else (*path, row), last
                if goes_on:
                    if no_cycle:
                        closed.add(key)
                    path.append(row)
                    stack.append((steps, key))
                    steps = iter(expand(after, closed))
                    break
            else:
                if not stack:
                    break
                steps, key = stack.pop()
                path.pop()
                if no_cycle:
                    closed.discard(key)

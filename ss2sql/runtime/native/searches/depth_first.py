"""Depth-first search: a step is evaluated when it is reached, and followed before its next sibling."""

from __future__ import annotations

from collections.abc import Hashable, Iterator

from ss2sql.runtime.native.searches.step import Found, Hunt, Step
from ss2sql.runtime.rows import Row


def depth_first(hunt: Hunt) -> Iterator[Found]:
    """Every path; siblings in source order."""
    steps = hunt.steps
    path: list[Row] = []
    stack = [steps(hunt.start, ())]
    while stack:
        for row, goal, following, _, _, _, last in stack[-1]:
            if goal:
                yield [*path, row], last
            if following is not None:
                path.append(row)
                stack.append(steps(following, ()))
                break
        else:
            stack.pop()
            if path:
                path.pop()


def depth_first_no_cycle(hunt: Hunt) -> Iterator[Found]:
    """Every path on which no row occurs twice."""
    path: list[Row] = []
    keys: list[Hashable] = []
    on_path: set[Hashable] = set()
    stack = [hunt.steps(hunt.start, on_path)]
    while stack:
        for row, goal, following, key, _, _, last in stack[-1]:
            if goal:
                yield [*path, row], last
            if following is not None:
                path.append(row)
                keys.append(key)
                on_path.add(key)
                stack.append(hunt.steps(following, on_path))
                break
        else:
            stack.pop()
            if path:
                path.pop()
                on_path.discard(keys.pop())


def depth_first_unique(hunt: Hunt) -> Iterator[Found]:
    """Each row once, by the first path in depth-first order."""
    path: list[Row] = []
    reached: set[Hashable] = set()
    stack: list[Iterator[Step]] = [hunt.steps(hunt.start, reached)]
    while stack:
        for row, goal, following, key, _, _, last in stack[-1]:
            reached.add(key)
            if goal:
                yield [*path, row], last
            if following is not None:
                path.append(row)
                stack.append(hunt.steps(following, reached))
                break
        else:
            stack.pop()
            if path:
                path.pop()

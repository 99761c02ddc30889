"""Moves of the towers of Hanoi that take a millisecond, for workers.py.

They have a module of their own, so that worker processes do not import ss2sql, which takes them half a second.
"""

from __future__ import annotations

import time


def move(step: list[int], tower: list[list[int]]) -> list[list[int]]:
    """A move of the towers of Hanoi; an empty list where the rules forbid it."""
    start, end = step
    if not tower[start] or (tower[end] and tower[end][-1] < tower[start][-1]):
        return []
    tower[end].append(tower[start].pop())
    return tower


def waiting(step: list[int], tower: list[list[int]]) -> list[list[int]]:
    """A move after a millisecond."""
    time.sleep(0.001)
    return move(step, tower)


def computing(step: list[int], tower: list[list[int]]) -> list[list[int]]:
    """A move after a millisecond of work."""
    total = 0
    for number in range(16_000):
        total += number & 7
    return move(step, tower)

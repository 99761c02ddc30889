"""Functions for tests of `workers`: other processes import them from here."""

from __future__ import annotations

import os
import signal
import time
from decimal import Decimal
from functools import partial
from typing import Any


class Calls:
    """The number of calls that this process has made, which is none of what functions consist of."""

    def __init__(self) -> None:
        self.made = 0

    def append(self, call: tuple[Any, ...]) -> None:
        self.made += 1

    def __reduce__(self) -> Any:
        return Calls, ()


MADE = Calls()
SIZE = 5


def in_worker() -> bool:
    return "SS2SQL_WORKER" in os.environ


def move(this: list[int], tower: list[list[int]]) -> list[list[int]]:
    MADE.append((this, tower))
    a, b = this
    if not tower[a] or (tower[b] and tower[b][-1] < tower[a][-1]):
        return []
    tower[b].append(tower[a].pop())
    return tower


def onward(state: int, element: int) -> int:
    MADE.append((state, element))
    return (state * 7 + element * 5 + 3) % 53


def neighbours(state: int) -> list[int]:
    MADE.append((state,))
    return [(state * 3 + 1) % 41, (state + 17) % 41, (state * state) % 41]


def weight(state: int, element: int) -> float:
    MADE.append((state, element))
    return (state * element) % 4 / 4


def is_far(state: int) -> bool:
    MADE.append((state,))
    return state % 5 == 0


def failing(state: int, element: int) -> int:
    MADE.append((state, element))
    if (state, element) == (16, 2):
        raise LookupError(f"{state} and {element}")
    return onward(state, element)


def not_a_number(state: int, element: int) -> float:
    return float("nan") if state > 20 else onward(state, element)


def odd_results(state: int, element: int) -> Any:
    """Results of many kinds."""
    number = onward(state, element)
    return [number, float(number), (number, True), {"a": [number]}, str(number), None][element % 6]


def laborious(state: int, element: int) -> int:
    """The same in a millisecond."""
    total = 0
    for number in range(16_000):
        total += number & 7
    return (state * 7 + element * 5 + 3) % 5003


def decimals(state: int, element: int) -> Decimal:
    return Decimal(onward(state, element))


def deadly(state: int, element: int) -> int:
    if in_worker():
        os.kill(os.getpid(), signal.SIGKILL)
    return onward(state, element)


def slow_and_deadly(state: int, element: int) -> int:
    """It is slow enough for other processes to be started, and as they are."""
    time.sleep(0.06)
    return deadly(state, element)


def leaving(state: int, element: int) -> int:
    if in_worker():
        os._exit(3)
    return onward(state, element)


def exiting(state: int, element: int) -> int:
    if in_worker():
        raise SystemExit(4)
    return onward(state, element)


def endless(state: int, element: int) -> int:
    if in_worker():
        time.sleep(60)
    return onward(state, element)


def printing(state: int, element: int) -> int:
    if in_worker():
        print("this would be an answer")
        os.write(1, b"and so would this")
    return onward(state, element)


def sized(state: int, element: int) -> int:
    MADE.append((state, element))
    return (state + element) % SIZE


def remembered_onward(state: int, element: int) -> int:
    """The same as `onward`, of nothing that a file could not remember."""
    after = state * 7 + element * 5
    return (after + 3) % 53


def walk(step: list[int], place: int) -> int:
    MADE.append((step, place))
    return place + step[0] * step[1]


def walk_back(step: list[int], place: int) -> int:
    return place - step[0] * step[1]


class Machine:
    """What calls a function by another way than its name."""

    def __init__(self, factor: int) -> None:
        self.factor = factor

    def onward(self, state: int, element: int) -> int:
        return onward(state * self.factor, element)

    @staticmethod
    def plain(state: int, element: int) -> int:
        return onward(state, element)

    def __call__(self, state: int, element: int) -> int:
        return self.onward(state, element)


by_three = partial(onward, element=3)

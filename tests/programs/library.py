"""The Python functions that random programs call: pure ones, and ones that change their argument, raise or count."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from cases.functions import bag, grow, pair, picky


def half(x: Any) -> Any:
    return x / 2 if isinstance(x, (int, float)) else 0.5


def even(x: Any) -> bool:
    return isinstance(x, int) and x % 2 == 0


def nothing(x: Any) -> None:
    return None


def same(x: Any) -> Any:
    return x


def array(x: int) -> Any:
    return np.array([x, x + 0.5])


def flip(values: list[Any]) -> list[Any]:
    """Changes its argument and what is inside of it."""
    values.reverse()
    for value in values:
        if isinstance(value, list):
            value.append(0)
    return values


def lookup(x: Any) -> Any:
    """Raises the exception of a dict."""
    return {0: "zero", 1: "one", 2: "two", 3: "three"}[x]


def strange(x: Any) -> Any:
    """Returns what the language does not have: NaN for 2, a large integer for 4."""
    if x == 2:
        return float("nan")
    return 2**64 if x == 4 else x


def near(x: int) -> list[int]:
    """Successors in a graph of five nodes."""
    return [[1, 2], [2, 3], [0, 3, 3], [4], []][x % 5]


def links(x: int) -> list[dict[str, Any]]:
    """The same graph with weights, as rows."""
    return [{"to_node": y, "toll": (x + 2 * y) % 4} for y in near(x)]


def shift(step: list[int], towers: list[list[int]]) -> list[list[int]]:
    """Moves the top disk of a tower, in place; an empty list when that is not allowed."""
    if not towers or not towers[step[0]]:
        return []
    disk = towers[step[0]].pop()
    if towers[step[1]] and towers[step[1]][-1] < disk:
        return []
    towers[step[1]].append(disk)
    return towers


def plus(a: Any, b: Any) -> Any:
    """Replaces `+`: lists of numbers are added as vectors."""
    if isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        return [x + y for x, y in zip(a, b, strict=True)]
    return a + b


class Body:
    """An opaque object: equal to itself alone."""

    def __init__(self, number: int) -> None:
        self.number = number

    def __repr__(self) -> str:
        return f"Body({self.number})"


class Box:
    """An opaque object that is not hashable, so that it is compared by identity whatever its `==` says."""

    __hash__ = None  # type: ignore[assignment]

    def __init__(self, number: int) -> None:
        self.number = number

    def __eq__(self, other: object) -> bool:
        return True

    def __repr__(self) -> str:
        return f"Box({self.number})"


BODIES = tuple(Body(number) for number in range(3))
BOXES = tuple(Box(number) for number in range(3))


def body(x: int) -> Body:
    return BODIES[x % 3]


def box(x: int) -> Box:
    return BOXES[x % 3]


def weigh(thing: Any) -> int:
    return thing.number * 10 if isinstance(thing, (Body, Box)) else 1


class Tick:
    """Volatile: counts its calls."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self) -> int:
        self.count += 1
        return self.count


class Blink:
    """Volatile: its argument at every odd call, 0 at every even one."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self, x: Any) -> Any:
        self.count += 1
        return x if self.count % 2 else 0


# name: (how to make it anew, the volatility that is declared; None leaves it to inference)
LIBRARY: dict[str, tuple[Callable[[], Callable[..., Any]], str | None]] = {
    "half": (lambda: half, None), "even": (lambda: even, "immutable"), "pair": (lambda: pair, None),
    "nothing": (lambda: nothing, None), "same": (lambda: same, "immutable"), "bag": (lambda: bag, "stable"),
    "array": (lambda: array, None), "grow": (lambda: grow, "immutable"), "flip": (lambda: flip, None),
    "picky": (lambda: picky, None), "lookup": (lambda: lookup, "immutable"), "strange": (lambda: strange, "immutable"),
    "near": (lambda: near, "immutable"), "links": (lambda: links, None), "shift": (lambda: shift, None),
    "add": (lambda: plus, "immutable"), "body": (lambda: body, "immutable"), "box": (lambda: box, "immutable"),
    "weigh": (lambda: weigh, "stable"), "tick": (Tick, "volatile"), "blink": (Blink, "volatile"),
}  # fmt: skip

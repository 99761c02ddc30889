"""Functions that cases may use, and representations, each by a name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from listings import move

Function = Callable[..., Any]

# --- Towers of Hanoi -----------------------------------------------------------------------------------


def moved(step, towers):
    """`move` for purists: it makes new lists."""
    source, target = step
    if not towers or not towers[source] or (towers[target] and towers[target][-1] < towers[source][-1]):
        return []
    change = {source: towers[source][:-1], target: [*towers[target], towers[source][-1]]}
    return [change.get(index, tower) for index, tower in enumerate(towers)]


# --- graphs --------------------------------------------------------------------------------------------


def neighbours(node):
    """A graph in which depth first reaches C through B, and breadth first does not."""
    return {"S": ["B", "C"], "B": ["C"], "C": ["D"], "D": []}[node]


def toll(source, target):
    """What a way of `neighbours` costs."""
    return 5 if source == "S" and target == "C" else 1


def around(node):
    """The successors of a node in a ring of four with a chord: a path may come back to where it was."""
    return {"a": ["b", "d"], "b": ["c", "a"], "c": ["d", "a"], "d": ["a"]}[node]


# --- people and things ---------------------------------------------------------------------------------


def mass(body):
    """The mass of a body; of anything else 0."""
    return getattr(body, "weight", 0)


def is_heavy(body):
    """Whether a body has more than 50 kg."""
    return getattr(body, "weight", 0) > 50


def grow(values):
    """Changes its argument."""
    values.append(len(values))
    return values


def grid(width, height):
    """A table function: the places of a grid."""
    return [{"x": x, "y": y} for y in range(height) for x in range(width)]


def vector_add(left, right):
    """Replaces `+`: lists of numbers are added place by place."""
    if isinstance(left, list) and isinstance(right, list):
        return [a + b for a, b in zip(left, right, strict=True)]
    return left + right


def caseless(left, right):
    """Replaces `==`: strings are equal whatever their case."""
    if isinstance(left, str) and isinstance(right, str):
        return left.lower() == right.lower()
    return left == right


# --- functions whose result needs a look ---------------------------------------------------------------


def pair(x):
    """A tuple."""
    return (x, (x,))


def bag(x):
    """A set."""
    return {x + 1, x, 0}


def array(x):
    """A NumPy array."""
    return np.array([[x, x + 1], [0, 0]])


def scalar(x):
    """A NumPy scalar."""
    return np.float64(x)


def not_a_number(x):
    return float("nan")


def infinite(x):
    return [1, [float("-inf")]]


def huge(x):
    return 2**63


def imaginary(x):
    return complex(x, 1)


def picky(x):
    """Raises an exception of its own."""
    if x == 3:
        raise ValueError("three is not allowed")
    return x


def two_rows():
    return [{"z": 90}, {"z": 91}]


def odd_rows():
    """Elements of several kinds."""
    return [{"z": 90}, {"y": 91}, 5]


def split_rows():
    """Rows with different columns."""
    return [{"p": 1}, {"q": 2}]


def nothing():
    """No rows, which is not seen from outside."""
    return [row for row in () if row]


def initial(row):
    return "m"


def minus_a(row):
    return -row["a"]


def twin(x):
    return [x] * 2


class Fetch:
    """Volatile: rows whose columns nobody knows before."""

    def __call__(self):
        return [{"a": 50, "initial": 70, "z": 90}]


class Counter:
    """Volatile: how often it was called."""

    def __init__(self) -> None:
        self.count = 0

    def __call__(self):
        self.count += 1
        return self.count


# --- the robot's floor ---------------------------------------------------------------------------------


class Floor:
    """A floor of 8 x 4 places with a wall in it; a place is [x, y]. The robot really moves."""

    PLAN = ("........", "....#...", "....#...", "....#...")

    def __init__(self) -> None:
        self.place = [2.0, 2.0]
        self.bells = 0

    def position(self, robot):
        return self.place

    def move(self, robot, place):
        self.place = place
        return place

    def check_collision(self, robot):
        x, y = map(int, self.place)
        return not (0 <= y < len(self.PLAN) and 0 <= x < len(self.PLAN[0])) or self.PLAN[y][x] == "#"

    def play_sound(self, file):
        self.bells += 1


class Clock:
    """A clock that a script sets: `at(3.0)`."""

    def __init__(self) -> None:
        self.now = 0.0

    def set(self, now):
        self.now = now
        return now

    def time(self):
        return self.now


# --- representations -----------------------------------------------------------------------------------


def csv(table, separator=",", head=True):
    """`AS csv(separator, head)`: the rows as text."""
    lines = [table.columns] if head else []
    return "\n".join(separator.join(map(str, row)) for row in [*lines, *table.rows])


# --- the registry --------------------------------------------------------------------------------------


def _floor(floor: Floor) -> dict[str, Function]:
    return {
        "position": floor.position,
        "move": floor.move,
        "checkCollision": floor.check_collision,
        "playSound": floor.play_sound,
    }


def _clock(clock: Clock) -> dict[str, Function]:
    return {"at": clock.set, "getTime": clock.time}


FUNCTIONS: dict[str, Callable[[], dict[str, Function]]] = {
    **{
        function.__name__: (lambda function=function: {function.__name__: function})  # type: ignore[misc]
        for function in (
            *(move, moved, neighbours, around, mass, grow, grid, pair, bag, array, scalar),
            *(two_rows, odd_rows, split_rows, nothing, initial, minus_a, twin),
            *(not_a_number, infinite, huge, imaginary, picky, toll),
        )
    },
    "isHeavy": lambda: {"isHeavy": is_heavy}, "vectors": lambda: {"add": vector_add},
    "caseless": lambda: {"eq": caseless}, "tick": lambda: {"tick": Counter()}, "fetch": lambda: {"fetch": Fetch()},
    "expressions": lambda: {
        "big": lambda n: n > 1,
        "one": lambda n: 1,
        "inc": lambda n: n + 1,
    },
    "floor": lambda: _floor(Floor()),
    "clock": lambda: _clock(Clock()),
}  # fmt: skip
REPRESENTATIONS: dict[str, Function] = {"csv": csv}

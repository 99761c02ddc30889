"""Adapters for the judge: one over arrays that keeps the rules, and some for each way to break one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from random import Random
from typing import Any

import numpy as np
from balls import Balls, BallWorld, Box, Gaps, Near

from ss2sql.vtables import Column, Table, TableFunction, Where, World, function


class Points(Table):
    """Everything in arrays, as MuJoCo has it."""

    name, key = "points", "id"
    columns = (Column("id", int, filter="="), Column("x", float), Column("y", float), Column("kind", int))
    arrays = {"place": "x y", "kind": "kind"}

    def keys(self, where: Where) -> range:
        return range(12)

    def place(self, keys: list[int]) -> Any:
        self.world.calls += 1
        return self.world.points[keys].T

    def kind(self, keys: list[int]) -> Any:
        return self.world.kinds[keys]


class ArrayWorld(World):
    tables = (Points,)

    def __init__(self) -> None:
        super().__init__()
        self.points = np.arange(24, dtype=np.float32).reshape(12, 2)
        self.kinds = np.arange(12, dtype=np.int32) % 3
        self.calls = 0


# --- adapters that break a rule ------------------------------------------------------------------------


class TooFew(Balls):
    def keys(self, where: Any) -> list[int]:
        return [key for key in super().keys(where) if where.low("x") < self.world.source.balls[key].x]


class Disorder(Balls):
    def keys(self, where: Any) -> list[int]:
        found = super().keys(where)
        return found[::-1] if where else found


class Twice(Balls):
    def keys(self, where: Any) -> list[int]:
        found = super().keys(where)
        return found + found[:1]


class Unhashable(Balls):
    def keys(self, where: Any) -> Any:
        return [[key] for key in super().keys(where)]


class Restless(Balls):
    def keys(self, where: Any) -> list[int]:
        self.world.source.balls[min(self.world.source.balls) - 1] = self.world.source.ball(Random(1), 0)
        return super().keys(where)


class Failing(Balls):
    def keys(self, where: Any) -> list[int]:
        raise RuntimeError("no connection")


class NotANumber(Balls):
    def place(self, key: int) -> Any:
        return float("nan"), 0.0, 0.0


class AnArray(Balls):
    def place(self, key: int) -> Any:
        return np.zeros(3), 0.0, 0.0


class TooManyValues(Balls):
    def place(self, key: int) -> Any:
        return 1.0, 2.0, 3.0, 4.0


class WrongType(Balls):
    def label(self, key: int) -> Any:
        return 7, None


class NotThere(Balls):
    def label(self, key: int) -> Any:
        return None, None


class Moving(Balls):
    def place(self, key: int) -> Any:
        self.world.source.balls[key].x += 0.5
        return super().place(key)


class Undead(Balls):
    def place(self, key: int) -> Any:
        return super().place(key) if key in self.world.source.balls else (0.0, 0.0, 0.0)


class KeyErrors(Balls):
    def place(self, key: int) -> Any:
        ball = self.world.source.balls[key]
        return ball.x, ball.y, ball.z


class WrongOrder(Points):
    def place(self, keys: list[int]) -> Any:
        return self.world.points[sorted(keys)].T


class Blocked(Balls):
    """Places in blocks."""

    groups = {"label": "name colour", "dynamics": "mass heavy", "pos": "pos"}
    blocks = {"spots": "x y z"}

    def spots(self, keys: list[int]) -> Any:
        return [self.place(key) for key in keys]


class WholeNumbers(Blocked):
    def spots(self, keys: list[int]) -> Any:
        return [tuple(map(round, row)) for row in super().spots(keys)]


class TooFewRows(Blocked):
    def spots(self, keys: list[int]) -> Any:
        return super().spots(keys)[: max(1, len(keys) // 2)]


class Backwards(Blocked):
    def spots(self, keys: list[int]) -> Any:
        return super().spots(keys)[::-1]


class UndeadBlocks(Blocked):
    def spots(self, keys: list[int]) -> Any:
        return [self.place(key) if key in self.world.source.balls else (0.0, 0.0, 0.0) for key in keys]


class NoGroup(Balls):
    groups = {"label": "name colour", "place": "x y z", "dynamics": "mass heavy"}


class NoMethod(Balls):
    groups = {**Balls.groups, "nothing": "pos"}


class Stranger(Near):
    def rows(self, x: float, y: float, z: float, radius: float = 1.0) -> list[int]:
        return [*super().rows(x, y, z, radius), 12345]


class Raising(Gaps):
    def rows(self, id: int, most: float = 1e9) -> Any:
        raise RuntimeError("no contact")


class Twins(Near):
    def rows(self, x: float, y: float, z: float, radius: float = 1.0) -> list[int]:
        return super().rows(x, y, z, radius) * 2


class Growing(Gaps):
    def rows(self, id: int, most: float = 1e9) -> Any:
        self.world.source.balls[id].x += 1.0
        return super().rows(id, most)


class Placed(Balls):
    places = {"this": "x y z"}


class Crooked(BallWorld):
    """It measures the wrong way."""

    tables = (Placed,)

    @function
    def distance(self, one: Any, other: Any) -> float:
        return 1.5


class Forgetting(Balls):
    """After a while one ball is not there any more, though nobody has removed it."""

    def keys(self, where: Any) -> list[int]:
        found = super().keys(where)
        return (
            found
            if self.world.source.calls["keys"] < 300
            else [key for key in found if key != min(self.world.source.balls)]
        )


class Dying(BallWorld):
    tables = (Forgetting,)


class Counting(BallWorld):
    count = 0

    @function
    def ticks(self, ball: int) -> int:
        self.count += 1
        return self.count


NOT_MISSED = "missing arguments are an error"


class Generator(Near):
    """Its rows come one by one, which is allowed."""

    def rows(self, x: float, y: float, z: float, radius: float = 1.0) -> Iterator[int]:  # type: ignore[override]
        yield from super().rows(x, y, z, radius)


BROKEN_TABLES: list[tuple[type[Table], str]] = [
    (TooFew, "keys are never too few"),
    (Disorder, "keys keep one order"),
    (Twice, "keys are unique"),
    (Unhashable, "keys are hashable"),
    (Restless, "keys are the same each time"),
    (Failing, "keys can be listed"),
    (NotANumber, "values fit their columns"),
    (AnArray, "values fit their columns"),
    (TooManyValues, "values fit their columns"),
    (WrongType, "values fit their columns"),
    (NotThere, "values fit their columns"),
    (Moving, "reading changes nothing"),
    (Undead, "the dead raise Gone"),
    (KeyErrors, "the dead raise Gone"),
    (WholeNumbers, "blocks fit their columns"),
    (TooFewRows, "blocks fit their columns"),
    (Backwards, "values belong to their keys"),
    (UndeadBlocks, "the dead raise Gone"),
    (NoGroup, "declarations hold together"),
    (NoMethod, "declarations hold together"),
]
BROKEN_FUNCTIONS: list[tuple[type[TableFunction], str]] = [
    (Stranger, "table functions give keys of their table"),
    (Twins, "keys are unique"),
    (Raising, "table functions give rows that fit"),
    (Growing, "reading changes nothing"),
]
BROKEN_WORLDS: list[tuple[Callable[[], Any], str]] = [
    (object, "there is an adapter"),
    (lambda: type("Broken", (ArrayWorld,), {"tables": (WrongOrder,)})(), "values belong to their keys"),
    (lambda: Counting(Box.row(2)), "functions keep what they declare"),
    (lambda: Crooked(Box.random(4, 9)), "places are true"),
    (lambda: Dying(Box.random(4, 9)), "queries see what is there"),
]

"""Adapters for the judge: one over arrays that keeps the rules, and some for each way to break one."""

from __future__ import annotations

from collections.abc import Callable
from random import Random
from typing import Any

import numpy as np
from balls import Balls, BallWorld, Box, Gaps, Near

from ss2sql.vtables import Column, Table, Where, World, function


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


class Blocked(Balls):
    """Places in blocks."""

    groups = {"label": "name colour", "dynamics": "mass heavy", "pos": "pos"}
    blocks = {"spots": "x y z"}

    def spots(self, keys: list[int]) -> Any:
        return [self.place(key) for key in keys]


def balls_of(table: Table) -> dict[int, Any]:
    return table.world.source.balls  # type: ignore[no-any-return]


def changed(work: Callable[[], object], value: Callable[[], Any]) -> Any:
    """The value after a change."""
    work()
    return value()


def failing(text: str) -> Callable[..., Any]:
    def fail(*_: Any, **__: Any) -> Any:
        raise RuntimeError(text)

    return fail


def place_of(ball: Any) -> tuple[float, float, float]:
    return ball.x, ball.y, ball.z


def push(balls: dict[int, Any], key: int) -> None:
    balls[key].x += 0.5


TOO_FEW, ORDER, UNIQUE = "keys are never too few", "keys keep one order", "keys are unique"
FIT, DEAD = "values fit their columns", "the dead raise Gone"
READING, DECLARED, OWN = "reading changes nothing", "declarations hold together", "values belong to their keys"
# What the adapter does, the table it does it in, what it has in place of the table's own, and the rule that it breaks.
BROKEN_TABLES: list[tuple[str, type[Any], dict[str, Any], str]] = [
    ("leaves out what lies on a bound", Balls, {"keys": lambda table, where: [
        key for key in Balls.keys(table, where) if where.low("x") < balls_of(table)[key].x]}, TOO_FEW),
    ("leaves out what two filters allow", Balls, {"keys": lambda table, where: [] if
        where.equal("id") is not None and where.low("x") > float("-inf") else Balls.keys(table, where)}, TOO_FEW),
    ("turns the order around", Balls, {"keys": lambda table, where:
        Balls.keys(table, where)[:: -1 if where else 1]}, ORDER),
    ("gives a key twice", Balls, {"keys": lambda table, where:
        (found := Balls.keys(table, where)) + found[:1]}, UNIQUE),
    ("gives lists as keys", Balls, {"keys": lambda table, where:
        [[key] for key in Balls.keys(table, where)]}, "keys are hashable"),
    ("bears a ball whenever it is asked", Balls, {"keys": lambda table, where: changed(
        lambda: balls_of(table).update({min(balls_of(table)) - 1: Box.ball(Random(1), 0)}),
        lambda: Balls.keys(table, where))}, "keys are the same each time"),
    ("fails", Balls, {"keys": failing("no connection")}, "keys can be listed"),
    ("gives no number", Balls, {"place": lambda table, key: (float("nan"), 0.0, 0.0)}, FIT),
    ("gives too many values", Balls, {"place": lambda table, key: (1.0, 2.0, 3.0, 4.0)}, FIT),
    ("gives another type", Balls, {"label": lambda table, key: (7, None)}, FIT),
    ("moves what it reads", Balls, {"place": lambda table, key: changed(
        lambda: push(balls_of(table), key), lambda: Balls.place(table, key))}, READING),
    ("reads the dead", Balls, {"place": lambda table, key:
        Balls.place(table, key) if key in balls_of(table) else (0.0, 0.0, 0.0)}, DEAD),
    ("says KeyError of the dead", Balls, {"place": lambda table, key: place_of(balls_of(table)[key])}, DEAD),
    ("turns blocks around", Blocked, {"spots": lambda table, keys: Blocked.spots(table, keys)[::-1]}, OWN),
    ("reads the dead in blocks", Blocked, {"spots": lambda table, keys: [
        Balls.place(table, key) if key in balls_of(table) else (0.0, 0.0, 0.0) for key in keys]}, DEAD),
    ("has a column without a group", Balls, {"groups": {
        "label": "name colour", "place": "x y z", "dynamics": "mass heavy"}}, DECLARED),
    ("has a group without a method", Balls, {"groups": {**Balls.groups, "nothing": "pos"}}, DECLARED),
    # table functions
    ("gives a stranger", Near, {"rows": lambda table, x, y, z, radius=1.0:
        [*Near.rows(table, x, y, z, radius), 12345]}, "table functions give keys of their table"),
    ("gives twins", Near, {"rows": lambda table, x, y, z, radius=1.0: Near.rows(table, x, y, z, radius) * 2}, UNIQUE),
    ("raises", Gaps, {"rows": lambda table, id, most=1e9: failing("no contact")()},
        "table functions give rows that fit"),
    ("moves what it measures", Gaps, {"rows": lambda table, id, most=1e9: changed(
        lambda: push(balls_of(table), id), lambda: Gaps.rows(table, id, most))}, READING),
]  # fmt: skip


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
        gone = None if self.world.source.calls["keys"] < 300 else min(self.world.source.balls)
        return [key for key in found if key != gone]


class Dying(BallWorld):
    tables = (Forgetting,)


class Counting(BallWorld):
    count = 0

    @function
    def ticks(self, ball: int) -> int:
        self.count += 1
        return self.count


class Backwards(BallWorld):
    @function("stable", indexed=True)
    def pos(self, key: int, axis: int | None = None) -> Any:
        ball = self.source.balls[key]
        return [ball.x, ball.y, ball.z] if axis is None else (ball.z, ball.y, ball.x)[axis]


class WrongOrder(Points):
    def place(self, keys: list[int]) -> Any:
        return self.world.points[sorted(keys)].T


BROKEN_WORLDS: list[tuple[str, Callable[[], Any], str]] = [
    ("no world", object, "there is an adapter"),
    ("arrays in another order", lambda: type("Broken", (ArrayWorld,), {"tables": (WrongOrder,)})(), OWN),
    ("counts", lambda: Counting(Box.row(2)), "functions keep what they declare"),
    ("has other items", lambda: Backwards(Box.random(4, 9)), "functions keep what they declare"),
    ("measures the wrong way", lambda: Crooked(Box.random(4, 9)), "places are true"),
    ("forgets", lambda: Dying(Box.random(4, 9)), "queries see what is there"),
]

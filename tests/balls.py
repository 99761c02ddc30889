"""A small world in plain Python, which counts what it is asked: balls that are born, move, and die."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from random import Random
from typing import Any

import pytest

import ss2sql
from ss2sql.vtables import Column, Gone, Table, TableFunction, World, function


@dataclass
class Ball:
    id: int
    name: str
    x: float
    y: float
    z: float
    mass: float
    colour: str | None = None


class Box:
    """A simulation. `calls` counts calls of its parts, and under `given` the keys that were handed out."""

    def __init__(self, *balls: Ball, time: float | None = None) -> None:
        self.balls = {ball.id: ball for ball in balls}
        self.calls: Counter[str] = Counter()
        self.time = time
        self.connected = True

    @classmethod
    def row(cls, count: int) -> Box:
        """Balls 1 to count at x = 1, 2, ..., of 20 kg, 40 kg, ..."""
        return cls(
            *(Ball(n, f"ball{n}", float(n), 0.0, 0.0, 20.0 * n, None if n % 2 else "red") for n in range(1, count + 1))
        )

    @classmethod
    def random(cls, seed: int, count: int) -> Box:
        dice = Random(seed)
        return cls(*(cls.ball(dice, number) for number in dice.sample(range(-20, 100), count)))

    @staticmethod
    def ball(dice: Random, number: int) -> Ball:
        x, y, z = (dice.choice((dice.uniform(-5, 5), float(dice.randint(-3, 3)))) for _ in range(3))
        name = dice.choice(("", "a", "B", "ä'", "ball"))
        return Ball(number, name, x, y, z, dice.uniform(0, 100), dice.choice((None, "red", "blue")))

    def change(self, dice: Random) -> None:
        """One dies, one is born, one moves."""
        if self.balls:
            del self.balls[dice.choice(list(self.balls))]
        number = max(self.balls, default=0) + dice.randint(1, 3)
        self.balls[number] = self.ball(dice, number)
        dice.choice(list(self.balls.values())).x += 1.0


class Balls(Table):
    """The balls."""

    name, key = "balls", "id"
    columns = (
        Column("id", int, filter="=", text="the number"), Column("name", str, filter="= < <= > >="),
        Column("x", float, "m", "from left to right", "= < <= > >="), Column("y", float, "m"), Column("z", float, "m"),
        Column("mass", float, "kg", "how heavy it is"), Column("colour", str | None), Column("heavy", bool),
        Column("pos", (float, float, float), "m"),
    )  # fmt: skip
    groups = {"label": "name colour", "place": "x y z", "dynamics": "mass heavy", "pos": "pos"}

    def keys(self, where: Any) -> list[int]:
        box = self.world.source
        box.calls["keys"] += 1
        number = where.equal("id")
        balls = box.balls.values() if number is None else filter(None, [box.balls.get(number)])
        found = [b.id for b in balls if where.allows("x", b.x) and where.allows("name", b.name)]
        box.calls["given"] += len(found)
        return found

    def ball(self, group: str, key: int) -> Ball:
        box = self.world.source
        box.calls[group] += 1
        if key not in box.balls:
            raise Gone
        return box.balls[key]

    def label(self, key: int) -> tuple[str, str | None]:
        ball = self.ball("label", key)
        return ball.name, ball.colour

    def place(self, key: int) -> tuple[float, float, float]:
        ball = self.ball("place", key)
        return ball.x, ball.y, ball.z

    def dynamics(self, key: int) -> tuple[float, bool]:
        ball = self.ball("dynamics", key)
        return ball.mass, ball.mass > 50

    def pos(self, key: int) -> list[float]:
        ball = self.ball("pos", key)
        return [ball.x, ball.y, ball.z]


class Near(TableFunction):
    """The balls around a point."""

    name, table = "near", "balls"

    def rows(self, x: float, y: float, z: float, radius: float = 1.0) -> list[int]:
        box = self.world.source
        box.calls["near"] += 1
        square = radius * radius
        return [b.id for b in box.balls.values() if (b.x - x) ** 2 + (b.y - y) ** 2 + (b.z - z) ** 2 <= square]


class Gaps(TableFunction):
    """Pairs of one ball with all others, and what is between them."""

    name = "gaps"
    columns = (Column("a", int), Column("b", int), Column("gap", float, "m"))

    def rows(self, id: int, most: float = 1e9) -> list[tuple[int, int, float]]:
        balls = self.world.source.balls
        gaps = [(id, b.id, abs(b.x - balls[id].x)) for b in balls.values() if b.id != id]
        return [row for row in gaps if row[2] <= most]


class BallWorld(World):
    """Balls in a box."""

    tables = (Balls, Near, Gaps)
    serves = (f"{__name__}.Box",)
    representations = {"weight": "weight"}

    @property
    def time(self) -> float | None:
        return self.source.time

    def check(self) -> None:
        if not self.source.connected:
            raise ConnectionError("the box is not connected")

    def weight(self, table: Any) -> float:
        """All values of the first column together."""
        return float(sum(row[0] for row in table.rows))

    @function
    def shifted(self, ball: int, by: float = 1.0) -> float:
        """Where the ball would be."""
        return self.source.balls[ball].x + by

    @function
    def distance(self, one: int, other: int) -> float:
        """How far two balls are apart."""
        return abs(self.source.balls[one].x - self.source.balls[other].x)

    @function("volatile")
    def push(self, ball: int, by: float) -> float:
        """Moves the ball and gives its new place."""
        self.source.balls[ball].x += by
        return self.source.balls[ball].x


@pytest.fixture(name="box")
def fixture_box() -> Box:
    return Box.row(5)


@pytest.fixture(name="ss")
def fixture_ss(ss: ss2sql.Session, box: Box) -> ss2sql.Session:
    ss.attach("space", BallWorld(box))
    return ss

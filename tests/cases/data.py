"""Values and tables that cases may use, each by a name."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from balls import Ball, BallWorld, Box
from cases.shelf import Shelf
from listings import MOVES

# The direct road from a to d is long; the cheapest one has three edges.
ROADS = [
    {"src": "a", "dst": "d", "length": 9},
    {"src": "a", "dst": "b", "length": 2},
    {"src": "b", "dst": "d", "length": 5},
    {"src": "b", "dst": "c", "length": 1},
    {"src": "c", "dst": "d", "length": 2},
]
CHANCES = [
    {"src": "a", "dst": "d", "chance": 0.25},
    {"src": "a", "dst": "b", "chance": 0.5},
    {"src": "b", "dst": "d", "chance": 0.75},
    {"src": "b", "dst": "c", "chance": 0.0},
    {"src": "c", "dst": "d", "chance": 1.0},
]
PEOPLE = [
    {"name": "Ada", "age": 36, "city": "London"},
    {"name": "Grace", "age": 85, "city": "New York"},
    {"name": "Alan", "age": 41, "city": "London"},
    {"name": "Edsger", "age": None, "city": "Rotterdam"},
]
YARD = [(1, "sphere_1", 0.0, 0.0, 0.0, 53.25), (2, "YouBot", 3.0, 4.0, 0.0, 2.0), (3, "it's 1\\2", 9.0, 0.0, 0.0, 0.0)]
COLUMNS = {"name": ["Ada", "Grace", "Alan"], "year": [1815, 1906, 1912]}


class Address(NamedTuple):
    """A named tuple in an object."""

    city: str
    street: str = ""


class Tenant:
    """An object with attributes, a method, a property and what nobody is to see."""

    kind = "tenant"

    def __init__(self, name: str, address: Address | None = None, **more: Any) -> None:
        self.name, self.address, self._secret = name, address, 7
        self.__dict__.update(more)

    def greet(self) -> str:
        return "hello"

    @property
    def title(self) -> str:
        raise RuntimeError("nobody asked for it")


class Slotted:
    """An object with slots, one of which is empty."""

    __slots__ = ("_hidden", "name", "rent")

    def __init__(self, name: str) -> None:
        self.name = name


@dataclass(frozen=True)
class Point:
    """An object with columns."""

    x: int
    y: int


class Body:
    """An opaque object: equal to itself alone."""

    def __init__(self, name: str, weight: float) -> None:
        self.name, self.weight = name, weight

    def __repr__(self) -> str:
        return f"<{self.name}>"


SQL = Path(__file__).with_suffix(".sql").read_text(encoding="utf-8")
TABLES: dict[str, str] = dict(re.findall(r"^-- needs: (.*)\n((?:(?!-- ).*\n)+)", SQL, re.MULTILINE))
VALUES: dict[str, Callable[[], Any]] = {
    "moves": lambda: [list(step) for step in MOVES],
    "people": lambda: [dict(person) for person in PEOPLE],
    "columns": lambda: {name: list(values) for name, values in COLUMNS.items()},
    "points": lambda: [Point(1, 2), Point(3, 4)],
    "tenants": lambda: [Tenant("Ann", Address("Oslo")), Tenant("Bob", Address("Rome", "Via"), rent=9), Slotted("Cy")],
    "addresses": lambda: [Address("Oslo"), Address("Rome", "Via")],
    "bodies": lambda: [Body("anvil", 80.0), Body("feather", 0.01), Body("table", 51)],
    "edges": lambda: [dict(road) for road in ROADS], "chances": lambda: [dict(chance) for chance in CHANCES],
    "ragged": lambda: {"name": ["Ada", "Grace"], "year": [1815]},
    "uneven": lambda: [{"name": "Ada", "age": 36}, {"name": "Grace"}], "number": lambda: 7, "shelf": lambda: Shelf(),
    "space": lambda: BallWorld(Box.row(5)), "again": lambda: BallWorld(Box.row(2)),
    "yard": lambda: BallWorld(Box(*(Ball(*ball) for ball in YARD))),
    "twins": lambda: BallWorld(Box(*(Ball(number, "cube", number, 0.0, 0.0, 60.0) for number in (0, 1)))),
    "t": lambda: [{"a": 1, "b": 2}, {"a": 3, "b": 4}], "u": lambda: [{"b": 20, "c": 30}],
    "gaps": lambda: [{"a": 1}, {"b": 2}, {"a": None, "b": 3}], "plain": lambda: [1, {"a": 1}],
    "rooms": lambda: [{"doors": [1, 2]}, {"doors": []}, {"doors": [3]}],
    "record": lambda: {"a": 1, "b": [2]},
    "large": lambda: [{"x": 2**62}, {"x": 2**62}],
    "holes": lambda: [{"k": "a", "v": 3}, {"k": "b", "v": None}, {"v": 1, "w": 2.5}],
    "mixed_keys": lambda: {"a": 1, 1: "one", (1, 2): "pair"},
    "alike": lambda: [
        None, True, 1, 1.0, 0, "1", [1], [1.0], [True, []], {"a": 1}, {"a": 1.0}, [{"a": True}], [[]], [], "", None,
    ],
    "alike_rows": lambda: [
        *({"v": v, "i": i} for i, v in enumerate([1.0, [1], None, {"a": True}, [[]], "1", False, [1.0, []]])),
        {"v": [{"a": 1}], "i": 8}, *({"v": v, "i": 9} for v in (True, [True], 2**53, 2.0**53, 2**53 + 1, "")),
    ],
    "alike_nested": lambda: [[["k", 1]], [["k", 1.0]], [[None]], [[]], [["k", None]], [[[1], 2]]],
    "alike_numbers": lambda: [1, 1.0, True, 2, -0.0, 0.0, 1, True, 0],
    "alike_few": lambda: [{"v": 1}, {"v": [1.0]}],
    "boxes": lambda: [{"k": {"a": 1}}, {"k": {"a": 2}}],
    "hops": lambda: [{"src": [1.0], "dst": 5}, {"src": 5, "dst": [1]}],
}  # fmt: skip

"""Values and tables that cases may use, each by a name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
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


TABLES: dict[str, str] = {
    "flights": """
        CREATE TABLE flights(src TEXT, dst TEXT, fare INTEGER, leaves INTEGER, arrives INTEGER);
        CREATE INDEX flights_by_src ON flights(src);
        INSERT INTO flights VALUES ('a', 'b', 50, 1, 2), ('b', 'c', 40, 3, 5), ('a', 'c', 120, 2, 4),
            ('c', 'a', 30, 6, 7), ('b', 'd', 200, 2, 3), ('c', 'd', 60, 5, 6), ('d', 'b', 10, 7, 8),
            ('b', 'c', 90, 1, 2), ('e', 'a', 5, 1, 2)""",
    "tasks": """
        CREATE TABLE tasks(task TEXT, needs TEXT);
        INSERT INTO tasks VALUES ('plan', NULL), ('dig', 'plan'), ('wall', 'dig'), ('roof', 'wall'), ('pipe', 'dig'),
            ('paint', 'wall'), ('paint', 'pipe'), ('roof', 'pipe')""",
    "employees": """
        CREATE TABLE employees(id INTEGER PRIMARY KEY, name TEXT, boss INTEGER, salary REAL);
        INSERT INTO employees VALUES (1, 'Mary', NULL, 9000), (2, 'Kim', 1, 5000.5), (3, 'Lee', 1, NULL),
            (4, 'Ann', 2, 4000), (5, 'Bob', 2, 4000), (6, 'Eve', 4, 3000)""",
    "words": """
        CREATE TABLE words(word TEXT COLLATE NOCASE, number INTEGER);
        INSERT INTO words VALUES ('Tree', 1), ('tree', 2), ('TREE', 3), ('house', 4)""",
    "mixed": """
        CREATE TABLE mixed(value INTEGER);
        INSERT INTO mixed VALUES (10), ('ten'), (NULL), (2.5), ('9')""",
    "codes": """
        CREATE TABLE codes(code TEXT PRIMARY KEY, meaning TEXT) WITHOUT ROWID;
        INSERT INTO codes VALUES ('b', 'second'), ('a', 'first'), ('c', NULL)""",
    "bosses": """
        CREATE TABLE staff(name TEXT, boss TEXT);
        INSERT INTO staff VALUES ('Mary', NULL), ('Kim', 'Mary'), ('Ann', 'Kim'), ('Lee', 'Mary');
        CREATE VIEW bosses AS SELECT boss AS name, count(*) AS reports FROM staff WHERE boss IS NOT NULL
            GROUP BY boss ORDER BY boss DESC""",
    "order": """
        CREATE TABLE "order"("group" TEXT, "index" INTEGER, "select" TEXT);
        INSERT INTO "order" VALUES ('x', 1, 'p'), ('y', 2, 'q')""",
    "roads": """
        CREATE TABLE roads(src TEXT, dst TEXT, length INTEGER);
        INSERT INTO roads VALUES ('a', 'd', 9), ('a', 'b', 2), ('b', 'd', 5), ('b', 'c', 1), ('c', 'd', 2)""",
    "sizes": """
        CREATE TABLE parts(part TEXT, width REAL);
        INSERT INTO parts VALUES ('bolt', -2.25), ('nut', 2.6);
        CREATE VIEW sizes AS SELECT part, CAST(round(abs(width)) AS INTEGER) AS size FROM parts""",
    "oddities": """
        CREATE TABLE kinds(a, b INTEGER, c REAL, d TEXT);
        INSERT INTO kinds VALUES (1, 'one', 2, 3), (1.5, 2.5, 'x', NULL), ('a', NULL, 4.0, 'd'), (x'00ff', 1, 1, 1);
        CREATE TABLE digits(number INTEGER, word TEXT);
        INSERT INTO digits VALUES (1, '1'), (2, '2');
        CREATE TABLE spellings(a TEXT COLLATE NOCASE PRIMARY KEY, b TEXT COLLATE RTRIM);
        INSERT INTO spellings VALUES ('b', 'x '), ('A', 'x'), ('C', 'y');
        CREATE TABLE keyed(key INTEGER PRIMARY KEY, a);
        INSERT INTO keyed VALUES (3, 'x'), (1, 'y'), (2, 'x');
        CREATE INDEX by_a ON keyed(a);
        CREATE VIEW turned AS SELECT a FROM keyed ORDER BY key DESC;
        CREATE TABLE numbered(rowid, Oid, a);
        INSERT INTO numbered VALUES ('z', 9, 1), ('y', 8, 2);
        CREATE TABLE renumbered(rowid, oid, _rowid_);
        INSERT INTO renumbered VALUES (3, 2, 1), (1, 2, 3);
        CREATE TABLE generated(a INTEGER, double INTEGER AS (2 * a), stored TEXT AS (a || '!') STORED) STRICT;
        INSERT INTO generated(a) VALUES (1), (2);
        CREATE TABLE nobody(a, b)""",
    "broken": """
        CREATE TABLE gone(part TEXT);
        CREATE VIEW broken AS SELECT part FROM gone;
        DROP TABLE gone""",
    "pairs": """
        CREATE TABLE pairs(a INTEGER, b INTEGER);
        INSERT INTO pairs VALUES (1, 2), (2, 3);
        CREATE VIEW seen AS SELECT * FROM pairs""",
    "big": """
        CREATE TABLE big(a INTEGER);
        INSERT INTO big VALUES (9007199254740993), (1)""",
    "ways": """
        CREATE TABLE ways(start, position);
        INSERT INTO ways VALUES (1, 2), (2, 3), (1, 3), (3, 4)""",
    "forms": """
        CREATE TABLE forms(src, dst);
        INSERT INTO forms VALUES (0, 1.0), (0, 1), (1, NULL), (NULL, '1')""",
    "indexed": """
        CREATE TABLE indexed(src INTEGER, dst INTEGER, length INTEGER);
        CREATE INDEX by_src ON indexed(src);
        INSERT INTO indexed VALUES (1, 2, 5), (2, 3, 4), (7, 8, 0), (20, 21, 1), (21, 22, 1), (21, 29, 1),
            (22, 23, 1), (23, 24, 1)""",
}
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
    "hops": lambda: [{"src": [1.0], "dst": 5}, {"src": 5, "dst": [1]}],
}  # fmt: skip

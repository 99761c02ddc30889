"""What cases may use besides the language: functions, values, tables and representations, each by a name.

A case names what it needs in its header. Everything is made anew for every session, so that counters start at
zero and nothing that a script does reaches another case.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import apsw
import numpy as np

from ss2sql.vtables import Column, Gone, Table, TableFunction, World, function

# --- a world -------------------------------------------------------------------------------------------

BOOKS = {1: ("Emma", 0.0, 0.3), 2: ("Ulysses", 0.1, 1.1), 3: ("Faust", 0.2, 0.2), 4: ("Middlemarch", 0.3, 1.2)}


class Books(Table):
    name, key = "books", "id"
    columns = (
        Column("id", int, filter="=", text="the number"),
        Column("title", str, text="what stands on its back"),
        Column("x", float, "m", "how far from the left", "< <= > >="),
        Column("weight", float, "kg"),
    )
    groups = {"book": "title x", "weight": "weight"}

    def keys(self, where):
        ids = BOOKS if where.equal("id") is None else [where.equal("id")]
        return [key for key in ids if key in BOOKS and where.allows("x", BOOKS[key][1])]

    def book(self, key):
        return BOOKS[key][:2]

    def weight(self, key):
        if key == 3:
            raise Gone("somebody has borrowed it")
        return BOOKS[key][2]


class Beside(TableFunction):
    name, table = "beside", "books"

    def rows(self, book, distance=0.1):
        return [key for key in BOOKS if key != book and abs(BOOKS[key][1] - BOOKS[book][1]) < distance + 0.01]


class Shelf(World):
    """Four books; the third has been borrowed."""

    tables = (Books, Beside)

    @function
    def longer(self, book, other):
        """Whether the title is longer than that of another book."""
        return len(BOOKS[book][0]) > len(BOOKS[other][0])


# --- Towers of Hanoi -----------------------------------------------------------------------------------


def move(step, towers):
    """The paper's function: it changes its argument, and an empty list says that the step is not allowed."""
    if not towers or not towers[step[0]]:
        pass
    elif not towers[step[1]] or towers[step[1]][-1] > towers[step[0]][-1]:
        towers[step[1]].append(towers[step[0]].pop())
        return towers
    return []


def moved(step, towers):
    """`move` for purists: it makes new lists."""
    source, target = step
    if not towers or not towers[source] or (towers[target] and towers[target][-1] < towers[source][-1]):
        return []
    change = {source: towers[source][:-1], target: [*towers[target], towers[source][-1]]}
    return [change.get(index, tower) for index, tower in enumerate(towers)]


MOVES = [[0, 1], [0, 2], [1, 0], [1, 2], [2, 0], [2, 1]]

# --- graphs --------------------------------------------------------------------------------------------


def neighbours(node):
    """A graph in which depth first reaches C through B, and breadth first does not."""
    return {"S": ["B", "C"], "B": ["C"], "C": ["D"], "D": []}[node]


def around(node):
    """The successors of a node in a ring of four with a chord: a path may come back to where it was."""
    return {"a": ["b", "d"], "b": ["c", "a"], "c": ["d", "a"], "d": ["a"]}[node]


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

# --- people and things ---------------------------------------------------------------------------------

PEOPLE = [
    {"name": "Ada", "age": 36, "city": "London"},
    {"name": "Grace", "age": 85, "city": "New York"},
    {"name": "Alan", "age": 41, "city": "London"},
    {"name": "Edsger", "age": None, "city": "Rotterdam"},
]
COLUMNS = {"name": ["Ada", "Grace", "Alan"], "year": [1815, 1906, 1912]}


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


# --- tables --------------------------------------------------------------------------------------------

TABLES: dict[str, str] = {
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
    "broken": """
        CREATE TABLE gone(part TEXT);
        CREATE VIEW broken AS SELECT part FROM gone;
        DROP TABLE gone""",
}

# --- the registry --------------------------------------------------------------------------------------

Function = Callable[..., Any]
FUNCTIONS: dict[str, Callable[[], dict[str, Function]]] = {
    **{
        function.__name__: (lambda function=function: {function.__name__: function})  # type: ignore[misc]
        for function in (
            *(move, moved, neighbours, around, mass, grow, grid, pair, bag, array, scalar),
            *(not_a_number, infinite, huge, imaginary, picky),
        )
    },
    "isHeavy": lambda: {"isHeavy": is_heavy},
    "vectors": lambda: {"add": vector_add},
    "caseless": lambda: {"eq": caseless},
    "tick": lambda: {"tick": Counter()},
    "floor": lambda: _floor(Floor()),
    "clock": lambda: _clock(Clock()),
}
VALUES: dict[str, Callable[[], Any]] = {
    "moves": lambda: [list(step) for step in MOVES],
    "people": lambda: [dict(person) for person in PEOPLE],
    "columns": lambda: {name: list(values) for name, values in COLUMNS.items()},
    "points": lambda: [Point(1, 2), Point(3, 4)],
    "bodies": lambda: [Body("anvil", 80.0), Body("feather", 0.01), Body("table", 51)],
    "edges": lambda: [dict(road) for road in ROADS],
    "chances": lambda: [dict(chance) for chance in CHANCES],
    "ragged": lambda: {"name": ["Ada", "Grace"], "year": [1815]},
    "uneven": lambda: [{"name": "Ada", "age": 36}, {"name": "Grace"}],
    "number": lambda: 7,
    "shelf": lambda: Shelf(),
}
REPRESENTATIONS: dict[str, Function] = {"csv": csv}
VOLATILE = frozenset({"tick", "floor", "clock"})


def _floor(floor: Floor) -> dict[str, Function]:
    return {
        "position": floor.position,
        "move": floor.move,
        "checkCollision": floor.check_collision,
        "playSound": floor.play_sound,
    }


def _clock(clock: Clock) -> dict[str, Function]:
    return {"at": clock.set, "getTime": clock.time}


def furnish(session: Any, needs: Sequence[str]) -> None:
    """Gives a session what a case needs besides tables. Raises KeyError for a name that is not here."""
    for name in needs:
        if name in FUNCTIONS:
            for called, function in FUNCTIONS[name]().items():
                session.function(called, function)
        elif name in VALUES:
            session.attach(name, VALUES[name]())
        elif name in REPRESENTATIONS:
            session.representation(name)(REPRESENTATIONS[name])
        elif name not in TABLES:
            raise KeyError(name)


def database(folder: Path, needs: Sequence[str]) -> Path | None:
    """A new file with the tables that a case needs, for `connect`; None if it needs none."""
    tables = [TABLES[name] for name in needs if name in TABLES]
    if not tables:
        return None
    path = folder / "world.db"
    path.unlink(missing_ok=True)
    connection = apsw.Connection(str(path))
    connection.execute(";".join(tables))
    connection.close()
    return path


def for_reference(needs: Sequence[str]) -> dict[str, Mapping[str, Any]]:
    """The same for the reference evaluator: arguments of `Reference`."""
    functions: dict[str, Function] = {}
    variables: dict[str, Any] = {}
    tables: dict[str, list[dict[str, Any]]] = {}
    for name in needs:
        if name in FUNCTIONS:
            functions.update(FUNCTIONS[name]())
        elif name in VALUES:
            variables[name] = VALUES[name]()
        elif name in TABLES:
            tables.update(_rows(TABLES[name]))
    return {"functions": functions, "variables": variables, "tables": tables}


def _rows(sql: str) -> dict[str, list[dict[str, Any]]]:
    """The tables and views that the statements make, as lists of dicts."""
    connection = apsw.Connection(":memory:")
    connection.execute(sql)
    tables = {}
    for (name,) in connection.execute("SELECT name FROM sqlite_schema WHERE type <> 'index'").fetchall():
        columns = [row[1] for row in connection.execute(f'PRAGMA table_info("{name}")')]
        try:
            rows = connection.execute(f'SELECT * FROM "{name}"').fetchall()
        except apsw.Error:
            continue  # a view that fails on purpose
        tables[name] = [dict(zip(columns, row, strict=True)) for row in rows]
    return tables

"""Groups that give tuples within tuples, as a simulator's call gives them, and what is only shown of worlds."""

from __future__ import annotations

import random
from typing import Any

import pytest

import ss2sql
from ss2sql.errors import ExecutionError, SessionError
from ss2sql.vtables import Column, Gone, Table, World

POINT = (float, float, float)


class Boats(Table):
    name, key = "boats", "id"
    columns = (
        Column("id", int, filter="="), Column("name", str), Column("pos", POINT), Column("x", float),
        Column("east", float), Column("y", float), Column("z", float), Column("speed", float), Column("tags", list),
    )  # fmt: skip
    blocks = {"place": "pos(x=east y z) speed", "called": "name"}
    groups = {"labels": "tags"}

    def keys(self, where: Any) -> Any:
        number = where.equal("id")
        return [key for key in range(self.world.count) if number in (None, key)]

    def place(self, keys: list[int]) -> list[Any]:
        self.world.asked.append(list(keys))
        if not self.world.lost.isdisjoint(keys):
            raise Gone("it sank")
        return [(self.world.odd.get(key, (key / 2, -float(key), 0.0)), float(key % 3)) for key in keys]

    def called(self, keys: list[int]) -> list[str]:
        return [self.world.names.get(key, f"boat {key}") for key in keys]

    def labels(self, key: int) -> list[Any]:
        return [key, [key]]


class Harbour(World):
    """Boats."""

    tables = (Boats,)

    def __init__(self, count: int = 70) -> None:
        super().__init__()
        self.count = count
        self.asked: list[list[int]] = []
        self.lost: set[int] = set()
        self.odd: dict[int, Any] = {}
        self.names: dict[int, str] = {}


@pytest.fixture
def world() -> Harbour:
    return Harbour()


@pytest.fixture
def ss(ss: ss2sql.Session, world: Harbour) -> ss2sql.Session:
    ss.attach("boats", world)
    return ss


def test_a_tuple_is_a_list_and_its_values_are_columns(ss: ss2sql.Session, world: Harbour, engine: Any) -> None:
    rows = ss.run("SELECT pos, x, east, y, z, speed FROM boats AS rows;", engine=engine).value
    assert rows == [([k / 2, -k, 0], k / 2, k / 2, -k, 0, k % 3) for k in range(70)]
    assert [key for keys in world.asked for key in keys] == list(range(70))


def test_conditions_read_the_same_values(ss: ss2sql.Session, engine: Any) -> None:
    script = "SELECT id FROM boats WHERE pos[1] == y AND east > 1 AND speed == 1 AND pos != [3.5, -7, 0] AS list;"
    assert ss.run(script, engine=engine).value == [k for k in range(3, 70) if k % 3 == 1 and k != 7]


@pytest.mark.parametrize("odd", [(1.0, float("nan"), 0.0), (1.0, 2e100, 0.0)])
def test_floats_inside_are_looked_at(ss: ss2sql.Session, world: Harbour, engine: Any, odd: Any) -> None:
    world.odd[5] = odd
    assert ss.run("SELECT x FROM boats LIMIT 5 AS list;", engine=engine).value == [0, 0.5, 1, 1.5, 2]
    with pytest.raises(ExecutionError, match="the column 'pos' of boats holds"):
        ss.run("SELECT x FROM boats;", engine=engine)


def test_names_beyond_ascii_are_asked_in_blocks_too(ss: ss2sql.Session, world: Harbour, engine: Any) -> None:
    world.names = {0: "Jolle", 1: "Möwe", 2: "漁船"}
    assert ss.run("SELECT name FROM boats LIMIT 3 AS list;", engine=engine).value == ["Jolle", "Möwe", "漁船"]
    world.names[1] = "\ud800"
    with pytest.raises(ExecutionError, match="no text that can be written"):
        ss.run("SELECT name FROM boats;", engine=engine)


@pytest.mark.parametrize(
    ("blocks", "message"),
    [
        ({"place": "pos(x=east y) speed"}, "'pos' is no list of 2 plain values"),
        ({"place": "pos(x=name y z) speed"}, "x and name are the same value, and of different types"),
        ({"place": "pos(x y z=y) speed"}, "the column 'y' is given twice"),
        ({"place": "pos(x y z speed"}, "does not name columns"),
        ({"place": "pos(x(y) z) speed"}, "does not name columns"),
    ],
)
def test_what_contradicts_the_columns_is_refused(ss: ss2sql.Session, blocks: Any, message: str) -> None:
    table = type("Wrong", (Boats,), {"blocks": blocks})
    with pytest.raises(SessionError) as caught:
        ss.attach("other", type("Other", (World,), {"tables": (table,)})())
    assert message in caught.value.message


def test_check_world_passes() -> None:
    assert ss2sql.check_world(Harbour(20), queries=40).elements == {"boats": 20}


# --- what is only shown --------------------------------------------------------------------------------

SHOWN = [
    "SELECT id, x, name FROM boats AS rows;",
    "SELECT this, pos FROM boats WHERE speed > 1 AS rows;",
    "SELECT a.pos, b.id, b.pos, a.tags FROM a = boats, b = boats WHERE b.id == a.id + 1 AND a.x > 30 AS rows;",
    "SELECT name, tags FROM boats WHERE id == 7;",
    "SELECT z, y, x FROM boats ORDER BY x DESC LIMIT 3 AS rows;",
    "SELECT x, pos FROM a = boats, b = range(2) WHERE b.this < a.speed AS rows;",
    "SELECT id, speed, x FROM boats GROUP BY speed AS rows;",
    "SELECT name, pos FROM boats AS set;",
    "SELECT x, y FROM boats LIMIT 2;",
]


@pytest.mark.parametrize("script", SHOWN)
def test_what_is_read_late_is_the_same(world: Harbour, script: str) -> None:
    values = []
    for engine, disable in (("database", []), ("database", ["late"]), ("native", [])):
        with ss2sql.connect(disable=disable) as ss:
            ss.attach("boats", world)
            values.append(repr(ss.run(script, engine=engine).value))
    assert values[0] == values[1] == values[2]


def test_the_sql_that_is_shown_asks_for_keys_as_the_one_that_runs(ss: ss2sql.Session) -> None:
    query = ss.compile("SELECT name, pos FROM boats WHERE x > 2 AS rows;", engine="database")
    assert "boats.id /* then name, pos */" in query.sql
    assert query.run().sql == query.sql
    assert "SQLite finds keys of a world alone" in query.explain()


def test_a_key_that_is_shown_twice_needs_no_comment(ss: ss2sql.Session, engine: Any) -> None:
    script = "SELECT id, id FROM boats WHERE x > 33.5 AS rows;"  # x is half the number of 0 to 69
    assert ss.run(script, engine=engine).value == [(68, 68), (69, 69)]
    assert "/* then" not in ss.compile(script, engine="database").sql


def test_each_result_has_lists_of_its_own(ss: ss2sql.Session) -> None:
    first, second = ss.run("SELECT a.pos, a.id FROM a = boats, b = range(2) WHERE a.id == 4 AS rows;").value
    first[0].append(9.0)
    assert second == ([2.0, -4.0, 0.0], 4)


def test_late_reading_asks_for_no_more_than_it_needs(ss: ss2sql.Session, world: Harbour, engine: Any) -> None:
    world.lost.add(3)
    assert len(ss.run("SELECT x, y FROM boats LIMIT 3 AS rows;", engine=engine).value) == 3
    assert sum(map(len, world.asked)) == 3
    with pytest.raises(ExecutionError, match=r"boats\[3\] no longer exists: it sank"):
        ss.run("SELECT x, y FROM boats AS rows;", engine=engine)


# --- small boxes ---------------------------------------------------------------------------------------


def test_cells_find_what_lies_in_a_box() -> None:
    client: Any = pytest.importorskip("pybullet_utils.bullet_client").BulletClient(0x2)
    try:
        from ss2sql.vtables.pybullet import PyBulletWorld
        from ss2sql.vtables.pybullet.places import Places

        dice = random.Random(3)
        ball = client.createCollisionShape(client.GEOM_SPHERE, radius=0.1)
        points = [tuple(dice.choice([-2.5, -1.0, 0.0, 0.5, dice.uniform(-4, 4)]) for _ in range(3)) for _ in range(120)]
        points += [(3.0, 3.0, 3.0)] * 80 + [(1e7, 0.0, -1e7)]
        for point in points:
            client.createMultiBody(1, ball, basePosition=point)
        world = PyBulletWorld(client)
        own = [client.getBasePositionAndOrientation(body)[0] for body in world.ids()]
        for first in (1.0, 0.01, 50.0):
            places = Places(world)
            places.between(*[(0.0, first)] * 3)
            for _ in range(300):
                middle = dice.choice(own) if dice.random() < 0.7 else [dice.uniform(-5, 5) for _ in range(3)]
                reach = dice.choice([0.0, 0.5, 1.0, 2.0, float("inf"), -1.0])
                ranges = [(value - reach, value + reach) for value in middle]
                wanted = [
                    body
                    for body, point in enumerate(own)
                    if all(low <= value <= high for value, (low, high) in zip(point, ranges, strict=True))
                ]
                assert places.between(*ranges) == wanted
    finally:
        client.disconnect()

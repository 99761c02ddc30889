"""How values come out of a world: in blocks, in tuples within tuples, read late, and only where they fit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from sql_calls import python_calls

import ss2sql
from ss2sql.errors import ExecutionError
from ss2sql.vtables import Column, Gone, Table, World, function

COUNT = 70


class Boats(Table):
    name, key = "boats", "id"
    columns = (
        Column("id", int, filter="="), Column("name", str), Column("pos", (float, float, float)), Column("x", float),
        Column("east", float), Column("y", float), Column("z", float), Column("speed", float), Column("tags", list),
        Column("mass", float), Column("heavy", bool),
    )  # fmt: skip
    blocks = {"place": "pos(x=east y z) speed", "called": "name", "matter": "mass heavy"}
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

    def matter(self, keys: list[int]) -> list[tuple[float, bool]]:
        return [(self.world.masses.get(key, key / 2), key > 5) for key in keys]

    def labels(self, key: int) -> list[Any]:
        return [key, [key]]


class Harbour(World):
    """Boats."""

    tables = (Boats,)

    def __init__(self, count: int = COUNT) -> None:
        super().__init__()
        self.count = count
        self.asked: list[list[int]] = []
        self.lost: set[int] = set()
        self.odd: dict[int, Any] = {}
        self.masses: dict[int, float] = {}
        self.names: dict[int, str] = {}
        self.called = 0

    @function("stable", indexed=True)
    def pos(self, boat: int, axis: int | None = None) -> Any:
        self.called += 1
        ((place, _),) = Boats(self).place([boat])
        return list(place) if axis is None else place[axis]


@pytest.fixture
def world() -> Harbour:
    return Harbour()


@pytest.fixture
def ss(ss: ss2sql.Session, world: Harbour) -> ss2sql.Session:
    ss.attach("boats", world)
    return ss


def test_check_world_passes() -> None:
    assert ss2sql.check_world(Harbour(20), queries=40).elements == {"boats": 20}


# --- blocks: how far ahead is read ---------------------------------------------------------------------


def test_blocks_grow_as_long_as_all_is_read(ss: ss2sql.Session, world: Harbour, engine: Any) -> None:
    rows = ss.run("SELECT pos, x, east, y, z, speed FROM boats AS rows;", engine=engine).value
    assert rows == [([k / 2, -k, 0], k / 2, k / 2, -k, 0, k % 3) for k in range(COUNT)]
    assert [len(keys) for keys in world.asked] == [1, 2, 4, 8, 16, 32, 7]
    assert [key for keys in world.asked for key in keys] == list(range(COUNT))


@pytest.mark.parametrize(
    ("script", "found", "asked"),
    [
        *[(f"SELECT x FROM boats LIMIT {n} AS list", [k / 2 for k in range(n)], n) for n in (1, 3, 7)],
        # where elements are left out, blocks begin anew
        ("SELECT x FROM boats WHERE tags[0] % 2 AS list", [k / 2 for k in range(1, COUNT, 2)], COUNT // 2),
        # a block goes no further than the keys
        ("SELECT x, mass FROM boats WHERE id == 7 AS rows", [(3.5, 3.5)], 1),
        # every element is asked once in a join
        ("SELECT a.x, b.x FROM a = boats, b = boats WHERE a.heavy AND b.x < 1 AS rows",
         [(a / 2, b / 2) for a in range(6, COUNT) for b in range(2)], COUNT),
        # what is not read in a row is not that of another row
        ("SELECT IF(id % 2; x; None), IF(id % 3; mass; None) FROM boats AS rows",
         [(k / 2 if k % 2 else None, k / 2 if k % 3 else None) for k in range(COUNT)], COUNT // 2),
        ("SELECT id FROM boats WHERE pos[1] == y AND east > 1 AND speed == 1 AND pos != [3.5, -7, 0] AS list",
         [k for k in range(3, COUNT) if k % 3 == 1 and k != 7], COUNT),
    ],
)  # fmt: skip
def test_little_is_read(ss: ss2sql.Session, world: Harbour, engine: Any, script: str, found: Any, asked: int) -> None:
    assert ss.run(script, engine=engine).value == found
    assert sum(map(len, world.asked)) == asked
    assert len({key for keys in world.asked for key in keys}) == asked


def test_the_dead_are_only_noticed_where_they_are_read(ss: ss2sql.Session, world: Harbour, engine: Any) -> None:
    world.lost.add(6)
    assert ss.run("SELECT x, y FROM boats LIMIT 6 AS rows;", engine=engine).value == [(k / 2, -k) for k in range(6)]
    others = [key / 2 for key in range(COUNT) if key != 6]
    assert ss.run("SELECT x FROM boats WHERE id != 6 AS list;", engine=engine).value == others
    for script in ("SELECT x FROM boats;", "SELECT x, y FROM boats AS rows;"):
        with pytest.raises(ExecutionError, match=r"boats\[6\] no longer exists: it sank"):
            ss.run(script, engine=engine)


@pytest.mark.parametrize("odd", [float("nan"), float("inf"), -2e100])
def test_floats_beyond_the_limit_are_refused(ss: ss2sql.Session, world: Harbour, engine: Any, odd: float) -> None:
    world.odd[5], world.masses[5] = (1.0, odd, 0.0), odd
    for column, named in (("x", "pos"), ("mass", "mass")):
        assert ss.run(f"SELECT {column} FROM boats LIMIT 5 AS list;", engine=engine).value == [0, 0.5, 1, 1.5, 2]
        with pytest.raises(ExecutionError, match=rf"the column '{named}' of boats\[5\] holds"):
            ss.run(f"SELECT {column} FROM boats;", engine=engine)


def test_names_beyond_ascii_are_asked_in_blocks_too(ss: ss2sql.Session, world: Harbour, engine: Any) -> None:
    world.names = {0: "Jolle", 1: "Möwe", 2: "漁船"}
    assert ss.run("SELECT name FROM boats LIMIT 3 AS list;", engine=engine).value == ["Jolle", "Möwe", "漁船"]
    world.names[1] = "\ud800"
    with pytest.raises(ExecutionError, match="no text that can be written"):
        ss.run("SELECT name FROM boats;", engine=engine)


def test_items_of_lists_are_columns(ss: ss2sql.Session, world: Harbour, engine: Any) -> None:
    script = "SELECT pos[0], pos(this, 1), this.pos[2], boats.pos(this, 0) FROM boats WHERE pos(this)[0] > 1 AS rows;"
    query = ss.compile(script, engine=engine)
    assert "item" not in python_calls(str(query.sql))
    assert query.run().value == [(k / 2, -k, 0, k / 2) for k in range(3, COUNT)]
    assert world.called == 0
    assert ss.run("SELECT pos(this, 2 - id) FROM boats LIMIT 3 AS list;", engine=engine).value == [0, -1, 1]
    assert world.called == 3
    with pytest.raises(IndexError):
        ss.run("SELECT pos(this, 3) FROM boats;", engine=engine)


# --- what is only shown --------------------------------------------------------------------------------


def test_the_sql_that_is_shown_asks_for_keys_as_the_one_that_runs(ss: ss2sql.Session) -> None:
    query = ss.compile("SELECT name, pos FROM boats WHERE x > 2 AS rows;", engine="database")
    assert "boats.id /* then name, pos */" in query.sql
    assert query.run().sql == query.sql
    assert "SQLite finds keys of a world alone" in query.explain()


def test_rows_are_made_of_their_own_keys_and_lists(ss: ss2sql.Session, engine: Any) -> None:
    script = "SELECT a.pos, b.this, a.this, b.id, b.pos FROM a = boats, b = boats WHERE b.id == a.id + 1 AND a.x > 33.5"
    ((place, after, before, number, other),) = ss.run(f"{script} AS rows;", engine=engine).value
    assert (place, number, other, before.id, after.id) == ([34, -68, 0], 69, [34.5, -69, 0], 68, 69)
    first, second = ss.run("SELECT a.pos, a.id FROM a = boats, b = range(2) WHERE a.id == 4 AS rows;").value
    first[0].append(9.0)
    assert second == ([2.0, -4.0, 0.0], 4)


# --- values fit what their column declares, or are refused ----------------------------------------------


def one_value(declared: Any, given: Any, engine: Any) -> Any:
    class Things(Table):
        name = "things"
        columns = (Column("value", declared),)
        groups = {"value": "value"}

        def keys(self, where: Any) -> list[Any]:
            return [("a", 1)]

        def value(self, key: Any) -> Any:
            assert key == ("a", 1)
            return given

    with ss2sql.connect() as ss:
        ss.attach("things", type("One", (World,), {"tables": (Things,)})())
        return ss.run("SELECT value FROM things AS value;", engine=engine).value


@pytest.mark.parametrize(
    ("declared", "given", "value"),
    [(float, np.float32(1.5), 1.5), (float, 3, 3.0), (int, np.int64(7), 7), (bool, np.bool_(True), True),
     (str, np.str_("a"), "a"), (int | None, None, None), (int | None, np.int8(3), 3), (float | None, 2, 2.0),
     (list, np.arange(3), [0, 1, 2]), (list, (1, (2, 3)), [1, [2, 3]]), ((float, float), np.array([1, 2]), [1.0, 2.0]),
     ((int, str), (1, "a"), [1, "a"]), (dict, {"a": np.int32(1)}, {"a": 1}), (object, [None, 1.5], [None, 1.5]),
     (int | str, "x", "x")],
)  # fmt: skip
def test_values_fit_their_declaration(declared: Any, given: Any, value: Any, engine: Any) -> None:
    assert repr(one_value(declared, given, engine)) == repr(value)


@pytest.mark.parametrize(
    ("declared", "given"),
    [(float, np.array([1.0])), (float, "1"), (float, True), (float, None), (float, float("inf")), (float, 1e101),
     (int, 1.0), (int, 2**63), (bool, 1), (str, 1), (str, "\ud800"), (list, "text"), ((float, float), (1.0,)),
     ((float, float), 1.0), (int | None, "1"), (int | str, 1.5)],
)  # fmt: skip
def test_values_that_do_not_fit_are_refused_by_name(declared: Any, given: Any, engine: Any) -> None:
    with pytest.raises(ss2sql.ExecutionError, match=r"X004.*the column 'value' of things.* holds"):
        one_value(declared, given, engine)

"""Groups that are read in blocks: how far ahead, and what happens where an element cannot be read."""

from __future__ import annotations

from typing import Any

import pytest

import ss2sql
from ss2sql.errors import ExecutionError
from ss2sql.vtables import Column, Gone, Table, World


class Beads(Table):
    name, key = "beads", "id"
    columns = (
        Column("id", int, filter="="), Column("colour", str), Column("x", float), Column("y", float),
        Column("mass", float), Column("heavy", bool),
    )  # fmt: skip
    groups = {"label": "colour"}
    blocks = {"place": "x y", "matter": "mass heavy"}

    def keys(self, where: Any) -> Any:
        number = where.equal("id")
        return range(self.world.count) if number is None else [key for key in range(self.world.count) if key == number]

    def label(self, key: int) -> str:
        return "red" if key % 2 else "blue"

    def place(self, keys: list[int]) -> list[tuple[float, float]]:
        self.world.asked.append(list(keys))
        if not self.world.lost.isdisjoint(keys):
            raise Gone("it rolled away")
        return [(self.world.odd.get(key, float(key)), -float(key)) for key in keys]

    def matter(self, keys: list[int]) -> list[tuple[float, bool]]:
        return [(key / 2, key > 5) for key in keys]


class String(World):
    """Beads on a string."""

    tables = (Beads,)

    def __init__(self, count: int) -> None:
        super().__init__()
        self.count = count
        self.asked: list[list[int]] = []
        self.lost: set[int] = set()
        self.odd: dict[int, float] = {}


@pytest.fixture
def world() -> String:
    return String(200)


@pytest.fixture
def ss(ss: ss2sql.Session, world: String) -> ss2sql.Session:
    ss.attach("beads", world)
    return ss


def test_blocks_grow_as_long_as_all_is_read(ss: ss2sql.Session, world: String, engine: Any) -> None:
    rows = ss.run("SELECT x, y FROM beads AS rows;", engine=engine).value
    assert rows == [(float(key), -float(key)) for key in range(200)]
    assert [len(keys) for keys in world.asked] == [1, 2, 4, 8, 16, 32, 64, 64, 9]
    assert [key for keys in world.asked for key in keys] == list(range(200))


@pytest.mark.parametrize("limit", [1, 3, 7])
def test_limit_asks_for_no_more_than_it_needs(ss: ss2sql.Session, world: String, engine: Any, limit: int) -> None:
    assert ss.run(f"SELECT x FROM beads LIMIT {limit} AS list;", engine=engine).value == list(range(limit))
    assert sum(map(len, world.asked)) == limit


def test_where_elements_are_left_out_blocks_begin_anew(ss: ss2sql.Session, world: String, engine: Any) -> None:
    rows = ss.run("SELECT x FROM beads WHERE colour == 'red' AS list;", engine=engine).value
    assert rows == [float(key) for key in range(1, 200, 2)]
    assert world.asked == [[key] for key in range(1, 200, 2)]


def test_a_block_goes_no_further_than_the_keys(ss: ss2sql.Session, world: String, engine: Any) -> None:
    assert ss.run("SELECT x, mass FROM beads WHERE id == 7 AS rows;", engine=engine).value == [(7.0, 3.5)]
    assert world.asked == [[7]]


def test_what_is_not_read_in_a_row_is_not_that_of_another_row(ss: ss2sql.Session, engine: Any) -> None:
    rows = ss.run(
        "SELECT IF(colour == 'red'; x; None), IF(id % 3; mass; None) FROM beads AS rows;", engine=engine
    ).value
    assert rows == [(float(key) if key % 2 else None, key / 2 if key % 3 else None) for key in range(200)]


def test_every_element_is_asked_once_in_a_join(ss: ss2sql.Session, world: String, engine: Any) -> None:
    world.count = 20
    script = "SELECT a.x, b.x FROM a = beads, b = beads WHERE a.heavy AND b.x < 2 AS rows;"
    rows = ss.run(script, engine=engine).value
    assert rows == [(float(a), float(b)) for a in range(6, 20) for b in range(2)]
    assert sorted(key for keys in world.asked for key in keys) == list(range(20))


def test_the_dead_are_only_noticed_where_they_are_read(ss: ss2sql.Session, world: String, engine: Any) -> None:
    world.lost.add(6)
    assert ss.run("SELECT x FROM beads LIMIT 6 AS list;", engine=engine).value == [0, 1, 2, 3, 4, 5]
    assert ss.run("SELECT x FROM beads WHERE id != 6 AS list;", engine=engine).value == [
        float(key) for key in range(200) if key != 6
    ]
    with pytest.raises(ExecutionError, match=r"beads\[6\] no longer exists: it rolled away"):
        ss.run("SELECT x FROM beads;", engine=engine)


@pytest.mark.parametrize("odd", [float("nan"), float("inf"), -2e100])
def test_floats_beyond_the_limit_are_refused(ss: ss2sql.Session, world: String, engine: Any, odd: float) -> None:
    world.odd[5] = odd
    assert ss.run("SELECT x FROM beads LIMIT 5 AS list;", engine=engine).value == [0, 1, 2, 3, 4]
    with pytest.raises(ExecutionError, match="the column 'x' of beads holds"):
        ss.run("SELECT x FROM beads;", engine=engine)


def test_a_column_may_be_called_as_a_function(ss: ss2sql.Session, world: String) -> None:
    assert ss.eval("heavy = SELECT this FROM beads WHERE mass == 4 AS list; SELECT x FROM heavy AS list;") == [8.0]


def test_a_block_of_one_column_is_a_list_of_its_values(ss: ss2sql.Session, engine: Any) -> None:
    single = type("Single", (Beads,), {"groups": {}, "blocks": {**Beads.blocks, "labels": "colour"},
                                       "labels": lambda self, keys: [self.label(key) for key in keys]})  # fmt: skip
    world = type("Other", (String,), {"tables": (single,)})(70)
    ss.attach("other", world)
    found = ss.run("SELECT colour FROM other AS list;", engine=engine).value
    assert found == ["red" if key % 2 else "blue" for key in range(70)]
    assert ss2sql.check_world(world, queries=20).elements == {"beads": 70}


def test_check_world_passes() -> None:
    assert ss2sql.check_world(String(20), queries=40).elements == {"beads": 20}

"""What worlds remember: as long as one query runs, and no longer."""

from __future__ import annotations

from typing import Any

import pytest
from balls import Balls, BallWorld, Box

import ss2sql
from ss2sql.vtables import TableFunction, function


class Left(TableFunction):
    """The balls that are to the left of a place."""

    name, table = "left", "balls"

    def rows(self, x: float) -> list[int]:
        return [number for number, place in self.world.places().items() if place < x]


class Attentive(BallWorld):
    """Balls that are looked at all together, and remembered."""

    tables = (Balls, Left)

    def places(self) -> dict[int, float]:
        known = self.memory
        if "places" not in known:
            self.source.calls["looks"] += 1
            known["places"] = {ball.id: ball.x for ball in self.source.balls.values()}
        return known["places"]  # type: ignore[no-any-return]

    @function
    def place(self, ball: int, by: float = 0.0) -> float:
        """Where a ball is."""
        return self.places()[ball] + by

    @function("volatile")
    def look(self, ball: int) -> float:
        """Where a ball is now."""
        return self.places()[ball]


@pytest.fixture
def box() -> Box:
    return Box.row(4)


@pytest.fixture
def world(box: Box) -> Attentive:
    return Attentive(box)


@pytest.fixture
def ss(ss: ss2sql.Session, world: Attentive) -> ss2sql.Session:
    ss.attach("space", world)
    return ss


def test_a_query_looks_once(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    query = ss.compile("SELECT place(this, 0.5) FROM space WHERE place(this) > 1 AS list;")
    assert query.run(engine=engine).value == [2.5, 3.5, 4.5]
    assert box.calls["looks"] == 1
    box.balls[3].x = 9.0
    assert query.run(engine=engine).value == [2.5, 9.5, 4.5]
    assert box.calls["looks"] == 2


def test_searches_and_tables_share_what_is_remembered(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    found = ss.run("SELECT place(this) FROM space.left(2.5) AS list;", engine=engine).value
    assert found == [1.0, 2.0]
    assert box.calls["looks"] == 1
    search = """SELECT this.id FROM space WHERE place(this) == 4 START WITH at = 0.0
                CONNECT BY NO CYCLE at = place(this) STOP WITH place(this) <= at AS list"""
    paths = ss.run(search, engine=engine).value
    assert sorted(paths) == [[1, 2, 3, 4], [1, 2, 4], [1, 3, 4], [1, 4], [2, 3, 4], [2, 4], [3, 4], [4]]
    assert box.calls["looks"] == 2


def test_a_query_that_may_move_the_world_looks_each_time(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    found = ss.run("SELECT push(this, 10.0), place(this), look(this) FROM space AS rows;", engine=engine).value
    assert found == [(11.0, 11.0, 11.0), (12.0, 12.0, 12.0), (13.0, 13.0, 13.0), (14.0, 14.0, 14.0)]
    assert box.calls["looks"] == 8
    ss.function("touch", lambda value: value, volatility="volatile")  # who knows what it does
    assert ss.run("SELECT place(this, touch(1)) FROM space AS list;", engine=engine).value == [12.0, 13.0, 14.0, 15.0]
    assert box.calls["looks"] == 12
    ss.set("text", "place(this, 2)")
    assert ss.run("SELECT eval(text) FROM space AS list;").value == [13.0, 14.0, 15.0, 16.0]
    assert box.calls["looks"] == 16


def test_outside_of_queries_nothing_is_remembered(ss: ss2sql.Session, world: Attentive, box: Box, engine: Any) -> None:
    first = ss.run("SELECT this FROM space LIMIT 1 AS value;").value
    assert ss.run("[place(b), place(b, 1)];", engine=engine, b=first).value == [1.0, 2.0]
    assert box.calls["looks"] == 2
    assert world.place(1) == 1.0
    box.balls[1].x = 7.0
    assert world.place(1) == 7.0
    assert world.memory == {}


def test_a_query_that_fails_leaves_nothing_behind(ss: ss2sql.Session, world: Attentive, box: Box, engine: Any) -> None:
    with pytest.raises(ss2sql.Error):
        ss.run("SELECT 1 / (place(this) - 3) FROM space AS list;", engine=engine)
    assert world.memory == {}
    box.balls[3].x = 5.0
    assert ss.run("SELECT place(this) FROM space AS list;", engine=engine).value == [1.0, 2.0, 5.0, 4.0]


def test_a_query_inside_of_a_function_has_a_memory_of_its_own(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    inner = "SELECT push(this, 10.0) FROM space WHERE id == 1 AS value; SELECT place(this) FROM space AS list;"
    seen: list[list[float]] = []

    def ask(value: float) -> float:
        seen.append(ss.run(inner, engine=engine).value)
        return value

    ss.function("ask", ask, volatility="stable")  # which it is not: what the outer query remembers stays as it was
    assert ss.run("SELECT ask(place(this)), place(this, 1) FROM space WHERE id < 3 AS rows;", engine=engine).value == [
        (1.0, 2.0),
        (2.0, 3.0),
    ]
    assert [places[0] for places in seen] == [11.0, 21.0]
    assert box.calls["looks"] == 1 + 2


def test_nested_queries_share_the_memory_of_the_whole(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    script = "SELECT this.id, (SELECT place(this) FROM space WHERE id == 2 AS value) FROM space AS rows;"
    assert ss.run(script, engine=engine).value == [(1, 2.0), (2, 2.0), (3, 2.0), (4, 2.0)]
    assert box.calls["looks"] == 1


def test_each_world_has_its_own_memory(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    other = Box.row(2)
    ss.attach("room", Attentive(other))
    script = "SELECT place(a.this), place(b.this) FROM a = space, b = room WHERE b.id == 2 AS rows;"
    assert ss.run(script, engine=engine).value == [(1.0, 2.0), (2.0, 2.0), (3.0, 2.0), (4.0, 2.0)]
    assert (box.calls["looks"], other.calls["looks"]) == (1, 1)


def test_one_world_in_two_sessions(ss: ss2sql.Session, world: Attentive, box: Box, engine: Any) -> None:
    other = ss2sql.connect()
    other.attach("space", world)
    inner = "SELECT place(this) FROM space AS list;"
    ss.function("others", lambda ball: other.run(inner, engine=engine).value, volatility="stable")
    script = "SELECT place(this), others(this)[3] FROM space WHERE id < 3 AS rows;"
    assert ss.run(script, engine=engine).value == [(1.0, 4.0), (2.0, 4.0)]
    assert box.calls["looks"] == 3

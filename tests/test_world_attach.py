"""Worlds in a session: how they are attached under a name, and how they describe themselves."""

from __future__ import annotations

from typing import Any

import pytest
from balls import BallWorld, Box
from balls import fixture_box as fixture_box
from balls import fixture_ss as fixture_ss
from sessions import code_of

import ss2sql
from ss2sql.vtables import Column, Gone, Table, World, register_world

# --- attaching -----------------------------------------------------------------------------------------


def test_adapters_are_found_by_type(box: Box, engine: Any) -> None:
    register_world(BallWorld)
    ss = ss2sql.connect()
    ss.attach("space", box)
    assert ss.run("SELECT count(*) FROM space GROUP BY 1 AS value;", engine=engine).value == 5
    world = ss.get("space")
    assert isinstance(world, BallWorld)
    assert world.source is box


def test_an_object_may_bring_its_own_adapter(box: Box, engine: Any) -> None:
    class Scene:
        def __world__(self) -> World:
            return BallWorld(box)

    ss = ss2sql.connect()
    ss.attach("space", Scene())
    assert ss.run("SELECT id FROM space LIMIT 2 AS list;", engine=engine).value == [1, 2]


def test_what_cannot_be_attached_is_refused_with_what_can() -> None:
    register_world(BallWorld)
    with pytest.raises(ss2sql.SessionError, match=r"a builtins.object cannot be attached[\s\S]*balls.Box") as caught:
        ss2sql.connect().attach("space", object())
    assert caught.value.code == "S002"


def test_a_name_can_get_another_meaning(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    query = ss.compile("SELECT id FROM space AS list;")
    assert query.run(engine=engine).value == [1, 2, 3, 4, 5]
    ss.attach("space", BallWorld(Box.row(2)))
    assert query.run(engine=engine).value == [1, 2]
    ss.attach("space", [{"id": 7}])
    assert query.run(engine=engine).value == [7]
    assert query.run(engine=engine, space=[{"id": 8}]).value == [8]
    ss.attach("space", BallWorld(box))
    assert query.run(engine=engine, space=[{"id": 8}]).value == [8]
    assert query.run(engine=engine).value == [1, 2, 3, 4, 5]
    ss.detach("space")
    assert code_of(ss.run, "SELECT id FROM space;", engine=engine) == "R003"
    assert code_of(ss.run, "mass(1);", engine=engine) == "R002"


def test_another_schema_under_the_same_name(ss: ss2sql.Session, engine: Any) -> None:
    class Things(Table):
        name, key = "balls", "id"
        columns = (Column("id", str), Column("size", int))
        groups = {"size": "size"}

        def keys(self, where: Any) -> list[str]:
            return ["b", "a"]

        def size(self, key: str) -> int:
            return ord(key)

    class Other(World):
        tables = (Things,)

    assert ss.run("SELECT * FROM space LIMIT 1;", engine=engine).columns[0:2] == ("id", "name")
    ss.attach("space", Other())
    assert ss.run("SELECT * FROM space AS rows;", engine=engine).value == [("b", 98), ("a", 97)]
    assert ss.run("SELECT id FROM space WHERE size > 0 AND id > 'a' AS list;", engine=engine).value == ["b"]


def test_a_world_hides_a_table_of_the_database(box: Box, engine: Any) -> None:
    ss = ss2sql.connect()
    ss.host.connection.execute("CREATE TABLE space(id); INSERT INTO space VALUES (77)")
    ss.host.connection.execute('CREATE TABLE "room.balls"(id); INSERT INTO "room.balls" VALUES (78)')
    assert ss.run("SELECT id FROM space AS list;", engine=engine).value == [77]
    ss.attach("space", BallWorld(box))
    ss.attach("room", BallWorld(box))
    assert ss.run("SELECT id FROM space LIMIT 1 AS list;", engine=engine).value == [1]
    assert ss.run("SELECT id FROM room LIMIT 1 AS list;", engine=engine).value == [1]


def test_the_clock_of_the_world_is_that_of_the_session(engine: Any) -> None:
    box = Box.row(1)
    ss = ss2sql.connect()
    ss.attach("space", BallWorld(box))
    box.time = 0.0
    assert ss.run("getTime();", engine=engine).value == 0.0
    ss.run("seen{10} = 1;", engine=engine)
    box.time = 5.0
    ss.run("seen{10} = 2;", engine=engine)
    assert ss.run("[seen{0.0}, seen{5.0}, getTime()];", engine=engine).value == [1, 2, 5.0]


def test_representations_of_a_world(ss: ss2sql.Session, engine: Any) -> None:
    assert ss.run("SELECT mass FROM space AS weight;", engine=engine).value == 300.0


# --- for people ----------------------------------------------------------------------------------------


def test_help_and_describe_come_from_the_declarations(ss: ss2sql.Session) -> None:
    text = ss.describe("space")
    assert text == ss.eval("help(space);")
    assert text.startswith("space: Balls in a box.\n")
    lines = [line.split() for line in text.splitlines()]
    assert ["x", "float", "m", "=", "<", "<=", ">", ">=", "from", "left", "to", "right"] in lines
    assert "FROM space.near(x, y, z, radius=1.0): elements of balls" in text
    assert "  push      Moves the ball and gives its new place. (volatile)" in text
    assert "how heavy it is [kg]" in ss.eval('help("mass");')
    assert ss.describe("space.gaps").splitlines()[0] == "FROM space.gaps(id, most=1000000000.0)"
    assert ss.tables()["space.gaps(id, most=1000000000.0)"] == ("a", "b", "gap")
    assert code_of(ss.describe, "spce") == "S002"


def test_the_sql_reads_like_the_script(ss: ss2sql.Session) -> None:
    sql = " ".join(ss.compile("SELECT b.mass FROM b = space, n = space.near(b.x, 0, 0) WHERE b.x > 2;").sql.split())
    assert sql == ('SELECT b.mass FROM "space.balls" AS b CROSS JOIN "space.near"(b.x, 0, 0) AS n WHERE b.x > 2')


def test_gone_is_an_exception_of_adapters() -> None:
    assert issubclass(Gone, Exception)

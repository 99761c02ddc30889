"""Worlds in a session: how they are attached, what queries ask of them, and how long anything of them is remembered.

What scripts over a world give stands in tests/cases/worlds.
"""

from __future__ import annotations

import ast
import copy
import pickle
from typing import Any

import pytest
from adapters import ArrayWorld
from balls import Ball, Balls, BallWorld, Box
from balls import fixture_box as fixture_box
from balls import fixture_ss as fixture_ss
from golden import each_row
from sessions import code_of

import ss2sql
from ss2sql.vtables import Element, TableFunction, World, function, register_world

# --- attaching -----------------------------------------------------------------------------------------


def test_adapters_are_found_by_type_and_by_the_object_itself(box: Box, engine: Any) -> None:
    class Scene:
        def __world__(self) -> World:
            return BallWorld(box)

    register_world(BallWorld)
    with ss2sql.connect() as ss:
        for thing in (box, Scene()):
            ss.attach("space", thing)
            assert ss.run("SELECT id FROM space LIMIT 2 AS list;", engine=engine).value == [1, 2]
            world = ss.get("space")
            assert isinstance(world, BallWorld)
            assert world.source is box
        for nothing in (object(), len, World, pytest):
            with pytest.raises(ss2sql.SessionError, match=r"cannot be attached[\s\S]*balls.Box") as caught:
                ss.attach("space", nothing)
            assert any("write an adapter" in hint for hint in caught.value.hints)


@pytest.mark.parametrize(
    ("start", "condition", "cure"),
    [("SELECT id FROM found", "mass > 20", "mass(this)"), ("SELECT o.id FROM o = found", "20 < mass", "mass(this)"),
     ("SELECT o.id FROM n = [1], o = found", "mass > 20", "mass(o.this)")],
)  # fmt: skip
def test_a_column_of_elements_in_a_variable(ss: ss2sql.Session, start: str, condition: str, cure: str) -> None:
    ss.run("found = SELECT this FROM space AS list;")
    with pytest.raises(ss2sql.ResolveError, match="unknown name 'mass'") as caught:
        ss.run(f"{start} WHERE {condition} AS list;")
    assert caught.value.hints == (f"'mass' is a function of elements, too: write {cure}",)
    wanted = ss.eval("SELECT id FROM space WHERE mass > 20 AS list;")
    assert ss.eval(f"{start} WHERE {condition.replace('mass', cure)} AS list;") == wanted != []


def test_a_name_can_get_another_meaning(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    query = ss.compile("SELECT id FROM space AS list;")
    assert query.run(engine=engine).value == [1, 2, 3, 4, 5]
    ss.attach("space", BallWorld(Box.row(2)))
    assert query.run(engine=engine).value == [1, 2]
    ss.attach("space", ArrayWorld())  # of other columns
    assert query.run(engine=engine).value == list(range(12))
    ss.attach("space", [{"id": 7}])
    assert query.run(engine=engine).value == [7]
    assert query.run(engine=engine, space=[{"id": 8}]).value == [8]
    ss.attach("space", BallWorld(box))
    assert query.run(engine=engine, space=[{"id": 8}]).value == [8]
    assert query.run(engine=engine).value == [1, 2, 3, 4, 5]
    ss.detach("space")
    assert code_of(ss.run, "SELECT id FROM space;", engine=engine) == "R003"
    assert code_of(ss.run, "mass(1);", engine=engine) == "R002"


def test_representations_of_a_world_come_and_go_with_it_and_never_replace_that_of_the_user(
    ss: ss2sql.Session, box: Box, engine: Any
) -> None:
    query = ss.compile("SELECT 7 FROM [1] AS weight;")
    other = BallWorld(box)
    other.weight = lambda table: -1.0  # type: ignore[method-assign]
    ss.attach("other", other)
    assert query.run(engine=engine).value == -1  # of the world that was attached last
    ss.detach("other")
    assert query.run(engine=engine).value == 7
    ss.representation("Weight")(lambda table: "mine")
    ss.attach("other", BallWorld(box))
    for name in ("other", "space"):
        assert query.run(engine=engine).value == "mine"
        ss.detach(name)
    assert query.run(engine=engine).value == "mine"
    with ss2sql.connect() as without:
        without.attach("space", BallWorld(box))
        without.detach("space")
        assert code_of(without.run, "SELECT 7 FROM [1] AS weight;", engine=engine) == "R006"


def test_a_world_hides_a_table_of_the_database(box: Box, engine: Any) -> None:
    ss = ss2sql.connect()
    ss.host.connection.execute("CREATE TABLE space(id); INSERT INTO space VALUES (77)")
    ss.host.connection.execute('CREATE TABLE "room.balls"(id); INSERT INTO "room.balls" VALUES (78)')
    assert ss.run("SELECT id FROM space AS list;", engine=engine).value == [77]
    for name in ("space", "room"):
        ss.attach(name, BallWorld(box))
        assert ss.run(f"SELECT id FROM {name} LIMIT 1 AS list;", engine=engine).value == [1]


def test_the_clock_of_the_world_is_that_of_the_session(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    box.time = 0.0
    assert ss.run("getTime();", engine=engine).value == 0.0
    ss.run("seen{10} = 1;", engine=engine)
    box.time = 5.0
    ss.run("seen{10} = 2;", engine=engine)
    assert ss.run("[seen{0.0}, seen{5.0}, getTime()];", engine=engine).value == [1, 2, 5.0]


def test_help_and_describe_come_from_the_declarations(ss: ss2sql.Session) -> None:
    text = ss.describe("space")
    assert text == ss.eval("help(space);")
    assert text.startswith("space: Balls in a box.\n")
    lines = [line.split() for line in text.splitlines()]
    assert ["x", "float", "m", "=", "<", "<=", ">", ">=", "from", "left", "to", "right"] in lines
    assert "FROM space.near(x, y, z, radius=1.0): elements of balls" in text
    assert "  push      Moves the ball and gives its new place. (volatile)" in text
    assert "mass(this): how heavy it is [kg]" in ss.eval('help("mass");')
    assert ss.describe("space.gaps").splitlines()[0] == "FROM space.gaps(id, most=1000000000.0)"
    assert ss.tables()["space.gaps(id, most=1000000000.0)"].columns == ("a", "b", "gap")
    assert code_of(ss.describe, "spce") == "S002"


# --- elements and functions ----------------------------------------------------------------------------


def test_an_element_is_an_object_that_knows_its_columns(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    found = ss.run("SELECT this FROM space WHERE x < 3 AS list;", engine=engine).value
    assert [type(element) for element in found] == [Element, Element]
    assert [element.key for element in found] == [1, 2]
    assert (found[0].mass, found[0].pos, found[1].colour) == (20.0, [1.0, 0.0, 0.0], "red")
    assert found[0] != found[1]
    assert found[0] == ss.run("SELECT this FROM space LIMIT 1 AS value;", engine=engine).value
    assert len({found[0], found[1], found[0]}) == 2
    assert repr(found[0]) == "balls[1]"
    with pytest.raises(AttributeError, match="colr"):
        _ = found[0].colr
    with pytest.raises(AttributeError, match="cannot be changed"):
        found[0].mass = 1.0
    ss.attach("again", BallWorld(box))  # the same object, so these are the same elements
    script = "SELECT a.id FROM a = space, b = again WHERE a.this == b.this AS list;"
    assert ss.run(script, engine=engine).value == [1, 2, 3, 4, 5]
    del box.balls[1]
    with pytest.raises(ss2sql.ExecutionError, match="no longer exists"):
        _ = found[0].mass


@pytest.mark.parametrize("condition", ["this == e", "this IN [e]", "same(this) == e", "this == same(e)", "e == this"])
def test_an_element_equals_itself_wherever_it_comes_from(ss: ss2sql.Session, engine: Any, condition: str) -> None:
    ss.function("same", lambda ball: ball, volatility="immutable")
    element = ss.eval("SELECT this FROM space WHERE id == 2 AS value;")
    assert ss.run(f"SELECT id FROM space WHERE {condition} AS list;", engine=engine, e=element).value == [2]
    assert ss.run("SELECT id FROM space WHERE same(this) == this AS list;", engine=engine).value == [1, 2, 3, 4, 5]


def test_an_element_stays_in_its_world(ss: ss2sql.Session) -> None:
    result = ss.run("SELECT this FROM space AS list;")
    assert copy.deepcopy(result).value[0] is result.value[0]
    assert copy.copy(result.value[0]) is result.value[0]
    with pytest.raises(TypeError, match="is an element of a world and cannot be pickled; select its columns"):
        pickle.dumps(result)


def test_an_exception_of_the_user_tells_nothing_of_a_run_before(ss: ss2sql.Session) -> None:
    def fail(ball: Any) -> Any:
        raise ValueError(ball.mass)

    ss.function("fail", fail, volatility="stable")
    with pytest.raises(ValueError, match="20") as caught:  # SQL gives up, then Python decides
        ss.run("SELECT fail(this) FROM space;")
    assert caught.value.__context__ is caught.value.__cause__ is None


def test_an_error_of_ours_from_a_function_is_at_its_call(ss: ss2sql.Session, engine: Any) -> None:
    def refuse(ball: Any) -> Any:
        raise ss2sql.ExecutionError("X007", "refused")

    ss.function("refuse", refuse, volatility="stable")
    with pytest.raises(ss2sql.ExecutionError, match="refused") as caught:
        ss.run("SELECT id, refuse(this) FROM space;", engine=engine)
    assert caught.value.span is not None
    assert caught.value.span.text == "refuse(this)"


def test_a_function_of_two_worlds_names_both(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    ss.attach("again", BallWorld(box))
    with pytest.raises(ss2sql.ExecutionError, match=r"write space.shifted\(...\) or again.shifted\(...\)"):
        ss.run("shifted(1);", engine=engine)


def test_functions_of_the_user_come_before_those_of_a_world(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("density", lambda ball: ball.mass / 10, volatility="stable")
    assert ss.run("SELECT density FROM space LIMIT 2 AS list;", engine=engine).value == [2.0, 4.0]
    ss.function("shifted", lambda ball: -1, volatility="stable")
    assert ss.run("SELECT shifted FROM space LIMIT 1 AS list;", engine=engine).value == [-1]


# --- live, and copied ----------------------------------------------------------------------------------


def test_births_moves_and_deaths_are_seen_by_the_next_query(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    query = ss.compile("SELECT id, x FROM space WHERE x > 3 AS rows;")
    assert query.run(engine=engine).value == [(4, 4.0), (5, 5.0)]
    box.balls[9] = Ball(9, "new", 3.5, 0.0, 0.0, 1.0)
    del box.balls[4]
    box.balls[1].x = 8.0
    assert query.run(engine=engine).value == [(1, 8.0), (5, 5.0), (9, 3.5)]


def test_births_within_a_query_are_not_seen_by_it(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    def bear(ball: Element) -> int:
        number = max(box.balls) + 1
        box.balls[number] = Ball(number, "child", 0.0, 0.0, 0.0, 1.0)
        return number

    ss.function("bear", bear, volatility="stable")
    assert ss.run("SELECT bear(this) FROM space AS list;", engine=engine).value == [6, 7, 8, 9, 10]
    assert box.calls["keys"] == 1


# --- only the columns that are read, only the elements that are needed ---------------------------------


@each_row("worlds/asked", "script", "told")
def test_what_a_query_asks_for(ss: ss2sql.Session, box: Box, engine: Any, script: str, told: str) -> None:
    found = ss.run(f"{script} AS rows;", engine=engine).value
    assert box.calls == ast.literal_eval(told)
    ss.attach("space", [{**vars(ball), "heavy": ball.mass > 50} for ball in box.balls.values()])
    if "near" not in script:
        assert found == ss.run(f"{script} AS rows;", engine="native").value


@each_row("worlds/filters", "where", "told")
def test_filters_are_passed_on(ss: ss2sql.Session, box: Box, engine: Any, where: str, told: str) -> None:
    given = ast.literal_eval(told)
    found = ss.run(f"SELECT id FROM space WHERE {where} AS list;", engine=engine).value
    assert box.calls["given"] == given
    ss.attach("rows", [vars(ball) for ball in box.balls.values()])
    assert found == ss.run(f"SELECT id FROM rows WHERE {where} AS list;", engine="native").value


# --- what worlds remember: as long as one query runs, and no longer ------------------------------------


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
def world(ss: ss2sql.Session) -> Attentive:
    """Four balls, in the place of the others."""
    made = Attentive(Box.row(4))
    ss.attach("space", made)
    return made


@each_row("worlds/looks", "script", "told")
def test_looking_once(ss: ss2sql.Session, world: Attentive, engine: Any, script: str, told: str) -> None:
    value, looks = ast.literal_eval(told)
    room = Attentive(Box.row(2))
    ss.attach("room", room)
    ss.attach("space", world)
    ss.function("touch", lambda value: value, volatility="volatile")  # who knows what it does
    found = ss.run(script, engine="auto" if looks > 1 and engine == "database" else engine).value
    assert (sorted(found), world.source.calls["looks"]) == (value, looks)
    assert room.source.calls["looks"] == ("room" in script)
    assert world.memory == {}


def test_outside_of_queries_nothing_is_remembered(ss: ss2sql.Session, world: Attentive, engine: Any) -> None:
    first = ss.run("SELECT this FROM space LIMIT 1 AS value;").value
    assert ss.run("[place(b), place(b, 1)];", engine=engine, b=first).value == [1.0, 2.0]
    assert world.source.calls["looks"] == 2
    assert world.place(1) == 1.0
    world.source.balls[1].x = 7.0
    assert (world.place(1), world.memory) == (7.0, {})


def test_a_query_that_fails_leaves_nothing_behind(ss: ss2sql.Session, world: Attentive, engine: Any) -> None:
    with pytest.raises(ss2sql.Error):
        ss.run("SELECT 1 / (place(this) - 3) FROM space AS list;", engine=engine)
    assert world.memory == {}
    world.source.balls[3].x = 5.0
    assert ss.run("SELECT place(this) FROM space AS list;", engine=engine).value == [1.0, 2.0, 5.0, 4.0]


def test_a_query_inside_a_function_has_a_memory_of_its_own(ss: ss2sql.Session, world: Attentive, engine: Any) -> None:
    inner = "SELECT push(this, 10.0) FROM space WHERE id == 1 AS value; SELECT place(this) FROM space AS list;"
    seen: list[list[float]] = []

    def ask(value: float) -> float:
        seen.append(ss.run(inner).value)
        return value

    ss.function("ask", ask, volatility="stable")  # which it is not: what the outer query remembers stays as it was
    script = "SELECT ask(place(this)), place(this, 1) FROM space WHERE id < 3 AS rows;"
    assert ss.run(script, engine=engine).value == [(1.0, 2.0), (2.0, 3.0)]
    assert [places[0] for places in seen] == [11.0, 21.0]
    assert world.source.calls["looks"] == 1 + 2

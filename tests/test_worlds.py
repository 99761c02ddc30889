"""Worlds in scripts: tables, columns as functions, filters, lazy groups, joins, searches, live reading and copies."""

from __future__ import annotations

from typing import Any

import pytest
from balls import Ball, Balls, BallWorld, Box

import ss2sql
from ss2sql.vtables import Column, Element, Gone, Table, World, register_world

ENGINES = ("database", "native")


@pytest.fixture(params=ENGINES)
def engine(request: Any) -> Any:
    return request.param


@pytest.fixture
def box() -> Box:
    return Box.row(5)


@pytest.fixture
def ss(box: Box) -> ss2sql.Session:
    session = ss2sql.connect()
    session.attach("space", BallWorld(box))
    return session


def code_of(call: Any, *arguments: Any, **named: Any) -> str:
    with pytest.raises(ss2sql.Error) as caught:
        call(*arguments, **named)
    return caught.value.code


# --- names, columns, functions -------------------------------------------------------------------------


@pytest.mark.parametrize(
    "column", ["mass", "mass(this)", "space.mass", "this.mass", "mass(space.this)", "space.mass(this)"]
)
def test_a_column_is_also_a_function_of_this(ss: ss2sql.Session, engine: Any, column: str) -> None:
    found = ss.run(f"SELECT {column} FROM space WHERE {column} > 50 AS list;", engine=engine)
    assert found.value == [60.0, 80.0, 100.0]
    assert found.columns == ("mass",)


def test_the_queries_of_the_paper_read_like_that(ss: ss2sql.Session, engine: Any) -> None:
    assert ss.run("SELECT name, mass FROM space WHERE heavy(this) AND mass(this) > 70;", engine=engine).value == [
        {"name": "ball4", "mass": 80.0},
        {"name": "ball5", "mass": 100.0},
    ]


def test_star_gives_the_declared_columns(ss: ss2sql.Session, engine: Any) -> None:
    found = ss.run("SELECT * FROM space WHERE id == 2 AS rows;", engine=engine)
    assert found.columns == tuple(column.name for column in Balls.columns)
    assert found.value == [(2, "ball2", 2.0, 0.0, 0.0, 40.0, "red", False, [2.0, 0.0, 0.0])]


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
    del box.balls[1]
    with pytest.raises(ss2sql.ExecutionError, match="no longer exists"):
        _ = found[0].mass


def test_elements_travel_through_variables_lists_and_queries(ss: ss2sql.Session, engine: Any) -> None:
    ss.run("big = SELECT this FROM space WHERE heavy AS list; one = big[0];", engine=engine)
    assert ss.run("SELECT id, big.name FROM big AS rows;", engine=engine).value == [
        (3, "ball3"),
        (4, "ball4"),
        (5, "ball5"),
    ]
    assert ss.run("mass(one);", engine=engine).value == 60.0
    assert ss.run("SELECT id FROM space WHERE this == one AS list;", engine=engine).value == [3]
    assert ss.run("SELECT id FROM space WHERE this IN big AND this != one AS list;", engine=engine).value == [4, 5]
    nested = "SELECT mass FROM (SELECT this FROM space WHERE id > 4 AS list) AS list;"
    assert ss.run(nested, engine=engine).value == [100.0]


def test_functions_of_a_world_and_of_the_user(ss: ss2sql.Session, engine: Any) -> None:
    assert ss.run("SELECT shifted, shifted(this, 10) FROM space LIMIT 2 AS rows;", engine=engine).value == [
        (2.0, 11.0),
        (3.0, 12.0),
    ]
    ss.function("density", lambda ball: ball.mass / 10, volatility="stable")
    assert ss.run("SELECT density FROM space LIMIT 2 AS list;", engine=engine).value == [2.0, 4.0]
    ss.function("shifted", lambda ball: -1, volatility="stable")  # the user's own comes first
    assert ss.run("SELECT shifted FROM space LIMIT 1 AS list;", engine=engine).value == [-1]


def test_a_built_in_function_of_the_same_name_stays_what_it_is(ss: ss2sql.Session, engine: Any) -> None:
    assert ss.run("distance([0, 0], [3, 4]);", engine=engine).value == 5.0
    pairs = "SELECT distance(a.this, b.this) FROM a = space, b = space WHERE a.id == 1 AND b.id == 4 AS list;"
    assert ss.run(pairs, engine=engine).value == [3.0]
    ss.set("mixed", [[0.0, 0.0], None])
    assert ss.run("distance(mixed[0], [3, 4]);", engine=engine).value == 5.0


def test_what_is_no_element_has_no_columns(ss: ss2sql.Session, engine: Any) -> None:
    assert code_of(ss.run, "mass(3);", engine=engine) == "X007"
    assert code_of(ss.run, "mass();", engine=engine) == "R005"
    assert code_of(ss.run, "SELECT nmae FROM space;", engine=engine) == "R001"
    assert code_of(ss.run, "SELECT space.nope(this) FROM space;", engine=engine) == "R002"
    assert code_of(ss.run, "SELECT spice.mass(this) FROM space;", engine=engine) == "R002"


def test_this_has_columns_in_plain_lists_too(ss: ss2sql.Session, engine: Any) -> None:
    ss.attach("rows", [{"x": 1, "y": 2}, {"x": 3, "y": 4}])
    assert ss.run("SELECT this.y FROM rows WHERE this.x > 1 AS list;", engine=engine).value == [4]


# --- what is asked of the world ------------------------------------------------------------------------


def test_groups_are_asked_only_for_what_is_read(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    ss.run("SELECT id FROM space;", engine=engine)
    assert box.calls == {"keys": 1, "given": 5}
    box.calls.clear()
    ss.run("SELECT x, y, mass FROM space WHERE mass > 50;", engine=engine)
    assert box.calls == {"keys": 1, "given": 5, "dynamics": 5, "place": 3}


def test_limit_touches_no_more_than_it_needs(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    assert ss.run("SELECT name FROM space LIMIT 3 AS list;", engine=engine).value == ["ball1", "ball2", "ball3"]
    assert box.calls["label"] == 3
    box.calls.clear()
    assert ss.run("SELECT id FROM space WHERE mass > 30 LIMIT 1 AS list;", engine=engine).value == [2]
    assert box.calls["dynamics"] == 2


@pytest.mark.parametrize(
    ("where", "given"),
    [
        ("id == 3", 1),
        ("3 == id", 1),
        ("id == 7", 0),
        ("x > 4", 2),  # bounds are passed on inclusively
        ("4 < x", 2),
        ("x >= 2 AND x <= 3", 2),
        ("x >= 2 AND mass > 50", 4),
        ("x == 3", 1),
        ("name == 'ball2'", 1),
        ("name > 'ball3'", 3),
        ("mass > 50", 5),  # the adapter cannot filter by it
        ("x > 2 OR id == 1", 5),
        ("id IN [1, 4]", 5),
        ("id != 3", 5),
        ("x + 1 > 4", 5),
        ("id == 'ball3'", 5),  # a value of another kind restricts nothing
    ],
)
def test_filters_are_passed_on(ss: ss2sql.Session, box: Box, engine: Any, where: str, given: int) -> None:
    found = ss.run(f"SELECT id FROM space WHERE {where} AS list;", engine=engine).value
    calls = box.calls["given"]
    rows = [vars(ball) for ball in box.balls.values()]
    ss.attach("rows", rows)
    assert found == ss.run(f"SELECT id FROM rows WHERE {where} AS list;", engine="native").value
    assert calls == given


def test_joins_pass_on_what_the_sources_before_know(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    script = "SELECT a.id, b.id FROM a = space, b = space WHERE b.x > a.x AND b.x <= a.x + 1 AS rows;"
    assert ss.run(script, engine=engine).value == [(1, 2), (2, 3), (3, 4), (4, 5)]
    assert box.calls["given"] == 5 + 9  # themselves and their neighbours to the right
    assert box.calls["place"] == 5  # every ball is asked once within a query


def test_a_condition_behind_one_that_may_fail_is_not_passed_on(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    ss.function("risky", lambda number: 1 / (number - 5), volatility="immutable")
    with pytest.raises(ZeroDivisionError):
        ss.run("SELECT id FROM space WHERE risky(id) != 0 AND x < 3;", engine=engine)
    assert ss.run("SELECT id FROM space WHERE x < 3 AND risky(id) != 0 AS list;", engine=engine).value == [1, 2]


def test_the_plan_shows_what_is_passed_on(ss: ss2sql.Session) -> None:
    plan = explained(ss, "SELECT id FROM space WHERE x >= 2 AND x < 4;")
    assert "VIRTUAL TABLE INDEX 0:x >= ?, x < ?" in plan
    assert "VIRTUAL TABLE INDEX 0:all" in explained(ss, "SELECT id FROM space WHERE mass > 2;")


def explained(ss: ss2sql.Session, script: str) -> str:
    sql = ss.compile(script).sql
    return "\n".join(row[3] for row in ss.host.connection.execute(f"EXPLAIN QUERY PLAN {sql}", sql.parameters))


# --- joins, nested queries, searches -------------------------------------------------------------------


def test_joins_with_lists_in_both_orders(ss: ss2sql.Session, engine: Any) -> None:
    ss.set("wanted", [4, 2, 9])
    first = "SELECT id FROM w = wanted, space WHERE id == w.this AS list;"
    assert ss.run(first, engine=engine).value == [4, 2]
    assert ss.run(first.replace("w = wanted, space", "space, w = wanted"), engine=engine).value == [2, 4]


def test_a_session_holds_several_worlds(ss: ss2sql.Session, engine: Any) -> None:
    ss.attach("other", BallWorld(Box(Ball(1, "far", 2.5, 0.0, 0.0, 1.0), Ball(2, "near", 1.5, 0.0, 0.0, 2.0))))
    script = "SELECT space.id, other.name FROM space, other WHERE other.x >= space.x AND other.x < space.x + 1 AS rows;"
    assert ss.run(script, engine=engine).value == [(1, "near"), (2, "far")]
    assert ss.run("SELECT mass(this) FROM other AS list;", engine=engine).value == [1.0, 2.0]
    assert ss.run("SELECT shifted FROM other AS list;", engine=engine).value == [3.5, 2.5]
    assert ss.run("SELECT a.this == b.this FROM a = space, b = other LIMIT 1 AS list;", engine=engine).value == [False]
    assert code_of(ss.run, "shifted(1);", engine=engine) == "X007"
    assert ss.run("[space.shifted(1), other.shifted(1)];", engine=engine).value == [2.0, 3.5]


def test_one_object_attached_twice_has_the_same_elements(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    ss.attach("again", BallWorld(box))
    script = "SELECT a.id FROM a = space, b = again WHERE a.this == b.this AS list;"
    assert ss.run(script, engine=engine).value == [1, 2, 3, 4, 5]


def test_nested_queries(ss: ss2sql.Session, engine: Any) -> None:
    heaviest = "SELECT name FROM space WHERE mass == max(SELECT mass FROM space AS list) AS list;"
    assert ss.run(heaviest, engine=engine).value == ["ball5"]
    right = "SELECT id, len(SELECT this FROM b = space WHERE b.x > space.x AS list) FROM space AS rows;"
    assert ss.run(right, engine=engine).value == [(1, 4), (2, 3), (3, 2), (4, 1), (5, 0)]
    assert ss.run("SELECT sum(mass) FROM space GROUP BY heavy AS list;", engine=engine).value == [60.0, 240.0]
    assert ss.run("SELECT id FROM space ORDER BY heavy DESC, x AS list;", engine=engine).value == [3, 4, 5, 1, 2]


def test_table_functions(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    pairs = "SELECT a.id, n.id FROM a = space, n = space.near(a.x, a.y, a.z) WHERE a.this != n.this AS rows;"
    assert ss.run(pairs, engine=engine).value == [(1, 2), (2, 1), (2, 3), (3, 2), (3, 4), (4, 3), (4, 5), (5, 4)]
    assert box.calls["near"] == 5
    assert ss.run("SELECT mass FROM space.near(1, 0, 0, radius=2) AS list;", engine=engine).value == [20.0, 40.0, 60.0]
    assert ss.run("SELECT this FROM space.near(1, 0, 0, 0) AS list;", engine=engine).value[0].key == 1
    assert ss.run("SELECT this FROM space.gaps(2, 1.0) AS list;", engine=engine).value == [
        {"a": 2, "b": 1, "gap": 1.0},
        {"a": 2, "b": 3, "gap": 1.0},
    ]
    by_element = "SELECT g.b FROM a = space, g = space.gaps(a.this, most=1) WHERE a.id == 5 AS list;"
    assert ss.run(by_element, engine=engine).value == [4]


@pytest.mark.parametrize(
    ("source", "code"),
    [
        ("space.near(1, 2)", "R005"),
        ("space.near", "R005"),
        ("space.near(1, 2, 3, 4, 5)", "R005"),
        ("space.near(1, 2, 3, size=4)", "R005"),
        ("space.balls(1)", "R005"),
        ("space.nearr(1, 2, 3)", "R003"),
        ("space.nothing", "R003"),
        ("spce.near(1, 2, 3)", "R002"),
    ],
)
def test_wrong_tables_and_arguments_are_named(ss: ss2sql.Session, engine: Any, source: str, code: str) -> None:
    assert code_of(ss.run, f"SELECT this FROM {source};", engine=engine) == code
    assert ss.run("SELECT id FROM space LIMIT 1 AS value;", engine=engine).value == 1


def test_a_missing_argument_shows_how_to_call(ss: ss2sql.Session) -> None:
    with pytest.raises(ss2sql.ResolveError, match=r"lacks z[\s\S]*space.near\(x, y, z, radius=1.0\)"):
        ss.run("SELECT this FROM space.near(1, 2);")


@pytest.mark.parametrize("option", ["", "BREADTH FIRST", "NO CYCLE", "UNIQUE", "COST mass", "MEMORIZE 4"])
def test_searches_over_a_world(ss: ss2sql.Session, option: str) -> None:
    script = (
        "SELECT id FROM b = space WHERE id == 4 AND x == at + 1 START WITH at = 0.0 "
        f"CONNECT BY {option} at = b.x STOP WITH b.x != at + 1 OR at > 4 AS list;"
    )
    assert ss.run(script, engine="native").value == [[1, 2, 3, 4]]
    assert ss.run(script).value == [[1, 2, 3, 4]]


def test_searches_with_a_table_function_of_the_state(ss: ss2sql.Session, engine: Any) -> None:
    script = (
        "SELECT n.this FROM n = space.near(at, 0, 0, 1) WHERE n.id == 3 START WITH at = 1.0 "
        "CONNECT BY UNIQUE at = n.x AS list;"
    )
    found = ss.run(script, engine=engine).value
    assert [[element.key for element in path] for path in found] == [[2, 3]]


# --- live, and copied ----------------------------------------------------------------------------------


def test_births_moves_and_deaths_are_seen_by_the_next_query(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    query = ss.compile("SELECT id, x FROM space WHERE x > 3 AS rows;")
    assert query.run(engine=engine).value == [(4, 4.0), (5, 5.0)]
    box.balls[9] = Ball(9, "new", 3.5, 0.0, 0.0, 1.0)
    del box.balls[4]
    box.balls[1].x = 8.0
    assert query.run(engine=engine).value == [(1, 8.0), (5, 5.0), (9, 3.5)]


def test_a_query_that_moves_things_reads_from_a_copy(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    found = ss.run("SELECT id, x, push(this, 10.0), x FROM space WHERE x < 4 AS rows;", engine=engine).value
    assert found == [(1, 1.0, 11.0, 1.0), (2, 2.0, 12.0, 2.0), (3, 3.0, 13.0, 3.0)]
    assert [ball.x for ball in box.balls.values()] == [11.0, 12.0, 13.0, 4.0, 5.0]
    box.calls.clear()

    def bear(ball: Element) -> int:
        number = max(box.balls) + 1
        box.balls[number] = Ball(number, "child", 0.0, 0.0, 0.0, 1.0)
        return number

    ss.function("bear", bear, volatility="volatile")
    assert ss.run("SELECT bear(this) FROM space AS list;", engine=engine).value == [6, 7, 8, 9, 10]
    assert box.calls["keys"] == 1


def test_statements_of_a_script_see_what_those_before_have_done(ss: ss2sql.Session, engine: Any) -> None:
    script = "SELECT push(this, 1) FROM space WHERE id == 1 AS value; SELECT x FROM space WHERE id == 1 AS value;"
    assert ss.run(script, engine=engine).value == 2.0


def test_an_element_that_dies_while_it_is_read_is_an_error(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    def kill(ball: Element) -> bool:
        box.balls.pop(5, None)
        return True

    ss.function("kill", kill, volatility="stable")  # which is a lie, so nothing was copied
    assert code_of(ss.run, "SELECT name FROM space WHERE kill(this);", engine=engine) == "X011"
    assert ss.run("SELECT id FROM space AS list;", engine=engine).value == [1, 2, 3, 4]


def test_a_world_that_is_not_connected_says_so(ss: ss2sql.Session, box: Box, engine: Any) -> None:
    box.connected = False
    for source in ("space", "space.near(1, 2, 3)"):
        with pytest.raises(ss2sql.ExecutionError, match="the box is not connected") as caught:
            ss.run(f"SELECT id FROM {source};", engine=engine)
        assert caught.value.code == "X011"
        assert isinstance(caught.value.__cause__, ConnectionError)
    box.connected = True
    assert ss.run("SELECT id FROM space LIMIT 1 AS value;", engine=engine).value == 1


def test_no_row_twice_and_none_lost_where_sqlite_puts_or_together(ss: ss2sql.Session) -> None:
    script = "SELECT id FROM space WHERE id == 4 OR x < 2 OR (x > 3 AND x < 5) OR name == 'ball1' AS list;"
    assert ss.run(script, engine="database").value == [1, 4]
    assert ss.run(script, engine="native").value == [1, 4]


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

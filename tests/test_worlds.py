"""Worlds in scripts: tables, columns as functions, joins, searches, live reading and copies."""

from __future__ import annotations

from typing import Any

import pytest
from balls import Ball, Balls, BallWorld, Box
from balls import fixture_box as fixture_box
from balls import fixture_ss as fixture_ss
from sessions import code_of

import ss2sql
from ss2sql.vtables import Element

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
    with pytest.raises(ss2sql.ResolveError, match=r"space\.near is a table: write FROM space\.near\(\.\.\.\)"):
        ss.run("SELECT space.near(x, y, z) FROM space;", engine=engine)


def test_this_has_columns_in_plain_lists_too(ss: ss2sql.Session, engine: Any) -> None:
    ss.attach("rows", [{"x": 1, "y": 2}, {"x": 3, "y": 4}])
    assert ss.run("SELECT this.y FROM rows WHERE this.x > 1 AS list;", engine=engine).value == [4]


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


def test_many_conditions_are_asked_of_a_table_and_of_a_table_function(ss: ss2sql.Session, engine: Any) -> None:
    conditions = " AND ".join(f"(n.x != {k} OR n.mass == {k})" for k in range(5, 25))
    for source in ("space", "space.near(3, 0, 0, 2)"):
        script = f"SELECT id FROM n = {source} WHERE {conditions} AS list;"
        assert ss.run(script, engine=engine).value == [1, 2, 3, 4]  # x is the number, and the mass 20 times that


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

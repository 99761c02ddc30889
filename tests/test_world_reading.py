"""What queries ask of a world: only the columns that they read, and only the elements that they need."""

from __future__ import annotations

from typing import Any

import pytest
from balls import Box
from balls import fixture_box as fixture_box
from balls import fixture_ss as fixture_ss

import ss2sql


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

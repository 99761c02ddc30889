"""The SQL that is shown is the SQL that runs."""

from __future__ import annotations

import ast
import sqlite3

import apsw
import pytest
from golden import each_row
from listings import HANOI, MOVES, move
from sql_calls import python_calls, run_shown_sql

import ss2sql
from ss2sql.language.plan_traversal import format_plan


def double(x):
    return x * 2


FLAT = [
    "SELECT name, pay FROM staff WHERE pay > 5 ORDER BY pay DESC LIMIT 3 AS rows;",
    "SELECT double(pay) FROM staff WHERE name != 'b' AS list;",
    "SELECT boss, count(*), sum(pay) FROM staff GROUP BY boss AS rows;",
    "SELECT a.this, b.this FROM a = [1, 2, 3], b = ['x', 'y'] WHERE a.this != 2 AS rows;",
    "SELECT a.name, b.name FROM a = staff, b = staff WHERE a.id == b.boss AS rows;",
    "SELECT this FROM [[1, 2], [3.0, True], [None, 'x']] WHERE this[0] != 1 AS list;",
]


TABLE = (
    "CREATE TABLE staff(id INTEGER PRIMARY KEY, boss INTEGER, name TEXT, pay REAL);"
    "INSERT INTO staff VALUES (1, NULL, 'a', 9.5), (2, 1, 'b', 7), (3, 1, 'c', 8.25), (4, 2, 'd', 3)"
)


def session() -> ss2sql.Session:
    ss = ss2sql.connect()
    ss.host.connection.execute(TABLE)
    ss.function(move)
    ss.function(double)
    ss.attach("moves", MOVES)
    return ss


@pytest.fixture(name="staff")
def fixture_staff() -> ss2sql.Session:
    return session()


@pytest.mark.parametrize("script", FLAT)
def test_the_text_gives_the_same_rows_in_another_connection_with_the_same_functions(
    staff: ss2sql.Session, script: str
) -> None:
    result = staff.run(script, engine="database")
    other = session()
    assert run_shown_sql(other, result.sql) == list(result)
    assert len(list(result)) > 0


@pytest.mark.parametrize("option", ["", "BREADTH FIRST", "NO CYCLE", "UNIQUE", "MAXIMUM 2"])
def test_the_text_of_a_search_gives_the_same_last_rows(staff: ss2sql.Session, option: str) -> None:
    listing = HANOI["no-cycle" if option in ("NO CYCLE", "UNIQUE") else "cycle"].replace("mov.this", "this")
    script = listing.replace("NO CYCLE # or UNIQUE", "").replace("CONNECT BY", f"CONNECT BY {option}")
    result = staff.run(script, engine="database")
    other = session()
    pasted = run_shown_sql(other, result.sql)
    assert [row[2:] for row in pasted] == [path[-1] for path in result.paths]
    assert len(pasted) > 0


def test_a_query_without_python_runs_in_any_sqlite(staff: ss2sql.Session) -> None:
    """Flat queries over tables need neither functions nor parameters: the text is plain SQL."""
    script = "SELECT name, pay FROM staff WHERE pay > 5 AND boss == 1 ORDER BY name DESC LIMIT 2 AS rows;"
    result = staff.run(script, engine="database")
    assert result.sql.parameters == {}
    plain = sqlite3.connect(":memory:")
    plain.executescript(TABLE)
    assert plain.execute(result.sql).fetchall() == result.value == [("c", 8.25), ("b", 7.0)]
    plain.close()


def test_the_text_that_is_shown_is_the_text_that_sqlite_gets(staff: ss2sql.Session) -> None:
    seen: list[str] = []
    staff.host.connection.trace_v2(apsw.SQLITE_TRACE_STMT, lambda event: seen.append(event["sql"]))
    assert str(staff.run(FLAT[0], engine="database").sql) in seen


def test_literals_stay_readable(staff: ss2sql.Session) -> None:
    text = staff.run("SELECT this FROM [[1, 2], [3, 4]] WHERE this == [3, 4] AS list;", engine="database").sql
    assert "/* [[1, 2], [3, 4]] */" in text
    assert "/* [3, 4] */" in text


def test_hostile_text_in_literals_cannot_leave_its_place(staff: ss2sql.Session) -> None:
    nasty = "x'; DROP TABLE staff; -- */ /* \\\" ` [ \u2028"
    literal = nasty.replace("\\", "\\\\").replace("'", "\\'")
    script = f"SELECT this FROM ['{literal}', 'b'] WHERE this == '{literal}' AS list;"
    assert staff.run(script, engine="database").value == [nasty]
    assert staff.eval("SELECT count(*) FROM staff GROUP BY 1 AS value;") == 4


@each_row("queries/names-in-sqlite", "script", "told")
def test_names_that_sqlite_has_or_takes_for_the_same(ss: ss2sql.Session, script: str, told: str) -> None:
    value = ast.literal_eval(told)
    for name, more in {"left": 0, "f": 1, "F": 10, "keep": 100, "count": 1000}.items():
        ss.function(name, lambda x, more=more: x + more)
    ss.attach("order", [{"where": 1, "Group": 2, "group": 3}])
    ss.attach("rowids", [{"rowid": 5, "RowID": 6}, {"rowid": 3, "RowID": 4}])
    assert ss.run(script, engine="database").value == value


def test_sqlite_tests_types_and_bounds_once_and_by_itself(ss: ss2sql.Session) -> None:
    search = "SELECT (x + 1) * 2 - 1 FROM [0, 1] START WITH x = 1 CONNECT BY x = x * 2 AS list"
    assert str(ss.compile(search).sql).count("typeof") == 1
    for name, value in {"grid": [[1, 2], [3, 4], [5, 6]], "far": [0, 1, 5]}.items():
        ss.attach(name, value)
    assert "WHEN far.this BETWEEN 0 AND 2" in str(ss.compile("SELECT grid[this][1] FROM far AS list").sql)


def test_a_text_that_was_read_early_is_read_again_without_its_variable(ss: ss2sql.Session) -> None:
    ss.run("k = 1;")
    query = ss.compile("SELECT this FROM [1, 2] WHERE eval('k + 1 == 2') AS list")
    assert query.run().value == [1, 2]
    ss.run("clear();")
    with pytest.raises(ss2sql.ResolveError, match="'k'"):
        query.run()


def test_a_plan_names_its_parameters(ss: ss2sql.Session) -> None:
    assert format_plan(ss.compile("SELECT this FROM [1] WHERE this == wanted").plan).startswith("parameters wanted\n")


def test_rows_of_a_query_that_gives_a_list_are_not_collected(ss: ss2sql.Session) -> None:
    ss.set("edges", [[0, 1, "a"], [1, 2, "b"]])
    query = "SELECT this FROM edges WHERE this[1] > 1 AS list"
    for script in (f"SELECT this[2], this FROM ({query});", f"SELECT e.this[2], p.this FROM e = ({query}), p = [1];"):
        assert "collect" not in ss.compile(script).sql


def test_sqlite_reads_the_columns_of_a_left_join(ss: ss2sql.Session) -> None:
    ss.set("pairs", [{"k": 1, "v": 5, "f": True}, {"k": 3, "v": 6, "f": False}])
    script = "SELECT a.this, b.{} FROM a = [1, 2] LEFT JOIN b = pairs ON b.k == a.this AS rows"
    result = ss.run(script.format("v"), engine="database")
    assert result.value == [(1, 5), (2, None)]
    assert python_calls(str(result.sql)) == set()
    assert ss.run(script.format("f"), engine="database").value == [(1, True), (2, None)]


def test_a_long_literal_is_shown_by_its_beginning(ss: ss2sql.Session) -> None:
    literal = str(list(range(100, 400)))
    sql = str(ss.compile(f"SELECT this FROM [150, 7] WHERE this IN {literal} AS list", engine="database").sql)
    assert f"/* {literal[:57]}... */" in sql


def test_the_coordinates_of_points_are_passed_as_numbers(ss: ss2sql.Session) -> None:
    ss.attach("places", [{"x": 0.0, "y": 0.0}, {"x": 3.0, "y": None}, {"x": 6.0, "y": 8.0}])
    script = "SELECT distance([p.x, p.y], [q.x, q.y]), norm([p.x, 4]) FROM p = places, q = places WHERE {} AS rows;"
    result = ss.run(script.format("p.x < q.x AND p.y == 0 AND q.y == 8"), engine="database")
    assert list(result) == [(10.0, 4.0)]
    assert "distance(p.x, p.y, q.x, q.y, " in result.sql
    assert "list(" not in result.sql
    with pytest.raises(ss2sql.ExecutionError, match="distance works on numbers, not on None") as raised:
        ss.run(script.format("p.x < q.x"), engine="database")
    assert raised.value.span is not None
    assert raised.value.span.column == 8

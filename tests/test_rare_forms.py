"""Rare forms of queries: what they give follows from the language, whichever way they are lowered or rewritten."""

# ruff: noqa: E501
from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from sessions import both

import ss2sql

DISABLE: tuple[tuple[str, ...], ...] = ((), ("fold",), ("split", "unnest", "fold"))


@pytest.fixture
def ss(request: pytest.FixtureRequest) -> Iterator[ss2sql.Session]:
    """Numbers, texts, and a table of pairs."""
    with ss2sql.connect(disable=getattr(request, "param", ())) as session:
        session.attach("n", [0, 1, 2])
        session.attach("mixed", [0, "", [], 1, "x", [0]])
        session.attach("names", ["b", "", "ab\0c"])
        session.attach("grid", [[1, 2, 3], [4, 5, 6], [7, 8, 9]])
        session.attach("words", {"len": 3, "other": [1]})
        session.host.connection.execute(
            "CREATE TABLE pairs(a INTEGER, b INTEGER); INSERT INTO pairs VALUES (1, 2), (2, 3)"
        )
        session.host.connection.execute("CREATE VIEW seen AS SELECT * FROM pairs")
        session.host.connection.execute("CREATE TABLE big(a INTEGER); INSERT INTO big VALUES (9007199254740993), (1)")
        session.function("twin", lambda x: [x] * 2, volatility="immutable")
        yield session


switches = pytest.mark.parametrize("ss", DISABLE, indirect=True, ids=["", "not folded", "as written"])

VALUES: dict[str, Any] = {
    # XOR gives a bool, by the truth of both sides, which are both evaluated.
    "SELECT a.this XOR b.this FROM a = [0, 2], b = mixed AS list": [False, False, False, True, True, True]
    + [True] * 3
    + [False] * 3,
    "SELECT this FROM n WHERE (1 / (this + 1) > 0.4) XOR (2 / (this + 1) > 0.9) AS list": [],
    "SELECT this XOR True, False XOR this FROM n AS rows": [(True, False), (False, True), (False, True)],
    "SELECT [this XOR 1, this] FROM n ORDER BY this XOR 1, this DESC AS list": [[False, 2], [False, 1], [True, 0]],
    # What decides stands to the right of what may fail, so that is asked first.
    "SELECT this FROM [1, 2] WHERE this == 1 OR this == 1 AND 2 / this > 1 AS list": [1],
    "SELECT this FROM [1, 2] WHERE this == 1 AND 2 / this > 1 OR this == 1 AS list": [1],
    "SELECT NOT (this AND 1), NOT NOT this, NOT this == 1 FROM n AS rows": [
        (True, False, True),
        (False, True, False),
        (False, True, True),
    ],
    "SELECT this FROM n WHERE this > 0 AND 2 / this > 0.5 OR this > 0 AS list": [1, 2],
    "SELECT NOT this FROM mixed WHERE NOT this AS list": [True, True, True],
    # Numbers of rows.
    "SELECT this FROM n WHERE len(SELECT b.this FROM b = [0, 1, 2] WHERE b.this < n.this AS list) == 2 AS list": [2],
    "SELECT this FROM n WHERE len(SELECT b.this, b.this FROM b = [0, 1, 2] WHERE b.this < n.this AS list) == 3 AS list": [],
    "SELECT this FROM n WHERE len(SELECT b.this, b.this FROM b = [0, 1, 2] WHERE b.this < n.this AS list) != 3 AS list": [
        0,
        1,
        2,
    ],
    "SELECT this FROM n WHERE len(SELECT b.this FROM b = [0, 1, 2] WHERE b.this < n.this AS list) == 0 AS list": [0],
    "SELECT this FROM n WHERE len(SELECT b.this FROM b = [0, 1, 2] WHERE b.this < n.this AS list) != 0 AS list": [1, 2],
    "SELECT this FROM n WHERE len(SELECT b.this FROM b = [0, 1, 2] WHERE b.this < n.this AS list) > 0 AS list": [1, 2],
    "SELECT this FROM n WHERE len(SELECT b.this FROM b = [0, 1, 2] WHERE b.this < n.this AS list) < 1 AS list": [0],
    "SELECT this FROM n WHERE len(SELECT b.this FROM b = [0, 1, 2] WHERE b.this < n.this AS list) >= 2 AS list": [2],
    "SELECT this FROM n WHERE len(SELECT b.this FROM b = [0, 1, 2] WHERE b.this < n.this AS list) <= 9 AS list": [
        0,
        1,
        2,
    ],
    "SELECT this FROM n WHERE len(SELECT b.this FROM b = [0, 1, 2] WHERE b.this < n.this AS list) > -1 AS list": [
        0,
        1,
        2,
    ],
    "SELECT this FROM n WHERE len(SELECT b.this FROM b = [0, 1, 2] WHERE b.this < n.this AS list) == -1 AS list": [],
    "SELECT this FROM n WHERE max(SELECT b.this FROM b = [0, 1] WHERE b.this < n.this OR True AS list) > 0 AS list": [
        0,
        1,
        2,
    ],
    "SELECT this FROM n WHERE max(SELECT to(b.this, x) FROM b = [] WHERE b.this == n.this AS list) == None AS list": [
        0,
        1,
        2,
    ],
    "SELECT this FROM n WHERE this IN (SELECT b.this FROM b = [] WHERE b.this == n.this AS list) AS list": [],
    "SELECT this FROM n WHERE this IN (SELECT b.this + n.this FROM b = [0, 1] AS list) AS list": [0, 1, 2],
    "SELECT this FROM n WHERE 1 / (2 * this - 1) IN (SELECT b.this + n.this FROM b = [0, 1] AS list) AS list": [1],
    "SELECT b.this, a.this FROM a = [[[1, 2]], [[3, 4], [5, 6]]], b = [3, 5] WHERE [b.this, 4] IN a.this AS rows": [
        (3, [[3, 4], [5, 6]])
    ],
    # Texts that are run where they stand.
    "SELECT eval('this + ' + str(this)) FROM n AS list": [0, 2, 4],
    "SELECT eval('this / 2') FROM n AS list": [0.0, 0.5, 1.0],
    "SELECT this FROM n WHERE eval('this == 1') AS list": [1],
    "SELECT this FROM n WHERE this > 0 AND eval('1 / this == 1') AS list": [1],
    "SELECT this FROM n WHERE eval(['this'][0]) AS list": [1, 2],
    "v{9} = 5; SELECT this FROM n WHERE eval('v{} == [5]') AND this AS list": [1, 2],
    "SELECT eval('this + 1') FROM n GROUP BY this > 0 AS list": {False: [1], True: [2, 3]},
    "v{9} = 5; SELECT this FROM n WHERE eval('v{}') AND this AS list": [1, 2],
    "k = 1; SELECT (k = k + 1) FROM n WHERE eval('k') AS list": [2, 3, 4],
    "SELECT this FROM n WHERE this IN (SELECT p.a FROM p = pairs AS list) AS list": [1, 2],
    "SELECT this FROM n WHERE [] == (SELECT p.a FROM p = pairs WHERE p.a == n.this AS list) AS list": [0],
    "SELECT this FROM n WHERE [] == (SELECT c.this FROM c = grid[0] WHERE c.this == n.this AS list) AS list": [0],
    "SELECT this FROM n WHERE NOT abs(this) AS list": [0],
    # Texts, and numbers from them.
    "SELECT len(this), this + '\\0' == 'b\\0' FROM names AS rows": [(1, True), (0, False), (4, False)],
    "SELECT distance(this, 2), distance(9007199254740993 * this, 0) FROM n AS rows": [
        (2.0, 0.0),
        (1.0, 9007199254740993.0),
        (0.0, 18014398509481986.0),
    ],
    "SELECT a / 3, (a - 1) / 2 FROM big AS rows": [(3002399751580331.0, 4503599627370496.0), (1 / 3, 0.0)],
    "SELECT a + a - a, (a - 1) * 2 - a, -a + 2 ^ 2 FROM big AS rows": [
        (9007199254740993, 9007199254740991, -9007199254740989),
        (1, -1, 3),
    ],
    "SELECT distance(a, 0), this['b'] - a FROM pairs AS rows": [(1.0, 1), (2.0, 1)],
    "SELECT len(this) FROM names WHERE this == 'ab\\0c' OR this == '\\0' AS list": [4],
    "SELECT min(1 / (this + 1), 2 / (this + 2)) FROM n AS list": [1.0, 0.5, 1 / 3],
    "SELECT len(this + 'x') ^ 2 % 3 FROM names AS list": [1, 1, 1],
    "SELECT this % (1 - 2 * len(str(this))) FROM n AS list": [0, 0, 0],
    "SELECT this % (-1 - abs(this)) FROM n AS list": [0, -1, -1],
    "SELECT distance(this, -this) FROM [5000000000000000000, 1] AS list": [1e19, 2.0],
    "SELECT abs(this) ^ 2 FROM [5, -4000000000] WHERE this > 0 AS list": [25],
    "SELECT grid[this][len(str(this))], grid[this, 1] FROM n AS rows": [(2, 2), (5, 5), (8, 8)],
    # Conditions, many of them.
    "SELECT this FROM IF(n; n) WHERE " + " AND ".join(f"this != {-number}" for number in range(1, 17)) + " AS list": [
        0,
        1,
        2,
    ],
    "SELECT q.this FROM q = (SELECT this FROM n AS set) WHERE "
    + " AND ".join(f"q.this != {-number} OR q.this == 'a'" for number in range(1, 17))
    + " AS list": [0, 1, 2],
    "SELECT q.this FROM q = (SELECT this FROM n AS set) WHERE "
    + " AND ".join(f"(q.this != {-k} OR q.this == {k + 90})" for k in range(1, 17))
    + " AS list": [0, 1, 2],
    "SELECT p.a FROM p = pairs, x = n WHERE "
    + " AND ".join(f"x.this + p.a != {-number}" for number in range(1, 17))
    + " AND x.this == 0 AS list": [1, 2],
    # Groups of products.
    "SELECT a.this, sum(b.this * 2), max(b.this * 2), count(*) FROM a = n, b = n WHERE a.this != b.this GROUP BY a.this AS rows": [
        (0, 6, 4, 2),
        (1, 4, 4, 2),
        (2, 2, 2, 2),
    ],
    "SELECT this % 2, count(*) FROM n WHERE 1 / (this + 1) > 0 GROUP BY this % 2 HAVING this % 2 == 0 AS rows": [
        (0, 2)
    ],
    "SELECT this % 2, count(*) FROM n WHERE 1 / (2 * this - 1) > 0 GROUP BY this % 2 HAVING this % 2 == 1 AS rows": [
        (1, 1)
    ],
    "SELECT sum(b.this), a.this FROM a = n, b = n GROUP BY a.this HAVING sum(b.this) > 2 ORDER BY a.this DESC LIMIT 2 AS rows": [
        (3, 2),
        (3, 1),
    ],
    # Queries inside others.
    "SELECT this, (SELECT this FROM [5, 6] AS value) FROM n AS rows": [(0, 5), (1, 5), (2, 5)],
    "SELECT (SELECT m.this FROM m = [5, 6] WHERE m.this > n.this + 5 LIMIT 1 AS value) FROM n AS list": [6, None, None],
    "SELECT (SELECT count(*) FROM [5, 6] GROUP BY 1 AS value) FROM n AS list": [2, 2, 2],
    "SELECT q.m FROM n, q = (SELECT to(max(this), m) FROM n GROUP BY this > 0 LIMIT 1) AS list": [0, 0, 0],
    "SELECT q.m, n.this FROM n, q = (SELECT to(1 / (this + 1), m) FROM n) WHERE q.m < 0.5 AS rows": [
        (1 / 3, 0),
        (1 / 3, 1),
        (1 / 3, 2),
    ],
    "SELECT (SELECT q.this FROM q = (SELECT this FROM n AS list) ORDER BY q.this DESC AS list) FROM [0] AS list": [
        [2, 1, 0]
    ],
    "SELECT q.m, n.this FROM n, q = (SELECT to(1 / (2 * this - 1), m) FROM n) WHERE q.m > 0.5 AS rows": [
        (1.0, 0),
        (1.0, 1),
        (1.0, 2),
    ],
    "SELECT (SELECT to(m.this, 'a\\x1bb') FROM m = [1, n.this] AS dict) FROM n LIMIT 1 AS list": [
        [{"a\x1bb": 1}, {"a\x1bb": 0}]
    ],
    "SELECT q.m FROM q = (SELECT to(max(this), m) FROM n GROUP BY this > 0) AS list": [0, 2],
    "SELECT n.this, q.m FROM n, q = (SELECT to(2 / a, m) FROM pairs) WHERE q.m < 2 AS rows": [
        (0, 1.0),
        (1, 1.0),
        (2, 1.0),
    ],
    "SELECT a % 2, count(*) FROM pairs WHERE 1 / a > 0 GROUP BY a % 2 HAVING a % 2 == 0 AS rows": [(0, 1)],
    "SELECT x.a, sum(b.this * 2), max(b.this * 3), x.a + count(*) FROM x = seen, b = n GROUP BY x.a AS rows": [
        (1, 6, 6, 4),
        (2, 6, 6, 5),
    ],
    "SELECT x.this FROM x = IF(n; n; None) WHERE "
    + " AND ".join(f"(x.this != {-k} OR x.this == {k + 90})" for k in range(1, 17))
    + " AS list": [0, 1, 2],
    # What depends on the first source alone is computed once for each of its rows.
    "SELECT a.this, b.this FROM a = n, b = n WHERE twin(a.this) == [1, 1] XOR b.this > 0 AS rows": [
        (0, 1),
        (0, 2),
        (1, 0),
        (2, 1),
        (2, 2),
    ],
    "SELECT a.this, b.this FROM a = n, b = n WHERE [twin(a.this), b.this] == [[1, 1], 2] AS rows": [(1, 2)],
    "SELECT a.this, b.this FROM a = [True, False], b = n WHERE twin(a.this) == [True, True] XOR b.this > 0 AS rows": [
        (True, 0),
        (False, 1),
        (False, 2),
    ],
    # Searches.
    "SELECT this FROM n START WITH x = 0 CONNECT BY x = this STOP WITH NOT (this == x + 1) AS list": [[1], [1, 2]],
    "SELECT this FROM n START WITH x = 0 CONNECT BY COST 1 x = this STOP WITH NOT (this == x + 1) AS list": [
        [1],
        [1, 2],
    ],
    "SELECT v FROM q = (SELECT to(this, v) FROM n ORDER BY this DESC) WHERE v == 0 START WITH x = 9 CONNECT BY NO CYCLE x = v STOP WITH v == 0 AS list": [
        [2, 1, 0],
        [2, 0],
        [1, 2, 0],
        [1, 0],
        [0],
    ],
    "SELECT this FROM n START WITH x = 0 CONNECT BY UNIQUE x = this STOP WITH 1 > 2 AS list": [[0], [1], [2]],
    "SELECT this FROM n WHERE IF(twin(this) == [1, 1]; True; this == 2) START WITH x = [] CONNECT BY NO CYCLE x = twin(this) STOP WITH twin(this) != [0, 0] AS list": [
        [0, 1],
        [0, 2],
        [1],
        [2],
    ],
}


@both
@switches
@pytest.mark.parametrize("script", VALUES)
def test_values(ss: ss2sql.Session, script: str, engine: Any) -> None:
    try:
        found = ss.run(script, engine=engine).value
    except ss2sql.UnsupportedError:
        assert engine == "database"
        return
    assert repr(found) == repr(VALUES[script])


@both
def test_errors_stand_where_the_written_order_meets_them(ss: ss2sql.Session, engine: Any) -> None:
    for expression in ("(1 / this > 0) XOR (1 / 0 > 0)", "min(1 / this, 2 / (this + 0))"):
        with pytest.raises(ss2sql.ExecutionError) as caught:
            ss.run(f"SELECT {expression} FROM n AS list", engine=engine)
        assert caught.value.span is not None
        assert caught.value.span.text == "/"
        assert caught.value.span.column == 8 + expression.index("/")


@both
@switches
@pytest.mark.parametrize(
    "script",
    [
        "SELECT this % 2, count(*) FROM n WHERE 1 / this > 0 GROUP BY this % 2 HAVING this % 2 == 1",
        "SELECT q.m, a.this FROM a = [], q = (SELECT to(1 / this, m) FROM n)",
    ],
)
def test_what_comes_later_spares_no_error(ss: ss2sql.Session, engine: Any, script: str) -> None:
    # HAVING is asked after WHERE; a source that mentions no other is read although one before it is empty.
    with pytest.raises(ss2sql.ExecutionError) as caught:
        ss.run(script, engine=engine)
    assert caught.value.code == "X002"


@switches
def test_the_name_of_a_column_is_evaluated_before_there_is_a_row(ss: ss2sql.Session) -> None:
    with pytest.raises(ss2sql.ExecutionError) as caught:
        ss.run(
            "SELECT this FROM n WHERE [] == (SELECT to(b.this, 1 / n.this) FROM b = [5] WHERE b.this == n.this AS list)"
        )
    assert caught.value.code == "X002"


@both
@switches
def test_an_index_is_computed_once(ss: ss2sql.Session, engine: Any) -> None:
    calls = []
    ss.function("place", lambda n: calls.append(n) or 2 - n)
    assert ss.eval("SELECT grid[place(this)][1] FROM n AS list", engine=engine) == [8, 5, 2]
    assert calls == [0, 1, 2]


@both
def test_connect_by_is_not_asked_of_a_step_that_stops(ss: ss2sql.Session, engine: Any) -> None:
    calls = []
    ss.function("next", lambda n: calls.append(n) or n, volatility="immutable")
    script = "SELECT this FROM n WHERE this == 2 START WITH x = 0 CONNECT BY NO CYCLE x = next(this) STOP WITH this > 0"
    assert ss.run(f"{script} AS list", engine=engine).value == [[0, 2], [2]]
    assert calls == [0]


@both
def test_a_text_that_was_read_early_is_read_again_without_its_variable(ss: ss2sql.Session, engine: Any) -> None:
    ss.run("k = 1;")
    query = ss.compile("SELECT this FROM [1, 2] WHERE eval('k + 1 == 2') AS list")
    assert query.run().value == [1, 2]
    ss.run("clear();")
    with pytest.raises(ss2sql.ResolveError, match="'k'"):
        query.run()


@both
@switches
def test_a_text_about_what_changes_is_read_when_it_runs(ss: ss2sql.Session, engine: Any) -> None:
    ss.run("v{9} = 5; k = 1;")
    for script, value in {
        "SELECT this FROM n WHERE eval('v{} == [5]') AND this AS list": [1, 2],
        "SELECT (k = k + 1) FROM n WHERE eval('k < 3') AS list": [2, 3],
    }.items():
        try:
            assert ss.run(script, engine=engine).value == value
        except ss2sql.UnsupportedError:
            assert engine == "database"


def test_nested_arithmetic_has_one_guard(ss: ss2sql.Session) -> None:
    script = "SELECT (x + 1) * 2 - 1 FROM n START WITH x = 1 CONNECT BY x = x * 2 AS list"
    text = str(ss.compile(script).sql)
    assert "typeof((search.x_before + 1) * 2 - 1) = 'integer'" in text
    assert text.count("typeof") == 1


@both
def test_none_in_from_behind_many_conditions(engine: Any) -> None:
    """The element None is there, though SQLite asks again whether the argument of a table function is NULL."""
    script = f"SELECT x.this FROM x = nothing WHERE {' AND '.join(['x.this == None'] * 20)} AS list"
    with ss2sql.connect(disable=["split"]) as ss:
        assert ss.run(script, engine=engine, nothing=None).value == [None]


def test_a_branch_evaluates_what_may_fail_and_its_last_value(ss: ss2sql.Session) -> None:
    text = str(ss.compile("SELECT IF(this > 1; this + 1, 1 / (this - 1), 5; this, 6) FROM [1, 2] AS list").sql)
    assert "THEN in_turn(coalesce(1.0 / (this.this - 1), div(1, this.this - 1, '1:33')), 5)" in text
    assert "ELSE 6" in text


def test_an_index_that_may_be_outside_is_tested_in_sql(ss: ss2sql.Session) -> None:
    ss.attach("far", [0, 1, 5])
    text = str(ss.compile("SELECT grid[this][1] FROM far AS list").sql)
    assert "WHEN far.this BETWEEN 0 AND 2" in text
    assert "ELSE item(item(:grid, far.this" in text


@pytest.mark.parametrize(("number", "written"), [("0.5", True), ("1e25", False), ("0.1234567890123456", False)])
def test_a_float_that_sqlite_may_read_as_another_is_bound(ss: ss2sql.Session, number: str, written: bool) -> None:
    script = f"SELECT this * {number} FROM n AS list"
    assert ss.eval(script, engine="database") == [0.0, float(number), 2 * float(number)]
    assert ("/*" not in str(ss.compile(script).sql)) is written


@both
def test_a_column_may_be_called_position(ss: ss2sql.Session, engine: Any) -> None:
    ss.host.connection.execute(
        "CREATE TABLE ways(start, position); INSERT INTO ways VALUES (1, 2), (2, 3), (1, 3), (3, 4)"
    )
    script = (
        "SELECT position FROM ways WHERE start == here AND position == 4 START WITH here = 1"
        " CONNECT BY here = position STOP WITH start != here OR position == 4 AS list"
    )
    assert ss.run(script, engine=engine).value == [[2, 3, 4], [3, 4]]
    if engine == "database":
        assert "position_2" in str(ss.compile(script).sql)


@pytest.mark.parametrize("engine", ["native", "database"])
@pytest.mark.parametrize(
    "options",
    ["COST c UNIQUE x = x + 1 / d", "COST c HEURISTIC 1 / d UNIQUE x = x + 1", "PROBABILITY c UNIQUE x = 1 / d"],
)
def test_what_fails_of_a_step_that_is_not_better_shows(ss: ss2sql.Session, engine: Any, options: str) -> None:
    # The second step has the row of the first, which waits still, so it is no repetition yet.
    ss.attach("ways", [{"row": 1, "c": 0.5, "d": 1}, {"row": 1, "c": 0.7 if "COST" in options else 0.2, "d": 0}])
    script = f"SELECT row FROM ways START WITH x = 0 CONNECT BY {options} STOP WITH x > 3 AS list"
    with pytest.raises(ss2sql.ExecutionError) as caught:
        ss.run(script, engine=engine)
    assert caught.value.code == "X002"

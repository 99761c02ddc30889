"""`early` and `hoist`: conditions are asked, and values computed, as soon as nobody can tell the difference."""

from __future__ import annotations

from typing import Any

import pytest
from listings import MOVES, move
from sessions import ENGINES, code_of

import ss2sql

TOWERS = """SELECT m1.this, m2.this, m3.this, m4.this, m5.this, m6.this, m7.this
FROM m1 = moves, m2 = moves, m3 = moves, m4 = moves, m5 = moves, m6 = moves, m7 = moves
WHERE [[], [], [3, 2, 1]] == move(m7.this, move(m6.this, move(m5.this, move(m4.this, move(m3.this,
    move(m2.this, move(m1.this, [[3, 2, 1], [], []]))))))) AS list"""


def session(*disable: str) -> tuple[ss2sql.Session, list[tuple[Any, ...]]]:
    """A session with functions that note their calls; `f` fails for "bad"."""
    ss = ss2sql.connect(disable=disable)
    calls: list[tuple[Any, ...]] = []

    def f(x: Any) -> Any:
        calls.append(("f", x))
        if x == "bad":
            raise ValueError(x)
        return x

    def g(x: Any, y: Any) -> Any:
        calls.append(("g", x, y))
        return [x, y]

    ss.function("f", f, volatility="immutable")
    ss.function("g", g, volatility="immutable")
    ss.function("loud", f, volatility="volatile")
    return ss, calls


def asked(result: ss2sql.Result, name: str = "f") -> int:
    """How often the value of a function was needed."""
    return result.stats.calls[name] + result.stats.remembered[name]


# --- hoist ---------------------------------------------------------------------------------------------


def test_inner_calls_of_the_paper_are_evaluated_once_per_prefix() -> None:
    ss = ss2sql.connect()
    ss.function("move", move)
    ss.attach("moves", MOVES)
    result = ss.run(TOWERS, engine="database")
    assert result.value == [[0, 2], [0, 1], [2, 1], [0, 2], [1, 0], [1, 2], [0, 2]]
    assert asked(result, "move") == sum(6**level for level in range(1, 8))
    assert str(result.sql).count("LIMIT -1") == 6
    assert "LIMIT" not in str(ss2sql_with("hoist").sql)


def ss2sql_with(*disable: str) -> ss2sql.Query:
    ss = ss2sql.connect(disable=disable)
    ss.function("move", move)
    ss.attach("moves", MOVES)
    return ss.compile(TOWERS)


def test_what_the_sql_looks_like() -> None:
    ss, _ = session()
    ss.attach("xs", [1, 2])
    text = str(ss.compile("SELECT f(a.this), a.this + b.this FROM a = [1, 2], b = xs").sql)
    assert text == (
        "WITH a_once AS MATERIALIZED (\n  SELECT\n    this\n  FROM elements(:p1 /* [1, 2] */)\n"
        "), xs_once AS MATERIALIZED (\n  SELECT\n    this\n  FROM elements(:xs)\n)\n"
        "SELECT\n  to_a.f,\n  to_a.a + b.this\n"
        "FROM (\n  SELECT\n    a.this AS a,\n    f(a.this) AS f\n  FROM a_once AS a\n"
        "  WHERE\n    EXISTS(\n      SELECT\n        1\n      FROM xs_once\n    )\n  LIMIT -1\n) AS to_a\n"
        "CROSS JOIN xs_once AS b"
    )  # fmt: skip
    ss, _ = session("hoist")
    ss.attach("xs", [1, 2])
    assert "LIMIT" not in str(ss.compile("SELECT f(a.this), a.this + b.this FROM a = [1, 2], b = xs").sql)


@pytest.mark.parametrize(
    ("columns", "times"),
    [
        ("[f(a.this), b.this]", 2),  # a part of a list is certain, so it is evaluated once for each element of a
        ("NOT f(a.this), b.this", 2),
        ("IF(f(a.this) > 1; 1; 2), b.this", 2),
        ("f(a.this) XOR b.this", 2),
        ("IF(b.this > 1; f(a.this); 2)", 4),  # one that may be skipped waits for the row
        ("b.this > 1 AND f(a.this)", 4),
    ],
)
def test_which_parts_are_evaluated_ahead(columns: str, times: int) -> None:
    ss, _ = session()
    ss.attach("xs", [1, 2, 3])
    result = ss.run(f"SELECT {columns} FROM a = [1, 2], b = xs AS list", engine="database")
    assert asked(result) == times
    assert result.value == ss.run(f"SELECT {columns} FROM a = [1, 2], b = xs AS list", engine="native").value


@pytest.mark.parametrize("engine", ENGINES)
def test_nothing_is_evaluated_ahead_of_what_fails_itself(engine: Any) -> None:
    ss, calls = session()
    with pytest.raises(ss2sql.ExecutionError) as caught:
        ss.run(
            "SELECT (SELECT 1 / c.this FROM c = [b.this] AS value), f(a.this) FROM a = ['bad'], b = [0]", engine=engine
        )
    assert (caught.value.code, calls) == ("X002", [])


@pytest.mark.parametrize("engine", ENGINES)
def test_nothing_is_evaluated_ahead_of_a_limit(engine: Any) -> None:
    for disable in ([], ["hoist"]):
        ss, calls = session(*disable)
        script = (
            "SELECT f(a.this), g(f(a.this), b.this), c.this FROM a = [1, 2], b = [5, 6], c = [7, 8] LIMIT 3 AS list"
        )
        assert ss.run(script, engine=engine).value == [1, [1, 5], 7, 1, [1, 5], 8, 1, [1, 6], 7]
        assert calls == [("f", 1), ("g", 1, 5), ("g", 1, 6)]


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize(
    ("script", "calls"),
    [
        # Of no rows nothing is evaluated, however early it could be.
        ("SELECT f(a.this) FROM a = [1, 2], b = empty AS list", []),
        ("SELECT 1 FROM a = [1, 2], b = [1], c = empty WHERE f(a.this) == b.this AS list", []),
        # What stands behind a condition is evaluated for those that pass it.
        ("SELECT f(a.this) FROM a = [1, 2], b = [2, 2] WHERE a.this == b.this AS list", [("f", 2)]),
        ("SELECT 1 FROM a = [1, 2, 3], b = [1, 2] WHERE b.this > 2 AND f(a.this) AS list", []),
        # The first error is that of the written order.
        ("SELECT 1 FROM a = [1], b = [2, 'bad'] WHERE g(f(b.this), f(a.this)) AS list", [2, 1, "bad"]),
        ("SELECT 1 FROM a = [0], b = [1] WHERE 1 / a.this > f(a.this) + b.this AS list", []),
        ("SELECT 1 FROM a = ['bad'], b = [1] WHERE f(b.this) == 1 AND f(a.this) AS list", [1, "bad"]),
        # A branch that is not taken, an operand that is not needed.
        ("SELECT IF(b.this == 1; 0; f(a.this)) FROM a = [1], b = [1] AS list", []),
        ("SELECT 1 FROM a = [1], b = [1] WHERE b.this == 1 OR f(a.this) AS list", []),
        # A source that is read for each row is read first.
        ("SELECT 1 FROM a = [1, 2], b = f(a.this), c = [1] WHERE g(a.this, 0) == 1 AS list",
         [("f", 1), ("g", 1, 0), ("f", 2), ("g", 2, 0)]),
        ("SELECT 1 FROM a = [1, 2], b = f(a.this) WHERE a.this > 5 AS list", [("f", 1), ("f", 2)]),
        ("SELECT f(a.this) FROM a = [1, 2], b = f(a.this + 7), c = empty AS list", [("f", 8), ("f", 9)]),
    ],
)  # fmt: skip
def test_only_what_the_written_order_evaluates(engine: Any, script: str, calls: list[Any]) -> None:
    expected = [call if isinstance(call, tuple) else ("f", call) for call in calls]
    for disable in ([], ["hoist"], ["early"], ["hoist", "early"]):
        ss, made = session(*disable)
        ss.attach("empty", [])
        try:
            ss.run(script, engine=engine)
        except (ValueError, ss2sql.ExecutionError):
            assert "bad" in script or "/" in script
        assert [call for call in made if call[0] == "f" or "g(a" in script] == expected


def test_a_query_that_depends_on_early_sources_is_evaluated_once_for_each() -> None:
    ss, _ = session()
    script = "SELECT (SELECT f(this) FROM [a.this, 9] AS list), b.this FROM a = [1, 2], b = range(50) AS rows"
    result = ss.run(script, engine="database")
    assert result.value == [([a, 9], b) for a in (1, 2) for b in range(50)]
    assert asked(result) == 4


def test_hoisted_values_in_sorted_and_grouped_queries() -> None:
    for disable in ([], ["hoist"]):
        ss, _ = session(*disable)
        ss.attach("rows", [{"k": 2, "v": "x"}, {"k": 1, "v": "y"}])
        script = "SELECT k, f(v), b.this FROM a = rows, b = [1, 2] WHERE f(k) != b.this ORDER BY b.this DESC AS rows"
        assert ss.run(script, engine="database").value == [(1, "y", 2), (2, "x", 1)]
        script = "SELECT k, count(*) FROM a = rows, b = [1, 2, 2] WHERE f(k) == b.this GROUP BY k AS rows"
        assert ss.run(script, engine="database").value == [(2, 2), (1, 1)]


# --- early ---------------------------------------------------------------------------------------------


def test_a_condition_is_asked_as_soon_as_its_sources_are_bound() -> None:
    script = "SELECT b.this, c.this FROM a = range(20), b = range(20), c = range(20) WHERE {} AS rows"
    for where, times in (
        ("f(a.this) == 5 AND f(b.this) == 6 AND f(c.this) == 7", 60),
        ("a.this == 5 AND f(b.this) == 6 AND c.this == 7", 20),
        ("f(a.this) == 5 AND a.this != b.this AND b.this == 6 AND f(c.this) == 7", 40),
        ("a.this == 5 AND b.this == 6 AND f(c.this) == 7", 20),
    ):
        ss, calls = session("hoist")
        result = ss.run(script.format(where), engine="database")
        assert result.value == [(6, 7)]
        assert asked(result) == times
        ss, others = session("hoist", "early")
        result = ss.run(script.format(where), engine="database")
        assert result.value == [(6, 7)]
        assert asked(result) >= times
        assert calls == others


def test_conditions_that_cannot_fail_filter_each_source() -> None:
    """`f` is asked about c as often as a and b let pass what lies behind them."""
    ss, _ = session()
    result = ss.run(
        "SELECT c.this FROM a = range(60), b = range(60), c = range(60), d = range(60) "
        "WHERE a.this < 2 AND b.this == a.this AND c.this < b.this AND f(d.this) == c.this AS list",
        engine="database",
    )
    assert result.value == [0]
    assert asked(result) == 60


def test_an_early_condition_waits_for_sources_that_may_be_empty() -> None:
    ss, _ = session()
    ss.attach("xs", [1, 2])
    text = str(ss.compile("SELECT 1 FROM a = [1, 2], b = xs WHERE f(a.this) == 1").sql)
    case = "CASE\n    WHEN NOT EXISTS(\n      SELECT\n        1\n      FROM elements(:xs)\n    )\n    THEN 0\n    ELSE "
    assert f"WHERE\n  {case}eq(f(a.this), 1, '1:50')\n  END" in text
    ss, _ = session("early", "hoist")
    ss.attach("xs", [1, 2])
    text = str(ss.compile("SELECT 1 FROM a = [1, 2], b = xs WHERE f(a.this) == 1").sql)
    assert "WHERE\n  in_turn(b.this, eq(f(a.this), 1, '1:50'))" in text


@pytest.mark.parametrize("engine", ENGINES)
def test_a_source_that_fails_comes_before_one_that_is_empty(engine: Any) -> None:
    ss, calls = session()
    ss.attach("nobody", [])
    script = "SELECT f(b.this) FROM a = [1], b = [1 / (a.this - 1)], c = nobody AS list"
    assert code_of(ss.run, script, engine=engine) == "X002"
    assert calls == []


@pytest.mark.parametrize("engine", ENGINES)
def test_volatile_functions_keep_the_written_order(engine: Any) -> None:
    ss, calls = session()
    ss.run("SELECT 1 FROM a = [1, 2], b = [3, 4] WHERE loud(a.this) == 1 AND loud(b.this) AS list", engine=engine)
    assert calls == [("f", 1), ("f", 3), ("f", 1), ("f", 4), ("f", 2), ("f", 2)]


def test_sqlite_does_not_put_constants_in_the_place_of_columns() -> None:
    """`2 < b.this` would be false for any source then, and asked before `f`."""
    ss, calls = session()
    script = "SELECT 1 FROM a = [1], b = [1, 2] WHERE f(a.this) AND b.this == 2 AND 2 < b.this AS list"
    assert ss.run(script, engine="database").value == []
    assert calls == [("f", 1)]


def test_an_index_does_not_change_what_is_asked_first(tmp_path: Any) -> None:
    path = tmp_path / "t.db"
    with ss2sql.connect(path) as ss:
        ss.host.connection.execute("CREATE TABLE t(x, y); CREATE INDEX i ON t(x); INSERT INTO t VALUES (3, 0), (3, 1)")
    ss, calls = session()
    ss.attach("file", path)
    assert ss.run("SELECT y FROM file.t WHERE y != 0 AND x == 3 AND loud(x) AS list", engine="database").value == [1]
    assert calls == [("f", 3)]

"""Which calls are inlined and which stay calls, and that nobody can tell by the result."""

from __future__ import annotations

import math
from typing import Any

import pytest
from agreement import exact
from inline_samples import go, inc, mean, several, square
from sessions import both

import ss2sql
from ss2sql.frontend.inliner import LIMITS


def outcome(script: str, engine: Any, disable: tuple[str, ...] = (), **functions: Any) -> tuple[Any, Any]:
    """The value or the error of a script, and the calls."""
    with ss2sql.connect(disable=disable) as ss:
        for name, function in functions.items():
            ss.function(name, function)
        try:
            result = ss.run(script, engine=engine)
        except Exception as error:
            return (type(error), str(error)), None
        return exact(result.value), {name: times for name, times in result.stats.calls.items() if times}


@both
@pytest.mark.parametrize(
    ("function", "script", "calls"),
    [
        (inc, "SELECT f(this) FROM [1, None] AS list;", TypeError),
        (inc, "SELECT f(this) FROM [1, 'a'] AS list;", TypeError),
        (inc, "SELECT f(this) FROM [1, 9223372036854775807] AS list;", ss2sql.ExecutionError),
        (mean, "SELECT f(this, 'a') FROM [1] AS list;", TypeError),
        (lambda x, y: x / y, "SELECT f(this, 0) FROM [1] AS list;", ZeroDivisionError),
        (lambda x, y: x * y, "SELECT f(this, 3) FROM ['ab'] AS list;", {"f": 1}),  # Python repeats text
        (lambda x, y: x * y, "SELECT f(this, 1e200) FROM [1e200] AS list;", ss2sql.ExecutionError),
        (lambda x: (x * x) % 7, "SELECT f(this) FROM [4611686018427387904] AS list;", {"f": 1}),  # beyond 64 bits
        (lambda x: x**0.5, "SELECT f(this) FROM [-1] AS list;", ss2sql.ExecutionError),
        (lambda x: x[0], "SELECT f(this) FROM [[1], []] AS list;", IndexError),
        (lambda x: math.dist(x, x), "SELECT f(this) FROM [1] AS list;", TypeError),
        (lambda x: x["k"], "SELECT f(this) FROM [[1]] AS list;", TypeError),
        (lambda x, y: x < y, "SELECT f(this, 'a') FROM [1] AS list;", TypeError),
        (lambda x: -x, "SELECT f(this) FROM [-9223372036854775807 - 1] AS list;", ss2sql.ExecutionError),
        (lambda x: int(x), "SELECT f(this) FROM ['7', 'b'] AS list;", ValueError),
        (lambda x: 1 in x, "SELECT f(this) FROM [[1], [2]] AS list;", {}),
        (lambda x: 1 in x, "SELECT f(this) FROM ['1'] AS list;", TypeError),
    ],
)  # fmt: skip
def test_what_may_fail_fails_as_the_function_does(function: Any, script: str, calls: Any, engine: Any) -> None:
    value, counted = outcome(script, engine, f=function)
    assert value == outcome(script, engine, ("inline",), f=function)[0]
    assert counted == calls if isinstance(calls, dict) else issubclass(value[0], calls)


@pytest.mark.parametrize("volatility", ["volatile", "stable"])
def test_what_is_declared_less_than_immutable_is_called(volatility: Any) -> None:
    with ss2sql.connect() as ss:
        ss.function("f", inc, volatility=volatility)
        ss.function("g", inc, volatility="immutable")
        assert ss.run("SELECT f(this), g(this) FROM [1, 2] AS list;").stats.calls == {"f": 2}


def test_a_function_that_other_machinery_needs_is_called() -> None:
    with ss2sql.connect() as ss:
        ss.function("f", inc, inverse=lambda n: n - 1)
        ss.function("g", inc, vectorized=True)
        assert ss.run("SELECT f(this), g(this) FROM [1, 2] AS list;").stats.calls == {"f": 2, "g": 2}


@both
def test_an_operator_that_the_user_replaces_is_not_that_of_the_function(engine: Any) -> None:
    with ss2sql.connect() as ss:
        ss.function("f", inc)
        query = ss.compile("SELECT f(this), this + 1 FROM [1, 2] AS list;")
        assert query.run(engine=engine).value == [2, 2, 3, 3]
        ss.function("add", lambda a, b: a * 100)
        result = query.run(engine=engine)
        assert result.value == [2, 100, 3, 200]
        assert result.stats.calls == {"f": 2, "add": 2}


@both
def test_a_function_that_is_registered_anew_is_inlined_anew(engine: Any) -> None:
    with ss2sql.connect() as ss:
        ss.function("f", inc)
        query = ss.compile("SELECT f(this) FROM [1, 2] AS list;")
        assert query.run(engine=engine).value == [2, 3]
        ss.function("f", square)
        assert query.run(engine=engine).value == [1, 4]
        ss.function("f", several)
        assert query.run(engine=engine).stats.calls == {"f": 2}


@both
def test_the_switch_turns_it_off(engine: Any) -> None:
    value, calls = outcome("SELECT f(this), f(this) FROM [1, 2] AS list;", engine, ("inline",), f=inc)
    assert (value, calls) == (exact([2, 2, 3, 3]), {"f": 2})


# --- arguments -----------------------------------------------------------------------------------------


@both
@pytest.mark.parametrize(
    ("function", "arguments", "calls"),
    [
        (lambda x: x + 1, "this % 2 / 2", {}),
        (lambda x: x + x, "this % 2 / 2", {}),  # cheap, and cannot fail
        (lambda x: x * 0, "7 % this", {}),
        (lambda x: 0, "7 % this", {"f": 3}),  # would never fail
        (lambda x: x + x, "7 % this", {"f": 3}),  # would be computed twice
        (lambda x: x if x else 1, "7 % this", {"f": 3}),
        (lambda x, y: y if x else 1, "this, 7 % this", {"f": 3}),  # under a condition only
        (lambda x, y: x - y, "7 % this, 5 % this", {}),
        (lambda x, y: y - x, "7 % this, 5 % this", {"f": 3}),  # in another order
        (lambda x: len(x) + len(x), "sorted([this, 2])", {"f": 3}),  # costly
        (lambda x: len(x) + 1, "sorted([this, 2])", {}),
        (lambda x: x[0] - x[0], "[this % 2]", {}),
        (lambda x: x[0], "[this, 7 % this]", {"f": 3}),
        (lambda x: [x, x], "[this, 1]", {"f": 3}),  # the list would be made twice
        (lambda x: x * 2, "print(this)", {}),
        (lambda x, y: x - y, "this, print(this)", {}),
        (lambda x, y: y - x, "this, print(this)", {"f": 3}),
    ],
)
def test_arguments_are_evaluated_as_often_and_in_the_order_of_the_call(
    function: Any, arguments: str, calls: dict[str, int], engine: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    script = f"SELECT f({arguments}) FROM [1, 2, -3] AS list;"
    value, counted = outcome(script, engine, f=function)
    printed = capsys.readouterr().out
    assert (value, printed) == (outcome(script, engine, ("inline",), f=function)[0], capsys.readouterr().out)
    assert counted == calls


@both
def test_functions_of_functions(engine: Any) -> None:
    script = "SELECT f(g(f(this)), h(this)) FROM [1, 2, -3] WHERE g(this) > -3 AS list;"
    value, calls = outcome(script, engine, f=lambda a, b=2: a * b - b, g=inc, h=lambda a: [a, 1][0] + 1)
    expected = [((this * 2 - 2) + 1) * (this + 1) - (this + 1) for this in [1, 2, -3]]
    assert (value, calls) == (exact(expected), {})


def test_what_would_become_too_long_is_called() -> None:
    text = "this"
    for _ in range(12):
        text = f"f({text})"
    value, calls = outcome(f"SELECT {text} FROM [1, 2] AS list;", "native", f=lambda x: x % 5 + x % 3)
    assert value == outcome(f"SELECT {text} FROM [1, 2] AS list;", "native", ("inline",), f=lambda x: x % 5 + x % 3)[0]
    assert calls


@both
def test_deep_expressions(engine: Any) -> None:
    text = "this" + " + f(1)" * 80
    assert outcome(f"SELECT {text} FROM [1] AS list;", engine, f=inc) == (exact([161]), {})


# --- rows, limits, searches, groups --------------------------------------------------------------------


@pytest.fixture
def table() -> Any:
    with ss2sql.connect() as ss:
        ss.host.connection.execute("CREATE TABLE t (id INTEGER, name TEXT, price REAL, parent INTEGER)")
        rows = [(1, "a", 1.5, None), (2, "b", 2.5, 1), (3, "a", 0.0, 1)]
        ss.host.connection.executemany("INSERT INTO t VALUES (?, ?, ?, ?)", rows)
        yield ss


@both
def test_a_function_of_a_row_reads_its_columns(table: ss2sql.Session, engine: Any) -> None:
    table.function("cheap", lambda row: row["price"] < 2 and row["name"] == "a")
    table.function("root", lambda row: row["parent"] is None)
    table.function("wrong", lambda row: row["prize"])
    result = table.run("SELECT id FROM t WHERE cheap(this) OR root(this) AS list;", engine=engine)
    assert (result.value, result.stats.calls) == ([1, 3], {})
    if engine == "database":
        assert "t.price < 2" in result.sql
    table.attach("rows", [{"price": 1, "name": "a"}, {"price": 3, "name": "a", "note": 1}])
    result = table.run("SELECT price FROM rows WHERE cheap(this) AS list;", engine=engine)
    assert (result.value, result.stats.calls) == ([1], {})
    for script in ("SELECT wrong(this) FROM t;", "SELECT noted(this) FROM rows;"):
        table.function("noted", lambda row: row["note"])  # the first row has none
        with pytest.raises(KeyError):
            table.run(script, engine=engine)


@both
def test_rows_and_lists_that_would_be_made_again_go_to_the_function(table: ss2sql.Session, engine: Any) -> None:
    table.attach("rows", [{"a": 1}, {"a": 2}])
    table.function("equal", lambda row, other: row == other)
    table.function("kept", lambda row: [row, 1])
    table.function("either", lambda row: row if row["a"] > 1 else row or 0)
    table.function("total", lambda pair: pair[0] + pair[1])
    scripts = {
        "SELECT equal(r.this, s.this) FROM r = rows, s = rows AS list;": [True, False, False, True],
        "SELECT kept(this) FROM rows AS list;": [[{"a": 1}, 1], [{"a": 2}, 1]],
        "SELECT either(this) FROM rows AS list;": [{"a": 1}, {"a": 2}],
        "SELECT total([this] + [1]) FROM [1, 2] AS list;": [2, 3],  # the list would be made twice
    }
    for script, value in scripts.items():
        result = table.run(script, engine=engine)
        assert result.value == value
        assert sum(result.stats.calls.values()) == len(value)


@both
def test_large_numbers_are_left_to_the_function(table: ss2sql.Session, engine: Any) -> None:
    table.function("f", lambda n: n * 3 + 1)
    script = "SELECT f(id) FROM t AS list;"
    assert table.run(script, engine=engine).stats.calls["f"] == 0
    # Three times the last one fits into 64 bits, but not three times the power of two above it, its bound.
    numbers = [LIMITS[0] + 1, LIMITS[0], -LIMITS[0] - 1, 2**61 + 1]
    table.host.connection.executemany("INSERT INTO t (id) VALUES (?)", [(number,) for number in numbers])
    result = table.run(script, engine=engine)
    assert result.value == [4, 7, 10, *(3 * number + 1 for number in numbers)]
    assert result.stats.calls["f"] == 3
    table.host.connection.execute("INSERT INTO t (id) VALUES (9223372036854775807)")
    with pytest.raises(ss2sql.ExecutionError, match="the function 'f' returned 27670116110564327422"):
        table.run(script, engine=engine)


@both
def test_the_limit_falls_with_the_power_of_the_numbers(table: ss2sql.Session, engine: Any) -> None:
    table.function("f", lambda a, b: a * b)
    table.function("g", lambda a, b: a * b * a * b)
    table.host.connection.execute(f"INSERT INTO t VALUES ({2**62}, 'large', 1e300, NULL)")
    script = "SELECT f(id, id), g(id, id), f(price, price) FROM t WHERE name != 'large' AS list;"
    result = table.run(script, engine=engine)
    assert result.value == [1, 1, 2.25, 4, 16, 6.25, 9, 81, 0.0]
    assert not any(result.stats.calls.values())
    assert all(f"beyond {limit:,}" in result.explain() for limit in LIMITS[1::2])
    assert "price <=" not in result.sql.replace(f"price <= {LIMITS[0]}", "")


@both
def test_counting_and_moving_in_a_search(engine: Any) -> None:
    with ss2sql.connect() as ss:
        ss.function("inc", inc)
        ss.function("go", go)
        ss.function("inside", lambda p, size: 0 <= p[0] < size and 0 <= p[1] < size)
        script = """SELECT place FROM [[1, 0], [0, 1]] WHERE level == 3 AND inside(place, 3)
            START WITH place = [0, 0], level = 0
            CONNECT BY place = go(place, this), level = inc(level)
            STOP WITH NOT inside(go(place, this), 3) AS list;"""
        result = ss.run(script, engine=engine)
        with ss2sql.connect(disable=["inline"]) as other:
            for name, entry in ss.host.functions.items():
                other.function(name, entry.function)
            assert other.run(script, engine=engine).value == result.value
        assert result.stats.calls == {}
        if engine == "database":
            assert "search.level + 1" in result.sql


@both
@pytest.mark.parametrize("disable", [(), ("fold", "unnest", "split", "hoist", "early")])
def test_bools_pass_through_queries_and_groups(engine: Any, disable: tuple[str, ...]) -> None:
    with ss2sql.connect(disable=disable) as ss:
        ss.function("big", lambda n: n > 1)
        ss.function("one", lambda n: 1)
        for script, value in {
            "SELECT p FROM (SELECT to(big(this), p) FROM [1, 2]) AS list;": [False, True],
            "SELECT big(this), count(*) FROM [1, 2, 3] GROUP BY big(this) HAVING big(count(*)) AS list;": [True, 2],
            "SELECT big FROM (SELECT big(this) FROM [1, 2] GROUP BY big(this)) AS list;": [False, True],
            "SELECT (SELECT big(this) FROM [1] GROUP BY big(this) AS value) FROM [1] AS list;": [False],
            "SELECT (SELECT big(this) FROM [a.this] AS value), [big(a.this)] FROM a = [1, 2] AS rows;": [
                (False, [False]),
                (True, [True]),
            ],
            "SELECT one(this), count(*) FROM [1, 2, 2] GROUP BY this AS list;": [1, 1, 1, 2],
            "SELECT this FROM [1, 2, 3] ORDER BY big(this) DESC, one(this) AS list;": [2, 3, 1],
            "SELECT n, b FROM [0] WHERE n == 3 START WITH b = False, n = 0 CONNECT BY b = big(n), n = n + 1"
            " STOP WITH n == 3 AS rows;": [[(0, False), (1, False), (2, False), (3, True)]],
        }.items():
            assert exact(ss.run(script, engine=engine).value) == exact(value), script


@both
def test_sums_of_groups(engine: Any) -> None:
    with ss2sql.connect() as ss:
        ss.function("inc", inc)
        ss.attach("n", [1, 2, 2])
        # What is known of the sum of a list says nothing of the sum of a group.
        result = ss.run("SELECT inc(sum(this)), inc(count(this)) + 1 FROM n GROUP BY this AS list;", engine=engine)
        assert result.value == [2, 3, 5, 4]


def test_a_group_is_what_is_written() -> None:
    """`inc(this)` is not `this + 1` where groups are told apart, inlined or not."""
    for disable in ((), ("inline",)):
        assert outcome("SELECT inc(this), count(*) FROM [1] GROUP BY this + 1;", "auto", disable, inc=inc)[0][
            1
        ].startswith("error[R008]")

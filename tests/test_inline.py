"""Python functions of one expression: which are read, which calls are inlined, and that no result tells it."""

from __future__ import annotations

import inspect
import math
import sys
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from agreement import exact
from purity_samples import Load, load

import ss2sql
from ss2sql.frontend.inlining import translate_function_body
from ss2sql.frontend.user_functions import FunctionBody

__all__ = ["load"]  # the fixture
WALL = 4
NAME = "abc"
EDGES = (0, 9)
STEP = 1
STEP = 2  # bound twice

# --- functions -----------------------------------------------------------------------------------------


def inc(n):
    """One more."""
    return n + 1


def square(x):
    return x**2


def cost(a, b=3):
    return abs(a - b)


def pair(x, y):
    return (x, [y, -x])


def go(position, step):
    return [position[0] + step[0], position[1] + step[1]]


def sign(x):
    if x > 0:
        return 1
    if x < 0:
        return -1
    return 0


def classify(x):
    if x < WALL:
        if x < 0:
            return "low"
    else:
        return "high"
    return None if x == 0 else "middle"


def perhaps(x):  # noqa: RET503
    if x:
        return "yes"


def through(x, y):
    return square(x - y) + cost(b=x, a=y)


def switched(x, on=True, off=False, nothing=0):
    if not off and (on and not nothing):
        return (on and x, off and x, x and on, off or x, nothing or x, [on, nothing])
    return "never"


# not one expression of the language


def several(x):
    x += 1
    return x


def raises(x):
    if x > 1:
        raise ValueError(x)
    return x


def recursive(x):
    return 0 if x < 1 else recursive(x - 1)


# --- bodies --------------------------------------------------------------------------------------------

Numbers = [0, 1, -2, 5, 7]
Floats = [0.0, -0.0, 1.5, -2.25, 4.0]
Mixed = [0, -0.0, 2, 2.5, True]
ONE = "a.this"
TWO = "a.this, b.this"
# function, arguments in terms of a and b, elements of a and of b
INLINED: list[tuple[Callable[..., Any], str, list[Any], list[Any]]] = [
    (lambda: 7, "", [1], [1]), (lambda x: x, ONE, [1, "x", None, [1], 0.5], [1]), (inc, ONE, Mixed, [1]),
    (cost, ONE, Numbers, [1]), (square, ONE, Floats, [1]), (sign, ONE, Mixed, [1]), (classify, ONE, Mixed, [1]),
    (lambda x, low, high: low <= x < high, "a.this, 'a', 'c'", ["", "a", "b", "c"], [1]),
    (lambda x, y=None: x if y is None else x + y, ONE, [1, None, "x"], [1]),
    (lambda x, y=None: x if y is None else x + y, TWO, ["", "ü"], ["", "x"]),
    (lambda x: x in (1, 2, 5) or x in EDGES, ONE, [0, 1, 1.0, True, "1", None, 9], [1]),
    (pair, TWO, Mixed, Numbers),
    (lambda p, q: abs(p[0] - q[0]) + abs(p[-1] - q[-1]), "[a.this, 1], [2, b.this]", Numbers, Floats),
    (go, "[a.this, b.this], [1, -1]", Numbers, Floats),
    (lambda x, y: str(x) + "/" + str(y), TWO, Mixed, [None, "x", ""]), (through, TWO, Numbers, Numbers),
    (lambda x, *, scale=2.5: x * scale % 4, ONE, Floats, [1]), (lambda x, y: pair(y, x), TWO, Numbers, Numbers),
    (lambda p, q: math.dist(p, q) < 3, "[a.this, 1], [2, b.this]", Numbers, Floats),
    (lambda s: s[:1] + s[1:3], ONE, ["", "a", "abcd"], [1]),
    (lambda s: s[:1] + s[1:3], ONE, [[], [1], [1, 2, 3, 4]], [1]),
    (perhaps, ONE, Mixed, [1]),
    (switched, ONE, Mixed, [1]),
    (lambda x, on=True, off=False: 1 if on and x > 0 else 2 if off and x < 0 else 3 if x == 0 or off else 4,
     ONE, Numbers, [1]),
    (lambda x: x in NAME, ONE, ["a", "", "bc", "x"], [1]),
    (lambda x, y: [bool(x), not (x < y)], TWO, Numbers, Numbers),
    (lambda x, y: (x > 0 and x < y) or x == y or False, TWO, Numbers, Numbers),
    (lambda x: (x + 1) and (x - 1), ONE, [-1, 0, 1, 2], [1]),
]  # fmt: skip


@pytest.mark.parametrize("disable", [(), ("unnest",)])
@pytest.mark.parametrize(("function", "arguments", "first", "second"), INLINED)
def test_what_is_inlined_gives_what_the_function_gives(
    function: Callable[..., Any], arguments: str, first: list[Any], second: list[Any], disable: Any, engine: Any
) -> None:
    script = f"SELECT f({arguments}) FROM a = first, b = second AS rows;"
    with ss2sql.connect(disable=disable) as ss, ss2sql.connect(disable=["inline"]) as calling:
        for session in (ss, calling):
            session.function("f", function)
            session.attach("first", first)
            session.attach("second", second)
        result, expected = ss.run(script, engine=engine), calling.run(script, engine=engine)
        assert exact(result.value) == exact(expected.value)
        assert (result.stats.calls, expected.stats.calls["f"] > 0) == ({}, True)
        assert "inline" in ss.compile(script).explain()


@pytest.mark.parametrize(
    ("function", "reason"),
    [
        (several, "is more than one expression"),
        (raises, "is more than one expression"),
        (lambda x: x // 2, "uses 'x // 2'"),
        (lambda x: y[0] + (y := [x])[0], "is more than one expression"),  # noqa: F821, F841
        (lambda x: x[::2], "a slice with a step"),
        (lambda x: cost(*x), "calls cost with arguments that cannot be told apart"),
        (lambda x: cost(x, a=x), "calls cost with the wrong arguments"),
        (lambda x: cost(b=x), "calls cost with the wrong arguments"),
        (lambda x: cost(x, c=x), "calls cost with the wrong arguments"), (lambda x: math.sin(x), "calls math.sin"),
        (lambda x: x.upper(), "calls x.upper"), (lambda x: x.real, "reads 'x.real'"),
        (lambda x: x + STEP, "reads the global name 'STEP', which may change"),
        (lambda *values: values, "takes any number of arguments"),
        (lambda x: f"{x}", "the language does not have"), (lambda x: {"x": x}, "uses '{'x': x}'"),
        (recursive, "too deeply"),
        (lambda x, y: (x, y) == (y, x), "uses '(x, y)'"),
        (lambda x, y: len(pair(x, y)), "calls pair, which gives a tuple"),
        (lambda x, y: x is y, "compares identities"), (lambda x, y: max(x, y, key=abs), "arguments by name"),
        (lambda x: x + 9223372036854775808, "uses a int"), (lambda x: [y + 1 for y in x], "uses '[y + 1 for y in x]'"),
        (lambda x, y=(1, 2): y, "uses a tuple"), (abs, "is not a function written in Python"),
        (eval("lambda x: x"), "has no source"),
    ],
)  # fmt: skip
def test_bodies_that_the_language_does_not_have(function: Callable[..., Any], reason: str) -> None:
    found = translate_function_body(function)
    assert isinstance(found, str)
    assert reason in found


@pytest.mark.parametrize(
    "text",
    ["return " + " + ".join(["x"] * 101), "\n    ".join(f"if x == {number}: pass" for number in range(8))],
    ids=["many operators", "many conditions"],
)
def test_bodies_that_are_too_large(load: Load, text: str) -> None:
    assert translate_function_body(load(f"def f(x):\n    {text}\n").f) == "is too long"


def test_a_body_is_followed_as_deep_as_python_goes(load: Load) -> None:
    function = load("def f(x): return " + "abs(" * 150 + "x" + ")" * 150).f
    assert isinstance(translate_function_body(function), FunctionBody)
    limit = sys.getrecursionlimit()
    sys.setrecursionlimit(len(inspect.stack()) + 200)
    try:
        found = translate_function_body(function)
    finally:
        sys.setrecursionlimit(limit)
    assert found == "is nested too deeply to be followed"


# --- calls ---------------------------------------------------------------------------------------------


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


@pytest.mark.parametrize(
    ("function", "arguments", "values", "calls"),
    [
        (inc, "this", "[1, None]", TypeError),
        (inc, "this", "[1, 'a']", TypeError),
        (inc, "this", "[1, 9223372036854775807]", ss2sql.ExecutionError),
        (lambda a, b: (a + b) / 2, "this, 'a'", "[1]", TypeError),
        (lambda x, y: x / y, "this, 0", "[1]", ZeroDivisionError),
        (lambda x, y: x * y, "this, 3", "['ab']", {"f": 1}),  # Python repeats text
        (lambda x, y: x * y, "this, 1e200", "[1e200]", ss2sql.ExecutionError),
        (lambda x: (x * x) % 7, "this", "[4611686018427387904]", {"f": 1}),  # beyond 64 bits
        (lambda x: x**0.5, "this", "[-1]", ss2sql.ExecutionError),
        (lambda x: x[0], "this", "[[1], []]", IndexError),
        (lambda x: math.dist(x, x), "this", "[1]", TypeError),
        (lambda x: x["k"], "this", "[[1]]", TypeError),
        (lambda x, y: x < y, "this, 'a'", "[1]", TypeError),
        (lambda x: -x, "this", "[-9223372036854775807 - 1]", ss2sql.ExecutionError),
        (lambda x: int(x), "this", "['7', 'b']", ValueError),
        (lambda x: 1 in x, "this", "[[1], [2]]", {}),
        (lambda x: 1 in x, "this", "['1']", TypeError),
        (lambda x: sum(x), "this", "[1]", TypeError),
        (lambda x: [sum(x)], "this", "[1]", TypeError),
        # Arguments are evaluated as often and in the order of the call.
        (inc, "this % 2 / 2", "[1, 2, -3]", {}),
        (lambda x: x + x, "this % 2 * 2", "[1, 2, -3]", {}),  # cheap, and cannot fail
        (lambda x: x * 0, "7 % this", "[1, 2, -3]", {"f": 3}),
        (lambda x: 0, "7 % this", "[1, 2, -3]", {"f": 3}),  # would never fail
        (lambda x: x + x, "7 % this", "[1, 2, -3]", {"f": 3}),  # would be computed twice
        (lambda x: x if x else 1, "7 % this", "[1, 2, -3]", {"f": 3}),
        (lambda x, y: y if x else 1, "this, 7 % this", "[1, 2, -3]", {"f": 3}),  # under a condition only
        (lambda x, y: x - y, "7 % this, 5 % this", "[1, 2, -3]", {"f": 3}),
        (lambda x, y: y - x, "7 % this, 5 % this", "[1, 2, -3]", {"f": 3}),  # in another order
        (lambda x: len(x) + len(x), "sorted([this, 2])", "[1, 2, -3]", {"f": 3}),  # costly
        (lambda x: len(x) + 1, "sorted([this, 2])", "[1, 2, -3]", {}),
        (lambda x: x[0] - x[0], "[this % 2]", "[1, 2, -3]", {}),
        (lambda x: x[0], "[this, 7 % this]", "[1, 2, -3]", {"f": 3}),
        (lambda x: [x, x], "[this, 1]", "[1, 2, -3]", {}),
        (lambda x: [x, x], "IF([this, 1] == [1, this]; this; -this)", "[1, 2, -3]", {"f": 3}),
        (lambda x: x * 2, "print(this)", "[1, 2, -3]", {"f": 3}),
        (lambda x, y: x - y, "this, print(this)", "[1, 2, -3]", {"f": 3}),
        (lambda x, y: y - x, "this, print(this)", "[1, 2, -3]", {"f": 3}),
    ],
)
def test_an_inlined_call_gives_fails_and_prints_as_the_call_does(
    function: Any, arguments: str, values: str, calls: Any, engine: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    script = f"SELECT f({arguments}) FROM {values} AS list;"
    engine = "auto" if "print" in arguments else engine  # which is volatile
    value, counted = outcome(script, engine, f=function)
    printed = capsys.readouterr().out
    assert (value, printed) == (outcome(script, engine, ("inline",), f=function)[0], capsys.readouterr().out)
    assert counted == calls if isinstance(calls, dict) else issubclass(value[0], calls)


def test_a_row_of_a_table_is_made_once(table: ss2sql.Session, engine: Any) -> None:
    table.function("once", lambda row: row is None)
    table.function("twice", lambda row: [row is None, row is not None])
    result = table.run("SELECT once(this), twice(this) FROM t WHERE id > 1 AS list;", engine=engine)
    assert (result.value, result.stats.calls) == ([False, [False, True]] * 2, {"twice": 2})


@pytest.mark.parametrize(
    ("options", "calls"),
    [
        ({}, {}),
        ({"volatility": "stable"}, {"f": 2}),
        ({"inverse": lambda n: n - 1}, {"f": 2}),  # what other machinery needs
        ({"vectorized": True}, {"f": 2}),
    ],
    ids=["plain", "stable", "inverse", "vectorized"],
)
def test_what_is_declared_to_be_more_than_its_body_is_called(options: Any, calls: Any, engine: Any) -> None:
    with ss2sql.connect() as ss:
        ss.function("f", inc, **options)
        ss.function("g", inc, volatility="immutable")
        assert ss.run("SELECT f(this), g(this) FROM [1, 2] AS list;", engine=engine).stats.calls == calls


def test_functions_and_operators_that_are_replaced(engine: Any) -> None:
    with ss2sql.connect() as ss:
        ss.function("f", inc)
        query = ss.compile("SELECT f(this), this + 1 FROM [1, 2] AS list;")
        assert query.run(engine=engine).value == [2, 2, 3, 3]
        ss.function("add", lambda a, b: a * 100)  # not that of the function
        result = query.run(engine=engine)
        assert (result.value, result.stats.calls) == ([2, 100, 3, 200], {"f": 2, "add": 2})
        ss.function("f", square)
        result = query.run(engine=engine)
        assert (result.value, result.stats.calls) == ([1, 100, 4, 200], {"add": 2})
        ss.function("f", several)
        assert query.run(engine=engine).stats.calls == {"f": 2, "add": 2}


def test_functions_of_functions(engine: Any) -> None:
    script = "SELECT f(g(f(this)), h(this)) FROM [1, 2, -3] WHERE g(this) > -3 AS list;"
    value, calls = outcome(script, engine, f=lambda a, b=2: a * b - b, g=inc, h=lambda a: [a, 1][0] + 1)
    expected = [((this * 2 - 2) + 1) * (this + 1) - (this + 1) for this in [1, 2, -3]]
    assert (value, calls) == (exact(expected), {})
    text = "this" + " + f(1)" * 80
    assert outcome(f"SELECT {text} FROM [1] AS list;", engine, f=inc) == (exact([161]), {})


def test_what_would_become_too_long_is_called() -> None:
    text = "f(" * 12 + "this" + ")" * 12
    value, calls = outcome(f"SELECT {text} FROM [1, 2] AS list;", "native", f=lambda x: x % 5 + x % 3)
    assert value == outcome(f"SELECT {text} FROM [1, 2] AS list;", "native", ("inline",), f=lambda x: x % 5 + x % 3)[0]
    assert calls


# --- rows, limits, searches, groups --------------------------------------------------------------------


@pytest.fixture
def table() -> Iterator[ss2sql.Session]:
    with ss2sql.connect() as ss:
        ss.host.connection.execute("CREATE TABLE t (id INTEGER, name TEXT, price REAL, parent INTEGER)")
        rows = [(1, "a", 1.5, None), (2, "b", 2.5, 1), (3, "a", 0.0, 1)]
        ss.host.connection.executemany("INSERT INTO t VALUES (?, ?, ?, ?)", rows)
        yield ss


def test_a_function_of_a_row_reads_its_columns(table: ss2sql.Session, engine: Any) -> None:
    table.function("cheap", lambda row: row["price"] < 2 and row["name"] == "a")
    table.function("root", lambda row: row["parent"] is None)
    table.function("wrong", lambda row: row["prize"])
    table.function("noted", lambda row: row["note"])  # the first row has none
    table.attach("rows", [{"price": 1, "name": "a"}, {"price": 3, "name": "a", "note": 1}])
    for script, value in (
        ("SELECT id FROM t WHERE cheap(this) OR root(this) AS list;", [1, 3]),
        ("SELECT price FROM rows WHERE cheap(this) AS list;", [1]),
    ):
        result = table.run(script, engine=engine)
        assert (result.value, result.stats.calls) == (value, {})
    for script in ("SELECT wrong(this) FROM t;", "SELECT noted(this) FROM rows;"):
        with pytest.raises(KeyError):
            table.run(script, engine=engine)


def test_rows_and_lists_that_would_be_made_again_go_to_the_function(table: ss2sql.Session, engine: Any) -> None:
    table.attach("rows", [{"a": 1}, {"a": 2}])
    table.function("equal", lambda row, other: row == other)
    table.function("kept", lambda row: [row, 1])
    table.function("either", lambda row: row if row["a"] > 1 else row or 0)
    table.function("total", lambda pair: pair[0] + pair[1])
    for script, value in (
        ("SELECT equal(r.this, s.this) FROM r = rows, s = rows AS list;", [True, False, False, True]),
        ("SELECT kept(this) FROM rows AS list;", [[{"a": 1}, 1], [{"a": 2}, 1]]),
        ("SELECT either(this) FROM rows AS list;", [{"a": 1}, {"a": 2}]),
        ("SELECT total([this] + [1]) FROM [1, 2] AS list;", [2, 3]),
    ):
        result = table.run(script, engine=engine)
        assert (result.value, sum(result.stats.calls.values())) == (value, len(value))


def test_large_numbers_are_left_to_the_function(table: ss2sql.Session, engine: Any) -> None:
    table.function("f", lambda n: n * 3 + 1)
    script = "SELECT f(id) FROM t AS list;"
    assert table.run(script, engine=engine).stats.calls == {}
    table.host.connection.execute(f"INSERT INTO t (id) VALUES ({2**61 + 1})")
    result = table.run(script, engine=engine)
    assert (result.value, result.stats.calls["f"]) == ([4, 7, 10, 3 * 2**61 + 4], 4)
    table.host.connection.execute("INSERT INTO t (id) VALUES (9223372036854775807)")
    with pytest.raises(ss2sql.ExecutionError, match="the function 'f' returned 27670116110564327422"):
        table.run(script, engine=engine)


def test_counting_and_moving_in_a_search(engine: Any) -> None:
    script = """SELECT place FROM [[1, 0], [0, 1]] WHERE level == 3 AND inside(place, 3)
        START WITH place = [0, 0], level = 0
        CONNECT BY place = go(place, this), level = inc(level)
        STOP WITH NOT inside(go(place, this), 3) AS list;"""
    functions = {"inc": inc, "go": go, "inside": lambda p, size: 0 <= p[0] < size and 0 <= p[1] < size}
    value, calls = outcome(script, engine, **functions)
    assert (value, calls) == (outcome(script, engine, ("inline",), **functions)[0], {})

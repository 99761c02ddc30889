"""Functions that take arrays: how often they are called, and that nothing else can be told from calls row by row."""

from __future__ import annotations

import ast
import inspect
import math
import re
import sqlite3
from collections.abc import Callable
from typing import Any, cast

import numpy as np
import pytest
from agreement import exact
from golden import each_row
from hypothesis import given, settings
from hypothesis import strategies as st

import ss2sql
from ss2sql.runtime.run.calls import FIRST

BLOCK, ROOM = 256, 4096  # instead of 8,192 and 131,072, which would take long


@pytest.fixture(autouse=True)
def _small_blocks(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("ss2sql.runtime.run.calls.BLOCK", BLOCK)
    monkeypatch.setattr("ss2sql.session.host.MEMO_LIMIT", ROOM)
    monkeypatch.setattr("ss2sql.runtime.run.calls.ROOM", ROOM)


class Blocks:
    """A function of rows as one that takes arrays; `sizes` are those of its blocks, `seen` all rows in them."""

    def __init__(self, function: Callable[..., Any]) -> None:
        self.function = function
        self.__signature__ = inspect.signature(function)
        self.sizes: list[int] = []
        self.seen: list[tuple[Any, ...]] = []

    def __call__(self, *columns: Any) -> Any:
        assert all(type(column) is np.ndarray and column.ndim == 1 for column in columns)
        rows = list(zip(*(column.tolist() for column in columns), strict=True))
        self.sizes.append(len(rows))
        self.seen += rows
        return [self.function(*row) for row in rows]


def run(script: str, sources: dict[str, Any], engine: Any = "auto", **functions: Any) -> ss2sql.Result:
    with ss2sql.connect(disable=["inline"]) as ss:  # which would make others of calls row by row
        for name, function in functions.items():
            ss.function(name, function, volatility="immutable", vectorized=isinstance(function, Blocks))
        for name, source in sources.items():
            ss.attach(name, source)
        return ss.run(script, engine=engine)


def outcome(script: str, sources: dict[str, Any], engine: Any = "auto", **functions: Any) -> Any:
    try:
        return exact(run(script, sources, engine, **functions).value)
    except ss2sql.Error as error:
        return error.code
    except Exception as error:  # where it was called is said of a block, or of a call
        return type(error), str(error)


def test_a_flat_query_calls_once_for_a_block() -> None:
    points = [{"x": n / 7 - 3.0, "y": n % 11} for n in range(3 * BLOCK)]
    f, g = Blocks(lambda x, y: x * y), Blocks(lambda x: x - 10.0)
    result = run("SELECT f(x, y) FROM points WHERE g(x) > 0 AS list;", {"points": points}, f=f, g=g)
    wanted = [row for row in points if row["x"] > 10]
    assert result.value == [row["x"] * row["y"] for row in wanted]
    assert g.sizes == [BLOCK] * 3
    assert f.sizes == [BLOCK, BLOCK, len(wanted) - 2 * BLOCK]
    assert f.seen == [(row["x"], row["y"]) for row in wanted]  # no row that WHERE drops, each once
    assert result.stats.calls == {"f": len(wanted), "g": len(points)}
    assert (result.stats.blocks, result.engine) == ({"f": 3, "g": 3}, "native")


def test_memories_hold_a_block_and_blocks_are_small_with_a_limit() -> None:
    numbers = list(range(ROOM + ROOM // 2))
    f, g = Blocks(lambda n: n + 1), Blocks(lambda n: n % 50)
    result = run("SELECT f(this) FROM numbers WHERE g(this) == 0 AS list;", {"numbers": numbers}, f=f, g=g)
    assert result.value == [n + 1 for n in numbers[::50]]
    assert g.seen == [(n,) for n in numbers]
    assert (len(f.sizes), len(g.sizes)) == (1, math.ceil(len(numbers) / BLOCK))
    f = Blocks(lambda n: n + 1)
    result = run("SELECT f(this) FROM numbers LIMIT 3 AS list;", {"numbers": list(range(1000))}, f=f)
    assert result.value == [1, 2, 3]
    assert f.sizes == [FIRST]


@pytest.mark.parametrize(
    "script",
    [
        "SELECT f(this) FROM numbers WHERE g(this) % 2 == 0 LIMIT 3 AS list;",
        "SELECT f(g(this)) FROM numbers WHERE f(g(this)) % 3 == 0 AND f(f(this)) % 2 == 0 LIMIT 5 OFFSET 2 AS list;",
        "SELECT this FROM numbers WHERE g(this) > 40 OR f(this) % 7 == 0 LIMIT 4 AS list;",
        "SELECT f(b.this) FROM a = numbers, b = [1, g(a.this), 3] WHERE f(g(a.this)) % 3 != 0 LIMIT 8 AS list;",
        "SELECT f(this), 1 / (50 - this) FROM numbers WHERE 1 / (60 - this) > 0 AND f(this) > 3 LIMIT 30 AS rows;",
    ],
)
def test_no_other_function_is_called_for_rows_that_a_limit_cuts_off(script: str) -> None:
    results, seen = [], []
    for f in (Blocks(double), double):
        calls: list[Any] = []
        result = run(script, {"numbers": list(range(100))}, "native", f=f, g=lambda n, c=calls: c.append(n) or 3 * n)
        results.append(result.value)
        seen.append(calls)
    assert results[0] == results[1]
    assert seen[0] == list(dict.fromkeys(seen[1]))


@pytest.mark.parametrize(
    "script",
    [
        "SELECT this FROM numbers WHERE this < 50 OR f(this) > 60 AS list;",
        "SELECT IF(this < 50; 0; f(this) > 60) FROM numbers AS list;",
        "SELECT f(this) FROM numbers WHERE IF(this < 50; False; this % 2 == 0 OR f(this) > 60) AS list;",
        "SELECT f(this) FROM numbers WHERE this >= 60 AND (this < 50 OR f(this) > 60) ORDER BY f(this) AS list;",
    ],
)
def test_a_guarded_call_is_not_made(script: str) -> None:
    f = Blocks(double)
    expected = outcome(script, {"numbers": list(range(100))}, f=double)
    assert outcome(script, {"numbers": list(range(100))}, f=f) == expected
    assert len(f.sizes) <= 2
    assert min(f.seen) >= (50,)


def double(n: Any) -> Any:
    return n * 2


def inverse(n: Any) -> Any:
    if n == 0:
        raise ZeroDivisionError("no inverse of 0")
    return 1 / n


FAILING = [
    "SELECT f(this) FROM numbers AS list;",
    "SELECT f(this) FROM numbers WHERE this != 0 AS list;",
    "SELECT f(this) FROM numbers LIMIT 3 AS list;",
    "SELECT f(this) FROM numbers WHERE this > 4 OR f(this) > 0.4 AS list;",
    """SELECT this FROM numbers WHERE n == 6 START WITH n = 1
    CONNECT BY n = n + this STOP WITH n > 6 OR f(this) < 0;""",
    """SELECT this FROM numbers WHERE n == 9 START WITH n = 1
    CONNECT BY UNIQUE n = n + this STOP WITH n > 6 OR f(this) < 0;""",
    """SELECT this FROM numbers WHERE n == 9 START WITH n = 1
    CONNECT BY UNIQUE n = n + this STOP WITH this == 0 OR n > 20 OR f(this) < 0.2;""",
]


@each_row("queries/blocks", "script", "told")
def test_every_place_of_a_flat_query(script: str, told: str) -> None:
    most = ast.literal_eval(told)
    numbers = {"numbers": list(range(100))}
    f, alone = Blocks(double), Blocks(double)
    expected = outcome(script, numbers, f=double)
    assert outcome(script, numbers, f=f) == expected
    assert outcome(script, numbers, "database", f=alone) in (expected, "U001")
    assert set(alone.sizes) <= {1}  # SQLite calls for one row at a time
    assert len(f.sizes) <= most
    assert len(f.seen) == len(set(f.seen))


@pytest.mark.parametrize("script", FAILING)
def test_a_failure_is_an_error_where_its_row_is_evaluated(engine: Any, script: str) -> None:
    numbers = {"numbers": [5, 4, 3, 2, 1, 0, 9, 8, 7]}
    assert outcome(script, numbers, engine, f=Blocks(inverse)) == outcome(script, numbers, engine, f=inverse)


# --- searches ------------------------------------------------------------------------------------------

MOVES = [1, 2, 3, 5, 8, 13]


@pytest.mark.parametrize(
    "options", ["UNIQUE", "", "BREADTH FIRST", "NO CYCLE", "MEMORIZE 4", "COST this", "COST g(n, this) UNIQUE"]
)
@pytest.mark.parametrize("maximum", ["", "MAXIMUM 3"])
def test_a_search_calls_once_for_the_steps_of_a_state(options: str, maximum: str) -> None:
    script = f"""SELECT n, this FROM moves WHERE f(n, this) == 8 START WITH n = 0
        CONNECT BY {options} {maximum} n = f(n, this) STOP WITH f(n, this) >= 8;"""
    f, g = Blocks(lambda n, move: n + move), Blocks(lambda n, move: n % 3 + move)
    result = run(script, {"moves": MOVES}, f=f, g=g)
    plain = run(script, {"moves": MOVES}, "native", f=lambda n, m: n + m, g=lambda n, m: n % 3 + m)
    assert exact(result.value) == exact(plain.value)
    assert result.value
    assert (result.stats.generated, result.stats.expanded) == (plain.stats.generated, plain.stats.expanded)
    for function in (f, g):
        states = [row[0] for row in function.seen]
        assert len(function.sizes) == len(set(states))
        assert function.seen == [(n, move) for n in dict.fromkeys(states) for move in MOVES]


def test_the_arrays_have_one_kind_of_number_or_plain_values(ss: ss2sql.Session) -> None:
    seen: list[tuple[str, list[Any]]] = []

    def f(x: Any, y: Any) -> Any:
        seen.append((f"{x.dtype} {y.dtype}", x.tolist()))
        return x

    values = [1, 2.5, 3, True, None, "a", [1], [2], {"k": 1}, 4.5, False, math]
    ss.function("f", f, volatility="immutable", vectorized=True)
    ss.attach("xs", values)
    assert exact(ss.eval("SELECT f(this, 7) FROM xs AS list;")) == exact(values)
    assert seen == [
        ("int64 int64", [1, 3]), ("float64 int64", [2.5, 4.5]), ("bool int64", [True, False]),
        ("object int64", [None, "a", [1], [2], {"k": 1}, math]),
    ]  # fmt: skip


SIMPLE = st.none() | st.booleans() | st.integers(-3, 3) | st.sampled_from([0.0, -0.0, 1.0, 2.5, "", "a"])
VALUES = st.recursive(SIMPLE, lambda inner: st.lists(inner, max_size=2), max_leaves=4)
SCRIPTS = [
    "SELECT f(x, y) FROM rows AS list;",
    "SELECT f(x, y), f(y, x) FROM rows WHERE f(x, 1) != f(1, y) AS rows;",
    "SELECT f(a.this, b.this) FROM a = xs, b = ys AS list;",
    "SELECT x FROM rows WHERE x == y OR f(x, y) AS list;",
    """SELECT f(n, this) FROM xs
    START WITH n = 0, d = 0 CONNECT BY UNIQUE n = f(n, this), d = d + 1 STOP WITH d > 2;""",
    "SELECT n FROM xs WHERE f(n, this) START WITH n = 0, d = 0 CONNECT BY n = f(this, n), d = d + 1 STOP WITH d > 1;",
]


def mixed(x: Any, y: Any) -> Any:
    """Of any two values; fails for some."""
    if x == "a" and y is None:
        raise LookupError("a")
    return [x, type(y).__name__] if isinstance(y, list) else y if x else [x, y][:1]


@pytest.mark.parametrize("engine", ["database", "native"])
@given(rows=st.lists(st.tuples(VALUES, VALUES), max_size=6), script=st.sampled_from(SCRIPTS))
@settings(max_examples=60, deadline=None)
def test_values_are_those_of_calls_row_by_row(engine: Any, rows: Any, script: str) -> None:
    sources = {
        "rows": [{"x": x, "y": y} for x, y in rows] or [{"x": 1, "y": 2}],
        "xs": [x for x, _ in rows],
        "ys": [y for _, y in rows],
    }
    f = Blocks(mixed)
    assert outcome(script, sources, engine, f=f) == outcome(script, sources, engine, f=mixed)


def test_what_takes_arrays_is_stable_and_cannot_be_volatile(ss: ss2sql.Session) -> None:
    @ss.function(vectorized=True)
    def norm_of(x: Any, y: Any) -> Any:
        return np.hypot(x, y)

    result = ss.run("SELECT norm_of(this, 4) FROM [3.0, 0.0] AS list;")
    assert (result.value, result.stats.blocks) == ([5.0, 4.0], {"norm_of": 1})
    assert "norm_of is stable: takes arrays, which says that it is not volatile" in result.explain()
    with pytest.raises(ss2sql.Error, match=r"S002.*takes arrays, so it cannot be volatile") as caught:
        ss.function("f", lambda x: x, volatility="volatile", vectorized=True)
    assert caught.value.hints


def test_rows_of_a_table_come_in_blocks(ss: ss2sql.Session) -> None:
    connection = sqlite3.connect(":memory:")
    connection.execute("CREATE TABLE t(x INTEGER)")
    connection.executemany("INSERT INTO t VALUES (?)", [(x,) for x in range(BLOCK + 4)])
    ss.attach("db", connection)
    f = Blocks(lambda x: x * x)
    ss.function("f", f, volatility="immutable", vectorized=True)
    result = ss.run("SELECT f(x) FROM db.t WHERE x > 3 AND f(x - 1) % 2 == 0 AS list;")
    assert result.value == [x * x for x in range(4, BLOCK + 4) if x % 2]
    assert (result.engine, f.sizes) == ("native", [BLOCK, 1])  # all others are known
    assert "native: it calls a function that takes arrays" in result.explain()


def test_a_run_that_must_end_ends_between_blocks(ss: ss2sql.Session) -> None:
    f = Blocks(lambda n: n)
    first = f.function

    def stop(n: Any) -> Any:
        ss.interrupt()
        return first(n)

    f.function = stop
    ss.function("f", f, volatility="immutable", vectorized=True)
    ss.attach("numbers", list(range(3 * BLOCK)))
    with pytest.raises(ss2sql.Cancelled):
        ss.run("SELECT f(this) FROM numbers AS list;")
    assert f.sizes == [BLOCK]
    f.function = cast(Any, first)
    assert ss.eval("SELECT f(this) FROM [5] AS list;") == [5]


# --- failures, and results that do not fit --------------------------------------------------------------


@pytest.mark.parametrize(
    ("returned", "got"),
    [([1.5], "1 element"), ([1.5] * 4, "4 elements"), ([], "0 elements"), (5.5, "5.5"), (None, "None"),
     (np.int64(6), "6"), (np.array(7), "7"), ("abc", "'abc'"), ({"a": 1}, "{'a': 1}")],
)  # fmt: skip
def test_a_block_of_another_length(ss: ss2sql.Session, returned: Any, got: str) -> None:
    ss.function("f", lambda x: returned, volatility="immutable", vectorized=True)
    for engine, rows in (("auto", "3 rows"), ("database", "1 row")):
        if rows == "1 row" and got == "1 element":
            continue
        said = re.escape(
            f"error[X012]: the function 'f' takes arrays; for {rows} it returned {got}\n --> <script>:2:3\n"
        )
        with pytest.raises(ss2sql.ExecutionError, match=said):
            ss.run("SELECT this,\n  f(this) FROM [1, 2, 3];", engine=cast(Any, engine))


def test_elements_are_lists_or_are_refused_where_their_rows_come(ss: ss2sql.Session, engine: Any) -> None:
    ss.function("f", lambda x: np.where(x == 3, np.nan, x * 1.0), volatility="immutable", vectorized=True)
    assert ss.run("SELECT f(this) FROM [1, 2, 3] LIMIT 2 AS list;", engine=engine).value == [1.0, 2.0]
    assert ss.run("SELECT f(this) FROM [1, 3, 2] WHERE this != 3 AS list;", engine=engine).value == [1.0, 2.0]
    with pytest.raises(ss2sql.ExecutionError, match=r"X004.*the function 'f' returned NaN\n.*<script>:1:8"):
        ss.run("SELECT f(this) FROM [1, 2, 3] AS list;", engine=engine)
    ss.function("f", lambda x: np.stack([x, 2 * x], axis=1), volatility="immutable", vectorized=True)
    assert ss.run("SELECT f(this) FROM [1, 2] AS list;", engine=engine).value == [[1, 2], [2, 4]]


@pytest.mark.parametrize("returned", [np.float32(2), np.int16(2), np.bool_(True), np.str_("a"), (1, 2), {3}, None])
def test_elements_pass_the_border(ss: ss2sql.Session, engine: Any, returned: Any) -> None:
    ss.function("f", lambda x: [returned] * len(x), volatility="immutable", vectorized=True)
    ss.function("g", lambda x: returned, volatility="immutable")
    made = ss.run("SELECT f(this), g(this) FROM [1, 2] AS rows;", engine=engine).value
    assert exact(made) == exact([(b, b) for _, b in made])

"""`early` and `hoist`: conditions are asked, and values computed, as soon as nobody can tell the difference."""

from __future__ import annotations

import ast
from typing import Any

import pytest
from golden import each_row
from listings import MOVES, move

import ss2sql

TOWERS = """SELECT m1.this, m2.this, m3.this, m4.this, m5.this, m6.this, m7.this
FROM m1 = moves, m2 = moves, m3 = moves, m4 = moves, m5 = moves, m6 = moves, m7 = moves
WHERE [[], [], [3, 2, 1]] == move(m7.this, move(m6.this, move(m5.this, move(m4.this, move(m3.this,
    move(m2.this, move(m1.this, [[3, 2, 1], [], []]))))))) AS list"""
SWITCHED = ((), ("hoist",), ("early",), ("hoist", "early"), ("fold",), ("split", "unnest"))
LISTS = {"moves": MOVES, "xs": [1, 2, 3], "ones": [1, 1], "empty": [], "rows": [{"k": 2, "v": "x"}, {"k": 1, "v": "y"}]}


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
    ss.function("move", move)
    for name, value in LISTS.items():
        ss.attach(name, value)
    return ss, calls


def asked(script: str, *disable: str, of: str = "f") -> tuple[Any, int]:
    """The value of a script in the database, and how often the value of a function was needed."""
    result = session(*disable)[0].run(script, engine="database")
    return result.value, result.stats.calls[of] + result.stats.remembered[of]


# --- hoist ---------------------------------------------------------------------------------------------


def test_inner_calls_of_the_paper_are_evaluated_once_per_prefix() -> None:
    path = [[0, 2], [0, 1], [2, 1], [0, 2], [1, 0], [1, 2], [0, 2]]
    assert asked(TOWERS, of="move") == (path, sum(6**level for level in range(1, 8)))


@each_row("rewrites/evaluated-ahead", "columns", "told")
def test_which_parts_are_evaluated_ahead(columns: str, told: str) -> None:
    times = ast.literal_eval(told)
    script = f"SELECT {columns} FROM a = [1, 2], b = xs AS list"
    assert asked(script) == (session()[0].run(script, engine="native").value, times)


@pytest.mark.parametrize("disable", SWITCHED)
@each_row("rewrites/calls", "script", "calls")
def test_only_what_the_written_order_evaluates(engine: Any, script: str, calls: str, disable: tuple[str, ...]) -> None:
    """SQL may call more, but none of them twice, and none for a row that LIMIT cuts off."""
    expected = [call if isinstance(call, tuple) else ("f", call) for call in ast.literal_eval(calls)]
    ss, made = session(*disable)
    if "bad" in script or "/" in script:
        with pytest.raises((ValueError, ss2sql.ExecutionError)):
            ss.run(script, engine=engine)
    else:
        ss.run(script, engine="auto" if "loud" in script and engine == "database" else engine)
    if engine == "native" or "loud" in script:
        assert [call for call in made if call[0] == "f" or "g(a" in script or "LIMIT" in script] == expected
    else:
        assert len(made) == len(set(made))
        assert "LIMIT" not in script or set(made) == set(expected)


@pytest.mark.parametrize("disable", [(), ("hoist",)])
@each_row("rewrites/hoisted-values", "script", "told")
def test_hoisted_values_in_sorted_grouped_and_cut_queries(
    engine: Any, disable: tuple[str, ...], script: str, told: str
) -> None:
    value = ast.literal_eval(told)
    assert session(*disable)[0].run(script, engine=engine).value == value


# --- early ---------------------------------------------------------------------------------------------


@each_row("rewrites/asked-early", "where", "told")
def test_a_condition_is_asked_as_soon_as_its_sources_are_bound(where: str, told: str) -> None:
    times = ast.literal_eval(told)
    script = f"SELECT b.this, c.this FROM a = range(20), b = range(20), c = range(20) WHERE {where} AS rows"
    assert asked(script, "hoist") == ([(6, 7)], times)
    value, without = asked(script, "hoist", "early")
    assert value == [(6, 7)]
    assert without >= times
    (early, asked_early), (late, asked_late) = session("hoist"), session("hoist", "early")
    for ss in (early, late):
        ss.run(script, engine="database")
    assert asked_early == asked_late


def test_conditions_that_cannot_fail_filter_each_source() -> None:
    """`f` is asked about d as often as a, b and c let pass what lies behind them."""
    script = """SELECT c.this FROM a = range(60), b = range(60), c = range(60), d = range(60)
        WHERE a.this < 2 AND b.this == a.this AND c.this < b.this AND f(d.this) == c.this AS list"""
    assert asked(script) == ([0], 60)

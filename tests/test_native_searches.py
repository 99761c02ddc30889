"""The native executor on searches: when what is evaluated, what is counted."""

from __future__ import annotations

from typing import Any

import pytest
from native_host import FakeHost

import ss2sql
from ss2sql.runtime.python.loop_helpers import TURNS_PER_CHECK

ORDERS = ["DEPTH FIRST", "BREADTH FIRST", "COST 1", "COST 1 HEURISTIC 0", "PROBABILITY 0.5"]
REPEATS = ["", "NO CYCLE", "UNIQUE"]
MANY = 3 * TURNS_PER_CHECK + 5  # elements, so that they are walked in several parts
orders = pytest.mark.parametrize("order", ORDERS)
repeated = pytest.mark.parametrize("repeats", REPEATS)


def native(ss: ss2sql.Session, script: str, **variables: Any) -> ss2sql.Result:
    return ss.run(script, engine="native", **variables)


def counts(result: ss2sql.Result) -> tuple[int, int, int]:
    return result.stats.generated, result.stats.expanded, result.stats.pruned


# --- counts --------------------------------------------------------------------------------------------


@repeated
@pytest.mark.parametrize("order", ["DEPTH FIRST", "BREADTH FIRST"])
def test_only_steps_up_to_the_last_result_are_counted(ss: ss2sql.Session, order: str, repeats: str) -> None:
    for place in (0, TURNS_PER_CHECK - 1, TURNS_PER_CHECK, MANY - 1):
        script = f"""SELECT this FROM numbers WHERE this == {place} START WITH n = 0
            CONNECT BY {order} {repeats} MAXIMUM 1 n = this STOP WITH True AS list;"""
        result = native(ss, script, numbers=list(range(MANY)))
        assert result.value == [[place]]
        assert counts(result) == (place + 1, 0, 0)
    assert counts(native(ss, script.replace("AS list", "LIMIT 0 AS list"), numbers=[1, 2])) == (0, 0, 0)


@repeated
@pytest.mark.parametrize("order", ["COST this + 1", "PROBABILITY 1 / (this + 1)"])
def test_all_steps_of_a_state_come_before_the_best_of_them(ss: ss2sql.Session, order: str, repeats: str) -> None:
    script = f"SELECT this FROM numbers START WITH n = 0 CONNECT BY {order} {repeats} MAXIMUM 2 n = this AS list;"
    result = native(ss, script, numbers=list(range(MANY)))
    # After the first result its state is expanded.
    assert result.value[0] == [0]
    assert (result.stats.generated, result.stats.expanded) == (2 * MANY, 1)
    assert counts(native(ss, script.replace("AS list", "LIMIT 0 AS list"), numbers=[1, 2])) == (0, 0, 0)


def test_nested_searches_count_together(ss: ss2sql.Session) -> None:
    inner = "(SELECT this FROM [1, 2, 3] START WITH m = 0 CONNECT BY m = this STOP WITH m > 0 AS list)"
    outer = f"SELECT len({inner}) FROM [1, 2] START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 1 AS list;"
    result = native(ss, outer)
    # Inside: 3 steps that go on, and 3 from each of them, which stop. Around it: 2 that go on, and 2 from each.
    # The inner search depends on nothing, so it is made once.
    assert result.value == [[3], [3]]
    assert counts(result) == (3 + 9 + 2 + 4, 3 + 2, 0)


# --- when what is evaluated ----------------------------------------------------------------------------


def trace(options: str, columns: str) -> list[str]:
    seen: list[str] = []

    def note(word: str, value: Any) -> Any:
        seen.append(word)
        return value

    host = FakeHost({"note": note}, {"note": "volatile"})
    host.run(f"""SELECT {columns} FROM [1] WHERE note('where', True) START WITH n = note('start', 0)
    CONNECT BY {options} n = note('connect', n + 1) STOP WITH note('stop', n == 1)""")
    return seen


@pytest.mark.parametrize(
    ("options", "columns", "expected"),
    [
        ("", "this", "start stop where select connect stop where select"),
        (
            "COST note('cost', 1) HEURISTIC note('heuristic', 0)",
            "this",
            "start stop where select cost heuristic connect stop where select cost",
        ),
        ("PROBABILITY note('p', 1)", "this", "start stop where select p connect stop where select p"),
        ("PROBABILITY note('p', 0)", "this", "start stop where select p"),  # an impossible step is not connected
        # A row that is compared comes first. One that is known is dropped before STOP WITH and WHERE are asked.
        *[(word, "n", "start select stop where connect select stop where") for word in (*REPEATS[1:], "MEMORIZE")],
        *[(word, "this", "start select stop where connect select") for word in (*REPEATS[1:], "MEMORIZE")],
    ],
)  # fmt: skip
def test_clauses_of_a_step(options: str, columns: str, expected: str) -> None:
    assert " ".join(trace(options, f"note('select', {columns})")) == expected


@orders
def test_what_a_source_and_a_clause_share_is_computed_once(ss: ss2sql.Session, order: str) -> None:
    calls: list[int] = []

    def items(n: int) -> list[int]:
        calls.append(n)
        return [n, n + 1]

    ss.function("items", items, volatility="immutable")
    script = f"""SELECT a.this, len(items(3)), c.this FROM a = items(3), b = [x], c = items(x + 10)
        WHERE len(items(3)) == 2 START WITH x = 0 CONNECT BY {order} x = x + 1 STOP WITH x == 1 AS list;"""
    # Four steps from the first state, and from each of them four that stop and are goals.
    assert sorted(len(path) for path in native(ss, script).value) == 4 * [3] + 16 * [6]
    assert sorted(calls) == [3, 10, 11]


@pytest.mark.parametrize("options", ["DEPTH FIRST", "UNIQUE", "MEMORIZE 3"])
def test_an_argument_that_is_computed_once_is_there_for_every_state(options: str) -> None:
    # The key of `low(1)` is known when the second state comes; `plus` is called for each state nevertheless.
    host = FakeHost({"low": lambda n: n < 2, "plus": lambda low, n: [n, low]})
    script = "SELECT n + this FROM [1, 2] WHERE [3, True] == plus(low(1), n + this)"
    script += f" START WITH n = 0 CONNECT BY {options} n = n + this STOP WITH n + this > 3 AS list"
    assert host.run(script)[0][-1] == 3

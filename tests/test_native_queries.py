"""The native executor: how often what is called and read, in which order; very wide queries; what searches count."""

from __future__ import annotations

import ast
from typing import Any

import pytest
from golden import each_row
from native_host import FakeHost

import ss2sql
from ss2sql.frontend.syntax.parser import parse
from ss2sql.runtime.python.query_execution import TURNS_PER_CHECK


@each_row("queries/calls", "script", "told")
def test_how_often_functions_are_called(script: str, told: str) -> None:
    functions = {
        "twice": lambda value: 2 * value, "loud": lambda value: 2 * value, "below": lambda n: list(range(n)),
        "draw": lambda: [1, 2], "add1": lambda a, b: [*b, a],
    }  # fmt: skip
    host = FakeHost(functions, {"loud": "volatile", "draw": "volatile"}, l=[1, 2, 3], ten=list(range(10)), empty=[])
    result = host.result(script)
    assert (result.value, sum(result.stats.calls.values())) == ast.literal_eval(told)


def test_a_text_is_read_once_per_run(monkeypatch: pytest.MonkeyPatch) -> None:
    read: list[Any] = []
    monkeypatch.setattr("ss2sql.session.host.parse", lambda source: read.append(source) or parse(source))
    host = FakeHost(texts=["rows.n", "1", "rows.n"], rows=[{"n": number} for number in range(20)])
    assert host.run("SELECT eval(t.this) FROM rows, t = texts AS list")[:3] == [0, 1, 0]
    assert len(read) == 2


def test_a_list_that_changes_while_it_is_read() -> None:
    numbers = [1, 2]
    host = FakeHost({"grow": lambda: numbers.append(9) or 0}, {"grow": "volatile"})
    host.session.attach("l", numbers)
    assert host.run("SELECT this + grow() FROM l AS list") == [1, 2]


# --- the order of evaluation ---------------------------------------------------------------------------


@each_row("queries/order-of-evaluation", "script", "told")
def test_order_of_evaluation(script: str, told: str) -> None:
    seen = ast.literal_eval(told)
    words: list[str] = []

    def note(word: str, value: Any) -> Any:
        words.append(word)
        return value

    host = FakeHost({"note": note}, {"note": "volatile"})
    if seen:
        host.run(script)
    else:
        assert host.error(script).code == "X002"
    assert "".join(words) == seen


# --- more sources than Python nests loops ----------------------------------------------------------------


@pytest.mark.parametrize("number", [16, 17, 40, 70])
def test_more_sources_than_python_nests(number: int) -> None:
    sources = ", ".join(f"s{index} = [{index}, {index}]" if index < 3 else f"s{index} = [s{index - 1}.this + 1]"
                        for index in range(number))  # fmt: skip
    where = f"s1.this != 5 AND s{number - 1}.this + s0.this + s3.this > 0"
    script = f"SELECT s0.this, s2.this, s{number - 1}.this FROM {sources} WHERE {where} AS rows"
    assert FakeHost().run(script) == [(0, 2, number - 1)] * 8


@pytest.mark.parametrize("order", ["NO CYCLE", "BREADTH FIRST UNIQUE", "COST 1"])
@pytest.mark.parametrize("number", [10, 17, 40])
def test_searches_with_more_sources_than_python_nests(number: int, order: str) -> None:
    sources = ", ".join(f"s{index} = [{index}, n]" if index < 2 else f"s{index} = [n]" for index in range(number))
    script = f"SELECT s0.this, s1.this, s{number - 1}.this FROM {sources} START WITH n = 3 CONNECT BY {order} n = n + 1"
    assert FakeHost().run(f"{script} STOP WITH n == 4 OR s0.this == 3 OR s1.this == 3 AS list") == [[0, 1, 3]]


@pytest.mark.parametrize("number", [17, 40])
def test_groups_with_more_sources_than_python_nests(number: int) -> None:
    pairs = ", ".join(f"s{index} = [1, 2]" if index > number - 4 else f"s{index} = [1]" for index in range(number))
    columns = f"s{number - 1}.this, count(*), sum(s{number - 2}.this)"
    found = FakeHost().run(f"SELECT {columns} FROM {pairs} GROUP BY s{number - 1}.this AS rows")
    assert found == [(1, 4, 6), (2, 4, 6)]


# --- searches: when what is evaluated, what is counted --------------------------------------------------


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
        assert counts(result) == (place + 1, 1, 0)
    assert counts(native(ss, script.replace("AS list", "LIMIT 0 AS list"), numbers=[1, 2])) == (0, 0, 0)


@repeated
@pytest.mark.parametrize("order", ["COST this + 1", "PROBABILITY 1 / (this + 1)"])
def test_all_steps_of_a_state_come_before_the_best_of_them(ss: ss2sql.Session, order: str, repeats: str) -> None:
    script = f"SELECT this FROM numbers START WITH n = 0 CONNECT BY {order} {repeats} MAXIMUM 2 n = this AS list;"
    result = native(ss, script, numbers=list(range(MANY)))
    # After the first result its state is expanded.
    assert result.value[0] == [0]
    assert (result.stats.generated, result.stats.expanded) == (2 * MANY, 2)
    assert counts(native(ss, script.replace("AS list", "LIMIT 0 AS list"), numbers=[1, 2])) == (0, 0, 0)


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

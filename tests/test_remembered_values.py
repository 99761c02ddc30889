"""Remembered graphs give back exactly the values that were put in, and the answers of fresh ones whatever is asked."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest
from remembering import asked, calls, session
from sessions import code_of, write

import ss2sql
from ss2sql.runtime.remembered.texts import NotKept, text_of, values_of

EXACT = [
    *(None, True, False, 0, 1, 1.0, -0.0, 0.1 + 0.2, 5e-324, 1e308, 2**63 - 1, -(2**63), 9007199254740993),
    *("", 'quote " and \\ and \n and \0 and \u2028', "smile 😀 ünï", "{"),
    *([], [[], [1, 1.0, True, None]], {}, {"b": 1, "a": {"z": [1.0], "y": "é"}}, [{"": None}]),
]
INEXACT: list[Any] = [
    *(object(), b"bytes", {1: 2}, {(1, 2): 3}, {"a": {None: 1}}, "half \ud83d of a smile", "\ud83d\ude00"),
    *(1j, float("inf")),
]


@pytest.mark.parametrize("value", INEXACT, ids=lambda value: ascii(value)[:20])
def test_values_without_a_text(value: Any) -> None:
    for nested in (value, [value], {"a": value}):
        with pytest.raises(NotKept):
            text_of((nested,))


def test_texts_that_are_none_of_one_value() -> None:
    for texts in (["1, 2"], ["1", ""], ["]"], ["NaN,1"]):
        with pytest.raises(ValueError):  # noqa: PT011 - whatever json says
            values_of(texts)


SCRIPT = """SELECT n, value(n), v FROM [0] START WITH n = 0, v = [] CONNECT BY MEMORIZE v = value(n), n = n + 1
STOP WITH n == number AS rows"""


def test_values_of_rows_and_states(tmp_path: Path) -> None:
    file, number = tmp_path / "values.db", len(EXACT)
    with session(None, value=lambda n: EXACT[n]) as ss:
        expected = ss.eval(SCRIPT, number=number - 1)
    with session(file, value=lambda n: EXACT[n]) as ss:
        assert repr(ss.eval(SCRIPT, number=number - 1)) == repr(expected)
    with session(file, value=lambda n: EXACT[n]) as ss:
        again = ss.run(SCRIPT, number=number - 1)
        assert repr(again.value) == repr(expected)
        assert calls(again) == 0
    texts = "SELECT min(json_valid(row)), min(json_valid(state)) FROM ss2sql_edges, ss2sql_nodes"
    assert asked(file, texts) == [(1, 1)]


@pytest.mark.parametrize("value", INEXACT[:7], ids=lambda value: ascii(value)[:20])
def test_what_json_cannot_give_back_is_not_remembered(value: Any, tmp_path: Path) -> None:
    values = [1, 2, value, 4, 5]
    with session(None, value=lambda n: values[n]) as ss:
        expected = ss.eval(SCRIPT, number=4)
    with session(tmp_path / "values.db", value=lambda n: values[n]) as ss:
        for _ in range(2):
            result = ss.run(SCRIPT, number=4)
            assert result.value == expected
            (note,) = result.stats.notes
            assert "not remembered: " in note


def test_elements_that_functions_give(tmp_path: Path) -> None:
    """Dicts as elements, read by their columns or as a whole, beside a source that is read once."""
    ways = [[{"to": 1, "how": "by foot"}, {"to": 2, "how": None}], [{"to": 2, "how": 1.0}], []]

    def out_of(node: int) -> list[dict[str, Any]]:
        return ways[node]

    scripts = [
        """SELECT w.to, k.this FROM k = [1, 2], w = out_of(node) WHERE w.to == 2
        START WITH node = 0 CONNECT BY MEMORIZE 3 node = w.to ORDER BY k.this DESC, w.how AS rows""",
        """SELECT w.this["to"], k.this FROM k = [1, 2], w = out_of(node) WHERE w.how != 1
        START WITH node = 0 CONNECT BY MEMORIZE 3 node = w.to AS rows""",
    ]
    file = tmp_path / "ways.db"
    for _ in range(2):
        for script in scripts:
            with session(None, out_of=out_of) as ss:
                expected = ss.eval(script)
            with session(file, out_of=out_of) as ss:
                first, again = ss.run(script), ss.run(script)
                assert first.value == again.value == expected
                assert calls(again) == 0


# --- whatever is asked -----------------------------------------------------------------------------------

QUERIES = [
    "SELECT e.this[0] FROM e = near(node) WHERE {goal} START WITH node = {first} CONNECT BY MEMORIZE {bound} {options} "
    "node = e.this[0] STOP WITH {stop} AS list",
    "SELECT k.this, reached(node, k.this) FROM k = [0, 1, 2] WHERE reached(node, k.this) IN {goals} "
    "START WITH node = {first} CONNECT BY MEMORIZE {bound} node = reached(node, k.this) "
    "STOP WITH reached(node, k.this) IN {stops} GROUP BY k.this % 2 ORDER BY node AS rows",
]


@pytest.mark.parametrize("seed", [*range(10), *(pytest.param(n, marks=pytest.mark.slow) for n in range(10, 30))])
def test_random_queries_one_after_the_other(seed: int, tmp_path: Path) -> None:
    """Whatever was asked before, a remembered graph answers as a fresh one, with the same steps."""
    dice = random.Random(seed)
    size = dice.randint(3, 7)
    weights = [0, 0.5, 1.0, 1]
    edges = [[[dice.randrange(size), dice.choice(weights)] for _ in range(dice.randint(0, 4))] for _ in range(size)]
    functions = {
        "near": lambda node: edges[node],
        "reached": lambda node, k: edges[node][k][0] if k < len(edges[node]) else node,
        "is_goal": lambda node, goals: node in goals,
        "weight": lambda edge: edge[1],
    }
    sessions = [session(path, **functions) for path in (tmp_path / "random.db", None)]
    for _ in range(8):
        goals, stops = ([dice.randrange(size) for _ in range(2)] for _ in range(2))
        script = dice.choice(QUERIES).format(
            goal=dice.choice([f"e.this[0] IN {goals}", f"is_goal(e.this[0], {goals})", "node != 0"]),
            stop=dice.choice([f"e.this[0] IN {stops}", f"is_goal(e.this[0], {stops}) AND near(e.this[0]) != []"]),
            options=dice.choice(["", "", "COST weight(e.this)", "PROBABILITY weight(e.this)"]),
            first=dice.randrange(size),
            bound=dice.choice([1, 2, 3, 4, ""]),
            goals=goals,
            stops=stops,
        )
        remembered, scratch = (ss.run(script) for ss in sessions)
        assert repr(remembered.value) == repr(scratch.value), script
        assert remembered.stats.levels == scratch.stats.levels, script
        assert calls(remembered) <= calls(scratch), script
        assert calls(sessions[0].run(script)) == 0, script
    for ss in sessions:
        ss.close()


AROUND = [[0, 1], [1, 0], [0, -1], [-1, 0.0], [1.0, True]]


@pytest.mark.parametrize(
    "row", ["plus(place, this)", "plus(place, this), place[0] + this[0]", "this, plus(place, this)"]
)
def test_rows_that_are_read_meet_those_that_are_made(tmp_path: Path, row: str) -> None:
    """Half of the graph is in the file, the other half is found out, and equal numbers are one row."""

    def plus(place: list[float], step: list[float]) -> list[float]:
        return [place[0] + step[0], place[1] + step[1]]

    def free(place: list[float]) -> bool:
        return -2 <= place[0] <= 2 and -2 <= place[1] <= 2

    def run(ss: ss2sql.Session, bound: int) -> ss2sql.Result:
        ss.function("plus", plus)
        ss.function("free", free, volatility="immutable")
        ss.set("around", AROUND)
        return ss.run(
            f"SELECT {row} FROM around WHERE plus(place, this) == [2, 1] START WITH place = [0, 0]"
            f" CONNECT BY MEMORIZE {bound} MAXIMUM 60 place = plus(place, this)"
            " STOP WITH plus(place, this) == [2, 1] OR not free(plus(place, this)) AS rows;"
        )

    with ss2sql.connect() as ss:
        wanted = run(ss, 6)
    file = tmp_path / "graphs.db"
    with ss2sql.connect(file) as ss:
        run(ss, 3)
    with ss2sql.connect(file) as ss:
        found = run(ss, 6)
    assert found.stats.remembered_steps
    assert len(wanted.value) == 60
    assert found.value == wanted.value


SPOILT = [
    *("[" * 100_000, "[" * 100_000 + "1" + "]" * 100_000),
    *(f"[{'[' * 5000}{']' * 5000}]", f"[{10**30}]", f"[{-(10**30)}]"),
    *("[1e999]", "[[-1e999]]", "[NaN]", '[{"a": [Infinity]}]', '{"n": 1}', '"abc"', "7", "null", "[1], [2]", ""),
]


@pytest.mark.parametrize("column", ["row", "elements", "state"])
@pytest.mark.parametrize("text", SPOILT, ids=lambda text: text[:20])
def test_texts_of_others_are_values_or_an_error(tmp_path: Path, text: str, column: str) -> None:
    """What another program has written into the tables never becomes a value that the language does not have."""
    file = tmp_path / "values.db"
    script = "SELECT this FROM value(n) START WITH n = 0 CONNECT BY MEMORIZE n = n + 1 STOP WITH n == 3 AS rows"
    with session(file, value=lambda n: [n, n + 1]) as ss:
        assert len(ss.eval(script)) > 2
    table = "ss2sql_nodes" if column == "state" else "ss2sql_edges"
    where = "id = (SELECT max(id) FROM ss2sql_nodes)" if column == "state" else "1"
    write(file, f"UPDATE {table} SET {column} = '{text}' WHERE {where}")
    with session(file, value=lambda n: [n, n + 1]) as ss:
        assert code_of(ss.run, script) == "X009"
    write(file, f"UPDATE ss2sql_graphs SET functions = '{text}', parameters = '{text}'")


@pytest.mark.parametrize("value", ["9e999", "-1", "2", "'1'", "x'01'"])
def test_a_verdict_of_others(tmp_path: Path, value: str) -> None:
    file = tmp_path / "values.db"
    script = """SELECT this FROM [1, 2] WHERE good(this) START WITH n = 0 CONNECT BY MEMORIZE n = n + this
        STOP WITH n > 3 AS rows"""
    with session(file, value=int, good=lambda n: n > 1) as ss:
        ss.eval(script)
    write(file, f"UPDATE ss2sql_verdicts SET value = {value}")
    with session(file, value=int, good=lambda n: n > 1) as ss:
        assert code_of(ss.run, script) == "X009"

"""Remembered graphs give back exactly the values that were put in, and the answers of fresh ones whatever is asked."""

from __future__ import annotations

import random
from pathlib import Path
from typing import Any

import pytest
from remembering import asked, calls, session

EXACT = [
    *(None, True, False, 0, 1, 1.0, -0.0, 0.1 + 0.2, 5e-324, 1e308, 2**63 - 1, -(2**63), 9007199254740993),
    *("", 'quote " and \\ and \n and \0 and \u2028', "smile 😀 ünï", "{"),
    *([], [[], [1, 1.0, True, None]], {}, {"b": 1, "a": {"z": [1.0], "y": "é"}}, [{"": None}]),
]
INEXACT: list[Any] = [
    *(object(), [b"bytes"], {1: 2}, {(1, 2): 3}, {"a": {None: 1}}, "half \ud83d of a smile", "\ud83d\ude00"),
]


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


@pytest.mark.parametrize("value", INEXACT, ids=lambda value: ascii(value)[:20])
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
    """Whatever was asked before, a remembered graph answers as a fresh one, with the same steps.

    Equal numbers are one place, whether they are read or made.
    """
    dice = random.Random(seed)
    size = dice.randint(3, 7)
    weights = [0, 0.5, 1.0, 1]
    places = [*range(size), True, *map(float, range(size))]
    edges = [[[dice.choice(places), dice.choice(weights)] for _ in range(dice.randint(0, 4))] for _ in range(size)]
    functions = {
        "near": lambda node: edges[int(node)],
        "reached": lambda node, k: edges[int(node)][k][0] if k < len(edges[int(node)]) else node,
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

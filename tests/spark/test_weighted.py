"""COST, PROBABILITY and MEMORIZE in tables of Spark find what the native search finds, in its order."""

from __future__ import annotations

import random
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from level_searches import FORMS, compare_random
from programs.drawn import PROGRAMS
from test_levels_cost import GUARDS, World
from test_levels_cost import variants as by_weight
from test_levels_memorize import variants as by_graph

import ss2sql
from spark.same import agree, ended
from ss2sql.frontend import ast
from ss2sql.runtime.levels import spark_tables

TRIALS = max(4, PROGRAMS // 250)
WAYS = ("MEMORIZE", "MEMORIZE 1", "MEMORIZE 2", "MEMORIZE 4")


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """A table of more than two parts becomes one."""
    monkeypatch.setattr(spark_tables, "PARTS", 2)


def one_of(variants: Callable[[ast.Query], list[ast.Query]]) -> Callable[[ast.Query], list[ast.Query]]:
    """One of the variants, by the length of the search, so that it is the same every time."""

    def chosen(query: ast.Query) -> list[ast.Query]:
        made = variants(query)
        return [made[len(query.span.text) % len(made)]]

    return chosen


@pytest.mark.parametrize(("variants", "number"), [(by_weight, 9), (by_graph, 10)], ids=["by weight", "by graph"])
def test_random_searches(spark: Any, variants: Any, number: int) -> None:
    assert compare_random(one_of(variants), "spark", spark, number, 30 * TRIALS, most=TRIALS) == TRIALS


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("number", range(2 * TRIALS))
def test_ties_totals_and_failing_steps(ss: ss2sql.Session, number: int) -> None:
    world = World(number)
    for name, function in world.functions().items():
        ss.function(name, function, volatility="immutable")
    if number % 2:
        guard = GUARDS[number % 3]
        script = world.script(guard, "MAXIMUM 2" if guard == "UNIQUE" else "MAXIMUM 3")
    else:
        weighs = f"{world.word} weigh(n, x.this)" if number % 4 else ""
        script = world.script(f"{world.some.choice(WAYS)} {weighs}", world.some.choice(["", "MAXIMUM 2"]))
    assert ended(ss, script, "spark") == ended(ss, script, "native")


@pytest.mark.parametrize("options", ["UNIQUE COST abs(n - x.this)", "MEMORIZE 3", "MEMORIZE 3 PROBABILITY 1 / (1 + n)"])
def test_forms(ss: ss2sql.Session, options: str) -> None:
    agree(ss, FORMS[1].format(options))


def test_a_graph_asks_for_each_edge_once(ss: ss2sql.Session, tmp_path: Path) -> None:
    """The function has a file with a line for each call, in whichever process."""
    calls = tmp_path / "calls"

    def noted(n: int, more: int) -> int:
        with calls.open("a") as file:
            file.write(f"{n} {more}\n")
        return min(n + more, 5)

    ss.function("noted", noted, volatility="immutable")
    script = (
        "SELECT noted(n, this) FROM [1, 2] WHERE noted(n, this) == 5 START WITH n = 0"
        " CONNECT BY MEMORIZE n = noted(n, this) AS list;"
    )
    result = ss.run(script)
    assert Counter(calls.read_text().splitlines()) == Counter(f"{n} {more}" for n in range(6) for more in (1, 2))
    assert result.stats.calls["noted"] == 12
    assert result.value == ss.run(script, engine="native").value


def test_steps_that_are_chosen_too_early_are_tried_once(ss: ss2sql.Session) -> None:
    """In this graph two are: DuckDB, where calls are remembered, tries them twice."""
    some = random.Random(14)
    roads = [[some.randrange(8) for _ in range(2)] for _ in range(8)]
    weights = {(a, b): some.choice([0.1, 0.2, 1, 1.5, 2, 3]) for a in range(8) for b in range(8)}
    ss.function("roads", lambda n: roads[n], volatility="immutable")
    ss.function("weigh", lambda n, to: weights[n, to], volatility="immutable")
    script = (
        "SELECT x.this FROM x = roads(n) START WITH n = 0 CONNECT BY UNIQUE COST weigh(n, x.this) n = x.this AS list;"
    )
    result = ss.run(script)
    assert result.value == ss.run(script, engine="native").value
    assert result.stats.generated == 2 * (1 + len(result.value))  # two roads from the start, and from each row


def test_the_most_rows_of_a_graph(ss: ss2sql.Session) -> None:
    script = "SELECT x.this FROM x = near(n) WHERE x.this == 5 START WITH n = 1 CONNECT BY MEMORIZE n = x.this AS list;"
    assert ss.run(script, max_rows=8).value == ss.run(script, engine="native").value
    with pytest.raises(ss2sql.ExecutionError) as caught:
        ss.run(script, max_rows=3)
    assert caught.value.code == "X010"


def test_their_paths_are_no_frame(ss: ss2sql.Session) -> None:
    query = ss.compile("SELECT x.this FROM x = near(n) START WITH n = 1 CONNECT BY UNIQUE COST 1 n = x.this;")
    with pytest.raises(ss2sql.UnsupportedError, match="put together by this process"):
        query.spark()

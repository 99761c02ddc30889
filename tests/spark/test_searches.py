"""Searches by levels in tables of Spark find what the native search finds, in its order."""

from __future__ import annotations

import os
import random
from collections import Counter
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import golden
import pytest
from hypothesis import given, seed
from level_searches import BY_LENGTH, FORMS, SHORT, World, agree, both_end_alike, by_sheet, compare, may_fail, one_of
from programs.drawn import PROGRAMS, drawn
from test_levels_typed import MOVES, expressions, script_of

import ss2sql
from ss2sql.runtime.levels import beginning, spark_search, spark_tables
from ss2sql.runtime.levels.spark_steps import Steps
from ss2sql.runtime.levels.spark_store import Store

pytestmark = pytest.mark.slow

CASES = golden.level_searches()[:: 1 if os.environ.get("SS2SQL_SPARK") == "all" else 3]
TRIALS = max(4, PROGRAMS // 250)
STRATEGIES = ("BREADTH FIRST MAXIMUM 7", "UNIQUE", "BREADTH FIRST NO CYCLE MAXIMUM 9")


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("strategy", STRATEGIES)
def test_forms(ss: ss2sql.Session, form: str, strategy: str) -> None:
    agree(ss, form.format(strategy))


@pytest.mark.parametrize("name", ["search/by-levels", "search/steps-in-sql"])
def test_what_the_sheets_say(ss: ss2sql.Session, name: str) -> None:
    assert list(by_sheet(ss, name))


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_golden_cases(spark: Any, case: golden.Case) -> None:
    found = golden.run(case, "spark")  # in the session that is active
    if not isinstance(found.error, ss2sql.UnsupportedError):
        assert found.verdict == golden.run(case, "native").verdict


@pytest.mark.parametrize("strategy", BY_LENGTH)
@pytest.mark.parametrize("bad", [0, 3, 5])
def test_a_step_that_fails_counts_where_it_would_have_been_taken(ss: ss2sql.Session, strategy: str, bad: int) -> None:
    both_end_alike(ss, f"{may_fail(ss, f'{strategy} MAXIMUM 3', bad)} AS list")


@pytest.mark.parametrize(
    ("variants", "number", "share"), [("by length", 8, 2), ("by weight", 9, 1), ("by graph", 10, 1)]
)
def test_random_searches(spark: Any, variants: str, number: int, share: int) -> None:
    most = TRIALS * share
    assert compare(one_of(variants), "spark", spark, number, 30 * most, most=most) == most


@pytest.mark.parametrize("number", range(2 * TRIALS))
def test_ties_totals_and_failing_steps(ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch, number: int) -> None:
    monkeypatch.setattr(spark_tables, "PARTS", 2)  # a table of more than two parts becomes one
    world = World(number)
    world.furnish(ss)
    by_weight = world.by_weight(["MAXIMUM 2"], ["MAXIMUM 3"])
    both_end_alike(ss, by_weight if number % 2 else world.by_graph(number % 4 > 0))


@pytest.mark.parametrize("script", [FORMS[1].format("UNIQUE"), SHORT], ids=["python", "sql"])
def test_large_levels_are_numbered_in_parts(ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    """And ways to many goals are looked up by joins, some goals at a time, and tables of rows become one."""
    for name, number in {"FEW": 0, "GOALS": 2, "AT_ONCE": 0, "TABLES": 2}.items():
        monkeypatch.setattr(spark_search, name, number)
    plans: list[str] = []
    persisted = Store.persisted

    def look(self: Store, frame: Any) -> Any:
        plans.append(frame._jdf.queryExecution().executedPlan().toString())
        return persisted(self, frame)

    monkeypatch.setattr(Store, "persisted", look)
    agree(ss, script)
    large = [text for text in plans if "rangepartitioning(place" in text]
    assert large
    assert not any("SinglePartition" in text for text in large)  # no exchange brings all rows into one partition


@pytest.mark.parametrize("most", [1, 3, 2000])
@pytest.mark.parametrize("strategy", ["UNIQUE", "BREADTH FIRST NO CYCLE"])
def test_the_first_levels_are_done_here(
    ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch, strategy: str, most: int
) -> None:
    monkeypatch.setattr(beginning, "STATES", most)
    agree(ss, FORMS[1].format(strategy))
    search = f"START WITH n = 0 CONNECT BY {strategy} n = (n + this) % 9 STOP WITH n > 6 ORDER BY n"
    agree(ss, f"SELECT (n + this) % 9, n % 2 FROM [1, 2] {search} AS list;")


def test_other_settings_of_spark(spark: Any, ss: ss2sql.Session) -> None:
    """Stages that are planned while they run, three partitions, small batches."""
    own = {"spark.sql.adaptive.enabled": "true", "spark.sql.shuffle.partitions": "3"}
    own["spark.sql.execution.arrow.maxRecordsPerBatch"] = "1"
    before = {name: spark.conf.get(name) for name in own}
    for name, value in own.items():
        spark.conf.set(name, value)
    agree(ss, FORMS[1].format("BREADTH FIRST NO CYCLE"))
    for name, value in before.items():
        spark.conf.set(name, value)


# --- steps in SQL: without a Python process ----------------------------------------------------------------


@pytest.fixture
def no_python(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: Steps) -> None:
        raise AssertionError("sent to Python")

    monkeypatch.setattr(Steps, "load", refuse)


@pytest.mark.usefixtures("no_python")
def test_random_steps(ss: ss2sql.Session) -> None:
    ss.set("moves", MOVES)

    @seed(89)
    @drawn(max(6, PROGRAMS // 160), shrunk=False)
    @given(expressions())
    def run(parts: dict[str, str]) -> None:
        number = len(str(parts))
        agree(ss, script_of(parts, BY_LENGTH[number % 3], set("ntbl"[number % 4 :]), grouped=False, ends=1))

    run()


@pytest.mark.usefixtures("no_python")
@pytest.mark.parametrize(
    "script",
    [
        # Variables are bound, lists too; ORDER BY asks for the elements and the state of the last step.
        'SELECT n + m.by, t FROM m = moves WHERE n + m.by IN goals AND wanted == t START WITH n = 0, t = "it\'s"'
        " CONNECT BY UNIQUE MAXIMUM 9 n = n + m.by STOP WITH abs(n) > 4 ORDER BY m.by, n DESC;",
        # Places are steps times 2^24, so the 200th step has one that a small integer of Spark cannot hold.
        "SELECT n + this FROM range(300) START WITH n = 0 CONNECT BY UNIQUE n = n + this STOP WITH n > 0 AS list;",
    ],
    ids=["variables", "32 bits"],
)
def test_values_in_sql(ss: ss2sql.Session, script: str) -> None:
    for name, value in {"goals": [3, 5], "wanted": "it's", "moves": MOVES}.items():
        ss.set(name, value)
    agree(ss, script)


# --- what it takes -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("strategy", "at_first"), [("UNIQUE", False), ("UNIQUE", True), ("MEMORIZE", False)])
def test_each_step_is_tried_once(
    ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, strategy: str, at_first: bool
) -> None:
    """By a clock on which each look takes an hour the level of the start is done here, and no other."""
    calls = tmp_path / "calls"

    def noted(n: int, more: int) -> int:
        with calls.open("a") as file:
            file.write(f"{os.getpid()} {n} {more}\n")
        return min(n + more, 5)

    if at_first:
        monkeypatch.setattr(beginning, "STATES", 2000)
        ticks = count(0, 3600)
        monkeypatch.setattr(beginning, "time", SimpleNamespace(monotonic=lambda: next(ticks)))
    ss.function("noted", noted, volatility="immutable")
    script = f"SELECT noted(n, this) FROM [1, 2] START WITH n = 0 CONNECT BY {strategy} n = noted(n, this) AS list;"
    result = ss.run(script)
    made = [tuple(map(int, line.split())) for line in calls.read_text().splitlines()]
    assert Counter(call[1:] for call in made) == Counter((n, more) for n in range(6) for more in (1, 2))
    assert {n for process, n, _ in made if process == os.getpid()} == ({0} if at_first else set())
    assert result.stats.calls["noted"] == 12
    assert result.value == ss.run(script, engine="native").value


def test_steps_that_are_chosen_too_early_are_tried_once(ss: ss2sql.Session) -> None:
    """In this graph two are: DuckDB, where calls are remembered, tries them twice."""
    some = random.Random(14)
    roads = [[some.randrange(8) for _ in range(2)] for _ in range(8)]
    weights = {(a, b): some.choice([0.1, 0.2, 1, 1.5, 2, 3]) for a in range(8) for b in range(8)}
    ss.function("roads", lambda n: roads[n], volatility="immutable")
    ss.function("weigh", lambda n, to: weights[n, to], volatility="immutable")
    search = "START WITH n = 0 CONNECT BY UNIQUE COST weigh(n, x.this) n = x.this"
    result = agree(ss, f"SELECT x.this FROM x = roads(n) {search} AS list;")
    assert result.stats.generated == 2 * (1 + len(result.value))  # two roads from the start, and from each row

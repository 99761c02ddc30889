"""Searches by levels in tables of Spark find what the native search finds."""

from __future__ import annotations

import os
from dataclasses import replace
from itertools import count
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import golden
import pytest
from level_searches import FORMS, by_length, compare_random, kept, options
from programs.drawn import PROGRAMS

import ss2sql
from spark.same import SHORT, agree, ended
from ss2sql.frontend import ast
from ss2sql.runtime.levels import beginning, spark_search
from ss2sql.runtime.levels.spark_store import Store

CASES = golden.level_searches()[:: 1 if os.environ.get("SS2SQL_SPARK") == "all" else 3]
COUNT = max(10, PROGRAMS // 100)


@pytest.mark.parametrize("form", FORMS)
@pytest.mark.parametrize("strategy", ["BREADTH FIRST MAXIMUM 7", "UNIQUE", "BREADTH FIRST NO CYCLE MAXIMUM 9"])
def test_forms(ss: ss2sql.Session, form: str, strategy: str) -> None:
    agree(ss, form.format(strategy))


@pytest.mark.parametrize("strategy", ["UNIQUE", "BREADTH FIRST NO CYCLE", "BREADTH FIRST"])
@pytest.mark.parametrize("bad", [0, 3, 5])
def test_a_step_that_fails_counts_where_it_would_have_been_taken(ss: ss2sql.Session, strategy: str, bad: int) -> None:
    def fail(n: int, level: int) -> bool:
        if (n * 3 + level) % 7 == bad:
            raise ValueError(n)
        return n > 3

    ss.function("fail", fail, volatility="immutable")
    ss.set("roads", [[0], [2, 3], [1, 3, 4], [2, 4], [1, 2]])
    script = (
        "SELECT x.this FROM x = roads[n] WHERE fail(x.this, level) START WITH n = 1, level = 0"
        f" CONNECT BY {strategy} MAXIMUM 3 n = x.this, level = level + 1 AS list;"
    )
    assert ended(ss, script, "spark") == ended(ss, script, "native")


@pytest.mark.parametrize("most", [1, 4, 9])
def test_rows_and_sources_that_fail(ss: ss2sql.Session, most: int) -> None:
    ss.set("roads", [[0], [2, 3], [3, 1, 5], [2, 7], []])  # there are no roads from 5 and 7
    ss.set("most", most)
    script = "SELECT 10 / (4 - x.this) FROM x = roads[n] START WITH n = 1 CONNECT BY UNIQUE MAXIMUM (most) n = x.this;"
    assert ended(ss, script, "spark") == ended(ss, script, "native")


def test_random_searches(spark: Any) -> None:
    """Those that end soon: a level takes long."""
    assert compare_random(one_of_three, "spark", spark, 8, 30 * COUNT, most=COUNT) == COUNT


def one_of_three(query: ast.Query) -> list[ast.Query]:
    """A search by one of the strategies, by its length so that it is the same every time, and with an end."""
    chosen = by_length(query)[len(query.span.text) % 3]
    end = () if kept(query, "MAXIMUM") else options("MAXIMUM 9")
    return [replace(chosen, options=(*chosen.options, *end))]


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_golden_cases(spark: Any, case: golden.Case) -> None:
    found = golden.run(case, "spark")  # in the session that is active
    if not isinstance(found.error, ss2sql.UnsupportedError):
        assert found.verdict == golden.run(case, "native").verdict


@pytest.mark.parametrize("script", [FORMS[1].format("UNIQUE"), SHORT], ids=["python", "sql"])
def test_large_levels_are_numbered_in_parts(ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch, script: str) -> None:
    """And ways to many goals are looked up by joins, some goals at a time, and tables of rows become one."""
    for name, number in {"FEW": 0, "GOALS": 2, "AT_ONCE": 0, "TABLES": 2}.items():
        monkeypatch.setattr(spark_search, name, number)
    agree(ss, script)


def test_numbering_leaves_rows_where_they_are(ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps are numbered without an exchange that brings all rows into one partition."""
    monkeypatch.setattr(spark_search, "FEW", 0)
    plans: list[str] = []
    persisted = Store.persisted

    def look(self: Store, frame: Any) -> Any:
        plans.append(frame._jdf.queryExecution().executedPlan().toString())
        return persisted(self, frame)

    monkeypatch.setattr(Store, "persisted", look)
    assert ss.run(SHORT).value == [[1], [2], [1, 3], [2, 4]]
    large = [text for text in plans if "rangepartitioning(place" in text]
    assert large
    for text in large:
        assert "SinglePartition" not in text


@pytest.mark.parametrize("most", [1, 3, 2000])
@pytest.mark.parametrize("strategy", ["BREADTH FIRST MAXIMUM 30", "UNIQUE", "BREADTH FIRST NO CYCLE"])
def test_the_first_levels_are_done_here(
    ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch, strategy: str, most: int
) -> None:
    monkeypatch.setattr(beginning, "STATES", most)
    agree(ss, FORMS[1].format(strategy))
    agree(
        ss,
        f"SELECT (n + this) % 9, n % 2 FROM [1, 2] START WITH n = 0 CONNECT BY {strategy} n = (n + this) % 9"
        " STOP WITH n > 6 ORDER BY n AS list;",
    )


def test_a_level_that_takes_long_is_left_to_spark(
    ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """By a clock on which each look takes an hour the level of the start is done here, and no other."""
    monkeypatch.setattr(beginning, "STATES", 2000)
    ticks = count(0, 3600)
    monkeypatch.setattr(beginning, "time", SimpleNamespace(monotonic=lambda: next(ticks)))
    calls = tmp_path / "calls"

    def noted(n: int, more: int) -> int:
        with calls.open("a") as file:
            file.write(f"{os.getpid()} {n}\n")
        return min(n + more, 5)

    ss.function("noted", noted, volatility="immutable")
    result = ss.run("SELECT noted(n, this) FROM [1, 2] START WITH n = 0 CONNECT BY UNIQUE n = noted(n, this) AS list;")
    assert sorted(path[-1] for path in result.value) == [1, 2, 3, 4, 5]
    made = [tuple(map(int, line.split())) for line in calls.read_text().splitlines()]
    assert {n for process, n in made if process == os.getpid()} == {0}
    assert sorted(n for _, n in made) == sorted([*range(6), *range(6)])


def test_other_settings_of_spark(spark: Any, ss: ss2sql.Session) -> None:
    """Stages that are planned while they run, three partitions, a folder of one's own, small batches."""
    own = {"spark.sql.adaptive.enabled": "true", "spark.sql.shuffle.partitions": "3"}
    own["spark.sql.execution.arrow.maxRecordsPerBatch"] = "1"
    before = {name: spark.conf.get(name) for name in own}
    for name, value in own.items():
        spark.conf.set(name, value)
    agree(ss, FORMS[1].format("BREADTH FIRST NO CYCLE"))
    for name, value in before.items():
        spark.conf.set(name, value)

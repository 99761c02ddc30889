"""Searches by levels in tables of Spark find what the native search finds."""

from __future__ import annotations

import os
from dataclasses import replace
from typing import Any

import golden
import pytest
from level_searches import FORMS, by_length, compare_random, kept, options

import ss2sql
from spark.same import SHORT, agree, ended
from ss2sql.frontend import ast
from ss2sql.runtime.levels import spark as engine
from ss2sql.runtime.levels import spark_store

COUNT = max(10, int(os.environ.get("SS2SQL_PROGRAMS", "1000")) // 100)


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


@pytest.mark.parametrize("case", golden.level_searches(), ids=lambda case: case.name)
def test_golden_cases(spark: Any, case: golden.Case) -> None:
    found = golden.run(case, "spark")  # in the session that is active
    if not isinstance(found.error, ss2sql.UnsupportedError):
        assert found.verdict == golden.run(case, "native").verdict


@pytest.mark.parametrize("few", [0, 1])
def test_large_levels_are_numbered_in_parts(ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch, few: int) -> None:
    """And ways to many goals are walked by joins, and file sets become one."""
    monkeypatch.setattr(engine, "FEW", few)
    monkeypatch.setattr(engine, "GOALS", few)
    monkeypatch.setattr(spark_store, "PARTS", 2)
    agree(ss, "SELECT x.this FROM x = near(n) START WITH n = 1 CONNECT BY UNIQUE n = x.this STOP WITH n == 4 AS list;")


def test_numbering_leaves_rows_where_they_are(spark: Any, ss: ss2sql.Session, monkeypatch: pytest.MonkeyPatch) -> None:
    """Steps are numbered without an exchange that brings all rows into one partition."""
    monkeypatch.setattr(engine, "FEW", 0)
    plans: list[str] = []
    number = engine.SparkTables._numbered

    def look(self: engine.SparkTables, unnumbered: engine.Part) -> engine.Part:
        part = number(self, unnumbered)
        plans.append(part.frame._jdf.queryExecution().executedPlan().toString())  # type: ignore[operator]
        return part

    monkeypatch.setattr(engine.SparkTables, "_numbered", look)
    assert ss.run(SHORT).value == [[1], [2], [1, 3], [2, 4]]
    assert plans
    for text in plans:
        assert "rangepartitioning(place" in text
        assert "SinglePartition" not in text


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

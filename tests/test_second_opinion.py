"""DuckDB gives the same rows for flat queries without Python functions, where both languages mean the same.

`SS2SQL_PROGRAMS` sets the number of queries, three tenths of it. What differs is told in `second_opinion`.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from typing import Any

import pytest
from agreement import exact, executor_outcome, reference_outcome
from hypothesis import given, seed
from hypothesis import strategies as st
from programs.drawn import amount, drawn
from second_opinion import DECISIONS, TYPES, Twin, twin
from sessions import ENGINES

COUNT = amount(3 / 10)
duckdb = pytest.importorskip("duckdb")


def opinion(connection: Any, made: Twin) -> list[tuple[Any, ...]]:
    """The rows that DuckDB finds."""
    for name, rows in made.case.tables.items():
        columns = ", ".join(f"{column} {kind}" for column, kind in TYPES.items())
        values = ", ".join(f"({', '.join('?' * len(TYPES))})" for _ in rows)
        connection.execute(f"CREATE OR REPLACE TABLE {name}({columns})")
        connection.execute(f"INSERT INTO {name} VALUES {values}", [value for row in rows for value in row.values()])
    found: list[tuple[Any, ...]] = connection.execute(made.sql).fetchall()
    return found


def compared(rows: Iterable[Iterable[Any]]) -> list[Any]:
    """Rows of exact values; the zero below zero is zero, which DuckDB multiplies differently."""
    return [tuple(("float", "0.0") if value == ("float", "-0.0") else value for value in row) for row in rows]


def test_duckdb_agrees() -> None:
    tried: Counter[str] = Counter()

    @seed(2015)
    @drawn(COUNT)
    @given(st.binary(min_size=DECISIONS, max_size=DECISIONS).map(twin))
    def run(made: Twin) -> None:
        second = compared(map(exact, opinion(connection, made)))
        outcomes = [reference_outcome(made.case), *(executor_outcome(made.case, engine) for engine in ENGINES)]
        for outcome in outcomes:
            if outcome is None:
                continue  # the database refuses a few
            tried["answers"] += 1
            assert outcome.error is None
            rows = compared(outcome.value[1:])
            assert rows == second if made.ordered else Counter(rows) == Counter(second)
        tried["rows"] += len(second)
        tried["several rows"] += len(second) > 1
        tried["nested"] += "FROM z" in made.case.script
        tried["groups"] += "GROUP BY" in made.case.script

    with duckdb.connect() as connection:
        connection.execute("SET threads = 1; SET order_by_non_integer_literal = true")
        run()
    assert tried["answers"] > 2.5 * COUNT
    assert tried["several rows"] > COUNT / 3
    assert min(tried["nested"], tried["groups"]) > COUNT / 20

"""DuckDB gives the same rows for flat queries without Python functions, where both languages mean the same.

They are asked of it in two ways: in SQL that was written beside the script, and in what the script becomes for DuckDB.

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
from programs import ProgramCase
from programs.drawn import amount, drawn
from second_opinion import DECISIONS, TYPES, Twin, twin
from sessions import ENGINES

import ss2sql
from ss2sql.lowering.sql_builder import DUCKDB
from ss2sql.session.compiled_script import translate_script

QUERIES = amount(3 / 10)
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


def becomes(case: ProgramCase) -> str | None:
    """The SQL of DuckDB that a program becomes; None where it is refused."""
    with ss2sql.connect() as ss:
        for name, rows in case.tables.items():
            ss.set(name, rows)
        try:
            return str(translate_script(ss.compile(case.script).statements(), DUCKDB))
        except ss2sql.UnsupportedError:
            return None


@pytest.mark.drawn
def test_duckdb_agrees() -> None:
    tried: Counter[str] = Counter()

    @seed(2015)
    @drawn(QUERIES)
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
        if text := becomes(made.case):
            assert compared(map(exact, connection.execute(text).fetchall())) == compared(outcomes[0].value[1:])
            tried["translated"] += 1

    with duckdb.connect() as connection:
        connection.execute("SET threads = 1; SET order_by_non_integer_literal = true")
        run()
    assert tried["answers"] > 2.5 * QUERIES
    assert tried["translated"] > QUERIES // 4

"""`split`: conditions as flat conjunctions and disjunctions of simple parts."""

from __future__ import annotations

from typing import Any

import pytest

import ss2sql
from ss2sql import plan
from ss2sql.lowering.rewrites import optimise

SOURCES = "FROM x = [1, 2, 3], y = [1, 2, 3], t = ['a']"
OTHERS = ["inline", "fold", "unnest"]


def condition(text: str, disabled: list[str] = OTHERS, **functions: Any) -> plan.Expr | None:
    ss = ss2sql.connect()
    for name, function in functions.items():
        ss.function(name, function)
    statement = ss.compile(f"SELECT 1 {SOURCES} WHERE {text}").plan.statements[0]
    assert isinstance(statement.expr, plan.Subquery)
    query, _ = optimise(statement.expr.query, disabled)
    return query.where


@pytest.mark.parametrize(
    ("written", "split"),
    [
        ("x.this == 1 AND (y.this == 2 AND x.this < y.this)", "x.this == 1 AND y.this == 2 AND x.this < y.this"),
        ("(x.this == 1 OR y.this == 2) OR x.this < y.this", "x.this == 1 OR y.this == 2 OR x.this < y.this"),
        ("NOT (x.this == 1 OR y.this != 2)", "x.this != 1 AND y.this == 2"),
        ("NOT (x.this < 1 AND y.this >= 2)", "x.this >= 1 OR y.this < 2"),
        ("NOT NOT x.this", "x.this"),
        ("NOT (NOT x.this OR y.this == 2)", "x.this AND y.this != 2"),
        ("NOT x.this IN [1, 'a']", "x.this NOT IN [1, 'a']"),
        ("x.this == 1 AND y.this == 2 AND x.this == 1", "x.this == 1 AND y.this == 2"),
        (
            "(x.this == 1 AND y.this == 1) OR (x.this == 1 AND y.this == 3)",
            "x.this == 1 AND (y.this == 1 OR y.this == 3)",
        ),
        ("x.this == 1 AND y.this OR x.this == 1 AND t.this", "x.this == 1 AND (y.this OR t.this)"),
        ("x.this == 1 AND y.this == 1 OR x.this == 1", "x.this == 1"),
        ("x.this == 1 OR x.this == 2 OR 3 == x.this OR y.this == 1", "x.this IN [1, 2, 3] OR y.this == 1"),
        ("x.this != 1 AND x.this != 2 AND x.this != 3", "x.this NOT IN [1, 2, 3]"),
        ("IF(NOT NOT x.this; y.this; 0)", "IF(x.this; y.this; 0)"),
    ],
)
def test_conditions_are_split(written: str, split: str) -> None:
    assert condition(written) == condition(split, [*OTHERS, "split"])
    everything = ss2sql.connect(disable=["split"])
    for engine in ("database", "native"):
        expected = everything.run(f"SELECT x.this, y.this {SOURCES} WHERE {written} AS rows", engine=engine).value  # type: ignore[arg-type]
        given = ss2sql.connect().run(f"SELECT x.this, y.this {SOURCES} WHERE {written} AS rows", engine=engine)  # type: ignore[arg-type]
        assert given.value == expected


@pytest.mark.parametrize(
    "text",
    [
        "NOT (x.this < t.this)",  # the error says `<`
        "tick() == 1 AND tick() == 1",
        "(x.this == 1 AND tick() == 1) OR (x.this == 1 AND y.this == 1)",
        "x.this == 1 OR x.this == 2",  # no better as IN
        "x.this == 1 OR x.this == None OR x.this == 'a'",
    ],
)
def test_what_stays_as_it_is(text: str) -> None:
    def tick() -> int:
        return next(numbers)

    numbers = iter(range(100))
    assert condition(text, tick=tick) == condition(text, [*OTHERS, "split"], tick=tick)


def test_a_part_is_not_dropped_when_a_variable_may_have_changed() -> None:
    script = "n = 0; SELECT this FROM [1, 2, 3] WHERE n == 0 AND (n = n + 1) AND n == 0 AS list"
    assert ss2sql.connect().eval(script) == []


def test_every_part_becomes_a_term_of_the_sql() -> None:
    script = f"SELECT 1 {SOURCES} WHERE NOT (x.this == 1 OR y.this == 1) AND NOT NOT (x.this < y.this)"
    where = "WHERE\n  x.this <> 1 AND y.this <> 1 AND x.this < y.this"
    assert str(ss2sql.connect().compile(script).sql).endswith(where)
    assert where not in str(ss2sql.connect(disable=["split"]).compile(script).sql)


def test_stop_and_having_are_split_too() -> None:
    ss = ss2sql.connect()
    script = "SELECT this FROM [1, 2] START WITH s = 1 CONNECT BY s = this STOP WITH NOT (this == 2 AND s != 2)"
    statement = ss.compile(script).plan.statements[0]
    assert isinstance(statement.expr, plan.Subquery)
    query, _ = optimise(statement.expr.query)
    assert query.search is not None
    assert isinstance(query.search.stop, plan.Or)
    assert ss.eval("SELECT this, count(*) FROM [1, 2, 2] GROUP BY this HAVING NOT NOT (count(*) > 1) AS rows") == [
        (2, 2)
    ]


def test_a_replaced_operator_is_left_alone() -> None:
    for disable in ([], ["split"]):
        ss = ss2sql.connect(disable=disable)
        ss.function("ne", lambda a, b: True, volatility="immutable")
        assert ss.eval("SELECT this FROM [1, 2] WHERE NOT (this == 1) AS list") == [2]


def test_many_parts_are_not_too_deep_for_sqlite() -> None:
    parts = [f"x.this != {number} + y.this" for number in range(5, 1600)]
    for joined, expected in ((" AND ".join(parts), 9), (" OR ".join(f"NOT ({part})" for part in parts), 0)):
        result = ss2sql.connect().run(f"SELECT x.this {SOURCES} WHERE {joined} AS list", engine="database")
        assert len(result.value) == expected

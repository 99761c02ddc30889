"""`fold`: what is made of constants alone is computed when the query is compiled."""

from __future__ import annotations

from typing import Any

import pytest

import ss2sql
from ss2sql import plan
from ss2sql.lowering.rewrites import optimise

BOTH: tuple[list[str], ...] = ([], ["fold"])


def folded(expression: str, **functions: Any) -> plan.Expr:
    """The column of SELECT after folding alone; `x` is an element of which nothing is known."""
    ss = ss2sql.connect()
    for name, function in functions.items():
        ss.function(name, function)
    statement = ss.compile(f"SELECT {expression} FROM x = given").plan.statements[0]
    assert isinstance(statement.expr, plan.Subquery)
    query, _ = optimise(statement.expr.query, ["inline", "unnest", "split"])
    return query.columns[0].expr


@pytest.mark.parametrize(
    ("expression", "value"),
    [
        ("60 * 60", 3600),
        ("10.0 + 0", 10.0),
        ("2 ^ 10", 1024),
        ("7 / 2", 3.5),
        ("-(-3)", 3),
        ("'a' + 'b'", "ab"),
        ("[1] + [2.0]", [1, 2.0]),
        ("[1 + 1, [True]]", [2, [True]]),
        ("[[1, 2], [3]][0][1]", 2),
        ("'abc'[1:]", "bc"),
        ("len('abc')", 3),
        ("len([x.this, 2])", 2),
        ("[x.this, 2][1]", 2),
        ("range(3)", [0, 1, 2]),
        ("2 IN [1, 2]", True),
        ("'a' < 'b'", True),
        ("1 == 1.0", True),
        ("None == 0", False),
        ("NOT []", True),
        ("1 XOR ''", True),
        ("True AND 1", True),
        ("False AND x.this / 0", False),
        ("1 OR x.this / 0", True),
        ("x.this == 1 AND False", False),
        ("IF(1 > 2; x.this / 0; 'else')", "else"),
        ("IF([]; 1)", False),
        ("max(1, 2) + min([3, 4])", 5),
        ("float(1)", 1.0),
        ("-0.0 * 1", -0.0),
    ],
)
def test_constants_are_computed_exactly(expression: str, value: Any) -> None:
    node = folded(expression)
    assert isinstance(node, plan.Constant)
    assert repr(node.value) == repr(value)
    for engine in ("database", "native"):
        result = ss2sql.connect().run(f"SELECT {expression} FROM x = [1] AS rows", engine=engine)  # type: ignore[arg-type]
        assert repr(result.value) == repr([(value,)])


@pytest.mark.parametrize(
    ("expression", "same_as"),
    [
        ("x.this == 1 AND True", "x.this == 1"),
        ("False OR x.this == 1 OR ''", "x.this == 1"),
        ("True XOR x.this", "NOT x.this"),
        ("IF(True; x.this; 1)", "x.this"),
        ("[x.this + 1, 2][0]", "x.this + 1"),
        ("x.this + 2 * 3", "x.this + 6"),
        ("True AND x.this", "NOT NOT x.this"),  # AND gives a bool
    ],
)
def test_what_is_left_of_an_expression(expression: str, same_as: str) -> None:
    assert folded(expression) == folded(same_as)


@pytest.mark.parametrize(
    "expression",
    [
        "1 / 0",
        "'a' + 1",
        "9223372036854775807 + 1",
        "[1][5]",
        "x.this / 0 AND False",
        "[1 / 0, 2][1]",
        "len([1 / 0])",
        "IF(True; 1 / 0, 2; 3)",
    ],
)
def test_what_fails_fails_when_it_runs(expression: str) -> None:
    script = f"SELECT {expression} FROM x = given AS list"
    assert ss2sql.connect().eval(script, given=[]) == []
    errors = set()
    for disable in BOTH:
        for engine in ("database", "native"):
            with pytest.raises(ss2sql.ExecutionError) as caught:
                ss2sql.connect(disable=disable).run(script, engine=engine, given=[1])  # type: ignore[arg-type]
            errors.add((caught.value.code, caught.value.span and caught.value.span.column))
    assert len(errors) == 1


def test_functions_of_the_user_are_not_run() -> None:
    def double(x: int) -> int:
        return 2 * x

    assert isinstance(folded("double(2)", double=double), plan.Call)
    assert isinstance(folded("1 + 2", add=lambda a, b: [a, b]), plan.Call)
    assert isinstance(folded("print(1)"), plan.Call)
    assert isinstance(folded("range(2000)"), plan.Call)  # a long list is better made when it is needed
    assert isinstance(folded("range(1, 1000)"), plan.Constant)
    assert isinstance(folded("range(1, 1001)"), plan.Call)


def test_the_sql_has_the_value() -> None:
    script = "SELECT this FROM [1, 4000] WHERE this > 60 * 60 AND True AND len('ab') == 2 AS list"
    assert str(ss2sql.connect().compile(script).sql).endswith("WHERE\n  this.this > 3600")
    assert "60 * 60" in str(ss2sql.connect(disable=["fold"]).compile(script).sql)
    assert ss2sql.connect().eval(script) == [4000]


@pytest.mark.parametrize("engine", ["database", "native"])
def test_conditions_that_always_hold_go(engine: Any) -> None:
    for disable in BOTH:
        ss = ss2sql.connect(disable=disable)
        assert ss.run("SELECT this FROM [1, 2] WHERE True AS list", engine=engine).value == [1, 2]
        # Without WHERE a step that stops would be no goal.
        script = "SELECT this FROM [1, 2] WHERE 1 == 1 START WITH x = 1 CONNECT BY x = 2 STOP WITH x == 1 AS list"
        assert ss.run(script, engine=engine).value == [[1], [2]]
        groups = "SELECT this, count(*) FROM [1, 2, 1] GROUP BY this HAVING 1 < 2 AS rows"
        assert ss.run(groups, engine=engine).value == [(1, 2), (2, 1)]


@pytest.mark.parametrize("engine", ["database", "native"])
def test_columns_that_are_bool_or_not_keep_their_form(engine: Any) -> None:
    for disable in BOTH:
        ss = ss2sql.connect(disable=disable)
        inner = "(SELECT to(IF(True; this == 1; 0), k) FROM [1, 2])"
        assert ss.run(f"SELECT k FROM q = {inner} AS list", engine=engine).value == [True, False]


@pytest.mark.parametrize("engine", ["auto", "native"])
def test_groups_that_are_bool_or_not_keep_their_form(engine: Any) -> None:
    for disable in BOTH:
        ss = ss2sql.connect(disable=disable)
        grouped = "SELECT IF(True; this == 1; 0), count(*) FROM [1, 2, 2] GROUP BY IF(True; this == 1; 0) AS rows"
        assert repr(ss.run(grouped, engine=engine).value) == "[(True, 1), (False, 2)]"


def test_constants_that_are_equal_but_not_the_same_stay_apart() -> None:
    for engine in ("database", "native"):
        result = ss2sql.connect().run("SELECT [1, 2.0], [1.0, 2], [1] + [2.0] FROM [0] AS rows", engine=engine)  # type: ignore[arg-type]
        assert repr(result.value) == "[([1, 2.0], [1.0, 2], [1, 2.0])]"

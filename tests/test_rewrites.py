"""Rewrites change how a query is evaluated, never what it gives; each has an off switch."""

from __future__ import annotations

import pytest
from agreement import executor_outcome, reference_outcome
from hypothesis import HealthCheck, given, seed, settings
from programs import ProgramCase, programs

import ss2sql
from ss2sql.lowering.rewrites import REWRITES

NAMES = "a b c d e f g h".split()  # noqa: SIM905
BORDERS = "ab ac ad ae af bc bd bf bg cd cg ch de dh ef eh fg gh".split()  # noqa: SIM905
COLOURS = ["red", "green", "blue", "yellow"]
SELECT = f"SELECT {', '.join(f'{n}.this' for n in NAMES)} FROM {', '.join(f'{n} = colours' for n in NAMES)} WHERE "
PAIRS = f"[{', '.join(f'[{one}.this, {other}.this]' for one, other in BORDERS)}]"
FORMS = {
    "inequalities": SELECT + " AND ".join(f"{one}.this != {other}.this" for one, other in BORDERS),
    "nested": SELECT + f"[] == (SELECT this FROM {PAIRS} WHERE this[0] == this[1] AS list)",
    "length": SELECT + f"len(SELECT this FROM {PAIRS} WHERE this[0] == this[1] AS list) == 0",
    "variable": f"pairs = {PAIRS};" + SELECT + "[] == (SELECT this FROM pairs WHERE this[0] == this[1] AS list)",
}


@pytest.mark.parametrize("form", FORMS)
def test_the_forms_of_the_map_become_the_same_sql(form: str) -> None:
    ss = ss2sql.connect()
    ss.attach("colours", COLOURS)
    result = ss.run(FORMS[form] + " AS rows;", engine="database")
    assert len(result.value) == 48
    assert result.value[0] == ("red", "green", "blue", "yellow", "green", "blue", "yellow", "red")
    plain = ss.run(FORMS["inequalities"] + " AS rows;", engine="database")
    assert result.sql.statements[-1] == plain.sql


@pytest.mark.parametrize("engine", ["database", "native"])
@pytest.mark.parametrize(
    ("condition", "expected"),
    [
        ("[] == (SELECT this FROM [a.this, b.this] WHERE this == 2 AS list)", [1, 1, 1, 3, 3, 1, 3, 3]),
        ("[] != (SELECT this FROM [a.this, b.this] WHERE this == 2 AS list)", [1, 2, 2, 1, 2, 2, 2, 3, 3, 2]),
        ("len(SELECT this FROM [a.this, b.this] WHERE this == 2 AS list) == 0", [1, 1, 1, 3, 3, 1, 3, 3]),
        ("0 != len(SELECT this, 1 FROM [a.this] WHERE this == 2 AS rows)", [2, 1, 2, 2, 2, 3]),
        ("(SELECT this FROM [a.this] WHERE this == 1 OR this == 3 AS list) == [] AND b.this == 1", [2, 1]),
    ],
)
def test_unnest_gives_the_same_rows_as_without(engine: str, condition: str, expected: list[int]) -> None:
    script = f"SELECT a.this, b.this FROM a = [1, 2, 3], b = [1, 2, 3] WHERE {condition} AS list;"
    for disable in ([], ["unnest"]):
        assert ss2sql.connect(disable=disable).run(script, engine=engine).value == expected  # type: ignore[arg-type]


def test_the_off_switch_leaves_the_nested_query_in_the_sql() -> None:
    for disable, times in (([], 0), (["unnest"], 1)):
        ss = ss2sql.connect(disable=disable)
        ss.attach("colours", COLOURS)
        assert ss.compile(FORMS["nested"]).sql.count("collect(") == times


@pytest.mark.parametrize(
    "condition",
    [
        "[] == (SELECT this FROM [a.this, 'x'] WHERE this < 2 AS list)",  # fails for the second element
        "[] == (SELECT 1 / this FROM [a.this, 0] WHERE this < 2 AS list)",  # so does its column
        "[] == (SELECT this FROM [a.this, 1 / (a.this - 1)] WHERE True AS list)",  # and this element
    ],
)
def test_a_condition_that_can_fail_still_fails(condition: str) -> None:
    script = f"SELECT this FROM a = [1, 2] WHERE {condition} AS list;"
    outcomes = set()
    for disable in ([], ["unnest"]):
        with pytest.raises(ss2sql.ExecutionError) as caught:
            ss2sql.connect(disable=disable).eval(script)
        outcomes.add((caught.value.code, caught.value.span.column if caught.value.span else None))
    assert len(outcomes) == 1


def test_an_unknown_switch_is_refused() -> None:
    with pytest.raises(ss2sql.SessionError, match="unnest"):
        ss2sql.connect(disable=["unnset"])


@pytest.mark.parametrize("name", sorted(REWRITES))
def test_random_programs_do_not_notice_a_rewrite(name: str) -> None:
    tried = 0

    @seed(7)
    @settings(max_examples=300, deadline=None, database=None, suppress_health_check=list(HealthCheck))
    @given(programs())
    def run(case: ProgramCase) -> None:
        nonlocal tried
        tried += 1
        expected = reference_outcome(case)
        for engine in ("database", "native"):
            outcome = executor_outcome(case, engine, disable=[name])
            assert outcome is None or outcome == expected or outcome.error == "R008"

    run()
    assert tried >= 300

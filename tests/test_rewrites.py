"""Rewrites change how a query is evaluated, never what it gives; each has an off switch."""

from __future__ import annotations

from typing import Any

import pytest
from agreement import EARLY, executor_outcome, reference_outcome
from hypothesis import given, seed
from hypothesis import strategies as st
from programs import ProgramCase, programs
from programs.drawn import amount, drawn
from rewrite_programs import DECISIONS, NotedCase, noted_program
from sessions import ENGINES

import ss2sql
from ss2sql.lowering.rewrites import REWRITES

SWITCHES = ["nothing", *REWRITES]
PROGRAMS = 2 * amount(3 / 10)  # of each kind; each without one of the rewrites
NAMES = "a b c d e f g h".split()  # noqa: SIM905
BORDERS = "ab ac ad ae af bc bd bf bg cd cg ch de dh ef eh fg gh".split()  # noqa: SIM905
COLOURS = ["red", "green", "blue", "yellow"]
SELECT = f"SELECT {', '.join(f'{n}.this' for n in NAMES)} FROM {', '.join(f'{n} = colours' for n in NAMES)} WHERE "
PAIRS = f"[{', '.join(f'[{one}.this, {other}.this]' for one, other in BORDERS)}]"
PAIRS_OF_NAMES = [[one, other] for one, other in BORDERS]
FORMS = {
    "inequalities": SELECT + " AND ".join(f"{one}.this != {other}.this" for one, other in BORDERS),
    "nested": SELECT + f"[] == (SELECT this FROM {PAIRS} WHERE this[0] == this[1] AS list)",
    "length": SELECT + f"len(SELECT this FROM {PAIRS} WHERE this[0] == this[1] AS list) == 0",
    "negation": SELECT + f"NOT (SELECT this FROM {PAIRS} WHERE this[0] == this[1] AS list)",
    "variable": f"pairs = {PAIRS};" + SELECT + "[] == (SELECT this FROM pairs WHERE this[0] == this[1] AS list)",
    "names": f"pairs = {PAIRS_OF_NAMES};" + SELECT + "[] == (SELECT this FROM pairs"
    " WHERE eval(this[0] + '.this;') == eval(this[1] + '.this;') AS list)",
    "one of them": SELECT + " AND NOT ".join(
        ["True", *(f"({one}.this == {other}.this OR {one}.this == {other}.this)" for one, other in BORDERS)]
    ),
}  # fmt: skip


@pytest.mark.parametrize("form", FORMS)
def test_the_forms_of_the_map_become_the_same_sql(form: str) -> None:
    ss = ss2sql.connect()
    ss.attach("colours", COLOURS)
    result = ss.run(FORMS[form] + " AS rows;", engine="database")
    assert len(result.value) == 48
    assert result.value[0] == ("red", "green", "blue", "yellow", "green", "blue", "yellow", "red")
    plain = ss.run(FORMS["inequalities"] + " AS rows;", engine="database")
    assert result.sql.statements[-1] == plain.sql


def test_an_unknown_switch_is_refused() -> None:
    with pytest.raises(ss2sql.SessionError, match="unnest"):
        ss2sql.connect(disable=["unnset"])


def options(switch: str) -> dict[str, Any]:
    return {} if switch == "nothing" else {"disable": [switch]}


@pytest.mark.parametrize("switch", SWITCHES)
def test_a_condition_waits_for_its_sources_where_a_constant_stands_in_it(switch: str) -> None:
    """SQLite leaves out `0 AND a.this != b.this` by itself; what remains mentions b no more."""
    calls: list[int] = []

    def odd(n: int) -> bool:
        calls.append(n)
        for _ in range(1):  # more than an expression
            pass
        return n % 2 == 1

    script = """
        SELECT a.this FROM a = ones, b = [a.this, 1] WHERE a.this != b.this AND (odd(a.this) AND (
          a.this > 5 OR (2 != (1 + 1) AND a.this != b.this)
          OR [] == (SELECT this FROM [a.this, 1] WHERE this == a.this AS list)
        )) AS list
    """
    with ss2sql.connect(**options(switch)) as ss:
        ss.function("odd", odd, volatility="immutable")
        ss.set("ones", [1, 1])
        assert ss.run(script, engine="database").value == []
    assert calls == []


def agreed(case: ProgramCase | NotedCase, switch: str) -> None:
    """Without a rewrite both engines come to what the reference evaluator does, by the same calls."""
    expected = reference_outcome(case)  # type: ignore[arg-type]
    calls = case.different_calls if isinstance(case, NotedCase) else []
    for engine in ENGINES:
        outcome = executor_outcome(case, engine, **options(switch))  # type: ignore[arg-type]
        if outcome is not None and outcome.error != EARLY:
            assert outcome == expected, (engine, switch)
            if isinstance(case, NotedCase):
                assert case.different_calls == calls, (engine, switch)


@seed(1)
@drawn(PROGRAMS)
@given(programs(), st.sampled_from(SWITCHES))
def test_random_programs_do_not_notice_a_rewrite(case: ProgramCase, switch: str) -> None:
    agreed(case, switch)


@seed(2)
@drawn(PROGRAMS)
@given(st.binary(min_size=DECISIONS, max_size=DECISIONS).map(noted_program), st.sampled_from(SWITCHES))
def test_random_programs_call_their_functions_as_the_written_order_does(case: NotedCase, switch: str) -> None:
    """Programs made for rewrites: the same answer or error, the same calls of functions, in the same order."""
    agreed(case, switch)

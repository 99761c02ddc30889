"""Rewrites change how a query is evaluated, never what it gives: random programs with each of them switched off."""

from __future__ import annotations

import pytest
from agreement import executor_outcome, is_allowed, reference_outcome
from hypothesis import given, seed
from hypothesis import strategies as st
from programs import ProgramCase, programs
from programs.drawn import amount, drawn
from sessions import ENGINES

from ss2sql.lowering.rewrites import REWRITES


@pytest.mark.drawn
@seed(1)
@drawn(2 * amount(3 / 10))
@given(programs(), st.sampled_from(list(REWRITES)))
def test_random_programs_do_not_notice_a_rewrite(case: ProgramCase, switch: str) -> None:
    expected = reference_outcome(case)
    for engine in (*ENGINES, "auto"):
        assert is_allowed(executor_outcome(case, engine, disable=[switch]), expected, engine), (engine, switch)

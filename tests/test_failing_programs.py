"""Random queries in which almost every part may fail: engines come to a value of the reference, or fail as they may."""

from __future__ import annotations

from random import Random
from typing import Any

import pytest
from agreement import Outcome, is_allowed, outcome, session_for
from mutated_scripts import LIMITED, Limited, is_no_program, reference_outcome
from programs import ProgramCase
from programs.drawn import SEED, amount
from programs.failing import FailingPrograms

COUNT = amount(1 / 2)
PARTS = 4


def limited_outcome(case: ProgramCase, engine: Any) -> Outcome | None:
    """What an engine makes of it; None where it refuses it, or takes too long."""
    with session_for(case) as session:
        found = outcome(session, case.script, engine=engine, timeout=0.5, max_rows=3000)[0]
    return None if found is None or found.error in LIMITED else found


@pytest.mark.drawn
@pytest.mark.parametrize("part", range(PARTS))
def test_engines_give_the_values_of_the_reference(part: int) -> None:
    """The engine `auto` gives one wherever there is one."""
    writer = FailingPrograms(Random(f"{SEED} failing {part}"))
    compared = 0
    while compared < COUNT // PARTS:
        case = writer.case()
        judge = Limited(case.functions, case.variables, case.tables, case.volatility)
        expected = reference_outcome(judge, case.script)
        if expected is None:
            continue
        for engine in ("native", "database", "auto"):
            found = limited_outcome(case, engine)
            assert found is None or is_no_program(found) or is_allowed(found, expected, engine), (case, engine, found)
        compared += 1

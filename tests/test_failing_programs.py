"""Random queries in which almost every part may fail: all evaluators hear of the same failure, both engines where."""

from __future__ import annotations

from random import Random
from typing import Any

import pytest
from agreement import Outcome, exact, session_for
from mutated_scripts import LIMITED, Limited, is_no_program, reference_outcome
from programs import ProgramCase
from programs.drawn import SEED, amount
from programs.failing import FailingPrograms

import ss2sql

COUNT = amount(1 / 2)
PARTS = 4


def placed_outcome(case: ProgramCase, engine: Any) -> tuple[Outcome, int | None] | None:
    """What an engine makes of it, and where in the script it fails; None where it refuses it, or takes too long."""
    with session_for(case) as session:
        try:
            return Outcome(exact(session.run(case.script, engine=engine, timeout=2.0, max_rows=3000).value)), None
        except ss2sql.UnsupportedError:
            return None
        except ss2sql.Error as error:
            return None if error.code in LIMITED else (Outcome(error=error.code), error.span and error.span.start)
        except Exception as error:
            return Outcome(error=type(error).__name__), None


@pytest.mark.drawn
@pytest.mark.parametrize("part", range(PARTS))
def test_all_hear_of_the_same_failure(part: int) -> None:
    writer = FailingPrograms(Random(f"{SEED} failing {part}"))
    compared = 0
    while compared < COUNT // PARTS:
        case = writer.case()
        native = placed_outcome(case, "native")
        if native is None or is_no_program(native[0]):
            continue
        judge = Limited(case.functions, case.variables, case.tables, case.volatility)
        assert reference_outcome(judge, case.script) in (None, native[0]), case
        database = placed_outcome(case, "database")
        assert database in (None, native), case
        compared += 1

"""The random programs are legal, small and varied."""

from __future__ import annotations

from collections import Counter
from random import Random

import pytest
from agreement import executor_outcome
from hypothesis import given, seed, settings
from programs import ProgramCase, features, programs
from programs.drawn import drawn
from programs.failing import FailingPrograms
from programs.features import LEAST, NAMED
from programs.scripts import DECISIONS, program
from reference import Failure, Reference
from test_program_laws import is_no_program, limited_outcome


def outcome(case: ProgramCase) -> tuple[Reference, str]:
    ref = Reference(case.functions, case.variables, case.tables, case.volatility)
    try:
        ref.run(case.script)
    except Failure as failure:
        return ref, failure.code
    except Exception as error:  # an exception of a function of the library
        return ref, type(error).__name__
    return ref, "value"


def test_programs_are_legal_small_and_varied() -> None:
    outcomes: Counter[str] = Counter()

    @settings(max_examples=200, database=None, deadline=None, derandomize=True)
    @given(programs())
    def run(case: ProgramCase) -> None:
        ref, code = outcome(case)
        assert not code.startswith(("P", "R")), case
        assert ref.steps <= 5000, case
        outcomes[code] += 1

    run()
    assert outcomes["value"] > 130
    assert outcomes["X001"] > 0


@pytest.mark.slow
def test_every_feature_is_in_five_of_a_hundred_programs() -> None:
    """And many are searches."""
    found: Counter[str] = Counter()

    @seed(2015)
    @drawn(2000)
    @given(programs())
    def run(case: ProgramCase) -> None:
        found.update(features(case.script))

    run()
    assert [name for name in NAMED if found[name] < 20 * LEAST] == []
    assert found["search"] > 400


@pytest.mark.slow
def test_many_programs_run_in_the_database() -> None:
    ran = Counter(executor_outcome(program(Random(n).randbytes(DECISIONS)), "database") is None for n in range(400))
    assert ran[False] > ran.total() / 4


@pytest.mark.slow
def test_of_programs_that_may_fail_half_do_and_most_run_in_the_database() -> None:
    writer = FailingPrograms(Random("2015 failing"))
    cases = [writer.case() for _ in range(200)]
    outcomes = [limited_outcome(case, "native") for case in cases]
    legal = [n for n, found in enumerate(outcomes) if found is not None and not is_no_program(found)]
    failing = [n for n in legal if outcomes[n].error is not None]
    assert len(legal) / 4 < len(failing) < 3 * len(legal) / 4
    assert sum(limited_outcome(cases[n], "database") is not None for n in legal) > len(legal) / 2

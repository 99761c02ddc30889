"""Three evaluators agree on random programs: the obvious one in tests/reference, SQLite, and the native one.

`SS2SQL_PROGRAMS` sets how many programs are tried; 600 without it.
"""

from __future__ import annotations

import os
from collections import Counter

import pytest
from agreement import differences, executor_outcome, reference_outcome
from hypothesis import HealthCheck, given, seed, settings
from programs import ProgramCase, features, programs

COUNT = int(os.environ.get("SS2SQL_PROGRAMS", "600"))


def test_three_evaluators_agree(capsys: pytest.CaptureFixture[str]) -> None:
    tried: Counter[str] = Counter()

    @seed(20_15)
    @settings(max_examples=COUNT, deadline=None, database=None, suppress_health_check=list(HealthCheck))
    @given(programs())
    def run(case: ProgramCase) -> None:
        tried["programs"] += 1
        tried["in the database"] += executor_outcome(case, "database") is not None
        tried["searches"] += "CONNECT BY" in case.script
        tried["failing"] += reference_outcome(case).error is not None
        assert differences(case) == []

    run()
    with capsys.disabled():
        print("\nagreement: " + ", ".join(f"{count} {name}" for name, count in tried.items()))
    assert tried["programs"] >= COUNT
    assert tried["in the database"] > COUNT / 4
    assert tried["searches"] > COUNT / 5


def test_every_feature_is_named() -> None:
    assert "UNIQUE" in " ".join(features("SELECT this FROM a START WITH b = 1 CONNECT BY UNIQUE b = this;")).upper()

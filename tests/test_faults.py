"""Functions that raise, return garbage, use their session again or close it, at the k-th call and in every clause.

By default some calls of each clause and kind are tried, drawn with a seed; `SS2SQL_FAULTS=all` tries all of them, and
`SS2SQL_FAULTS=3` those of another seed.
"""

from __future__ import annotations

import os
from random import Random
from typing import Any

import pytest
from faulty import CLAUSES, ENDINGS, ENGINES, KINDS, VOLATILITIES, Patient, endured, judge

WANTED = os.environ.get("SS2SQL_FAULTS", "1")
CALLS = range(1, 41)
SAMPLE = 9  # kinds of faults for each clause, engine and volatility; 45 ms each


@pytest.mark.parametrize("volatility", VOLATILITIES)
@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("clause", CLAUSES)
def test_faults(clause: str, engine: Any, volatility: Any) -> None:
    patient = Patient(clause, engine, volatility)
    most = min(patient.calls + 1, CALLS[-1])  # one more than there are: nothing happens
    dice = Random(f"{WANTED} {clause} {engine} {volatility}")
    for kind in KINDS if WANTED == "all" else dice.sample(KINDS, SAMPLE):
        for k in range(1, most + 1) if WANTED == "all" else [dice.choice((1, 2, dice.randint(1, most)))]:
            at = f"{patient.script}, {engine}, {volatility}"
            patient = endured(patient, lambda: Patient(clause, engine, volatility), judge, kind, k, at)
    patient.close()


def test_every_ending_is_noticed() -> None:
    assert set(ENDINGS) < set(KINDS)

"""Scripts with parts of each other: on the database and natively they come to the same.

Random programs are written clause by clause, so they lack what their writer did not think of. These are golden scripts
of which parts were exchanged, nested and repeated, as `fuzz_mutations` does it for the compiler.
"""

from __future__ import annotations

import contextlib
import os
from random import Random

import pytest
from agreement import Outcome, outcome
from fuzz import seeds
from fuzz_judge import session
from fuzz_mutations import Donors, Mutator

import ss2sql

COUNT = int(os.environ.get("SS2SQL_PROGRAMS", "1000")) // 10
SEED = int(os.environ.get("SS2SQL_SEED", "2015"))
LONGEST = 800  # characters
# What takes long, or gives very much, may do so on one engine alone; `tick` and time differ from call to call.
LIMITED = {"T001", "X010", "X014"}
MOVING = ("tick", "getTime", "print")


def outcomes(script: str) -> list[Outcome]:
    """What the engines that run a script make of it; nothing of one that does not compile."""
    found = []
    for engine in ("native", "database"):
        with session() as ss, contextlib.suppress(ss2sql.Error):
            ss.compile(script).statements()
            found.append(outcome(ss, script, engine=engine, timeout=2.0, max_rows=3000)[0])
    return [one for one in found if one is not None and one.error not in LIMITED]


@pytest.mark.parametrize("part", range(4))
def test_engines_agree_on_scripts_with_parts_of_others(part: int) -> None:
    dice = Random(f"{SEED} {part}")
    scripts = [script for script in seeds() if len(script) < LONGEST and not any(word in script for word in MOVING)]
    mutator = Mutator(Donors(scripts))
    compared = 0
    while compared < COUNT // 4:
        script = mutator.changed(dice.choice(scripts), dice)
        if len(script) > LONGEST or any(word in script for word in MOVING):
            continue
        found = outcomes(script)
        assert found[1:] in ([], found[:1]), script
        compared += len(found) == 2


def test_a_source_that_fails_after_the_first_step() -> None:
    """It was found like this; both are compared, and fail."""
    first, second = outcomes("SELECT this FROM [1 / n, 2] START WITH n = 1 CONNECT BY NO CYCLE n = 0 AS list;")
    assert first == second == Outcome(error="X002")

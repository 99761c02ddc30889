"""Random programs with parts of each other: the reference and both engines come to the same.

`test_mutated.py` does it with golden scripts, which have few functions, tables and values. These have those of five
random programs together, so that whatever is taken from one of them means something in the others.
"""

from __future__ import annotations

import contextlib
import os
import re
from collections.abc import Iterator
from functools import cache
from random import Random

import pytest
from agreement import Outcome, judged, outcome, session_for
from fuzz_mutations import Donors, Mutator
from hypothesis import given, seed
from programs import ProgramCase, programs
from programs.drawn import drawn
from test_mutated import LIMITED, LONGEST, EnoughError, Limited, is_no_program

import ss2sql

COUNT = int(os.environ.get("SS2SQL_PROGRAMS", "1000")) // 5
SEED = int(os.environ.get("SS2SQL_SEED", "2015"))
PARTS = 4
POOL = 400  # programs
TOGETHER = 5  # programs
OF_EACH = 20  # scripts
# What such objects, and calls that count, come to depends on how often and in which order they are asked.
MOVING = ("tick", "body", "box")
BARE = re.compile(r"\b(count|sum|min|max|average)\b(?! *\()")  # aggregates without `(this)`: the reference has none


@cache
def pool(part: int) -> tuple[ProgramCase, ...]:
    """Programs that come to the same whenever they run."""
    found: list[ProgramCase] = []

    @seed(SEED + part)
    @drawn(POOL)
    @given(programs())
    def draw(case: ProgramCase) -> None:
        if not any(word in case.script for word in MOVING) and "volatile" not in case.volatility.values():
            found.append(case)

    draw()
    return tuple(found)


def together(cases: list[ProgramCase], script: str) -> ProgramCase:
    """A script with what all of these have; a table hides a variable of another program."""
    tables = {name: rows for case in cases for name, rows in case.tables.items()}
    variables = {name: value for case in cases for name, value in case.variables.items() if name not in tables}
    return ProgramCase(script, variables, tuple(dict.fromkeys(name for case in cases for name in case.uses)), tables)


def mixed(part: int) -> Iterator[ProgramCase]:
    """Programs of no end."""
    dice = Random(f"{SEED} mixed {part}")
    while True:
        cases = dice.sample(pool(part), TOGETHER)
        mutator = Mutator(Donors([case.script for case in cases]))
        for _ in range(OF_EACH):
            script = mutator.changed(dice.choice(cases).script, dice)
            if len(script) <= LONGEST and not any(word in script for word in MOVING) and not BARE.search(script):
                yield together(cases, script)


def outcomes(case: ProgramCase) -> dict[str, Outcome]:
    """What engines and reference make of it, as far as they run it; nothing of one that does not compile."""
    found: dict[str, Outcome] = {}
    for engine in ("native", "database"):
        with session_for(case) as ss, contextlib.suppress(ss2sql.Error):
            ss.compile(case.script).statements()
            here = outcome(ss, case.script, engine=engine, timeout=2.0, max_rows=3000)[0]
            if here is not None and here.error not in LIMITED:
                found[engine] = here
    # To the reference what an element lacks is None; engines may learn too late that it is a column of others.
    lacking = {here.error for here in found.values()} == {"X008"}
    if found and not lacking and not is_no_program(next(iter(found.values()))):
        with contextlib.suppress(EnoughError):
            judge = Limited(case.functions, case.variables, case.tables, case.volatility)
            found["reference"] = judged(judge, case.script)
    return {name: here for name, here in found.items() if not is_no_program(here)}


@pytest.mark.parametrize("part", range(PARTS))
def test_programs_with_parts_of_others(part: int) -> None:
    compared = 0
    for case in mixed(part):
        found = outcomes(case)
        assert len(set(found.values())) <= 1, f"{case!r}\n{found}"
        compared += len(found) > 1
        if compared >= COUNT // PARTS:
            break
    assert compared == COUNT // PARTS

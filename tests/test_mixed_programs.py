"""Random programs with parts of each other: the reference and both engines come to the same.

`test_mutated.py` does it with golden scripts, which have few functions, tables and values. These have those of five
random programs together, so that whatever is taken from one of them means something in the others.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from functools import cache, partial
from itertools import islice
from random import Random

import pytest
from agreement import Outcome, is_spared, session_for
from hypothesis import given, seed
from mutated_scripts import ALONE, LONGEST, Limited, engine_outcomes, is_no_program, mutated, reference_outcome
from programs import ProgramCase, programs
from programs.drawn import SEED, amount, drawn

COUNT = amount(1 / 5)
PARTS = 4
POOL = 400  # programs
TOGETHER = 5  # programs
OF_EACH = 20  # scripts
# What such objects, and calls that count, come to depends on how often and in which order they are asked; aggregates
# without `(this)` are unknown to the reference.
OMITTED = re.compile(f"tick|body|box|{ALONE}")


@cache
def pool(part: int) -> tuple[ProgramCase, ...]:
    """Programs that come to the same whenever they run."""
    found: list[ProgramCase] = []

    @seed(SEED + part)
    @drawn(POOL)
    @given(programs())
    def draw(case: ProgramCase) -> None:
        kept = len(case.script) <= LONGEST and not OMITTED.search(case.script)
        if kept and "volatile" not in case.volatility.values():
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
        for script in islice(mutated([case.script for case in cases], OMITTED, dice), OF_EACH):
            yield together(cases, script)


def outcomes(case: ProgramCase) -> list[Outcome]:
    """What engines and reference make of it, as far as they run it; nothing of one that does not compile."""
    found = engine_outcomes(partial(session_for, case), case.script)
    # To the reference what an element lacks is None; engines may learn too late that it is a column of others.
    lacking = {one.error for one in found} == {"X008"}
    if found and not lacking and not is_no_program(found[0]):
        judge = Limited(case.functions, case.variables, case.tables, case.volatility)
        expected = reference_outcome(judge, case.script)
        if expected is not None and not (expected.error and is_spared(case)):
            found.append(expected)
    return [one for one in found if not is_no_program(one)]


def agree(cases: Iterator[ProgramCase], count: int, also: Callable[[ProgramCase, list[Outcome]], bool]) -> None:
    """Runs programs until so many have come to the same in several evaluators; what `also` says holds for each."""
    compared = 0
    while compared < count:
        case = next(cases)
        found = outcomes(case)
        assert len(set(found)) <= 1, f"{case!r}\n{found}"
        assert also(case, found), f"{case!r}\n{found}"
        compared += len(found) > 1


@pytest.mark.parametrize("part", range(PARTS))
def test_programs_with_parts_of_others(part: int) -> None:
    agree(mixed(part), COUNT // PARTS, lambda case, found: True)

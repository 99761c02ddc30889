"""Scripts with parts of each other: on the database and natively they come to the same.

Random programs are written clause by clause, so they lack what their writer did not think of. These are golden scripts
of which parts were exchanged, nested and repeated, as `fuzz_mutations` does it for the compiler. Those that the
reference evaluator knows enough of come to the same there, too.
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Iterator
from random import Random
from typing import Any

import pytest
from agreement import Outcome, judged, outcome
from cases import needs
from cases.data import TABLES, VALUES
from cases.functions import FUNCTIONS
from fuzz import seeds
from fuzz_judge import CALLED, VARIABLES, session
from fuzz_mutations import Donors, Mutator
from golden import cases
from reference import Reference
from test_cases import MANY_ARGUMENTS, UNKNOWN_TO_REFERENCE

import ss2sql

COUNT = int(os.environ.get("SS2SQL_PROGRAMS", "1000")) // 10
SEED = int(os.environ.get("SS2SQL_SEED", "2015"))
LONGEST = 800  # characters
# What takes long, or gives very much, may do so on one engine alone; `tick` and time differ from call to call.
LIMITED = {"T001", "X010", "X014"}
MOVING = ("tick", "getTime", "print")
# The reference does not know these: what it says of variables, worlds, history, and totals of more than 64 bits.
UNKNOWN = ("help", "clear", "var", "shelf", "ragged", "weight", "{", "922337203685")
MOST = 100_000  # expressions that the reference evaluates of one script


def outcomes(script: str, engines: tuple[str, ...] = ("native", "database")) -> list[Outcome]:
    """What the engines that run a script make of it; nothing of one that does not compile."""
    found = []
    for engine in engines:
        with session() as ss, contextlib.suppress(ss2sql.Error):
            ss.compile(script).statements()
            found.append(outcome(ss, script, engine=engine, timeout=2.0, max_rows=3000)[0])
    return [one for one in found if one is not None and one.error not in LIMITED]


def mutated(known: list[str], omitted: tuple[str, ...], part: int) -> Iterator[str]:
    """Scripts of no end that are made of parts of known ones; those with an omitted word are left out."""
    dice = Random(f"{SEED} {part}")
    scripts = [script for script in known if len(script) < LONGEST and not any(word in script for word in omitted)]
    mutator = Mutator(Donors(scripts))
    while True:
        script = mutator.changed(dice.choice(scripts), dice)
        if len(script) <= LONGEST and not any(word in script for word in omitted):
            yield script


@pytest.mark.parametrize("part", range(4))
def test_engines_agree_on_scripts_with_parts_of_others(part: int) -> None:
    scripts = mutated(seeds(), MOVING, part)
    compared = 0
    while compared < COUNT // 4:
        script = next(scripts)
        found = outcomes(script)
        assert found[1:] in ([], found[:1]), script
        compared += len(found) == 2


class EnoughError(BaseException):
    """A script would take the reference evaluator minutes; no script can catch it."""


class Limited(Reference):
    """The reference evaluator, which gives up after a while."""

    left = MOST

    def evaluate(self, expr: Any, frame: Any) -> Any:
        self.left -= 1
        if not self.left:
            raise EnoughError
        return super().evaluate(expr, frame)


def like_a_session() -> Limited:
    """With what `session` has, except for its world."""
    given = needs.for_reference([*FUNCTIONS, *VALUES, *TABLES])
    functions = {**{name: function for name, (function, _) in CALLED.items()}, **given["functions"]}
    return Limited(functions, {**VARIABLES, **given["variables"]}, given["tables"])


def is_no_program(found: Outcome) -> bool:
    """Engines refuse it as soon as it is compiled, where the reference fails when it runs, or knows no limit."""
    return found.error is not None and (found.error.startswith("R") or found.error in ("P002", "X005", "MemoryError"))


def reference_outcome(script: str) -> Outcome | None:
    """None where the reference has nothing to say."""
    try:
        found = judged(like_a_session(), script)
    except EnoughError:
        return None
    return None if is_no_program(found) else found


@pytest.mark.parametrize("part", range(2))
def test_the_reference_agrees_on_scripts_with_parts_of_others(part: int) -> None:
    known = [case.script for case in cases() if not case.name.startswith((*UNKNOWN_TO_REFERENCE, *MANY_ARGUMENTS))]
    scripts = mutated(known, (*MOVING, *UNKNOWN), part)
    compared = 0
    while compared < COUNT // 2:
        script = next(scripts)
        found = outcomes(script, ("native",))
        if not found or (found[0].error or "").startswith("R"):
            continue
        expected = reference_outcome(script)
        assert expected in (None, found[0]), script
        compared += expected is not None


def test_a_source_that_fails_after_the_first_step() -> None:
    """It was found like this; both are compared, and fail."""
    first, second = outcomes("SELECT this FROM [1 / n, 2] START WITH n = 1 CONNECT BY NO CYCLE n = 0 AS list;")
    assert first == second == Outcome(error="X002")

"""Scripts with parts of each other: on the database and natively they come to the same values.

Random programs are written clause by clause, so they lack what their writer did not think of. These are golden scripts
of which parts were exchanged, nested and repeated, as `fuzz_mutations` does it for the compiler. Those that the
reference evaluator knows enough of come to the same there, too.
"""

from __future__ import annotations

import re
from random import Random

import pytest
from agreement import is_allowed
from cases import needs
from cases.data import TABLES, VALUES
from cases.functions import FUNCTIONS
from fuzz import seeds
from fuzz_judge import CALLED, VARIABLES, session
from golden import cases
from mutated_scripts import ALONE, Limited, engine_outcomes, mutated, reference_outcome
from programs.drawn import SEED, amount
from test_cases import MANY_ARGUMENTS, UNKNOWN_TO_REFERENCE

COUNT = amount(1 / 10)
MOVING = "tick|getTime|print"  # they differ from call to call
# The reference does not know these: what it says of variables, worlds and the distance of their objects, history, and
# totals of more than 64 bits.
UNKNOWN = "help|clear|var|shelf|ragged|weight|distance|[{]|922337203685"


@pytest.mark.drawn
@pytest.mark.parametrize("part", range(4))
def test_engines_agree_on_scripts_with_parts_of_others(part: int) -> None:
    scripts = mutated(seeds(), re.compile(MOVING), Random(f"{SEED} {part}"))
    compared = 0
    while compared < COUNT // 4:
        script = next(scripts)
        found = engine_outcomes(session, script)
        if "native" in found:
            wrong = {engine for engine, one in found.items() if not is_allowed(one, found["native"], engine)}
            assert not wrong, (script, found)
            compared += 1


def like_a_session() -> Limited:
    """The reference evaluator with what `session` has, except for its world."""
    given = needs.for_reference([*FUNCTIONS, *VALUES, *TABLES])
    functions = {**{name: function for name, (function, _) in CALLED.items()}, **given["functions"]}
    return Limited(functions, {**VARIABLES, **given["variables"]}, given["tables"])


@pytest.mark.drawn
@pytest.mark.parametrize("part", range(2))
def test_the_reference_agrees_on_scripts_with_parts_of_others(part: int) -> None:
    known = [case.script for case in cases() if not case.name.startswith((*UNKNOWN_TO_REFERENCE, *MANY_ARGUMENTS))]
    scripts = mutated(known, re.compile(f"{MOVING}|{UNKNOWN}|{ALONE}"), Random(f"{SEED} {part}"))
    compared = 0
    while compared < COUNT // 2:
        script = next(scripts)
        found = engine_outcomes(session, script, ("native",)).get("native")
        if found is None or (found.error or "").startswith("R"):
            continue
        expected = reference_outcome(like_a_session(), script)
        assert expected is None or is_allowed(found, expected, "native"), script
        compared += expected is not None

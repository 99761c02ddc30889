"""Scripts that are made of parts of others, and what engines and the reference evaluator make of them."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable, Iterator
from random import Random
from typing import Any

from agreement import Outcome, judged, outcome
from fuzz_mutations import Donors, Mutator
from reference import Reference

import ss2sql

LONGEST = 800  # characters
# What takes long, or gives very much, may do so on one engine alone.
LIMITED = {"T001", "X010", "X014"}
MOST = 100_000  # expressions that the reference evaluates of one script
ALONE = r"\b(count|sum|min|max|average)\b(?! *\()"  # aggregates of `this`, which the reference does not know


def mutated(known: list[str], omitted: re.Pattern[str], dice: Random) -> Iterator[str]:
    """Scripts of no end that are made of parts of known ones; those with something omitted are left out."""

    def kept(script: str) -> bool:
        return len(script) <= LONGEST and not omitted.search(script)

    scripts = [script for script in known if kept(script)]
    mutator = Mutator(Donors(scripts))
    while True:
        script = mutator.changed(dice.choice(scripts), dice)
        if kept(script):
            yield script


def engine_outcomes(
    session: Callable[[], ss2sql.Session], script: str, engines: tuple[str, ...] = ("native", "database", "auto")
) -> dict[str, Outcome]:
    """What the engines that run a script make of it; nothing of one that does not compile."""
    found: dict[str, Outcome | None] = {}
    for engine in engines:
        with session() as ss, contextlib.suppress(ss2sql.Error):
            ss.compile(script).statements()
            found[engine] = outcome(ss, script, engine=engine, timeout=0.5, max_rows=3000)[0]
    return {engine: one for engine, one in found.items() if one is not None and one.error not in LIMITED}


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


def is_no_program(found: Outcome) -> bool:
    """Engines refuse it as soon as it is compiled, where the reference fails when it runs, or knows no limit."""
    return found.error is not None and (found.error.startswith("R") or found.error in ("P002", "X005", "MemoryError"))


def reference_outcome(judge: Limited, script: str) -> Outcome | None:
    """None where the reference has nothing to say."""
    try:
        found = judged(judge, script)
    except EnoughError:
        return None
    return None if is_no_program(found) else found

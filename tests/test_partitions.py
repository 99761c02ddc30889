"""WHERE p and WHERE NOT p share the rows of a query between them, whatever p is.

Truth is Python's, so there is no third answer: the rows for which p is None are among those of NOT p. Where p fails for
a row, both queries fail, with the same error. `SS2SQL_PROGRAMS` sets the number of conditions, a fifth of it.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from typing import Any

from agreement import Outcome, executor_outcome
from hypothesis import given, seed
from hypothesis import strategies as st
from programs import ProgramCase
from programs.choices import Choices
from programs.drawn import amount, drawn
from programs.expressions import WITH_LISTS, Sight
from programs.flat import Flat
from sessions import ENGINES

COUNT = amount(1 / 5)
DECISIONS = 160


@dataclass(frozen=True)
class Partition:
    """A product, and the query of its rows for the condition, for NOT, for None, and for all of them."""

    everything: ProgramCase
    true: ProgramCase
    false: ProgramCase
    none: ProgramCase


def partition(data: bytes) -> Partition:
    """The condition and the product that the bytes stand for; neither calls what answers otherwise the next time."""
    writer = Flat(Choices(data))
    writer.templates = WITH_LISTS
    text, sight, origins = writer.sources(Sight(), writer.choices.weighted((50, 1), (35, 2), (15, 3)))
    condition = writer.expr("any" if writer.choices.chance(25) else "bool", sight, 3)
    if writer.choices.chance(25):
        condition = writer.condition(sight)
    shown = ", ".join(["this", *(f"{origin.name}.this" for origin in origins[1:])])
    cases = (
        ProgramCase(f"SELECT {shown} FROM {text}{where} AS rows", writer.variables, tuple(writer.uses), writer.tables)
        for where in ("", f" WHERE {condition}", f" WHERE NOT ({condition})", f" WHERE ({condition}) == None")
    )
    return Partition(*cases)


def rows(outcome: Outcome) -> Counter[Any]:
    """How often each row occurs."""
    return Counter(outcome.value[1:])


def test_a_condition_and_its_opposite_share_the_rows() -> None:
    shared: Counter[str] = Counter()

    @seed(2015)
    @drawn(COUNT)
    @given(st.binary(min_size=DECISIONS, max_size=DECISIONS).map(partition))
    def run(made: Partition) -> None:
        for engine in ENGINES:
            outcomes = [executor_outcome(case, engine) for case in (made.everything, made.true, made.false, made.none)]
            everything, true, false, none = outcomes
            if everything is None or true is None or false is None or none is None or everything.error is not None:
                continue  # the engine refuses one of them, or a source itself fails
            assert true.error == false.error == none.error
            if true.error is not None:
                shared["failing"] += 1
                continue
            assert rows(true) + rows(false) == rows(everything)
            assert rows(none) <= rows(false)
            shared["with both"] += bool(rows(true) and rows(false))
            shared["with None"] += bool(rows(none))

    run()
    assert shared["with both"] > COUNT / 10
    assert shared["with None"] > COUNT / 100
    assert shared["failing"] > COUNT / 100

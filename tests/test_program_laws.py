"""What a program means depends neither on its names nor on orders that the language leaves open; WHERE splits rows.

WHERE p and WHERE NOT p share the rows of a query between them, whatever p is: truth is Python's, so there is no third
answer. The rows for which p is None are among those of NOT p. Where p fails for a row, both queries fail, with the same
error. `SS2SQL_PROGRAMS` sets how many programs are tried: a twenty-fifth for each law, a fifth of conditions.
"""

from __future__ import annotations

from collections import Counter
from contextlib import redirect_stdout
from dataclasses import dataclass
from io import StringIO
from random import Random
from typing import Any

import pytest
from agreement import Outcome, exact, executor_outcome, session_for
from hypothesis import given, seed
from hypothesis import strategies as st
from programs import ProgramCase, programs
from programs.choices import Choices
from programs.drawn import SEED, amount, drawn
from programs.expressions import WITH_LISTS, Sight
from programs.flat import Flat
from programs.renaming import CASES, RenamedCase, renamed
from programs.shuffling import product, shuffled
from sessions import ENGINES

import ss2sql

many = drawn(amount(1 / 25))


def with_old_names(case: RenamedCase, outcome: Outcome) -> Outcome:
    """What a renamed program came to, in the names of the other one."""

    def back(value: Any) -> Any:
        match value:
            case ("str", str(text)):
                return ("str", case.back(text))
            case tuple() | frozenset():
                return type(value)(map(back, value))
            case _:
                return value

    return Outcome(back(outcome.value), outcome.error, case.back(outcome.printed))


def same_with_other_names(case: ProgramCase, other: RenamedCase) -> None:
    for engine in ENGINES:
        expected, found = executor_outcome(case, engine), executor_outcome(other, engine)  # type: ignore[arg-type]
        assert engine == "database" or expected is not None  # the database leaves some of it to the native executor
        assert (expected is None) == (found is None), other
        assert found is None or with_old_names(other, found) == expected, other


@seed(SEED)
@many
@given(programs(), st.integers(0, 2**16))
def test_other_names_change_nothing(case: ProgramCase, number: int) -> None:
    other = renamed(case, Random(number))
    assert len(set(other.names.values())) == len(other.names)
    same_with_other_names(case, other)


TEMPORAL = """
    mood{1000} = 1; other{1000.0} = [mood]; mood{1000} = 'a'; mood{1000} = other + [2];
    places = SELECT p FROM mood{} START WITH p = 0 CONNECT BY UNIQUE p = p + 1 STOP WITH p > 2 AS list;
    [mood, other, mood{}, other{}, mood{-500}, SELECT this, mood FROM xs WHERE this IN other AS rows, places]
"""


@pytest.mark.parametrize("number", range(10))
def test_other_names_of_temporal_variables_change_nothing(number: int) -> None:
    case = ProgramCase(TEMPORAL, {"xs": [1, 2, 3]})
    other = renamed(case, Random(number))
    assert {"mood", "other", "places", "xs", "p"} == set(other.names)
    assert number or set(other.names.values()) & set(CASES)
    native = executor_outcome(case, "native")
    assert native is not None
    assert native.error is None
    same_with_other_names(case, other)


@seed(SEED)
@many
@given(programs(), st.integers(0, 2**16))
def test_orders_that_the_language_leaves_open_change_nothing(case: ProgramCase, number: int) -> None:
    other = shuffled(case, Random(number))
    for engine in ENGINES:
        assert executor_outcome(other, engine) == executor_outcome(case, engine), other


@seed(SEED)
@many
@given(st.binary(min_size=80, max_size=80), st.integers(0, 2**16))
def test_rows_follow_the_order_of_from_and_no_other(data: bytes, number: int) -> None:
    dice, made = Random(number), product(data)
    written = [name for name, _ in made.sources]
    names = dice.sample(written, len(written))
    parts = dice.sample(made.parts, len(made.parts))
    for engine in ENGINES:
        rows = rows_of(made.case(written, made.parts), engine)
        assert rows == rows_of(made.case(written, parts), engine)
        turned = rows_of(made.case(names, parts), engine)
        assert sorted(turned, key=repr) == sorted(rows, key=repr)
        if not made.order:
            assert rows == sorted(rows, key=lambda row: made.places(row, written))
            assert turned == sorted(rows, key=lambda row: made.places(row, names))


def rows_of(case: ProgramCase, engine: str) -> list[Any]:
    """The rows of a program that does not fail."""
    with session_for(case) as ss:
        return list(ss.run(case.script, engine=engine).value)  # type: ignore[arg-type]


@seed(SEED)
@many
@given(programs())
def test_as_many_steps_as_a_program_takes_are_enough_and_one_fewer_are_not(case: ProgramCase) -> None:
    for engine in ENGINES:
        expected, steps = steps_of(case, engine)
        if steps:
            assert steps_of(case, engine, max_steps=steps) == (expected, steps)
            assert steps_of(case, engine, max_steps=steps - 1)[0].error == "T004"


def steps_of(case: ProgramCase, engine: str, **limits: int) -> tuple[Outcome, int]:
    """What a program comes to, and the steps of its searches; none where it fails or is refused."""
    with session_for(case, **limits) as ss, redirect_stdout(StringIO()):
        try:
            result = ss.run(case.script, engine=engine)  # type: ignore[arg-type]
        except ss2sql.Error as error:
            return Outcome(error=error.code), 0
        except Exception as error:
            return Outcome(error=type(error).__name__), 0
        return Outcome(exact(result.value)), result.stats.generated


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


def counted(outcome: Outcome) -> Counter[Any]:
    """How often each row occurs."""
    return Counter(outcome.value[1:])


@seed(2015)
@drawn(amount(1 / 5))
@given(st.binary(min_size=160, max_size=160).map(partition))
def test_a_condition_and_its_opposite_share_the_rows(made: Partition) -> None:
    for engine in ENGINES:
        outcomes = [executor_outcome(case, engine) for case in (made.everything, made.true, made.false, made.none)]
        everything, true, false, none = outcomes
        if everything is None or true is None or false is None or none is None or everything.error is not None:
            continue  # the engine refuses one of them, or a source itself fails
        assert true.error == false.error == none.error
        if true.error is None:
            assert counted(true) + counted(false) == counted(everything)
            assert counted(none) <= counted(false)

"""What a program means depends neither on its names nor on orders that the language leaves open.

`SS2SQL_PROGRAMS` sets how many programs are tried: a twenty-fifth for each law, by the seed `SS2SQL_SEED`.
"""

from __future__ import annotations

from collections import Counter
from contextlib import redirect_stdout
from io import StringIO
from random import Random
from typing import Any

import pytest
from agreement import Outcome, exact, executor_outcome, session_for
from hypothesis import given, seed
from hypothesis import strategies as st
from programs import ProgramCase, programs
from programs.drawn import SEED, amount, drawn
from programs.renaming import CASES, RenamedCase, renamed
from programs.shuffling import product, shuffled
from sessions import ENGINES

import ss2sql

COUNT = amount(1 / 25)
many = drawn(COUNT)


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


def test_other_names_change_nothing() -> None:
    tried: Counter[str] = Counter()

    @seed(SEED)
    @many
    @given(programs(), st.integers(0, 2**16))
    def run(case: ProgramCase, number: int) -> None:
        other = renamed(case, Random(number))
        assert len(set(other.names.values())) == len(other.names)
        for engine in ENGINES:
            expected, found = executor_outcome(case, engine), executor_outcome(other, engine)  # type: ignore[arg-type]
            assert (expected is None) == (found is None), other
            if expected is not None and found is not None:
                assert with_old_names(other, found) == expected, other
                tried[engine] += 1
                tried["names"] += len(other.names)
                tried["values"] += expected.error is None

    run()
    assert tried["native"] >= COUNT
    assert tried["database"] > COUNT / 4
    assert tried["names"] > 3 * COUNT
    assert tried["values"] > COUNT


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
    for engine in ENGINES:
        expected, found = executor_outcome(case, engine), executor_outcome(other, engine)  # type: ignore[arg-type]
        if engine == "native":
            assert expected is not None
            assert expected.error is None
        assert (expected is None) == (found is None)  # the database leaves some of it to the native executor
        assert found is None or with_old_names(other, found) == expected, other


def test_orders_that_the_language_leaves_open_change_nothing() -> None:
    tried: Counter[str] = Counter()

    @seed(SEED)
    @many
    @given(programs(), st.integers(0, 2**16))
    def run(case: ProgramCase, number: int) -> None:
        other = shuffled(case, Random(number))
        for engine in ENGINES:
            assert executor_outcome(other, engine) == executor_outcome(case, engine), other
        tried["text"] += other.script != case.script
        tried["made known"] += [*other.variables, *other.uses] != [*case.variables, *case.uses]

    run()
    assert tried["text"] > COUNT / 20
    assert tried["made known"] > COUNT / 20


def test_rows_follow_the_order_of_from_and_no_other() -> None:
    tried: Counter[str] = Counter()

    @seed(SEED)
    @many
    @given(st.binary(min_size=80, max_size=80), st.integers(0, 2**16))
    def run(data: bytes, number: int) -> None:
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
            tried["turned"] += rows != turned
            tried["rows"] += len(rows)

    run()
    assert tried["turned"] > COUNT / 10
    assert tried["rows"] > COUNT


def rows_of(case: ProgramCase, engine: str) -> list[Any]:
    """The rows of a program that does not fail."""
    with session_for(case) as ss:
        return list(ss.run(case.script, engine=engine).value)  # type: ignore[arg-type]


def test_as_many_steps_as_a_program_takes_are_enough_and_one_fewer_are_not() -> None:
    tried: Counter[str] = Counter()

    @seed(SEED)
    @many
    @given(programs())
    def run(case: ProgramCase) -> None:
        for engine in ENGINES:
            expected, steps = steps_of(case, engine)
            if steps:
                assert steps_of(case, engine, max_steps=steps) == (expected, steps)
                assert steps_of(case, engine, max_steps=steps - 1)[0].error == "T004"
                tried[engine] += 1

    run()
    assert tried["native"] > COUNT / 4
    assert tried["database"] > COUNT / 8


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


@pytest.mark.parametrize(
    ("script", "shuffles"),
    [
        ("((1 + 1) + (1 + 1))", {"((1 + 1) + (1 + 1))"}),
        ("(a = 1); (b = 2); (a + b)", {"a = 1; b = 2; (a + b)", "b = 2; a = 1; (a + b)"}),
        (
            "(SELECT this FROM [1] LIMIT 1 ORDER BY this)",
            {"(SELECT this FROM [1] LIMIT 1 ORDER BY this )", "(SELECT this FROM [1] ORDER BY this LIMIT 1 )"},
        ),
    ],
)
def test_scripts_in_parentheses_are_shuffled(script: str, shuffles: set[str]) -> None:
    found = {shuffled(ProgramCase(script), Random(number)).script for number in range(20)}
    assert {" ".join(one.split()) for one in found} == shuffles

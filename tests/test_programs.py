"""The random programs are legal, small and varied, and the reference obeys the laws of section 6 on their machines."""

from __future__ import annotations

from collections import Counter
from random import Random
from typing import Any

import pytest
from agreement import executor_outcome
from hypothesis import given, seed, settings
from hypothesis import strategies as st
from programs import ProgramCase, features, programs
from programs.choices import Choices
from programs.drawn import drawn
from programs.failing import FailingPrograms
from programs.features import LEAST, NAMED
from programs.library import LIBRARY
from programs.machines import MACHINES, Machine
from programs.scripts import DECISIONS, program
from reference import Failure, Reference
from test_program_laws import is_no_program, limited_outcome

Paths = list[tuple[Any, ...]]
BYTES = st.binary(min_size=40, max_size=40)


def outcome(case: ProgramCase) -> tuple[Reference, str]:
    ref = Reference(case.functions, case.variables, case.tables, case.volatility)
    try:
        ref.run(case.script)
    except Failure as failure:
        return ref, failure.code
    except Exception as error:  # an exception of a function of the library
        return ref, type(error).__name__
    return ref, "value"


def test_programs_are_legal_small_and_varied() -> None:
    outcomes: Counter[str] = Counter()

    @settings(max_examples=200, database=None, deadline=None, derandomize=True)
    @given(programs())
    def run(case: ProgramCase) -> None:
        ref, code = outcome(case)
        assert not code.startswith(("P", "R")), case
        assert ref.steps <= 5000, case
        outcomes[code] += 1

    run()
    assert outcomes["value"] > 130
    assert outcomes["X001"] > 0


@pytest.mark.slow
def test_every_feature_is_in_five_of_a_hundred_programs() -> None:
    """And many are searches."""
    found: Counter[str] = Counter()

    @seed(2015)
    @drawn(2000)
    @given(programs())
    def run(case: ProgramCase) -> None:
        found.update(features(case.script))

    run()
    assert [name for name in NAMED if found[name] < 20 * LEAST] == []
    assert found["search"] > 400


@pytest.mark.slow
def test_many_programs_run_in_the_database() -> None:
    ran = Counter(executor_outcome(program(Random(n).randbytes(DECISIONS)), "database") is None for n in range(400))
    assert ran[False] > ran.total() / 4


@pytest.mark.slow
def test_of_programs_that_may_fail_half_do_and_most_run_in_the_database() -> None:
    writer = FailingPrograms(Random("2015 failing"))
    cases = [writer.case() for _ in range(200)]
    outcomes = [limited_outcome(case, "native") for case in cases]
    legal = [n for n, found in enumerate(outcomes) if found is not None and not is_no_program(found)]
    failing = [n for n in legal if outcomes[n].error is not None]
    assert len(legal) / 4 < len(failing) < 3 * len(legal) / 4
    assert sum(limited_outcome(cases[n], "database") is not None for n in legal) > len(legal) / 2


# Laws between options


def search(machine: Machine, seed: bytes, options: str, level: int = 0, weight: str = "") -> Paths:
    """The paths of a search over the machine, as tuples; with a level every path stops there."""
    goal = machine.goals[seed[-1] % len(machine.goals)]
    stop = [machine.must_stop] if machine.must_stop else []
    stop += [f"level >= {level}"] if level else []
    connect = ", ".join(f"{name} = {text}" for name, text in machine.connect)
    start = ", ".join(f"{name} = {text}" for name, text in machine.start)
    ref = Reference(
        {name: LIBRARY[name][0]() for name in machine.uses},
        tables={"edges": [{"src": i % 4, "dst": (i * i + seed[i]) % 4, "far": seed[i] % 3} for i in range(6)]},
    )
    paths = ref.run(
        f"{machine.before} SELECT {', '.join(machine.row)}{weight} FROM {machine.sources} WHERE {goal} "
        f"START WITH {start}, level = 1 CONNECT BY {options} {connect}, level = level + 1 "
        f"{'STOP WITH ' + ' OR '.join(stop) if stop else ''} AS rows"
    )
    return [tuple(repr(row) for row in path) for path in paths]


@pytest.mark.parametrize("make", MACHINES)
@settings(max_examples=12, database=None, deadline=None)
@given(seed=BYTES)
def test_laws_between_options(make: Any, seed: bytes) -> None:
    machine = make(Choices(seed))
    level = 3
    everything = search(machine, seed, "", level)
    simple = search(machine, seed, "NO CYCLE", level)

    assert search(machine, seed, f"MEMORIZE {level}") == sorted(simple, key=len)
    assert [path for path in everything if path in simple] == simple
    assert search(machine, seed, "DEPTH FIRST", level) == everything
    assert search(machine, seed, "BREADTH FIRST", level) == sorted(everything, key=len)
    assert list(map(len, search(machine, seed, "COST 1", level))) == sorted(map(len, everything))
    orders = ("", "BREADTH FIRST", "COST level", "PROBABILITY 1 / level")
    for options in (*orders, "NO CYCLE", "UNIQUE", f"MEMORIZE {level}"):
        assert search(machine, seed, f"{options} MAXIMUM 2", level) == search(machine, seed, options, level)[:2]

    reached = {path[-1] for path in everything}
    for options in ("UNIQUE", "UNIQUE COST 1", "UNIQUE PROBABILITY 0.5"):
        ends = [path[-1] for path in search(machine, seed, options, level)]
        assert len(ends) == len(set(ends))
        assert set(ends) == reached


@pytest.mark.parametrize("make", MACHINES)
@settings(max_examples=12, database=None, deadline=None)
@given(seed=BYTES)
def test_laws_of_costs(make: Any, seed: bytes) -> None:
    machine = make(Choices(seed))
    cost = machine.costs[0]
    found = [(total(path), path) for path in search(machine, seed, f"COST {cost}", 4, f", {cost}")]
    assert [price for price, _ in found] == sorted(price for price, _ in found)

    best: dict[str, float] = {}
    for price, path in found:
        best.setdefault(path[-1], price)
    unique = {path[-1]: total(path) for path in search(machine, seed, f"UNIQUE COST {cost}", 0, f", {cost}")}
    assert all(unique[end] <= price for end, price in best.items())

    # Whatever follows a step costs 1 at least, so that 1 is a lower bound.
    lengths = [len(path) for path in search(machine, seed, "COST 1 HEURISTIC 1", 4)]
    assert lengths == [len(path) for path in search(machine, seed, "COST 1", 4)]


def total(path: tuple[str, ...]) -> float:
    """The cost of a path whose last column is the cost of a step."""
    return sum(eval(row)[-1] for row in path)

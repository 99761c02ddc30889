"""The cost of a step does not grow with the length of its path: chains with their one goal at the end."""

from __future__ import annotations

import cProfile
import pstats
from typing import Any

import apsw
import pytest

import ss2sql

CHAIN = """
SELECT n FROM [1] WHERE n == {length}
START WITH n = 1
CONNECT BY {option} n = n + 1
STOP WITH n == {length};
"""
OPTIONS = ["", "BREADTH FIRST", "UNIQUE"]


def run(length: int, option: str, engine: Any) -> ss2sql.Result:
    result = ss2sql.connect().run(CHAIN.format(length=length, option=option), engine=engine)
    assert result.engine == engine
    assert [len(path) for path in result.paths] == [length]
    assert result.stats.generated == length
    return result


def python_calls(length: int, option: str, engine: Any) -> int:
    """How many Python functions one run calls, C functions included."""
    profile = cProfile.Profile()
    profile.runcall(run, length, option, engine)
    return int(pstats.Stats(profile).total_calls)  # type: ignore[attr-defined]


def machine_steps(length: int, option: str) -> int:
    """How many instructions SQLite's virtual machine runs for the search."""
    ss = ss2sql.connect()
    steps: list[int] = []

    def note(event: dict[str, Any]) -> None:
        if "RECURSIVE" in event["sql"]:
            steps.append(event["stmt_status"]["SQLITE_STMTSTATUS_VM_STEP"])

    ss.host.connection.trace_v2(apsw.SQLITE_TRACE_PROFILE, note)
    assert len(ss.run(CHAIN.format(length=length, option=option), engine="database").paths) == 1
    return sum(steps)


@pytest.mark.parametrize("engine", ["database", "native"])
@pytest.mark.parametrize("option", OPTIONS)
def test_a_chain_twice_as_long_calls_twice_as_many_functions(option: str, engine: str) -> None:
    short, long = (python_calls(length, option, engine) for length in (10_000, 20_000))
    assert short > 10_000
    assert long < 2.05 * short


@pytest.mark.parametrize("option", OPTIONS)
def test_a_chain_twice_as_long_takes_sqlite_twice_as_many_steps(option: str) -> None:
    short, long = (machine_steps(length, option) for length in (10_000, 20_000))
    assert short > 10_000
    assert long < 2.05 * short

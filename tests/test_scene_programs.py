"""Random programs over a world and over copies of it give the same, on both engines and by the reference evaluator.

`SS2SQL_PROGRAMS` sets how many are tried, a twenty-fifth of it, by the seed `SS2SQL_SEED`.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable
from typing import Any

import pandas as pd
import polars as pl
import pytest
from agreement import EARLY, code_of, exact
from balls import BallWorld
from hypothesis import given, seed
from hypothesis import strategies as st
from programs.drawn import SEED, amount, drawn
from programs.library import LIBRARY
from programs.scenes import BALL, CALLED, DECISIONS, SceneCase, Stirring, over_copies, scene_program
from reference import Failure, Reference

import ss2sql

COUNT = amount(1 / 25)
FRAMES: tuple[Callable[..., Any], ...] = (pd.DataFrame, pl.DataFrame)
Outcome = tuple[str, Any]


def outcome(work: Callable[[], Any]) -> Outcome:
    """A value with the types of all parts, the code of an error, or the type of a user's exception."""
    try:
        with contextlib.redirect_stdout(io.StringIO()):
            return "value", exact(work())
    except ss2sql.Error as error:
        return "error", code_of(error)
    except Failure as failure:
        return "error", failure.code
    except Exception as error:
        return "error", type(error).__name__


def furnish(ss: ss2sql.Session, case: SceneCase) -> None:
    """What a program needs beside the world and the frame."""
    for name, function in case.functions().items():
        ss.function(name, function, volatility=LIBRARY[name][1])
    for name, value in case.variables.items():
        ss.attach(name, value)
    for name, rows in case.tables.items():
        ss.host.connection.execute(f"CREATE TABLE {name}({', '.join(rows[0])})")
        marks = ", ".join("?" * len(rows[0]))
        ss.host.connection.executemany(f"INSERT INTO {name} VALUES ({marks})", [tuple(r.values()) for r in rows])


def of_world(case: SceneCase, engine: Any) -> Outcome:
    """The whole script in one go, over the world."""
    stirring = Stirring(case)
    with ss2sql.connect() as ss:
        furnish(ss, case)
        ss.attach("space", BallWorld(stirring.box))
        ss.attach("frame", FRAMES[case.seed % len(FRAMES)](case.frame))
        ss.function("stir", stirring, volatility="volatile")
        kind, value = outcome(lambda: ss.run(case.script, engine=engine).value)
        return kind, with_names_of_copies(value)


def with_names_of_copies(value: Any) -> Any:
    """Columns are named by their texts, which mention the function of the world."""
    if isinstance(value, tuple):
        return tuple(map(with_names_of_copies, value))
    return over_copies(value) if isinstance(value, str) else value


def of_copies(case: SceneCase, engine: Any) -> Outcome:
    """Statement by statement, over copies that are made before each."""
    stirring = Stirring(case)
    with ss2sql.connect() as ss:
        furnish(ss, case)
        ss.attach("frame", case.frame)
        ss.function("stir", stirring, volatility="volatile")
        ss.function("near_space", stirring.near, volatility="stable")
        for name in CALLED:
            ss.function(name, column(name), volatility="stable")

        def work() -> Any:
            value = None
            for statement in case.copied:
                ss.attach("space", stirring.rows() or {name: [] for name in BALL})
                value = ss.run(statement, engine=engine).value
            return value

        return outcome(work)


def of_reference(case: SceneCase) -> Outcome:
    """The obvious evaluator, over a copy that is made anew whenever the world changes."""
    judge = Reference(case.functions(), {**case.variables, "frame": case.frame}, case.tables)

    def copied(_: Any = None) -> None:
        judge.variables["space"] = stirring.rows() or {name: [] for name in BALL}

    stirring = Stirring(case, copied)
    copied()
    judge.functions |= {"stir": stirring, "near_space": stirring.near, **{name: column(name) for name in CALLED}}
    return outcome(lambda: judge.run(";\n".join(case.copied)))


def column(name: str) -> Callable[[dict[str, Any]], Any]:
    return lambda row: row[name]


@pytest.mark.drawn
def test_programs_over_a_world_equal_those_over_copies() -> None:
    values = 0

    @seed(SEED)
    @drawn(COUNT)
    @given(st.binary(min_size=DECISIONS, max_size=DECISIONS).map(scene_program))
    def run(case: SceneCase) -> None:
        nonlocal values
        expected = of_reference(case)
        for engine in ("auto", "native"):
            for found in (of_world(case, engine), of_copies(case, engine)):
                assert found in (expected, ("error", EARLY)) or expected[0] == "error", case.script
        values += expected[0] == "value"

    run()
    assert values > COUNT / 2

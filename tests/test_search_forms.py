"""Searches whose functions give equal values in other forms: floats, tuples, arrays."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

import ss2sql

FORMS: dict[str, Callable[[int, int], Any]] = {
    "the same": lambda a, b: [a, b],
    "floats": lambda a, b: [float(a), b],
    "all floats": lambda a, b: [float(a), float(b)],
    "bools": lambda a, b: [True if a == 1 else a, b],
    "tuples": lambda a, b: (a, b),
    "arrays": lambda a, b: np.array([a, b]),
    "float arrays": lambda a, b: np.array([a, b], dtype=float),
    "scalars": lambda a, b: [np.int64(a), np.float32(b)],
    "mixed": lambda a, b: [a, b] if b else (float(a), b),
}
forms = pytest.mark.parametrize("form", list(FORMS))


def in_form(form: str) -> ss2sql.Session:
    """A session whose function `go` counts steps and notes the last element."""
    session = ss2sql.connect()
    session.function("go", lambda at, move: FORMS[form](int(at[0]) + 1, move), volatility="immutable")
    session.set("goal", [1, 2])
    session.set("far", [3, 2])
    return session


@pytest.mark.parametrize("option", ["", "BREADTH FIRST", "COST 1", "NO CYCLE", "BREADTH FIRST MAXIMUM 20"])
@forms
def test_a_goal_is_found_in_any_form(form: str, option: str, engine: Any) -> None:
    session = in_form(form)
    script = """SELECT at, this FROM [0, 1, 2] WHERE go(at, this) == {goal} START WITH at = [0, 0], level = 1
        CONNECT BY {option} at = go(at, this), level = level + 1 STOP WITH level == 3;"""
    for goal in ("far", "[3, 2]", "[3.0, 2]"):
        paths = session.run(script.format(goal=goal, option=option), engine=engine).paths
        assert [[row[1] for row in path] for path in paths] == [[a, b, 2] for a in range(3) for b in range(3)]
    paths = session.run(script.format(goal="goal", option=option), engine=engine).paths
    assert [[row[1] for row in path] for path in paths] == [[2]]


@pytest.mark.parametrize("option", ["", "BREADTH FIRST", "COST 1", "NO CYCLE"])
@forms
def test_a_stop_is_found_in_any_form(form: str, option: str, engine: Any) -> None:
    script = """SELECT this FROM [0, 2, 1] START WITH at = [0, 0], level = 1
        CONNECT BY {option} at = go(at, this), level = level + 1
        STOP WITH go(at, this) == {goal} OR level == 3 OR at == [1, 1];"""
    if option == "NO CYCLE":
        script = script.replace("SELECT this", "SELECT this, level")
    for goal in ("goal", "[1, 2]", "[1, 2.0]"):
        # What has gone on when level is 3 stops without a goal; so does the step with 2 at the start, and what is
        # behind a step with 1.
        wanted = {(0,), (1,)} | {(0, move) for move in (0, 2, 1)}
        result = in_form(form).run(script.format(goal=goal, option=option), engine=engine)
        assert {tuple(row[0] for row in path) for path in result.paths} == wanted
        assert len(result.paths) == len(wanted)


@forms
def test_another_form_is_no_reason_to_call_again(form: str, engine: Any) -> None:
    """The statement is run again when one turns up, with the calls that were made."""
    seen: list[tuple[Any, ...]] = []

    def go(at: list[int], move: int) -> Any:
        seen.append((repr(at), move))
        return FORMS[form](int(at[0]) + 1, move)

    session = ss2sql.connect()
    session.function("go", go, volatility="immutable")
    result = session.run(
        """SELECT this FROM [0, 1, 2] WHERE go(at, this) == [3, 2] START WITH at = [0, 0], level = 1
        CONNECT BY at = go(at, this), level = level + 1 STOP WITH level == 3;""",
        engine=engine,
    )
    assert len(result.paths) == 9
    assert len(seen) == len(set(seen)) == result.stats.calls["go"]


@pytest.mark.parametrize("order", ["", "DEPTH FIRST", "COST 1", "PROBABILITY 0.5"])
@forms
def test_rows_are_the_same_in_any_form(form: str, order: str, engine: Any) -> None:
    """Some steps give their row as ints and some in another form; equal rows are one."""
    session = ss2sql.connect()
    given = lambda at, move: FORMS["the same" if move % 2 else form]((int(at[0]) + move) % 3, 1)  # noqa: E731
    session.function("go", given, volatility="immutable")
    script = """SELECT go(at, this) FROM [1, 2, 4] START WITH at = [0, 1]
        CONNECT BY {order} {guard} at = go(at, this);"""
    paths = session.run(script.format(order=order, guard="UNIQUE"), engine=engine).paths
    assert sorted([*path[-1][0]] for path in paths) == [[0, 1], [1, 1], [2, 1]]
    # The next remainder is any one not on the path: elements 1 and 4 lead to the same one, 2 to the other.
    paths = session.run(script.format(order=order, guard="NO CYCLE"), engine=engine).paths
    wanted = sorted(
        [sum(chosen[:length]) % 3 for length in range(1, len(chosen) + 1)]
        for count in (1, 2, 3)
        for chosen in itertools.product([1, 2, 4], repeat=count)
        if len({sum(chosen[:length]) % 3 for length in range(1, count + 1)}) == count
    )
    assert sorted([int(row[0][0]) for row in path] for path in paths) == wanted

"""Searches whose functions give equal values in other forms: floats, tuples, arrays."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from reference import Reference

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
LEVELS = "START WITH at = [0, 0], level = 1 CONNECT BY {option} at = go(at, this), level = level + 1"
# What a search compares with a goal, with what stops, and as rows; the options that it goes by; and the goals.
SEARCHES: dict[str, tuple[str, tuple[str, ...], tuple[str, ...]]] = {
    "a goal": (
        f"SELECT at, this FROM [0, 1, 2] WHERE go(at, this) == {{goal}} {LEVELS} STOP WITH level == 3",
        ("", "BREADTH FIRST", "COST 1", "NO CYCLE", "BREADTH FIRST MAXIMUM 20"),
        ("far", "[3, 2]", "[3.0, 2]", "goal"),
    ),
    "a stop": (
        f"SELECT this, level FROM [0, 2, 1] {LEVELS} STOP WITH go(at, this) == {{goal}} OR level == 3 OR at == [1, 1]",
        ("", "BREADTH FIRST", "COST 1", "NO CYCLE"),
        ("goal", "[1, 2]", "[1, 2.0]"),
    ),
    "rows": (
        "SELECT turn(at, this) FROM [1, 2, 4] START WITH at = [0, 1] CONNECT BY {option} at = turn(at, this)",
        tuple(f"{order} {guard}" for order in ("", "DEPTH FIRST", "COST 1", "PROBABILITY 0.5")
              for guard in ("UNIQUE", "NO CYCLE")),
        ("",),
    ),
}  # fmt: skip


def functions(form: str) -> dict[str, Callable[..., Any]]:
    """`go` counts steps and notes the last element; `turn` counts from 0 again and again, in the form at some steps."""
    return {
        "go": lambda at, move: FORMS[form](int(at[0]) + 1, move),
        "turn": lambda at, move: FORMS["the same" if move % 2 else form]((int(at[0]) + move) % 3, 1),
    }


@pytest.mark.parametrize("what", SEARCHES)
@forms
def test_equal_values_are_the_same_in_any_form(form: str, what: str, engine: Any) -> None:
    """Paths are those of plain lists."""
    script, options, goals = SEARCHES[what]
    variables = {"goal": [1, 2], "far": [3, 2]}
    with ss2sql.connect() as ss:
        for name, function in functions(form).items():
            ss.function(name, function, volatility="immutable")
        for name, value in variables.items():
            ss.set(name, value)
        for option in options:
            for goal in goals:
                search = script.format(option=option, goal=goal)
                wanted = Reference(functions("the same"), variables).run(f"{search} AS rows")
                assert wanted
                assert ss.run(search, engine=engine).paths == wanted, search


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

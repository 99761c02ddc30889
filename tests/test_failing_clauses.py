"""Searches in which several clauses fail: both engines and the reference hear of the same one, at the same place.

Every order and rule for repeats meets every clause that fails, alone and with others, for a goal and for what is none.
"""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from typing import Any

import pytest
from agreement import Outcome, exact, judged
from reference import Reference

import ss2sql

OPTIONS = (
    "", "BREADTH FIRST", "UNIQUE", "NO CYCLE", "DEPTH FIRST UNIQUE", "COST 1", "COST 1 UNIQUE", "COST 1 NO CYCLE",
    "COST 1 / (node - 2)", "COST 1 HEURISTIC 'a' + 1", "COST 1 HEURISTIC 'a' + 1 UNIQUE", "COST 1 HEURISTIC node - 3",
    "PROBABILITY 0.5", "PROBABILITY 0.5 UNIQUE", "PROBABILITY 3 - node", "PROBABILITY 0 NO CYCLE",
)  # fmt: skip
SHOWN = ("1 / (node - 2)", "[this, 1 + text[7]]", "node")
GOALS = ("", "WHERE node > 1", "WHERE node > 5", "WHERE text[9] == 'a'")
NEXT = ("node = this, text = this + 'y'", "node = this, text = text", "node = 1 / (node - 2), text = text")
LATER = ("node = this, text = text[this - 6]", "node = node + this, text = text")
ENDS = ("GROUP BY 1 / (this - 7)", "ORDER BY 1 / (this - 8)", "ORDER BY this LIMIT 1 - 3", "GROUP BY this")
STOPS = ("node >= 4", "node >= 1", "text[8] == 'x'")


def engine_outcome(script: str, engine: Any) -> tuple[Outcome | None, int | None]:
    """What an engine makes of it, None where it refuses it, and where in the script it fails."""
    with ss2sql.connect() as session:
        try:
            return Outcome(exact(session.run(script, engine=engine, max_rows=1000).value)), 0
        except ss2sql.UnsupportedError:
            return None, 0
        except ss2sql.Error as error:
            return Outcome(error=error.code), error.span and error.span.start


def agree(scripts: Iterable[str]) -> int:
    """How many of them the database runs, too; all come to the same, those that fail at the same place."""
    in_database = 0
    for script in scripts:
        native, place = engine_outcome(script, "native")
        assert native == judged(Reference(), script), script
        found, where = engine_outcome(script, "database")
        assert found is None or (found, where) == (native, place), script
        in_database += found is not None
    return in_database


@pytest.mark.parametrize("most", ["", "MAXIMUM 1"])
@pytest.mark.parametrize("option", OPTIONS)
def test_the_first_clause_that_fails_shows(option: str, most: str) -> None:
    scripts = (
        f"SELECT {shown} FROM [7, 8] {goal} START WITH node = 2, text = 'x' "
        f"CONNECT BY {option} {most} {following} STOP WITH {stop} AS rows"
        for shown, goal, following, stop in product(SHOWN, GOALS, NEXT, STOPS)
    )
    assert agree(scripts) > 50


@pytest.mark.parametrize("option", OPTIONS)
def test_what_is_done_with_results_fails_after_the_steps(option: str) -> None:
    scripts = (
        f"SELECT {shown} FROM [7, 8] {goal} START WITH node = 2, text = 'xy' "
        f"CONNECT BY {option} {following} STOP WITH node > 14 {end} AS list"
        for shown, goal, following, end in product(SHOWN, GOALS, LATER, ENDS)
    )
    assert agree(scripts) > 50

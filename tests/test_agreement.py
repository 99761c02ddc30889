"""Three evaluators agree on random programs: the obvious one in tests/reference, SQLite, and the native one.

They come in parts of 1,000, each with a seed of its own, so that a difference in one part hides none in the next. Each
rewrite is switched off in turn, and queries stand inside of others in every clause.
"""

from __future__ import annotations

import contextlib
import io
from typing import Any

import pytest
from agreement import Outcome, exact, executor_outcome, is_allowed, reference_outcome, session_for, trial
from hypothesis import given, seed, settings
from hypothesis import strategies as st
from programs import ProgramCase, programs
from programs.drawn import SEED, amount, drawn
from reference import Reference
from replay import Replay, search_of
from sessions import ENGINES

import ss2sql
from ss2sql.errors import Source
from ss2sql.frontend.syntax.parser import parse
from ss2sql.lowering.rewrites import REWRITES

COUNT = amount()
PART = 1000


@pytest.mark.drawn
@pytest.mark.parametrize("part", range(-(-COUNT // PART)))
def test_three_evaluators_agree(part: int) -> None:
    @seed(SEED + part)
    @settings(drawn(min(PART, COUNT - part * PART)), report_multiple_bugs=False)
    @given(programs())
    def run(case: ProgramCase) -> None:
        assert trial(case).differences == []

    run()


@pytest.mark.drawn
def test_paths_of_random_searches_replay() -> None:
    replayed = 0

    @seed(SEED)
    @drawn(amount(1 / 4))
    @given(programs())
    def run(case: ProgramCase) -> None:
        nonlocal replayed
        script = parse(Source(case.script))
        search = search_of(script)
        if search is None or search.group or "MEMORIZE" in case.script or "volatile" in case.volatility.values():
            return  # behind a row of MEMORIZE stands the state of its first visit, which other paths did not have
        with session_for(case) as ss, contextlib.redirect_stdout(io.StringIO()):
            try:
                paths = ss.run(case.script).paths
            except Exception:  # whether it is the right error is asked above
                return
            replay = Replay(Reference(case.functions, case.variables, case.tables, case.volatility), script, search)
            assert all(replay.leads_to_a_goal(path) for path in paths)
        replayed += len(paths)

    run()
    assert replayed > 0


def test_a_search_from_both_ends_asks_nothing_of_steps_that_lead_to_no_goal() -> None:
    search = "START WITH n = 0 CONNECT BY COST -1 MEMORIZE 1 n = n + this AS list"
    asked = trial(ProgramCase(f"SELECT n + this FROM [1] WHERE n + this > 4 {search}"))
    spared = trial(ProgramCase(f"SELECT n + this FROM [1] WHERE n + this == 5 {search}"))
    assert asked.expected.error == spared.expected.error == "X006"
    assert asked.outcomes["native"] == asked.expected
    assert spared.outcomes["native"] == Outcome(exact([]))
    assert asked.differences == spared.differences == []


@pytest.mark.parametrize("shown", ["box(this)", "[1, [box(this)]]", "pair(box(this))"])
def test_what_has_no_hash_is_no_member_of_a_set(shown: str) -> None:
    tried = trial(ProgramCase(f"SELECT {shown} FROM [1, 2] AS set", uses=("box", "pair")))
    assert tried.expected.error == "V001"
    assert tried.differences == []


# --- rewrites change how a query is evaluated, never what it gives --------------------------------------


@pytest.mark.drawn
@seed(1)
@drawn(2 * amount(3 / 10))
@given(programs(), st.sampled_from(list(REWRITES)))
def test_random_programs_do_not_notice_a_rewrite(case: ProgramCase, switch: str) -> None:
    expected = reference_outcome(case)
    for engine in (*ENGINES, "auto"):
        assert is_allowed(executor_outcome(case, engine, disable=[switch]), expected, engine), (engine, switch)


# --- queries inside of others, in every clause ----------------------------------------------------------


VARIABLES: dict[str, Any] = {
    "people": [{"age": 7, "home": 1}, {"age": 8, "home": 2}, {"age": 9, "home": 1}],
    "pairs": [[1, 2], [2, 3], [2, 2]],
    "n": 1,
}
NUMBERS = (
    "n",
    "len(pairs)",
    "len(SELECT this FROM [[1, 2], [3, 3]] WHERE this[0] == this[1] AS list)",
    "max(SELECT this[1] FROM [[1, 2], [3, 3]] ORDER BY this[0] DESC LIMIT 1 AS list)",
    "(SELECT sum(this) FROM [1, 2, 2] GROUP BY this AS list)[0]",
    "len(SELECT a.this FROM a = [1, 2], b = [1, a.this] WHERE a.this == b.this LIMIT 2 AS list)",
    "IF(1 IN (SELECT this FROM [1, 2] AS list); 1; 2)",
    "(SELECT count(*) FROM people GROUP BY home HAVING count(*) > 1 AS list)[0]",
    "len(SELECT a.age, b.home FROM a = people, b = people WHERE a.home == b.home AND b.age == 9 AS rows)",
    "(SELECT u FROM (SELECT to(this[0], u) FROM [[2, 1], [1, 1]] WHERE 1 / this[1] > 0 LIMIT 1) AS list)[0]",
    "len(SELECT this FROM [1, 2] START WITH k = 0 CONNECT BY k = k + 1 STOP WITH k > 0 AS list)",
    "len(SELECT a.this FROM a = [1, 2, 3], b = [[1, 1], [2, 1]] WHERE b.this[0] == a.this AS list)",
    "(SELECT this[0] FROM pairs WHERE this[1] == 2 AS value)",
    "len(SELECT this FROM [n, 2, 3] WHERE this IN (SELECT this[1] FROM pairs AS list) AS list)",
)
QUERIES = (
    "SELECT this + {0} FROM [1, 2, 3] WHERE this >= {1} AS list",
    "SELECT this FROM [3, 1, 2] ORDER BY this % {0} LIMIT {1} AS list",
    "SELECT min(this % {0}), count(*) FROM [1, 2, 3] GROUP BY this % {0} HAVING count(*) >= {1} AS rows",
    "SELECT max(this + {0}) FROM [1, 2, 3] GROUP BY {1} AS list",
    "SELECT this, {0} FROM [1, 2, 3] GROUP BY this, {1} HAVING max(this) > {0} LIMIT {1} AS list",
    "SELECT [this, m] FROM [1, 2] START WITH m = {0} CONNECT BY m = m + {1} STOP WITH m > 3 AS list",
    "SELECT this FROM [1, 2] START WITH m = 0 CONNECT BY MAXIMUM ({0}) m = m + this STOP WITH m > {1} AS list",
    "SELECT this FROM [1, 2] WHERE m == {0} START WITH m = 0 CONNECT BY COST {1} m = m + this STOP WITH m > 2 AS list",
    "SELECT this FROM [1, 2] WHERE m >= {0} START WITH m = 0 CONNECT BY UNIQUE m = {1} STOP WITH m > 3 AS list",
    "SELECT this FROM [1, 2] START WITH m = 0 CONNECT BY MEMORIZE ({0}) m = m + {1} STOP WITH m > 3 AS list",
    "SELECT this FROM range({0}, 3 + {1}) AS list",
    "SELECT a.this, b.this FROM a = [1, 2], b = [{0}, a.this + {1}] AS rows",
    "SELECT a.this, b.this FROM a = [1, 2], b = [{0}, 1 / (3 - {1})] AS rows",
    "SELECT a.this, u FROM a = [1, 2], (SELECT to(this + {0}, u) FROM [1, 2] WHERE this >= {1} LIMIT 1) AS rows",
    "SELECT a.this, u FROM a = [1, 2], (SELECT to({0} / this, u) FROM [1, 2] WHERE 1 / (this - 3) < {1}) AS rows",
    "SELECT a.this FROM a = [1, 2, 3] WHERE a.this IN (SELECT this + {0} FROM [0, 1] WHERE this < {1} AS list) AS list",
    "SELECT (SELECT this FROM [1, 2, 3] LIMIT {0} AS list) FROM [1, 2] GROUP BY this, {1} AS list",
    "found = {0}; SELECT this + found FROM [1, 2] WHERE this > {1} - 1 AS list",
    "SELECT age FROM people START WITH p = {0} CONNECT BY NO CYCLE p = age - 6 STOP WITH p > {1} AS list",
    "SELECT age, sum(home) FROM people GROUP BY age HAVING sum(home) <= {0} ORDER BY age % ({1} + 1), age AS rows",
    "SELECT b.this[1] FROM a = pairs, b = pairs WHERE a.this[0] == b.this[1] AND b.this[0] >= {0} LIMIT {1} AS list",
)


@pytest.mark.parametrize("query", QUERIES)
def test_a_query_inside_means_the_same_in_every_clause(query: str) -> None:
    others = NUMBERS[5:] + NUMBERS[:5]
    for pair in zip(NUMBERS, others, strict=True):
        case = ProgramCase(query.format(*pair), VARIABLES)
        expected = reference_outcome(case)
        for engine in ("native", "database", "auto"):
            assert is_allowed(executor_outcome(case, engine), expected, engine), (case.script, engine)


def test_two_rows_are_enough_to_see_that_a_value_has_several(ss: ss2sql.Session, engine: Any) -> None:
    called: list[int] = []
    ss.function("noted", lambda x: called.append(x) or x, volatility="stable")
    with pytest.raises(ss2sql.ExecutionError, match="several rows"):
        ss.run("1 + (SELECT noted(this) FROM range(100))", engine=engine)
    assert called == [0, 1]

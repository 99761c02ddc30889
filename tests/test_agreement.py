"""Three evaluators agree on random programs: the obvious one in tests/reference, SQLite, and the native one.

They come in parts of 1,000, each with a seed of its own, so that a difference in one part hides none in the next.
"""

from __future__ import annotations

import contextlib
import io

import pytest
from agreement import Outcome, exact, executor_outcome, is_allowed, reference_outcome, session_for, trial
from hypothesis import given, seed, settings
from hypothesis import strategies as st
from programs import ProgramCase, features, programs
from programs.drawn import SEED, amount, drawn
from reference import Reference
from replay import Replay, search_of
from sessions import ENGINES

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


def test_a_path_is_replayed_up_to_an_element_that_fails() -> None:
    script = parse(
        Source("SELECT a.this, f(a.this) FROM a = [1, 2] START WITH n = 0 CONNECT BY MAXIMUM 1 n = n + a.this AS list")
    )
    search = search_of(script)
    assert search is not None

    def replay() -> Replay:
        return Replay(Reference({"f": lambda n: 1 // (2 - n)}, {}, {}, {}), script, search)

    assert replay().leads_to_a_goal([(1, 1)])
    assert not replay().leads_to_a_goal([(2, 1)])
    assert not replay().leads_to_a_goal([(1, 2)])


def test_a_path_is_replayed_past_an_element_that_stops_before_select_would_fail() -> None:
    script = parse(
        Source("SELECT f(a.this) FROM a = [0, 1] WHERE a.this > 0 START WITH n = 0 CONNECT BY n = 1 STOP WITH n == 0")
    )
    search = search_of(script)
    assert search is not None
    replay = Replay(Reference({"f": lambda n: 1 // n}, {}, {}, {}), script, search)
    assert replay.leads_to_a_goal([(1,)])


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


def test_every_feature_is_named() -> None:
    assert "UNIQUE" in " ".join(features("SELECT this FROM a START WITH b = 1 CONNECT BY UNIQUE b = this;")).upper()


# --- rewrites change how a query is evaluated, never what it gives --------------------------------------


@pytest.mark.drawn
@seed(1)
@drawn(2 * amount(3 / 10))
@given(programs(), st.sampled_from(list(REWRITES)))
def test_random_programs_do_not_notice_a_rewrite(case: ProgramCase, switch: str) -> None:
    expected = reference_outcome(case)
    for engine in (*ENGINES, "auto"):
        assert is_allowed(executor_outcome(case, engine, disable=[switch]), expected, engine), (engine, switch)

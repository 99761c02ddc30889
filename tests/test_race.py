"""The race: which strategies run, what rows tell, and what the language promises of two answers."""

from __future__ import annotations

from collections import Counter

import pytest
from agreement import session_for
from hypothesis import given, seed
from programs import ProgramCase, programs
from programs.drawn import drawn

import ss2sql
from ss2sql import plan
from ss2sql.errors import Source
from ss2sql.frontend import ast
from ss2sql.frontend.parser import parse
from ss2sql.race import Heat, Rules, heats, strategy_of
from ss2sql.race.cells import Cell
from ss2sql.race.jury import Finished, Jury
from ss2sql.race.lineup import Strategy, lineup
from ss2sql.race.named import unnamed, whims
from ss2sql.race.promises import Answer, compared, compared_rows
from ss2sql.runtime import executing, run

QUICK = Rules(repeat=1)


def search(options: str = "", tail: str = "") -> ast.Query:
    script = f"SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY {options} n = n + 1 STOP WITH n == 2 {tail};"
    (statement,) = parse(Source(script)).statements
    assert isinstance(statement, ast.Query)
    return statement


def names(options: str = "", longest: int | None = 3, tail: str = "") -> list[str]:
    return [strategy.name for strategy in lineup(search(options, tail), longest)]


# --- who takes part ------------------------------------------------------------------------------------


def test_a_search_without_options_is_raced_against_all_that_find_the_same_or_a_part_of_it() -> None:
    assert names() == [
        "BREADTH FIRST", "NO CYCLE", "BREADTH FIRST NO CYCLE", "UNIQUE", "DEPTH FIRST UNIQUE", "MEMORIZE 3",
    ]  # fmt: skip


def test_rows_that_a_search_does_not_repeat_stay_unrepeated() -> None:
    assert names("NO CYCLE") == ["BREADTH FIRST NO CYCLE", "UNIQUE", "DEPTH FIRST UNIQUE", "MEMORIZE 3"]
    assert names("UNIQUE") == ["DEPTH FIRST UNIQUE"]
    assert names("MEMORIZE 5") == ["UNIQUE", "DEPTH FIRST UNIQUE"]  # NO CYCLE would have no bound
    assert names("MEMORIZE") == ["NO CYCLE", "BREADTH FIRST NO CYCLE", "UNIQUE", "DEPTH FIRST UNIQUE"]


def test_costs_choose_the_results_where_these_are_cut() -> None:
    assert names("COST this HEURISTIC 0 UNIQUE") == ["COST this UNIQUE", "UNIQUE", "DEPTH FIRST UNIQUE"]
    assert names("COST this HEURISTIC 0 UNIQUE MAXIMUM 1") == ["COST this UNIQUE MAXIMUM 1"]
    assert names("COST this UNIQUE", tail="LIMIT 1") == []
    assert "COST this MEMORIZE 3" in names("COST this HEURISTIC 0")
    assert all("HEURISTIC" not in name for name in names("COST this HEURISTIC 0") if "MEMORIZE" in name)


def test_groups_do_not_go_with_rules_for_rows() -> None:
    assert names(tail="GROUP BY this") == ["BREADTH FIRST"]


def test_memorize_has_no_bound_where_no_longest_path_is_known() -> None:
    assert names(longest=None)[-1] == "MEMORIZE"


def test_strategies_that_a_user_writes() -> None:
    assert strategy_of("unique cost km  heuristic 2*x", ()).name == "COST km HEURISTIC 2*x UNIQUE"
    assert strategy_of("NO CYCLE UNIQUE", ()).repeats == "UNIQUE"
    own = search("MAXIMUM 4").options
    assert strategy_of("BREADTH FIRST", own).name == "BREADTH FIRST MAXIMUM 4"
    assert strategy_of("MAXIMUM 2", own).name == "DEPTH FIRST MAXIMUM 2"
    for wrong in ("NO", "UNIQUE x = 1", "UNIQUE x = 2; 7", "UNIQUE x = 1 STOP WITH True; 3"):
        with pytest.raises(ss2sql.Error):
            strategy_of(wrong, ())


# --- what rows tell ------------------------------------------------------------------------------------


def query(script: str) -> plan.Query:
    with ss2sql.connect() as ss:
        ss.function("roll", lambda: __import__("random").random(), volatility="volatile")
        ss.function("step", lambda x, y: x, volatility="immutable")
        expr = ss.compile(script).plan.statements[-1].expr
    assert isinstance(expr, plan.Subquery)
    return expr.query


@pytest.mark.parametrize(
    ("columns", "missing"),
    [
        ("this, at", ("n",)), ("this, at, n", ()), ("[at, this], n", ()), ("step(at, this)", ("this", "n")),
        ("step(at, this), n", ("this",)), ("step(at, this), at, n", ("this",)), ("1", ("n", "this", "at")),
    ],
)  # fmt: skip
def test_what_clauses_read_and_select_does_not_name(columns: str, missing: tuple[str, ...]) -> None:
    found = query(
        f"SELECT {columns} FROM [1, 2] WHERE this == 2 START WITH at = 0, n = 0 "
        "CONNECT BY at = step(at, this), n = n + 1 STOP WITH n == 3"
    )
    assert set(unnamed(found)) == set(missing)


def test_a_row_tells_what_is_computed_from_it() -> None:
    tail = "WHERE step(at, this) == 2 START WITH at = 0 CONNECT BY at = step(at, this) STOP WITH step(at, this) > 4"
    assert unnamed(query(f"SELECT step(at, this) FROM [1, 2] {tail}")) == ()
    table = "t = [1, 2]; SELECT this FROM (SELECT * FROM t WHERE this > at) WHERE this == 2 START WITH at = 0"
    assert unnamed(query(f"{table} CONNECT BY at = this")) == ()


def test_whims() -> None:
    assert whims(query("SELECT this FROM [1] WHERE roll() < 1")) == "roll is volatile"
    assert whims(query("SELECT this FROM [1] WHERE (n = this) > 0")) == "it assigns n"
    assert whims(query("SELECT this FROM [1]")) is None


# --- promises ------------------------------------------------------------------------------------------


def answer(options: str, *paths: str, cut: bool = False, bound: int | None = None) -> Answer:
    """An answer whose paths are words, each letter a row."""
    return Answer(strategy_of(options, ()), [[(row,) for row in path] for path in paths], bound, cut)


ALL = answer("DEPTH FIRST", "aba", "ab", "b", "bc")


@pytest.mark.parametrize(
    ("other", "words"),
    [
        (answer("BREADTH FIRST", "b", "ab", "bc", "aba"), "same, other order"),
        (answer("NO CYCLE", "ab", "b", "bc"), "3 of the 4, without repeated rows"),
        (answer("BREADTH FIRST NO CYCLE", "b", "ab", "bc"), "3 of the 4, without repeated rows"),
        (answer("MEMORIZE 2", "b", "ab", "bc", bound=2), "3 of the 4, without repeated rows"),
        (answer("PROBABILITY p", "ab", "b"), "2 of the 4, none of probability 0"),
    ],
)
def test_promised_differences(other: Answer, words: str) -> None:
    verdict = compared(ALL, other, ())
    assert (verdict.words, verdict.forbidden) == (words, False)
    assert verdict.same == words.startswith("same")


@pytest.mark.parametrize(
    "other",
    [
        answer("BREADTH FIRST", "b", "ab", "bc"),  # one is missing
        answer("BREADTH FIRST", "b", "ab", "bc", "aba", "aba"),  # one comes twice
        answer("BREADTH FIRST", "ab", "b", "bc", "aba"),  # a longer path before a shorter one
        answer("NO CYCLE", "aba", "ab", "b", "bc"),  # a row repeats
        answer("NO CYCLE", "ab", "b"),  # one is missing
        answer("NO CYCLE", "ab", "b", "bc", "c"),  # one that there is not
        answer("UNIQUE", "b", "ab", "bc"),  # b is reached twice
        answer("UNIQUE", "b", "ac"),  # no path of the default
        answer("UNIQUE", "b"),  # a and c are not reached
        answer("MEMORIZE 2", "ab", "b", "bc", bound=2),  # a longer path before a shorter one
        answer("MEMORIZE 1", "b", "ab", bound=1),  # longer than its bound
        answer("MEMORIZE 2", "b", "bc", bound=2),  # one is missing
        answer("PROBABILITY p", "ab", "b", "c"),  # one that there is not
    ],
)
def test_forbidden_differences(other: Answer) -> None:
    assert compared(ALL, other, ()).forbidden


def test_unique_is_one_of_the_paths_to_each_row() -> None:
    every = answer("DEPTH FIRST", "ab", "b", "abc", "bc")
    assert compared(every, answer("UNIQUE", "b", "bc"), ()).words == "2 of the 4, one for each row"
    assert compared(every, answer("DEPTH FIRST UNIQUE", "ab", "abc"), ()).words == "2 of the 4, one for each row"
    one, other = answer("UNIQUE", "b", "bc"), answer("DEPTH FIRST UNIQUE", "ab", "abc")
    assert compared(one, other, ()).words == "other paths to the same rows"
    assert compared(one, answer("DEPTH FIRST UNIQUE", "ab"), ()).forbidden
    assert compared(one, every, ()).words == "4 paths, as DEPTH FIRST finds more"


def test_what_select_does_not_name_excuses_memorize_and_unique() -> None:
    fewer = answer("MEMORIZE 3", "b", bound=3)
    assert compared(ALL, fewer, ()).forbidden
    assert compared(ALL, fewer, ("n",)).words == "1 path: SELECT does not name n"
    assert compared(ALL, answer("UNIQUE", "b"), ("n",)).words == "1 path: SELECT does not name n"
    assert compared(ALL, answer("UNIQUE", "b", "ac"), ("n",)).forbidden  # it is no path of the default at all
    assert compared(ALL, answer("NO CYCLE", "b"), ("n",)).forbidden


def test_answers_that_were_cut_have_as_many_paths() -> None:
    three = answer("DEPTH FIRST MAXIMUM 3", "aba", "ab", "b", cut=True)
    assert compared(three, answer("BREADTH FIRST MAXIMUM 3", "b", "ab", "bc", cut=True), ()).words == (
        "the first 3 paths of this order, 2 the same")  # fmt: skip
    assert compared(three, answer("BREADTH FIRST MAXIMUM 3", "b", "ab", cut=True), ()).forbidden
    assert not compared(three, answer("UNIQUE MAXIMUM 3", "b"), ()).forbidden


def test_rows_of_groups() -> None:
    assert compared_rows([("a", 1), ("b", 2)], [("b", 2), ("a", 1)]).words == "same, other order"
    assert compared_rows([("a", 1)], [("a", 2)]).forbidden
    assert not compared_rows([("a", 0.1)], [("a", 0.2)]).forbidden


# --- the jury ------------------------------------------------------------------------------------------


def finished(script: str, engine: str = "database", failure: str = "") -> Finished:
    with ss2sql.connect() as ss:
        result = None if failure else ss.run(script, engine="native")
        found = ss.compile(script).plan.statements[-1].expr
    assert isinstance(found, plan.Subquery)
    return Finished(Strategy(()), Cell("DEPTH FIRST", engine), found.query, result, failure)


def judged(whim: str | None, *several: Finished) -> Cell:
    jury = Jury("DEPTH FIRST", whim, ())
    for one in several:
        jury.judge(one)
    return several[-1].cell


def test_two_engines_have_to_agree_to_the_last_bit() -> None:
    ones = "SELECT this FROM [1, 1];"
    assert judged(None, finished(ones), finished(ones, "native")).answer == "same"
    for other in ("SELECT this FROM [1, 1.0];", "SELECT this FROM [True, 1];", "SELECT this FROM [1];"):
        cell = judged(None, finished(ones), finished(other, "native"))
        assert (cell.answer, cell.forbidden) == ("not what database gives", True)
    cell = judged("roll is volatile", finished(ones), finished("SELECT this FROM [2, 1];", "native"))
    assert (cell.answer, cell.forbidden) == ("not what database gives; roll is volatile", False)


def test_one_engine_must_not_fail_alone() -> None:
    ones = "SELECT this FROM [1, 1];"
    cell = judged(None, finished(ones), finished(ones, "native", "X002"))
    assert (cell.answer, cell.forbidden) == ("it fails in native and not so in database", True)
    assert not judged(None, finished(ones, failure="X002"), finished(ones, "native", "X002")).forbidden


# --- whole races ---------------------------------------------------------------------------------------


def raced(ss: ss2sql.Session, script: str, rules: Rules = QUICK) -> list[Heat]:
    found = []
    for heat in heats(ss, Source(script), rules):
        for _ in heat.run():
            pass
        found.append(heat)
    return found


def test_statements_between_the_searches_run_as_they_are() -> None:
    script = """
        start = 1;
        x = SELECT this FROM [start, 2] START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 2 AS list;
        y = len(x);
        SELECT this FROM [y] START WITH n = 0 CONNECT BY n = n + 1 STOP WITH n == 1 AS list;
        missing(1);
    """
    with ss2sql.connect() as ss:
        ss.function("missing", lambda x: x / 0)  # what comes behind the last search is not run
        first, second = raced(ss, script, Rules(repeat=1, strategies=("UNIQUE",)))
        assert ss.get("x") == [[1], [1, 1], [1, 2], [2], [2, 1], [2, 2]]  # not what UNIQUE gives
        assert ss.get("y") == 6
    assert [cell.name for cell in first.cells] == [
        "DEPTH FIRST in database", "DEPTH FIRST in native", "UNIQUE in database", "UNIQUE in native"]  # fmt: skip
    assert second.cells[0].paths == 1
    assert not first.forbidden + second.forbidden


def test_runs_find_the_variables_as_the_first_one_did() -> None:
    script = "n = 0; SELECT this FROM [1, 2, 3] WHERE (n = n + 1) < 3;"
    with ss2sql.connect() as ss:
        (heat,) = raced(ss, script, Rules(repeat=4))
    assert [cell.rows for cell in heat.cells if cell.missing is None] == [2]
    assert len(heat.cells[1].seconds) == 4


def test_a_search_inside_of_an_expression_races_engines_only() -> None:
    with ss2sql.connect() as ss:
        (heat,) = raced(ss, "len(SELECT this FROM [1] START WITH n = 0 CONNECT BY n = 1 STOP WITH n == 1 AS list);")
    assert [cell.strategy for cell in heat.cells] == ["", ""]
    assert "inside of another expression" in heat.notes[0]


def test_a_reference_that_did_not_finish_gives_way() -> None:
    script = "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY n = n + 1;"
    with ss2sql.connect() as ss:
        (heat,) = raced(
            ss, script, Rules(engines=("native",), strategies=("NO CYCLE", "UNIQUE"), repeat=1, timeout=0.1)
        )
    assert (heat.cells[0].missing or "").startswith("over 0.1 s")
    assert heat.reference == "NO CYCLE"
    assert [cell.paths for cell in heat.cells] == [None, 4, 2]
    assert heat.cells[2].answer == "2 of the 4, one for each row"


@pytest.mark.parametrize(
    ("limits", "missing"),
    [({"max_steps": 100}, "over 100 steps, "), ({"max_memory": 10**6}, "out of memory")],
    ids=["steps", "memory"],
)
def test_what_comes_up_against_a_limit_of_the_session_is_out_of_the_race(
    monkeypatch: pytest.MonkeyPatch, limits: dict[str, int], missing: str
) -> None:
    script = "SELECT n FROM [1, 2] START WITH n = 0 CONNECT BY n = n + this STOP WITH n >= 12;"
    monkeypatch.setattr(run, "LOOK_EVERY", 0.0)
    with ss2sql.connect(**limits) as ss:  # type: ignore[arg-type]
        if "max_memory" in limits:  # each look finds a megabyte more
            looks = iter(range(10**9))
            for module in (run, executing):
                monkeypatch.setattr(module, "memory_in_use", lambda: next(looks) * 2**20)
        (heat,) = raced(ss, script, Rules(engines=("native",), strategies=("DEPTH FIRST", "UNIQUE"), repeat=1))
    assert (heat.cells[0].missing or "").startswith(missing)
    if "max_steps" in limits:
        assert [cell.paths for cell in heat.cells] == [None, 12]


def test_random_programs_keep_their_promises() -> None:
    words: Counter[str] = Counter()

    @seed(6)
    @drawn(120)
    @given(programs())
    def run(case: ProgramCase) -> None:
        if "CONNECT BY" not in case.script:
            return
        with session_for(case) as ss:
            try:
                found = raced(ss, case.script, Rules(repeat=1, timeout=0.5))
            except Exception:  # the script itself fails
                return
        for heat in found:
            words.update(cell.answer.split(",")[0].lstrip("0123456789 ") for cell in heat.cells)
            assert [(cell.name, cell.answer) for cell in heat.forbidden] == []

    run()
    assert words["same"] > 30

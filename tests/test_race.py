"""The race: which strategies run, what rows tell, and what the language promises of two answers; and `ss2sql bench`."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import Any

import pandas
import pytest
from agreement import session_for
from click.testing import Result
from command_lines import call, moved_into
from golden import each_row
from hypothesis import given, seed
from programs import ProgramCase, programs
from programs.drawn import amount, drawn

import ss2sql
from ss2sql.bench import BenchRules, StatementRuns, make_runs, parse_strategy
from ss2sql.bench import runs as deciding
from ss2sql.bench.raced_strategies import list_strategies
from ss2sql.bench.runs import Answer, Verdict, compare_answer_groups, compare_answers, find_reason_answers_differ
from ss2sql.errors import Source
from ss2sql.frontend.syntax import ast
from ss2sql.frontend.syntax.parser import parse
from ss2sql.language import plan
from ss2sql.language.plan_traversal import describe_unnamed

QUICK = BenchRules(repeat=1)


def search(options: str = "", tail: str = "") -> ast.Query:
    script = f"SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY {options} n = n + 1 STOP WITH n == 2 {tail};"
    (statement,) = parse(Source(script)).statements
    assert isinstance(statement, ast.Query)
    return statement


def names(options: str = "", longest: int | None = 3, tail: str = "") -> list[str]:
    return [strategy.name for strategy in list_strategies(search(options, tail), longest)]


ROWS_ONCE = ["UNIQUE", "DEPTH FIRST UNIQUE"]


@pytest.mark.parametrize(
    ("options", "tail", "expected"),
    [
        ("", "", ["BREADTH FIRST", "NO CYCLE", "BREADTH FIRST NO CYCLE", *ROWS_ONCE, "MEMORIZE 3"]),
        # rows that a search does not repeat stay unrepeated
        ("NO CYCLE", "", ["BREADTH FIRST NO CYCLE", *ROWS_ONCE, "MEMORIZE 3"]),
        ("UNIQUE", "", ["DEPTH FIRST UNIQUE"]),
        ("MEMORIZE 5", "", ROWS_ONCE),  # NO CYCLE would have no bound
        ("MEMORIZE", "", ["NO CYCLE", "BREADTH FIRST NO CYCLE", *ROWS_ONCE]),
        # costs choose the results where these are cut
        ("COST this HEURISTIC 0 UNIQUE", "", ["COST this UNIQUE", *ROWS_ONCE]),
        ("COST this HEURISTIC 0 UNIQUE MAXIMUM 1", "", ["COST this UNIQUE MAXIMUM 1"]),
        ("COST this UNIQUE", "LIMIT 1", []),
        # groups do not go with rules for rows
        ("", "GROUP BY this", ["BREADTH FIRST"]),
    ],
)
def test_who_takes_part(options: str, tail: str, expected: list[str]) -> None:
    """All that find the same as the search that was written, or a part of it."""
    assert names(options, tail=tail) == expected


def test_memorize_takes_part_without_a_heuristic_and_needs_a_longest_path_for_its_bound() -> None:
    assert "COST this MEMORIZE 3" in names("COST this HEURISTIC 0")
    assert all("HEURISTIC" not in name for name in names("COST this HEURISTIC 0") if "MEMORIZE" in name)
    assert names(longest=None)[-1] == "MEMORIZE"


def test_strategies_that_a_user_writes() -> None:
    assert parse_strategy("unique cost km  heuristic 2*x", ()).name == "COST km HEURISTIC 2*x UNIQUE"
    assert parse_strategy("NO CYCLE UNIQUE", ()).repeats == "UNIQUE"
    own = search("MAXIMUM 4").options
    assert parse_strategy("BREADTH FIRST", own).name == "BREADTH FIRST MAXIMUM 4"
    assert parse_strategy("MAXIMUM 2", own).name == "DEPTH FIRST MAXIMUM 2"
    for wrong in ("NO", "UNIQUE x = 1", "UNIQUE x = 2; 7", "UNIQUE x = 1 STOP WITH True; 3"):
        with pytest.raises(ss2sql.Error):
            parse_strategy(wrong, ())


def query(script: str) -> plan.Query:
    with ss2sql.connect() as ss:
        ss.function("roll", lambda: __import__("random").random(), volatility="volatile")
        ss.function("step", lambda x, y: x, volatility="immutable")
        expr = ss.compile(script).plan.statements[-1].expr
    assert isinstance(expr, plan.Subquery)
    return expr.query


@each_row("search/unnamed", "script", "told")
def test_what_clauses_read_and_select_does_not_name(script: str, told: str) -> None:
    assert (", ".join(sorted(describe_unnamed(query(script)))) or "nothing") == told


def test_whims() -> None:
    assert find_reason_answers_differ(query("SELECT this FROM [1] WHERE roll() < 1")) == "roll is volatile"
    assert find_reason_answers_differ(query("SELECT this FROM [1] WHERE (n = this) > 0")) == "it assigns n"
    assert find_reason_answers_differ(query("SELECT this FROM [1]")) is None


def answer(options: str, *paths: str, cut: bool = False) -> Answer:
    """An answer whose paths are words, each letter a row."""
    return Answer(parse_strategy(options, ()), [[(row,) for row in path] for path in paths], cut)


ALL = answer("DEPTH FIRST", "aba", "ab", "b", "bc")
EVERY = answer("DEPTH FIRST", "ab", "b", "abc", "bc")
ONE = answer("UNIQUE", "b", "bc")
THREE = answer("DEPTH FIRST MAXIMUM 3", "aba", "ab", "b", cut=True)


@pytest.mark.parametrize(
    ("one", "other", "unnamed", "words"),
    [
        (ALL, answer("BREADTH FIRST", "b", "ab", "bc", "aba"), (), "same, other order"),
        (ALL, answer("NO CYCLE", "ab", "b", "bc"), (), "3 of the 4"),
        (ALL, answer("BREADTH FIRST NO CYCLE", "b", "ab", "bc"), (), "3 of the 4"),
        (ALL, answer("MEMORIZE 2", "b", "ab", "bc"), (), "3 of the 4"),
        (ALL, answer("PROBABILITY p", "ab", "b"), (), "2 of the 4"),
        # UNIQUE is one of the paths to each row
        (EVERY, ONE, (), "2 of the 4"),
        (EVERY, answer("DEPTH FIRST UNIQUE", "ab", "abc"), (), "2 of the 4"),
        (ONE, answer("DEPTH FIRST UNIQUE", "ab", "abc"), (), "other paths"),
        (answer("DEPTH FIRST UNIQUE", "ab", "abc"), answer("MEMORIZE 2", "b", "bc"), (), "other paths"),
        (ONE, EVERY, (), "4 paths"),
        # what SELECT does not name excuses MEMORIZE and UNIQUE
        (ALL, answer("MEMORIZE 3", "b"), ("n",), "1 path: SELECT does not name n"),
        (ALL, answer("UNIQUE", "b"), ("n",), "1 path: SELECT does not name n"),
        # answers that were cut have as many paths
        (THREE, answer("BREADTH FIRST MAXIMUM 3", "b", "ab", "bc", cut=True), (),
         "the first 3 paths of this order, 2 the same"),
        (THREE, answer("UNIQUE MAXIMUM 3", "b"), (), "the first 1 path of this order, 1 the same"),
    ],
)  # fmt: skip
def test_promised_differences(one: Answer, other: Answer, unnamed: tuple[str, ...], words: str) -> None:
    verdict = compare_answers(one, other, unnamed)
    assert (verdict.words, verdict.same) == (words, words.startswith("same"))


def test_rows_of_groups() -> None:
    assert compare_answer_groups([("a", 1)], [("a", 1)]).words == "same"
    assert compare_answer_groups([("a", 1), ("b", 2)], [("b", 2), ("a", 1)]).words == "same, other order"
    assert compare_answer_groups([("a", 1)], [("a", 2)]).forbidden
    assert not compare_answer_groups([("a", 0.1)], [("a", 0.2)]).forbidden


def raced(ss: ss2sql.Session, script: str, rules: BenchRules = QUICK) -> list[StatementRuns]:
    found = []
    for heat in make_runs(ss, Source(script), rules):
        heat.run_strategies()
        found.append(heat)
    return found


@pytest.mark.parametrize(
    ("given", "answer", "forbidden"),
    [({"native": 1}, "same", False),
     *(({"native": other}, "not what database gives", True) for other in (1.0, True, 2)),
     ({}, "it fails in native and not so in database", True)],
)  # fmt: skip
def test_two_engines_have_to_agree_to_the_last_bit(given: dict[str, Any], answer: str, forbidden: bool) -> None:
    """And none must fail alone; here a function answers otherwise in each."""
    answers = {"database": 1, **given}
    with ss2sql.connect() as ss:
        ss.function("roll", lambda x: answers[heat.cells[-1].engine], volatility="immutable")
        (heat,) = make_runs(ss, Source("SELECT roll(this) FROM [1];"), QUICK)
        heat.run_strategies()
    assert [(cell.answer, cell.forbidden) for cell in heat.cells[1:]] == [(answer, forbidden)]


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
        first, second = raced(ss, script, BenchRules(repeat=1, strategies=("UNIQUE",)))
        assert ss.get("x") == [[1], [1, 1], [1, 2], [2], [2, 1], [2, 2]]  # not what UNIQUE gives
        assert ss.get("y") == 6
    assert [cell.name for cell in first.cells] == [
        "DEPTH FIRST in database", "DEPTH FIRST in native", "UNIQUE in database", "UNIQUE in native"]  # fmt: skip
    assert second.cells[0].paths == 1
    assert not first.forbidden + second.forbidden


def test_runs_find_the_variables_as_the_first_one_did() -> None:
    script = "n = 0; SELECT this FROM [1, 2, 3] WHERE (n = n + 1) < 3;"
    with ss2sql.connect() as ss:
        (heat,) = raced(ss, script, BenchRules(repeat=4))
    assert [cell.rows for cell in heat.cells if cell.missing is None] == [2]
    assert len(heat.cells[1].seconds) == 4


def test_files_race_in_the_database_too(folder: Path) -> None:
    """Types of columns are known to the race as they are to a run."""
    pandas.DataFrame({"g": ["a", "a", "b"], "x": [1.0, 2.0, 3.0]}).to_parquet(folder / "readings.parquet")
    with ss2sql.connect() as ss:
        ss.attach("readings", folder / "readings.parquet")
        (heat,) = raced(ss, "SELECT g, max(x) FROM readings GROUP BY g;")
    assert [(cell.missing, cell.rows) for cell in heat.cells] == [(None, 2), (None, 2)]


def test_a_search_inside_of_an_expression_races_engines_only() -> None:
    with ss2sql.connect() as ss:
        (heat,) = raced(ss, "len(SELECT this FROM [1] START WITH n = 0 CONNECT BY n = 1 STOP WITH n == 1 AS list);")
    assert [cell.strategy for cell in heat.cells] == ["", ""]
    assert "inside of another expression" in heat.notes[0]


def test_a_reference_that_did_not_finish_gives_way() -> None:
    script = "SELECT this FROM [1, 2] START WITH n = 0 CONNECT BY n = n + 1;"
    with ss2sql.connect() as ss:
        (heat,) = raced(
            ss, script, BenchRules(engines=("native",), strategies=("NO CYCLE", "UNIQUE"), repeat=1, timeout=0.1)
        )
    assert (heat.cells[0].missing or "").startswith("over 0.1 s")
    assert heat.reference is not None
    assert heat.reference.cell.strategy == "NO CYCLE"
    assert [cell.paths for cell in heat.cells] == [None, 4, 2]
    assert heat.cells[2].answer == "2 of the 4"


@pytest.mark.parametrize(
    ("limits", "missing"), [({"max_steps": 100}, "over 100 steps, "), ({"max_memory": 10**6}, "out of memory")]
)
def test_what_comes_up_against_a_limit_of_the_session_is_out_of_the_race(limits: Any, missing: str) -> None:
    stop = "STOP WITH n >= 12" if "max_steps" in limits else ""
    script = f"SELECT n FROM [1, 2] START WITH n = 0 CONNECT BY n = n + this {stop};"
    with ss2sql.connect(**limits) as ss:
        (heat,) = raced(ss, script, BenchRules(engines=("native",), strategies=("DEPTH FIRST", "UNIQUE"), repeat=1))
    assert (heat.cells[0].missing or "").startswith(missing)
    if "max_steps" in limits:
        assert [cell.paths for cell in heat.cells] == [None, 12]


@pytest.mark.drawn
@seed(6)
@drawn(amount(1 / 8))
@given(programs())
def test_random_programs_keep_their_promises(case: ProgramCase) -> None:
    if "CONNECT BY" not in case.script:
        return
    with session_for(case) as ss:
        try:
            found = raced(ss, case.script, BenchRules(repeat=1, timeout=0.5))
        except Exception:  # the script itself fails
            return
    for heat in found:
        assert [(cell.name, cell.answer) for cell in heat.forbidden] == []


ROADS = """
roads = [["A", "B", 4], ["A", "C", 1], ["C", "B", 2], ["B", "A", 4], ["B", "D", 5], ["C", "D", 8]];
SELECT this[0], this[1] FROM (SELECT this FROM roads WHERE this[0] == town AS list) WHERE this[1] == "D"
START WITH town = "A", n = 1
CONNECT BY town = this[1], n = n + 1
STOP WITH  n == 5
AS list;
"""
PAGE = Path(__file__).parent.parent / "docs" / "bench_command.md"


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    return moved_into(tmp_path, monkeypatch, {"roads.ss": ROADS})


def bench(*arguments: str) -> Result:
    return call("bench", *arguments)


def rows(text: str) -> list[list[str]]:
    """The cells of a table, by the places of its headings; names that stand only once are filled in."""
    lines = text.splitlines()
    heading = next(line for line in lines if "best ms" in line)
    ends = [match.end() for match in re.finditer(r"\S+(?: \S+)*", heading)]
    starts = [0, heading.index("engine"), *ends[1:-1]]
    starts[-1] = heading.index("answer")
    body = lines[lines.index(heading) + 2 :]
    found: list[list[str]] = []
    for line in body:
        if not line[starts[1] :].startswith(("database", "native")):
            if line.startswith(("Fastest", "Not run")):
                break
            continue
        engine_end = starts[1] + len("database")
        strategy, engine = line[: starts[1]].strip() or found[-1][0], line[starts[1] : engine_end].strip()
        found.append([strategy, engine, *line[engine_end : starts[-1]].split(), line[starts[-1] :].strip()])
    return found


def test_times_in_the_table() -> None:
    answer = bench("roads.ss", "--repeat", "2", "--timeout", "60")
    assert (answer.exit_code, answer.stderr) == (0, "")
    told = " ".join(answer.stdout.split())
    assert "Not run: MEMORIZE 5 in database: MEMORIZE builds a graph in memory, so it runs natively." in told
    for _, _, *cells in rows(answer.stdout):
        if len(cells) > 1:
            best, middle, ratio = (float(cell.replace(",", "")) for cell in cells[:3])
            assert 0 < best <= middle
            assert ratio >= 1


def test_engines_and_strategies_are_chosen() -> None:
    answer = bench("roads.ss", *shlex.split("--engine native --strategy unique --strategy 'cost this[2]' --repeat 1"))
    assert [row[:2] for row in rows(answer.stdout)] == [
        ["DEPTH FIRST", "native"], ["UNIQUE", "native"], ["COST this[2]", "native"]]  # fmt: skip


def test_figures_as_json(folder: Path) -> None:
    answer = bench("roads.ss", "--repeat", "2", "--json", "race.json")
    assert answer.stderr.splitlines() == ["written to race.json"]
    told = json.loads((folder / "race.json").read_text())
    (heat,) = told["statements"]
    assert (told["repeat"], heat["place"], heat["reference"]) == (2, "roads.ss:3:1", "DEPTH FIRST")
    first = heat["cells"][0]
    assert (first["strategy"], first["engine"], first["paths"], first["rows"]) == ("DEPTH FIRST", "database", 8, 30)
    assert first["best"] == min(first["seconds"])
    assert len(first["seconds"]) == 2
    assert min(cell["ratio"] for cell in heat["cells"] if cell["ratio"]) == 1
    (folder / "f.py").write_text("def f(x):\n    return divmod(x, 3)[0]\n")
    bench("-e", "SELECT f(this) FROM [1, 2, 3, 3];", "--functions", "f.py", "--json", "race.json", "--repeat", "1")
    cells = json.loads((folder / "race.json").read_text())["statements"][0]["cells"]
    assert [cell["calls"] for cell in cells] == [{"f": 3}, {"f": 3}]  # immutable: the second 3 is remembered


def test_an_answer_that_the_language_forbids_is_loud(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(deciding, "compare_answers", lambda *answers: Verdict("1 path too many", True))
    answer = bench("roads.ss", "--strategy", "NO CYCLE", "--engine", "native", "--repeat", "1")
    assert answer.exit_code == 1
    assert "FORBIDDEN" in answer.stdout
    assert "roads.ss:3:1: NO CYCLE in native: 1 path too many" in answer.stderr


@pytest.mark.parametrize(
    ("arguments", "code", "told"),
    [("-e '1 + 1;'", 1, "the script has no query"), ("-e 'SELECT this FROM nowhere;'", 1, "error[R003]"),
     ("-e 'SELECT 1 / this FROM [0];'", 1, "error[X002]"), ("roads.ss --strategy NO", 2, "Usage:"),
     ("roads.ss --repeat 0", 2, "Usage:"), ("-e 'SELECT bad(this) FROM [0];' --functions bad.py", 1, "TypeError")],
)  # fmt: skip
def test_how_it_ends_otherwise(arguments: str, code: int, told: str, folder: Path) -> None:
    (folder / "bad.py").write_text("def bad(x):\n    return x[0]\n")
    answer = bench(*shlex.split(arguments))
    assert answer.exit_code == code
    assert told in answer.stderr


def test_what_a_script_prints_is_not_seen() -> None:
    answer = bench("-e", "SELECT print('loud') FROM [1];", "--repeat", "1")
    assert "loud\n" not in answer.stdout + answer.stderr


def test_the_table_of_the_page() -> None:
    """All but the times is what the commands of the page print."""
    text = PAGE.read_text("utf-8")
    for name, body in re.findall(r"```\w+\n# file: (\S+)\n(.*?)```", text, re.DOTALL):
        Path(name).write_text(body)
    shown = re.findall(r"```sh\nss2sql bench (.*?)\n```\n\n```text\n(.*?)```", text, re.DOTALL)
    assert shown
    for command, table in shown:
        answer = bench(*shlex.split(command), "--repeat", "1")
        ours, theirs = ([[*row[:2], *row[5:]] for row in rows(printed)] for printed in (table, answer.stdout))
        assert ours == theirs

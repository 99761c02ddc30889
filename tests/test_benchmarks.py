"""The problems of benchmarks/: all contenders agree, and the table leaves nothing out."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))

import compare
import worker
from problems import PROBLEMS, tables
from problems.base import COMPILING

BENCHMARKS = Path(__file__).parents[1] / "benchmarks"


@pytest.fixture(scope="module", autouse=True)
def _tables_of_its_own(tmp_path_factory):
    before, tables.FOLDER = tables.FOLDER, tmp_path_factory.mktemp("tables")
    yield
    tables.FOLDER = before


def answers(problem):
    """What each contender that can run here makes of the smallest size."""
    found = {}
    for contender in problem.contenders:
        try:
            work = worker.prepare(problem, problem.tiny, contender)
        except (worker.MissingError, worker.RefusedError):
            continue
        found[contender] = worker.short(work.answer(work.run()))
    return found


FAMILIES = {problem.name.split("-")[0]: problem.name for problem in reversed(PROBLEMS.values())}


@pytest.mark.parametrize(
    "problem",
    [pytest.param(problem, id=name, marks=() if name in FAMILIES.values() else pytest.mark.slow)
     for name, problem in PROBLEMS.items()],
)  # fmt: skip
def test_all_contenders_give_the_same_answer(problem):
    """Of each family of problems, the first is tried always, and the others with the slow tests."""
    found = answers(problem)
    assert len(set(found.values())) == 1, found
    assert "native" in found or COMPILING in found


def record(contender, seconds=None, answer="1", status="ok", problem="reach", size=100_000):
    made = {"problem": problem, "size": size, "contender": contender, "status": status, "reason": "because"}
    return made if seconds is None else made | {"seconds": seconds, "cpu": seconds, "answer": answer}


def test_the_table_shows_ratios_words_and_targets():
    records = [record("database", 3.0), record("native", status="refused"), record("python", 2.0), record("sql", 4.0),
               record("igraph", status="missing")]  # fmt: skip
    heads, rows = compare.ratio_rows(records)
    shown = dict(zip(heads, rows[0], strict=True))
    assert shown["Python, ms"] == "2,000"
    assert (shown["database"], shown["native"], shown["SQL"], shown["igraph"]) == ("1.5", "refused", "2", "missing")
    assert shown["networkx"] == "not run"
    assert shown["target"] == "database 1.3 missed, database 1.5 x SQL met"
    assert len(compare.reasons(records)) == 2
    small = [record("database", 3.0, size=10), record("python", 2.0, size=10)]
    assert compare.ratio_rows(small)[1][0][-1] == ""  # a target counts from its size on


def test_one_measurement_runs_in_a_process():
    command = [sys.executable, str(BENCHMARKS / "worker.py"), "jugs", "5", "python", "1", "0.01"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=60)
    found = json.loads(done.stdout)
    assert found["status"] == "ok"
    assert found["seconds"] > 0
    assert found["answer"] == "[6]"


def test_means_are_those_of_the_largest_sizes():
    small = [record("database", 9.0, size=10), record("python", 1.0, size=10)]
    large = [record("database", 8.0) | {"auto": "native"}, record("native", 1.0), record("python", 2.0)]
    other = [record(name, 1.0, problem="jugs") | {"auto": "database"} for name in ("database", "python")]
    records = small + large + other
    assert compare.means(records) == {
        "auto": (pytest.approx(0.5**0.5), 2), "database": (pytest.approx(2.0), 2), "native": (pytest.approx(0.5), 1)
    }  # fmt: skip

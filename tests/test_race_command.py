"""`ss2sql bench`: its table, its files and how it ends."""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from command_lines import moved_into

from ss2sql.cli import main
from ss2sql.race import jury
from ss2sql.race.promises import Verdict

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
    answer = CliRunner().invoke(main, ["bench", *arguments], env={"COLUMNS": "100"})
    if answer.exception is not None and not isinstance(answer.exception, SystemExit):
        raise answer.exception
    return answer


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
        cells = [
            line[: starts[1]].strip(),
            line[starts[1] : engine_end].strip(),
            *line[engine_end : starts[-1]].split(),
        ]
        found.append([cells[0] or found[-1][0], *cells[1:], line[starts[-1] :].strip()])
    return found


def test_the_table() -> None:
    answer = bench("roads.ss", "--repeat", "2", "--timeout", "60")
    assert answer.exit_code == 0
    assert answer.stderr == ""
    found = {(row[0], row[1]): row[2:] for row in rows(answer.stdout)}
    # ABABD ABACBD ABACD ABD ACBABD ACBACD ACBD ACD, on two of which a road is taken twice; D is reached by two roads
    assert found["DEPTH FIRST", "database"][3] == "8"
    assert found["DEPTH FIRST", "database"][-1] == "as written"
    assert found["DEPTH FIRST", "native"][-1] == "same"
    assert found["BREADTH FIRST", "database"][-1] == "same, other order"
    assert found["NO CYCLE", "native"][3] == "6"
    assert found["UNIQUE", "native"][3] == "2"
    assert found["MEMORIZE 5", "database"] == ["not run"]
    assert "Not run: MEMORIZE 5 in database: MEMORIZE builds a graph in memory, so it runs natively." in " ".join(
        answer.stdout.split()
    )
    for cells in found.values():
        if len(cells) > 1:
            best, middle, ratio = (float(cell.replace(",", "")) for cell in cells[:3])
            assert 0 < best <= middle
            assert ratio >= 1


def test_engines_and_strategies_are_chosen() -> None:
    answer = bench(
        "roads.ss", "--engine", "native", "--strategy", "unique", "--strategy", "cost this[2]", "--repeat", "1"
    )
    assert [row[:2] for row in rows(answer.stdout)] == [
        ["DEPTH FIRST", "native"], ["UNIQUE", "native"], ["COST this[2]", "native"]]  # fmt: skip


def test_figures_as_json_and_a_picture(folder: Path) -> None:
    pytest.importorskip("matplotlib")
    answer = bench("roads.ss", "--repeat", "2", "--memory", "--json", "race.json", "-o", "race.png")
    assert answer.stderr.splitlines() == ["written to race.json", "written to race.png"]
    told = json.loads((folder / "race.json").read_text())
    (heat,) = told["statements"]
    assert (told["repeat"], heat["place"], heat["reference"]) == (2, "roads.ss:3:1", "DEPTH FIRST")
    first = heat["cells"][0]
    assert (first["strategy"], first["engine"], first["paths"], first["rows"]) == ("DEPTH FIRST", "database", 8, 30)
    assert first["best"] == min(first["seconds"])
    assert len(first["seconds"]) == 2
    assert first["memory"] > 0
    assert min(cell["ratio"] for cell in heat["cells"] if cell["ratio"]) == 1
    assert (folder / "race.png").read_bytes().startswith(b"\x89PNG")


def test_calls_are_counted(folder: Path) -> None:
    (folder / "f.py").write_text("def f(x):\n    return divmod(x, 3)[0]\n")
    bench("-e", "SELECT f(this) FROM [1, 2, 3, 3];", "--functions", "f.py", "--json", "race.json", "--repeat", "1")
    cells = json.loads((folder / "race.json").read_text())["statements"][0]["cells"]
    assert [cell["calls"] for cell in cells] == [{"f": 3}, {"f": 3}]  # immutable: the second 3 is remembered


def test_an_answer_that_the_language_forbids_is_loud(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(jury, "compared", lambda *answers: Verdict("1 path too many", True))
    answer = bench("roads.ss", "--strategy", "NO CYCLE", "--engine", "native", "--repeat", "1")
    assert answer.exit_code == 1
    assert "FORBIDDEN" in answer.stdout
    assert "roads.ss:3:1: NO CYCLE in native: 1 path too many" in answer.stderr


def test_how_it_ends_otherwise(folder: Path) -> None:
    assert bench("-e", "1 + 1;").exit_code == 1
    assert "the script has no query" in bench("-e", "1 + 1;").stderr
    assert bench("-e", "SELECT this FROM nowhere;").exit_code == 1
    assert "error[X002]" in bench("-e", "SELECT 1 / this FROM [0];").stderr
    assert bench("roads.ss", "--strategy", "NO").exit_code == 2
    assert bench("roads.ss", "--repeat", "0").exit_code == 2
    (folder / "bad.py").write_text("def bad(x):\n    return x[0]\n")
    answer = bench("-e", "SELECT bad(this) FROM [0];", "--functions", "bad.py")
    assert answer.exit_code == 1
    assert "TypeError" in answer.stderr


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

"""Lists, completion and pictures on the command line."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
from click.shell_completion import ShellComplete
from command_lines import ENDLESS, FUNCTIONS, bad, call, good

from ss2sql.cli import COMMANDS, main
from ss2sql.cli.completion import SHELLS
from ss2sql.cli.listing import TOPICS
from ss2sql.cli.plot import KINDS as KINDS_OF_OPTION
from ss2sql.cli.run import ENGINES as ENGINES_OF_OPTION
from ss2sql.errors import CODES
from ss2sql.lowering.strategies import GUARDS, ORDERS
from ss2sql.results.plots import KINDS
from ss2sql.runtime.builtins import BUILTINS
from ss2sql.runtime.engines import ENGINES
from ss2sql.runtime.representations import ALL
from ss2sql.runtime.session import SWITCHES
from ss2sql.vtables import known_types


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "functions.py").write_text(FUNCTIONS)
    return tmp_path


# --- lists ---------------------------------------------------------------------------------------------


def listed(*arguments: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = json.loads(call("list", *arguments, "--format", "json").stdout)
    return found


def names(topic: str) -> set[str]:
    return {entry["name"] for entry in listed(topic)}


def test_lists_are_complete() -> None:
    assert names("functions") == set(BUILTINS)
    assert names("representations") == set(ALL)
    strategies = {order.keyword for order in ORDERS.values()} | {guard.keyword for guard in GUARDS.values()}
    assert names("strategies") == strategies - {""} | {"(none)"}
    assert names("worlds") == set(known_types())
    assert names("errors") == set(CODES)
    assert names("rewrites") == set(SWITCHES)
    assert {entry["name"] for entry in listed()} == set(TOPICS)


@pytest.mark.parametrize("topic", TOPICS)
def test_every_entry_is_told_in_a_line(topic: str) -> None:
    entries = listed(topic)
    lines = good("list", topic).splitlines()
    assert lines[0].split() == list(entries[0])
    assert len(lines) == len(entries) + 1
    for entry, line in zip(entries, lines[1:], strict=True):
        assert entry["text"]
        assert all(text in line for text in entry.values())


def test_one_of_a_list() -> None:
    assert listed("errors", "x001") == [
        {"name": "X001", "title": CODES["X001"].title, "text": CODES["X001"].explanation}
    ]
    assert good("list", "functions", "len").splitlines()[:3] == ["name: len", "arguments: 1", "volatility: immutable"]
    assert listed("strategies", "no", "cycle")[0]["decides"] == "repeats"


def test_functions_and_worlds_of_the_user(folder: Path) -> None:
    (entry, *_) = listed("functions", "double", "--functions", "functions.py")
    assert entry["arguments"] == "x"
    assert entry["volatility"] == "immutable"
    assert entry["text"].startswith("Twice the value; immutable: ")
    pytest.importorskip("pybullet")
    told = call("list", "worlds", "--world", "space=ss2sql.scenes:chaos(bodies=2)").stdout
    assert "FROM space.links" in told
    assert listed("representations", "--world", "space=ss2sql.scenes:chaos(bodies=2)")[-1]["name"] not in ALL


# --- completion ----------------------------------------------------------------------------------------


def completed(*words: str) -> list[str]:
    *before, incomplete = words
    return [item.value for item in ShellComplete(main, {}, "ss2sql", "_").get_completions(before, incomplete)]


def test_what_is_completed() -> None:
    assert completed("") == list(COMMANDS)
    assert completed("co") == ["completion"]
    assert "--help" in completed("--")
    assert completed("run", "--eng") == ["--engine"]
    assert completed("run", "--engine", "d") == ["database", "duckdb"]
    assert completed("list", "err") == ["errors"]
    assert completed("list", "errors", "t") == ["T001", "T002", "T003", "T004"]
    assert completed("list", "functions", "sq") == ["sqrt"]
    assert completed("sql", "--dialect", "") == ["sqlite", "duckdb", "spark", "postgres"]
    assert completed("run", "-o", "t") == ["t"]  # the shell goes on with the names of files
    assert completed("completion", "") == list(SHELLS)


@pytest.mark.parametrize("shell", SHELLS)
def test_scripts_for_shells(shell: str) -> None:
    script = good("completion", shell)
    assert f"_SS2SQL_COMPLETE={shell}_complete" in script
    if shutil.which(shell):
        answer = subprocess.run([shell, "-n"], input=script, capture_output=True, text=True, timeout=60, check=False)
        assert (answer.returncode, answer.stderr) == (0, "")


def test_choices_are_those_of_the_package() -> None:
    """They are written down once more, so that completion need not import the package."""
    assert ENGINES_OF_OPTION == ENGINES
    assert KINDS_OF_OPTION == KINDS


# --- pictures ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "start"), [("p.png", b"\x89PNG"), ("p.svg", b"<?xml"), ("p.PDF", b"%PDF")])
def test_pictures(name: str, start: bytes) -> None:
    pytest.importorskip("matplotlib")
    answer = call("plot", "-e", "SELECT this, this ^ 2 FROM range(9);", "-o", name, "--kind", "line", "--title", "T")
    assert (answer.exit_code, answer.stdout, answer.stderr) == (0, "", f"written to {name}: 9 rows\n")
    assert Path(name).read_bytes().startswith(start)


def test_the_size_of_a_picture() -> None:
    pytest.importorskip("matplotlib")
    call("plot", "-e", "SELECT this FROM range(9);", "-o", "p.png", "--size", "4x3")
    data = Path("p.png").read_bytes()
    wide, high = (int.from_bytes(data[place : place + 4]) for place in (16, 20))
    assert wide * 3 == high * 4


def test_a_search_without_end_is_drawn_as_far_as_it_came() -> None:
    pytest.importorskip("matplotlib")
    answer = call("plot", "-e", f"{ENDLESS};", "--timeout", "0.2", "-o", "p.png", "--kind", "lengths", "--most", "3")
    assert answer.exit_code == 124
    assert Path("p.png").exists()


def test_what_cannot_be_drawn() -> None:
    pytest.importorskip("matplotlib")
    assert "error[V001]" in bad(1, "plot", "-e", "SELECT 'a', 'b' FROM [1];", "-o", "p.png")
    assert not Path("p.png").exists()

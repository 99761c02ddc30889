"""`ss2sql explain`: with and without a run, as text and as JSON."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result

from ss2sql.cli import main

COUNT = "SELECT n FROM [1] START WITH n = 1 CONNECT BY n = n + 1 {};"


@pytest.fixture(autouse=True)
def _folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "functions.py").write_text("def double(x):\n    print('called')\n    return 2 * x\n")


def call(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["explain", *arguments])


def facts(*arguments: str) -> Any:
    found = call(*arguments, "--format", "json")
    assert found.exit_code == 0
    return json.loads(found.stdout)


def test_analyze_alone_runs_and_tells_what_was_done() -> None:
    found = call("-e", "SELECT double(this) FROM [1, 2];", "--functions", "functions.py")
    assert found.exit_code == 0
    assert "called" not in found.stderr
    assert "double is volatile: it calls print" in found.stdout
    assert "the run:" not in found.stdout
    assert "warning: nothing bounds this search" in call("-e", COUNT.format("")).stdout
    found = call("-e", "SELECT double(this) FROM [1, 2];", "--functions", "functions.py", "--analyze")
    assert (found.exit_code, found.stderr.count("called")) == (0, 2)
    assert "called\n" not in found.stdout
    assert "(2 calls)" in found.stdout
    assert "the run: complete, 2 rows, " in found.stdout


def test_a_run_that_is_broken_off_is_explained_nevertheless() -> None:
    call("-e", COUNT.format("LIMIT 1"), "--analyze")  # all is loaded then, and the next run begins in time
    found = call("-e", COUNT.format(""), "--analyze", "--timeout", "0.5")
    assert found.exit_code == 124
    assert "the run: timeout, " in found.stdout
    assert "T001" in found.stderr


def test_names_without_a_value_are_told() -> None:
    script = ("-e", "SELECT this FROM [1] WHERE this > least AND this < most;")
    assert call(*script).stdout.startswith("needs a value for least, most\n")
    assert call(*script, "-p", "least", "1").stdout.startswith("needs a value for most\n")
    assert facts(*script, "-p", "least", "1", "-p", "most", "2")["missing"] == []
